"""Trainings of every algorithm that take about a second."""

from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from train.run import Run
from train.training import Algorithm, algorithm_of
from turning_env import Family, Scenario

SCENARIO = Scenario.model_validate({"name": "short", "tool": {"wear_criterion": 0.1}})

_ON_POLICY = {
    "total_timesteps": 1024,
    "num_envs": 8,
    "n_steps": 32,
    "batch_size": 128,
    "n_epochs": 2,
}
# So few are remembered that the oldest are overwritten while actions are still random.
_OFF_POLICY = {
    "total_timesteps": 1024,
    "num_envs": 8,
    "learning_starts": 550,
    "buffer_size": 400,
    "batch_size": 32,
    "gradient_steps": 1,
}
_TEACHER = {
    "total_timesteps": 1024,
    "num_envs": 8,
    "n_steps": 8,
    "batch_envs": 4,
    "cells": 8,
}
_STRATEGY = {
    "total_timesteps": 1024,
    "num_envs": 8,
    "population_size": 4,
    "episode_steps": 32,
    "sigma": 0.05,
}
PARAMETERS: dict[str, dict[str, Any]] = {
    "ppo": _ON_POLICY,
    "sac": _OFF_POLICY,
    "tqc": _OFF_POLICY | {"n_quantiles": 5},
    "recurrent_ppo": _ON_POLICY | {"lstm_hidden_size": 4},
    "lagrangian_ppo": _ON_POLICY,
    "analytic_gradient": _TEACHER,
    "linear_cma_es": _STRATEGY,
}
"""Small trainings by algorithm; ``guided_ppo``, for families alone, has tests of its own."""

ALGORITHMS = {name: algorithm_of(name) for name in PARAMETERS}


class Interruption(BaseCallback):
    """Interrupts a training after some steps."""

    def __init__(self, steps: int) -> None:
        super().__init__()
        self._steps = steps

    def _on_step(self) -> bool:
        if self.num_timesteps > self._steps:
            raise KeyboardInterrupt
        return True


def small_run(
    algorithm: Algorithm,
    runs: Path,
    scenario: Scenario | Family = SCENARIO,
    env_id: str = "RoughTurning-v0",
    **changes: Any,
) -> Run:
    return Run.plan(
        algorithm=algorithm.name,
        env_id=env_id,
        scenario=scenario,
        seed=3,
        runs=runs,
        command="a command --runs here",
        given=PARAMETERS[algorithm.name] | changes,
    )
