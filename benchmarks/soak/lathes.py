"""Months of cutting in one process: whether memory grows, and whether lanes drift from the single lathe of their seed."""

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from turning_env import RoughTurningEnv, RoughTurningVectorEnv

ENV_ID = "RoughTurning-v0"
_CALLS = 512
"""Steps between looks at the memory."""


@dataclass(frozen=True)
class Endured:
    """What long use came to."""

    steps: int
    """Control steps, or resets."""
    episodes: int
    """That began."""
    growth: int
    """Of the memory that the process has in use, from when a tenth was done to the end [bytes]."""
    seconds: float
    differing: int
    """Lanes that came to something else than the single lathe of their seed."""


def resident() -> int:
    """Memory that this process has in use [bytes]."""
    import psutil  # type: ignore[import-untyped]

    used: int = psutil.Process().memory_info().rss
    return used


def steps(count: int, num_envs: int = 1024, checked: int = 1) -> Endured:
    """Step lanes for so many control steps in all, with random actions.

    The first ``checked`` lanes are accompanied by single environments of their seeds with the same actions from the beginning to
    the end, which must come to the same observations and ends, bit for bit, at every step.

    Args:
        count: control steps in all; whole steps of all lanes are made.
        lanes: side by side.
        checked: lanes that are compared.
    """
    env = RoughTurningVectorEnv(num_envs)
    env.reset(seed=0)
    singles = [RoughTurningEnv() for _ in range(checked)]
    due = [False] * checked
    seen = [single.reset(seed=lane)[0] for lane, single in enumerate(singles)]
    random = np.random.default_rng(0)
    apart: set[int] = set()
    episodes = num_envs
    steps = max(1, count // num_envs)
    actions = np.zeros((num_envs, 2), np.float32)

    def step() -> None:
        nonlocal episodes
        actions[:] = random.uniform(-1.0, 1.0, actions.shape)
        observations, _, terminated, truncated, _ = env.step(actions)
        episodes += int(np.count_nonzero(terminated | truncated))
        for lane, single in enumerate(singles):
            if due[lane]:  # as a lane's next step, a reset
                seen[lane], due[lane] = single.reset()[0], False
            else:
                seen[lane], _, worn, over, _ = single.step(actions[lane])
                due[lane] = worn or over
            if seen[lane].tobytes() != observations[lane].tobytes() or due[lane] != (terminated | truncated)[lane]:
                apart.add(lane)

    growth, seconds = _repeated(step, steps, f"{num_envs} lanes", num_envs)
    env.close()
    return Endured(steps * num_envs, episodes, growth, seconds, len(apart))


def resets(count: int) -> Endured:
    """Reset one environment so often, half of the times with a seed, and step it once each time.

    At the end it must be where a new one is after the same seed.
    """
    env = RoughTurningEnv()
    env.reset(seed=0)
    number = 0

    def step() -> None:
        nonlocal number
        number += 1
        env.reset(seed=number if number % 2 else None)
        env.step(np.zeros(2, np.float32))

    growth, seconds = _repeated(step, count, "resets", 1)
    fresh = RoughTurningEnv()
    same = env.reset(seed=7)[0].tobytes() == fresh.reset(seed=7)[0].tobytes()
    return Endured(count, count + 1, growth, seconds, 0 if same else 1)


def _repeated(step: Callable[[], None], count: int, what: str, size: int) -> tuple[int, float]:
    """(Growth of memory [bytes] after the first tenth, time taken [s]) of so many calls."""
    start, settled = time.perf_counter(), 0
    with tqdm(total=count * size, desc=what, unit_scale=True, disable=None) as bar:
        for number in range(count):
            if number == count // 10:
                settled = resident()
            step()
            if number % _CALLS == 0:
                bar.update(number * size - bar.n)
    return resident() - settled, time.perf_counter() - start
