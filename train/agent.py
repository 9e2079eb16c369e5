"""Trained agents as policies."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stable_baselines3 import PPO

from baselines.policy import Actions, Observations, PolicyFactory
from train.run import Run
from turning_env import Scenario

ALGORITHMS = {"ppo": PPO}


class MemorylessAgent:
    """A policy that is a function of the present observation: a trained model's most likely action."""

    def __init__(self, model: Any) -> None:
        self._model = model

    def reset(self, lanes: NDArray[np.bool_]) -> None:
        """Nothing to forget."""

    def act(self, observations: Observations) -> Actions:
        """Actions, shape (lanes, 2), for observations, shape (lanes, 11)."""
        actions, _ = self._model.predict(observations, deterministic=True)
        return np.asarray(actions, np.float32)


@dataclass(frozen=True)
class TrainedAgent:
    """A finished training, ready to play."""

    name: str
    seed: int
    env_id: str
    scenario: Scenario
    command: str
    parameters: dict[str, Any]
    trained_intervals: int
    make: PolicyFactory


def load(folder: Path) -> TrainedAgent:
    """Load the finished agent of one of your own runs. It is a pickle, which can run code: never load a stranger's.

    Raises:
        ValueError: the folder holds no finished training.
    """
    run = Run.read(folder)
    if not run.policy.exists():
        raise ValueError(f"the training in {folder} is not finished: run its command again: {run.command}")
    model = ALGORITHMS[run.algorithm].load(run.policy, device="cpu")
    return TrainedAgent(
        name=run.algorithm,
        seed=run.seed,
        env_id=run.env_id,
        scenario=run.scenario,
        command=run.command,
        parameters=run.parameters,
        trained_intervals=run.parameters["intervals"],
        make=lambda lanes: MemorylessAgent(model),
    )
