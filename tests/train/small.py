"""Trainings of every algorithm that take about a second."""

from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from train.run import ALGORITHMS as NAMES
from train.run import Run
from train.training import Algorithm, algorithm_of
from turning_env import Family, Scenario

SCENARIO = Scenario.model_validate({"name": "short", "tool": {"wear_criterion": 0.1}})

_SMALL: dict[str, Any] = {
    "total_timesteps": 1024,
    "num_envs": 8,
    "n_steps": 32,
    "batch_size": 128,
    "n_epochs": 2,
    # So few are remembered that the oldest are overwritten while actions are still random.
    "learning_starts": 550,
    "buffer_size": 400,
    "gradient_steps": 1,
    "n_quantiles": 5,
    "lstm_hidden_size": 4,
    "batch_envs": 4,
    "cells": 8,
    "population_size": 4,
    "episode_steps": 32,
    "sigma": 0.05,
}
"""Values for small trainings; an algorithm takes those that it has."""


def _algorithms() -> dict[str, Algorithm]:
    """Return the algorithms that learn on one scenario; the others have tests of their own."""
    algorithms = {}
    for name in NAMES:
        algorithm = algorithm_of(name)
        if algorithm.single_scenarios:
            algorithms[name] = algorithm
    return algorithms


def _small(algorithm: Algorithm) -> dict[str, Any]:
    """Return the hyperparameters of an algorithm that have a small value."""
    return {name: value for name, value in _SMALL.items() if name in algorithm.defaults}


ALGORITHMS = _algorithms()
PARAMETERS = {name: _small(algorithm) for name, algorithm in ALGORITHMS.items()}
"""Hyperparameters of small trainings by algorithm."""


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
        given=_small(algorithm) | changes,
    )
