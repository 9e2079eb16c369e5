"""What is the same whichever algorithm learns: lathes of its own for every seed, progress, and going on after an interruption.

A run's folder holds ``run.json`` (what was asked for), ``checkpoint.zip`` (everything needed to go on exactly where it stopped),
``learning_curve.csv``, ``policy.zip`` (the finished agent) and TensorBoard logs. Only load such files from your own trainings:
they are pickles, which can run code.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from optuna.distributions import BaseDistribution
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from train.actor import Actor
from train.learning_curve import LearningCurve
from train.run import Run, warn_of_pickle
from train.vec_env import RoughTurningVecEnv
from turning_env import Scenario
from turning_env.files import exclusive_lock, replace_file
from turning_env.score.seeds import TUNING_START

SEED_STRIDE = 1_000_000
"""Lane i of training seed s plays the episodes of seed s * SEED_STRIDE + i, so that no two trainings share bars."""
SEEDS = TUNING_START // SEED_STRIDE
"""Training seeds are below this."""

ACTIVATIONS: dict[str, type[torch.nn.Module]] = {"relu": torch.nn.ReLU, "tanh": torch.nn.Tanh}


@dataclass(frozen=True)
class Algorithm:
    """A way to learn."""

    name: str
    """Of its Python file, of its hyperparameters' file, and in ``run.json``."""
    title: str
    """For people."""
    model: type[BaseAlgorithm]
    new_model: Callable[[Run, RoughTurningVecEnv], BaseAlgorithm]
    """Makes an untrained model for a run on given lathes."""
    actor: Callable[[Path], Actor]
    """Loads the finished agent from its file."""
    search: Mapping[str, BaseDistribution]
    """The hyperparameters that are tuned, and between what."""
    lathes: Callable[..., RoughTurningVecEnv] = RoughTurningVecEnv
    """Makes the lathes to learn from; takes scenario, number of lanes and reward scale."""
    kept: tuple[str, ...] = ()
    """What belongs into a checkpoint beside what Stable-Baselines3 saves of a model."""
    callbacks: Callable[[Run], list[BaseCallback]] = lambda run: []
    """What is done besides while a run is trained."""
    columns: Callable[[Any], dict[str, float]] = lambda model: {}
    """Its own columns of the learning curve."""
    plays: Callable[[Scenario], bool] = lambda scenario: True
    """Whether it can learn on a scenario."""
    log_interval: int = 5
    """Rollouts, or off-policy episodes, between entries in the TensorBoard logs."""


class Progress(BaseCallback):
    """Shows a progress bar, and keeps a checkpoint before each rollout that is due one."""

    def __init__(self, run: Run, algorithm: Algorithm, checkpoint_every: int) -> None:
        super().__init__()
        self.run, self.algorithm, self.checkpoint_every = run, algorithm, checkpoint_every
        self.bar: Any = None
        self.last_checkpoint = 0

    def _on_training_start(self) -> None:
        self.last_checkpoint = self.num_timesteps
        total = self.run.parameters["steps"]
        self.bar = tqdm(
            total=total, initial=self.num_timesteps, unit="interval", unit_scale=True, desc=self.run.label, disable=None
        )

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self.last_checkpoint >= self.checkpoint_every:
            self.last_checkpoint = self.num_timesteps
            save_checkpoint(self.model, self.run, self.algorithm)

    def _on_step(self) -> bool:
        # The last rollout is finished whole, a little beyond what was asked for.
        self.bar.update(min(self.num_timesteps, self.bar.total) - self.bar.n)
        return True

    def _on_rollout_end(self) -> None:
        if self.model.ep_info_buffer:
            mean_return = np.mean([episode["r"] for episode in self.model.ep_info_buffer])
            self.bar.set_postfix_str(f"return per episode {mean_return:.0f} s", refresh=False)

    def _on_training_end(self) -> None:
        self.bar.close()


def save_checkpoint(model: Any, run: Run, algorithm: Algorithm) -> None:
    """Write the model with the lathes and all generators' states beside it: all of it or nothing."""
    model.beside = {
        "lathes": model.get_env(),
        "torch_state": torch.get_rng_state(),
        "numpy_state": np.random.get_state(),  # noqa: NPY002 - SB3 shuffles with it
        # Loading seeds the action space anew, from which off-policy algorithms draw their first actions.
        "attributes": {name: getattr(model, name) for name in ("action_space", *algorithm.kept)},
    }
    replace_file(run.checkpoint, model.save)


def load_checkpoint(run: Run, algorithm: Algorithm) -> Any:
    """The model of the last checkpoint, ready to go on as if it had never stopped.

    Raises:
        ValueError: it has been damaged since it was written.
    """
    warn_of_pickle(run.checkpoint)
    try:
        model: Any = algorithm.model.load(run.checkpoint, device="cpu")
    except Exception as error:  # there is nothing that garbled bytes cannot lead to
        raise ValueError(f"{run.checkpoint} cannot be read: {error}; delete it to begin the training anew") from error
    beside = model.beside
    model.set_env(beside["lathes"], force_reset=False)
    for name, value in beside["attributes"].items():
        setattr(model, name, value)
    torch.set_rng_state(beside["torch_state"])
    np.random.set_state(beside["numpy_state"])  # noqa: NPY002
    return model


def new_model(run: Run, algorithm: Algorithm) -> Any:
    """An untrained model on freshly seeded lathes."""
    lathes = algorithm.lathes(run.scenario, run.parameters["num_envs"], run.parameters["reward_scale"])
    model = algorithm.new_model(run, lathes)
    lathes.seed(run.seed * SEED_STRIDE)
    return model


def train(run: Run, algorithm: Algorithm, checkpoint_every: int = 500_000, wait: bool = False) -> Path:
    """Train, or resume, or find the work done; return the path of the finished agent.

    Args:
        run: what to train; its folder is made if need be.
        algorithm: how.
        checkpoint_every: environment steps between checkpoints.
        wait: where another process trains in the run's folder, wait until it has done; without, that is an error.

    Raises:
        ValueError: the folder holds a run of other settings or what cannot be read, another process trains in it, or the
            algorithm cannot learn on the scenario.
        OSError: something cannot be written; what was written before stands.
    """
    if not algorithm.plays(run.scenario):
        raise ValueError(
            f"{algorithm.name} cannot learn on scenario {run.scenario.name!r}, whose actions or aim it does not know"
        )
    with exclusive_lock(run.folder, wait):
        run.begin()
        return run.policy if run.policy.exists() else _train(run, algorithm, checkpoint_every)


def _train(run: Run, algorithm: Algorithm, checkpoint_every: int) -> Path:
    torch.set_num_threads(1)
    resumed = run.checkpoint.exists()
    model = load_checkpoint(run, algorithm) if resumed else new_model(run, algorithm)
    callbacks = [*algorithm.callbacks(run), LearningCurve(run, algorithm.columns), Progress(run, algorithm, checkpoint_every)]
    model.learn(
        run.parameters["steps"] - model.num_timesteps,
        callback=callbacks,
        log_interval=algorithm.log_interval,
        tb_log_name=algorithm.name,
        reset_num_timesteps=not resumed,
    )
    model.env = None
    model.__dict__.pop("beside", None)
    replace_file(run.policy, model.save)
    run.checkpoint.unlink(missing_ok=True)
    return run.policy
