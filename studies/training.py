"""Measure the environment's cost in training with Stable-Baselines3.

    python -m studies.training
    python -m studies.training --repeats 1 --json

It measures, in one process on one thread with all cases in turn:

- how much faster the adapter for Stable-Baselines3 steps than single environments in its ``DummyVecEnv``;
- how much faster PPO trains with it, at settings made for many environments;
- what share of PPO's time the environment takes, at the settings of ``train.ppo``.

The exit status is 1 if one of these misses its criterion.
"""

import argparse
import statistics
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest.mock import patch

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv
from tqdm import tqdm

from studies.throughput import MAIN
from studies.timing import judge
from train import ppo
from train.run import Run
from train.training import new_model
from turning_env import IDS, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.console import described, exits

NUM_ENVS = 1024
MANY_ENVS: dict[str, Any] = {"n_steps": 16, "batch_size": 4096, "n_epochs": 2, "device": "cpu", "seed": 0}
"""PPO for many environments: long batches, few epochs."""

MIN_STEPPING_RATIO = 20.0
MIN_TRAINING_RATIO = 2.0
MAX_SHARE = 0.10


def seconds(work: Callable[[], object]) -> float:
    """Return the wall time of a call [s]."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def stepping(env: VecEnv, steps: int) -> float:
    """Return the time per step of all environments [s], with actions drawn beforehand."""
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (8, env.num_envs, 2)).astype(np.float32)
    return seconds(lambda: [env.step(actions[number % len(actions)]) for number in range(steps)]) / steps


def learning(model: PPO) -> float:
    """Return the time [s] of one rollout and the updates after it."""
    return seconds(lambda: model.learn(model.n_envs * model.n_steps, reset_num_timesteps=False))


def share_in_environment(model: PPO) -> float:
    """Return the share of PPO's time that is spent in the environment's own ``step`` [-]."""
    env: Any = model.get_env()
    step, inside = env.vector_env.step, 0.0

    def timed(actions: Any) -> Any:
        nonlocal inside
        start = time.perf_counter()
        result = step(actions)
        inside += time.perf_counter() - start
        return result

    with patch.object(env.vector_env, "step", timed):
        total = learning(model)
    return inside / total


def ppo_run(folder: Path) -> Run:
    """Return the run that ``train.ppo`` would train."""
    return Run.plan("ppo", MAIN, Scenario.load(IDS[MAIN]), 0, folder, "", {})


def measure(repeats: int, num_envs: int, folder: Path) -> dict[str, list[float]]:
    """Return (ratio of stepping, ratio of training, share) of every turn."""
    torch.set_num_threads(1)
    makers = (
        lambda: DummyVecEnv([lambda: gymnasium.make(MAIN)] * num_envs),
        lambda: RoughTurningVecEnv(Scenario.load(IDS[MAIN]), num_envs),
    )
    single, batch = (make() for make in makers)
    for env in (single, batch):
        env.seed(0)
        env.reset()
        stepping(env, 2)  # not timed: what the first steps load
    slow, fast = (PPO("MlpPolicy", make(), **MANY_ENVS) for make in makers)
    usual = new_model(ppo_run(folder), ppo.ALGORITHM)
    measured: dict[str, list[float]] = {"stepping": [], "training": [], "share": []}
    for _ in tqdm(range(repeats), unit="turn", dynamic_ncols=True, disable=None):
        measured["stepping"].append(stepping(single, 2) / stepping(batch, 50))
        measured["training"].append(learning(slow) / learning(fast))
        measured["share"].append(share_in_environment(usual))
    return measured


@exits(checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.training", **described(__doc__))
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
    return judge(verdicts, {"medians": medians} if options.json else None)


if __name__ == "__main__":
    sys.exit(main())
