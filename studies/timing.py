"""Shared parts of the speed benchmarks: cases that are timed in turns, and verdicts."""

import time
from collections.abc import Callable, Sequence
from itertools import cycle
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from tqdm import tqdm

from turning_env.console import DONE, FAILED, print_json

BATCHES = 16
"""Number of batches of random actions, drawn beforehand and used in turn."""


class Case(NamedTuple):
    """Something to time: ``step`` makes ``steps`` environment steps per call."""

    name: str
    num_envs: int
    steps: int
    step: Callable[[], object]


class Timing(NamedTuple):
    """Rates of one turn of a case."""

    rate: float
    """Environment steps per second of wall time."""
    cpu_rate: float
    """The same per second of CPU time, of all threads."""


def one(name: str, env: gymnasium.Env[Any, Any]) -> Case:
    """Return the case of a single environment, reset whenever its episode ends."""
    env.reset(seed=0)
    action = actions_of(env.action_space)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(action())
        if terminated or truncated:
            env.reset()

    return Case(name, 1, 1, step)


def many(name: str, env: Any, num_envs: int, space: gymnasium.Space[Any], batches: int = BATCHES) -> Case:
    """Return the case of a vector environment, which starts its next episodes itself."""
    action = actions_of(space, num_envs, batches=batches)
    return Case(name, num_envs, num_envs, lambda: env.step(action()))


def actions_of(space: gymnasium.Space[Any], *num_envs: int, batches: int = BATCHES) -> Callable[[], Any]:
    r"""Return a function that returns random actions of a space, shape (\*num_envs, \*space.shape)."""
    rng = np.random.default_rng(0)
    if isinstance(space, gymnasium.spaces.Discrete):
        drawn: Any = rng.integers(0, space.n, (batches, *num_envs))
    else:
        assert isinstance(space, gymnasium.spaces.Box)
        drawn = rng.uniform(space.low, space.high, (batches, *num_envs, *space.shape)).astype(space.dtype)
    return cycle(drawn).__next__


def measure(cases: Sequence[Case], repeats: int, seconds: float) -> list[list[Timing]]:
    """Time every case (first index) in every turn (second), each for about ``seconds`` of wall time."""
    counts = [_calls_within(case, seconds) for case in cases]
    timings: list[list[Timing]] = [[] for _ in cases]
    with tqdm(total=repeats * len(cases), unit="case", dynamic_ncols=True, disable=None) as bar:
        for _ in range(repeats):
            for case, count, turns in zip(cases, counts, timings, strict=True):
                bar.set_description(f"{case.name}, {case.num_envs}")
                turns.append(timed(case, count))
                bar.update()
    return timings


def _calls_within(case: Case, seconds: float) -> int:
    case.step()  # compiles, or loads what was compiled
    count = 1
    # The quickest of three: a single pause would look like slow calls, and turns of a few calls would time cold caches.
    while (taken := count * case.steps / max(timed(case, count).rate for _ in range(3))) < 0.2 * seconds:
        count *= 2
    return max(1, round(count * seconds / taken))


def timed(case: Case, count: int) -> Timing:
    """Time ``count`` calls of a case."""
    step = case.step
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(count):
        step()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    steps = count * case.steps
    return Timing(steps / wall, steps / max(cpu, 1e-9))


def judge(verdicts: Sequence[tuple[str, bool]], json: dict[str, Any] | None) -> int:
    """Print which criteria are met, as JSON together with ``json`` if it is given; return the exit status."""
    if json is not None:
        print_json(json | {"verdicts": [{"text": text, "met": met} for text, met in verdicts]})
    else:
        for text, met in verdicts:
            print(f"{'met   ' if met else 'FAILED'}  {text}")
    return DONE if all(met for _, met in verdicts) else FAILED
