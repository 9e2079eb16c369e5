"""Steps per second beside Gymnasium's own Pendulum: ``python -m benchmarks.throughput``.

One process, one thread. All cases take turns, so that whatever else the machine does hits all alike, and ratios are taken
within a turn. Actions are uniformly random and drawn beforehand; starting episodes anew counts as part of stepping.

The exit status is 1 if a criterion fails: 1024 lanes make at least 20 times Pendulum's steps per second, and one step of
the unwrapped single environment takes at most 1.5 times Pendulum's.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from itertools import cycle
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from turning_env import IDS, RoughTurningVectorEnv

PEER = "Pendulum-v1"
MAIN = "RoughTurning-v0"
LEAST_VECTOR_RATIO = 20.0
MOST_TIME_RATIO = 1.5
_ACTION_BATCHES = 64


class Case(NamedTuple):
    """Something to time: ``step`` makes ``steps`` environment steps per call."""

    name: str
    steps: int
    step: Callable[[], object]


def single(env_id: str) -> Case:
    """One environment without wrappers, reset whenever its episode ends."""
    env: gymnasium.Env[Any, Any] = gymnasium.make(env_id).unwrapped
    env.reset(seed=0)
    next_action = cycle(_random_actions(env.action_space, 1)[:, 0]).__next__

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(next_action())
        if terminated or truncated:
            env.reset()

    return Case(f"{env_id}, single", 1, step)


def vector(env_id: str, lanes: int, batches: int = _ACTION_BATCHES, threads: int = 1) -> Case:
    """Many lanes, which start their next episodes by themselves; so many batches of actions take turns."""
    env = RoughTurningVectorEnv(lanes, IDS[env_id], threads=threads)
    env.reset(seed=0)
    next_actions = cycle(_random_actions(env.single_action_space, lanes, batches)).__next__
    return Case(f"{env_id}, {lanes} lanes", lanes, lambda: env.step(next_actions()))


def _random_actions(space: gymnasium.Space[Any], lanes: int, batches: int = _ACTION_BATCHES) -> Any:
    assert isinstance(space, gymnasium.spaces.Box)
    shape = (batches, lanes, *space.shape)
    return np.random.default_rng(0).uniform(space.low, space.high, shape).astype(space.dtype)


def rates(cases: Sequence[Case], repeats: int, seconds: float) -> list[list[float]]:
    """Steps per second of every case (first index) in every turn (second), each timed for about ``seconds``."""
    calls = [_calls_within(case, seconds) for case in cases]
    measured: list[list[float]] = [[] for _ in cases]
    for _ in range(repeats):
        for case, count, results in zip(cases, calls, measured, strict=True):
            results.append(count * case.steps / _time(case, count))
    return measured


def _calls_within(case: Case, seconds: float) -> int:
    case.step()  # compiles, or loads what was compiled
    count = 1
    while (taken := _time(case, count)) < 0.2 * seconds:
        count *= 2
    return max(1, round(count * seconds / taken))


def _time(case: Case, count: int) -> float:
    step = case.step
    start = time.perf_counter()
    for _ in range(count):
        step()
    return time.perf_counter() - start


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.throughput", description=__doc__.split("\n", 1)[0])
    parser.add_argument("--repeats", type=int, default=9, help="turns that every case gets (default: %(default)s)")
    parser.add_argument("--lanes", type=int, default=1024, help="lanes of the vector environments (default: %(default)s)")
    parser.add_argument("--seconds", type=float, default=0.25, help="length of one turn in s (default: %(default)s)")
    options = parser.parse_args(arguments)
    if options.repeats < 1 or options.lanes < 1 or not options.seconds > 0:
        parser.error("--repeats and --lanes must be at least 1, and --seconds above 0")

    cases = [single(PEER), single(MAIN), *(vector(env_id, options.lanes) for env_id in IDS)]
    measured = rates(cases, options.repeats, options.seconds)
    ratios = [[rate / peer for rate, peer in zip(row, measured[0], strict=True)] for row in measured]

    width = max(len(case.name) for case in cases)
    print(f"{'medians of ' + str(options.repeats) + ' turns (range)':<{width}}  {'steps per second':>33}  {'x ' + PEER:>25}")
    for case, row, ratio in zip(cases, measured, ratios, strict=True):
        speed = f"{statistics.median(row):,.0f} ({min(row):,.0f} to {max(row):,.0f})"
        print(f"{case.name:<{width}}  {speed:>33}  {statistics.median(ratio):>9.2f} ({min(ratio):.2f} to {max(ratio):.2f})")

    time_ratio = statistics.median(1.0 / ratio for ratio in ratios[1])
    vector_ratio = statistics.median(ratios[2 + list(IDS).index(MAIN)])
    verdicts = [
        (
            f"{options.lanes} lanes of {MAIN}: {vector_ratio:.2f} times {PEER}'s steps per second, at least {LEAST_VECTOR_RATIO}",
            vector_ratio >= LEAST_VECTOR_RATIO,
        ),
        (
            f"one step of {MAIN}: {time_ratio:.2f} times {PEER}'s time, at most {MOST_TIME_RATIO}",
            time_ratio <= MOST_TIME_RATIO,
        ),
    ]
    for text, met in verdicts:
        print(f"{'met   ' if met else 'FAILED'}  {text}")
    return 0 if all(met for _, met in verdicts) else 1


if __name__ == "__main__":
    sys.exit(main())
