"""Cases that are timed in turns: what the speed benchmarks have in common."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from tqdm import tqdm

BATCHES = 16
"""Batches of random actions that are drawn beforehand, and taken in turn."""


class Case(NamedTuple):
    """Something to time: ``step`` makes ``steps`` environment steps per call."""

    name: str
    num_envs: int
    steps: int
    step: Callable[[], object]


@dataclass(frozen=True)
class Timing:
    """What one turn of a case took."""

    rate: float
    """Environment steps per second of wall time."""
    cpu_rate: float
    """The same per second of CPU time, of all threads."""


def one(name: str, env: gymnasium.Env[Any, Any]) -> Case:
    """A single environment, reset whenever its episode ends."""
    env.reset(seed=0)
    action = actions_of(env.action_space)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(action())
        if terminated or truncated:
            env.reset()

    return Case(name, 1, 1, step)


def many(name: str, env: Any, num_envs: int, space: gymnasium.Space[Any], batches: int = BATCHES) -> Case:
    """Environments side by side, which start their next episodes by themselves."""
    action = actions_of(space, num_envs, batches=batches)
    return Case(name, num_envs, num_envs, lambda: env.step(action()))


def actions_of(space: gymnasium.Space[Any], *num_envs: int, batches: int = BATCHES) -> Callable[[], Any]:
    """Gives random actions of a space in turn, each with these dimensions before the space's own."""
    rng = np.random.default_rng(0)
    if isinstance(space, gymnasium.spaces.Discrete):
        drawn: Any = rng.integers(0, space.n, (batches, *num_envs))
    else:
        assert isinstance(space, gymnasium.spaces.Box)
        drawn = rng.uniform(space.low, space.high, (batches, *num_envs, *space.shape)).astype(space.dtype)
    return cycle(drawn).__next__


def measure(cases: Sequence[Case], repeats: int, seconds: float) -> list[list[Timing]]:
    """Timings of every case (first index) in every turn (second), each of about ``seconds`` of wall time."""
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
    # The quickest of three: a single pause would pass for many calls, and turns of a few calls would time cold caches.
    while (taken := count * case.steps / max(timed(case, count).rate for _ in range(3))) < 0.2 * seconds:
        count *= 2
    return max(1, round(count * seconds / taken))


def timed(case: Case, count: int) -> Timing:
    """So many calls of a case."""
    step = case.step
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(count):
        step()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    steps = count * case.steps
    return Timing(steps / wall, steps / max(cpu, 1e-9))
