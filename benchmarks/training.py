"""What the environment costs in training with Stable-Baselines3.

    python -m benchmarks.training
    python -m benchmarks.training --repeats 1 --json

Three questions, in one process on one thread, all cases in turn:

- how much faster many lathes step behind ``train.vec_env`` than single environments in Stable-Baselines3's ``DummyVecEnv``;
- how much faster all of PPO is so, at settings made for many environments;
- what share of PPO's time, at the settings of ``train.ppo``, is spent in the environment.

The exit status is 1 if an answer is not as good as it should be.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv
from tqdm import tqdm

from benchmarks.throughput import MAIN
from train import ppo
from train.run import Run
from train.training import new_model
from train.vec_env import RoughTurningVecEnv
from turning_env import IDS, Scenario
from turning_env.console import DONE, FAILED, described, exits, print_json

NUM_ENVS = 1024
MANY_ENVS: dict[str, Any] = {"n_steps": 16, "batch_size": 4096, "n_epochs": 2, "device": "cpu", "seed": 0}
"""PPO for many environments: long batches, few epochs."""

MIN_STEPPING_RATIO = 20.0
MIN_TRAINING_RATIO = 2.0
MAX_SHARE = 0.10


def seconds(work: Callable[[], object]) -> float:
    """How long it takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def singles(num_envs: int) -> VecEnv:
    """Single environments, one after the other."""
    return DummyVecEnv([lambda: gymnasium.make(MAIN)] * num_envs)


def together(num_envs: int) -> VecEnv:
    """Environments side by side."""
    return RoughTurningVecEnv(Scenario.load(IDS[MAIN]), num_envs)


def stepping(env: VecEnv, steps: int) -> float:
    """Time per step of all environments [s], with actions drawn beforehand."""
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (8, env.num_envs, 2)).astype(np.float32)

    def work() -> None:
        for number in range(steps):
            env.step(actions[number % len(actions)])

    return seconds(work) / steps


def learning(model: PPO, rollouts: int) -> float:
    """Time per step [s] of PPO, with all that it does."""
    intervals = rollouts * model.n_envs * model.n_steps
    return seconds(lambda: model.learn(intervals, reset_num_timesteps=False)) / intervals


class Stopwatch(AbstractContextManager["Stopwatch"]):
    """Time spent in the environment's own ``step`` [s]."""

    def __init__(self, env: RoughTurningVecEnv) -> None:
        self._lathes: Any = env.vector_env
        self._step = self._lathes.step
        self.seconds = 0.0

    def __enter__(self) -> "Stopwatch":
        self._lathes.step = self._timed
        return self

    def __exit__(self, *error: object) -> None:
        self._lathes.step = self._step

    def _timed(self, actions: Any) -> Any:
        start = time.perf_counter()
        result = self._step(actions)
        self.seconds += time.perf_counter() - start
        return result


def share_in_environment(model: PPO, rollouts: int) -> float:
    """Share of PPO's time that is spent in the environment's ``step`` [-]."""
    env = model.get_env()
    assert isinstance(env, RoughTurningVecEnv)
    with Stopwatch(env) as inside:
        total = seconds(lambda: model.learn(rollouts * model.n_envs * model.n_steps, reset_num_timesteps=False))
    return inside.seconds / total


def ppo_run(folder: Path) -> Run:
    """What ``train.ppo`` would train."""
    return Run.plan("ppo", MAIN, Scenario.load(IDS[MAIN]), 0, folder, "", {})


def measure(repeats: int, num_envs: int, folder: Path) -> dict[str, list[float]]:
    """(Ratio of stepping, ratio of training, share) of every turn."""
    torch.set_num_threads(1)
    separate, joint = singles(num_envs), together(num_envs)
    for env in (separate, joint):
        env.seed(0)
        env.reset()
        stepping(env, 2)  # not timed: what the first steps load
    many = [PPO("MlpPolicy", make(num_envs), **MANY_ENVS) for make in (singles, together)]
    usual = new_model(ppo_run(folder), ppo.ALGORITHM)
    measured: dict[str, list[float]] = {"stepping": [], "training": [], "share": []}
    for _ in tqdm(range(repeats), unit="turn", dynamic_ncols=True, disable=None):
        measured["stepping"].append(stepping(separate, 2) / stepping(joint, 50))
        slow, fast = (learning(model, 1) for model in many)
        measured["training"].append(slow / fast)
        measured["share"].append(share_in_environment(usual, 1))
    return measured


@exits(checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.training", **described(__doc__))
    parser.add_argument("--repeats", type=int, default=5, help="turns that every case gets (default: %(default)s)")
    parser.add_argument("--num-envs", type=int, default=NUM_ENVS, help="environments side by side (default: %(default)s)")
    parser.add_argument("--json", action="store_true", help="print the medians as JSON")
    options = parser.parse_args(arguments)
    if options.repeats < 1 or options.num_envs < 1:
        parser.error("--repeats and --num-envs must be at least 1")
    with TemporaryDirectory() as folder:
        measured = measure(options.repeats, options.num_envs, Path(folder))
    medians = {name: statistics.median(values) for name, values in measured.items()}
    spread = {name: f"({min(values):.3g} to {max(values):.3g})" for name, values in measured.items()}
    batch = MANY_ENVS["batch_size"]
    verdicts = [
        (
            f"{options.num_envs} environments step {medians['stepping']:.3g} times {spread['stepping']} as fast as single ones "
            f"in DummyVecEnv, at least {MIN_STEPPING_RATIO:g}",
            medians["stepping"] >= MIN_STEPPING_RATIO,
        ),
        (
            f"PPO with them, batch {batch}, is {medians['training']:.3g} times {spread['training']} as fast, at least "
            f"{MIN_TRAINING_RATIO:g}",
            medians["training"] >= MIN_TRAINING_RATIO,
        ),
        (
            f"PPO as in train.ppo spends {100.0 * medians['share']:.3g} % of its time in the environment (shares "
            f"{spread['share']}), at most {100.0 * MAX_SHARE:g} %",
            medians["share"] <= MAX_SHARE,
        ),
    ]
    if options.json:
        print_json({"medians": medians, "verdicts": [{"text": text, "met": met} for text, met in verdicts]})
    else:
        for text, met in verdicts:
            print(f"{'met   ' if met else 'FAILED'}  {text}")
    return DONE if all(met for _, met in verdicts) else FAILED


if __name__ == "__main__":
    sys.exit(main())
