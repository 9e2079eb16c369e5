"""Things to time in turns."""

import sys
import time
from collections.abc import Callable, Sequence
from itertools import cycle
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from tqdm import tqdm

MAIN = "RoughTurning-v0"
NUM_ENVS = 1024
"""Number of environments of a batch, unless stated."""
_ACTIONS = 16  # batches of random actions, drawn beforehand and used in turn


class Case(NamedTuple):
    """Something to time: ``step`` makes ``steps`` environment steps per call."""

    name: str
    num_envs: int
    steps: int
    step: Callable[[], object]


class Timing(NamedTuple):
    """Environment steps of one turn per second of wall time, and per second of CPU time of all threads."""

    rate: float
    cpu_rate: float


def one(name: str, env: gymnasium.Env[Any, Any]) -> Case:
    """Return the case of a single environment, reset whenever its episode ends."""
    env.reset(seed=0)
    action = _actions_of(env.action_space)

    def step() -> None:
        _, _, terminated, truncated, _ = env.step(action())
        if terminated or truncated:
            env.reset()

    return Case(name, 1, 1, step)


def many(name: str, env: Any, num_envs: int, space: gymnasium.Space[Any]) -> Case:
    """Return the case of a vector environment, which starts its next episodes itself."""
    action = _actions_of(space, num_envs)
    return Case(name, num_envs, num_envs, lambda: env.step(action()))


def single(env_id: str) -> Case:
    """Return the case of one environment without wrappers."""
    return one(f"{env_id}, unwrapped", gymnasium.make(env_id).unwrapped)


def vector(env_id: str, num_envs: int = NUM_ENVS) -> Case:
    """Return the case of a batch of one of the project's ids, on one thread."""
    env = gymnasium.make_vec(env_id, num_envs, vectorization_mode="vector_entry_point")
    env.reset(seed=0)
    return many(f"{env_id}, vector", env, num_envs, env.single_action_space)


def _actions_of(space: gymnasium.Space[Any], *num_envs: int) -> Callable[[], Any]:
    r"""Return a function that returns random actions of a space, shape (\*num_envs, \*space.shape)."""
    rng = np.random.default_rng(0)
    if isinstance(space, gymnasium.spaces.Discrete):
        drawn: Any = rng.integers(0, space.n, (_ACTIONS, *num_envs))
    else:
        assert isinstance(space, gymnasium.spaces.Box)
        drawn = rng.uniform(space.low, space.high, (_ACTIONS, *num_envs, *space.shape)).astype(space.dtype)
    return cycle(drawn).__next__


def measure(cases: Sequence[Case], repeats: int, seconds: float) -> list[list[Timing]]:
    """Time every case (first index) in every turn (second), each for about ``seconds`` of wall time."""
    counts = [calls_within(case, seconds) for case in cases]
    turns = [
        [timed(case, count) for case, count in zip(cases, counts, strict=True)]
        for _ in tqdm(range(repeats), unit="turn", dynamic_ncols=True, disable=None)
    ]
    return [list(timings) for timings in zip(*turns, strict=True)]


def calls_within(case: Case, seconds: float) -> int:
    """Return the number of calls of a case that take about ``seconds``."""
    case.step()  # compiles, or loads compiled code
    count = 1
    # The quickest of three: a single pause would look like slow calls, and turns of a few calls would time cold caches.
    while (taken := count * case.steps / max(timed(case, count).rate for _ in range(3))) < 0.2 * seconds:
        count *= 2
    return max(1, round(count * seconds / taken))


def timed(case: Case, count: int) -> Timing:
    """Time ``count`` calls of a case."""
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(count):
        case.step()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    return Timing(count * case.steps / wall, count * case.steps / max(cpu, 1e-9))


def main() -> None:
    """Print, for each line of input, the steps per CPU second of one turn of a single environment and of a batch.

    ``studies.throughput`` runs this in each of two checkouts; the argument is the length of a turn [s].
    """
    import turning_env  # noqa: F401 - registers the ids

    cases = (single(MAIN), vector(MAIN))
    counts = [calls_within(case, float(sys.argv[1])) for case in cases]
    for _ in sys.stdin:
        print(*(timed(case, count).cpu_rate for case, count in zip(cases, counts, strict=True)), flush=True)
