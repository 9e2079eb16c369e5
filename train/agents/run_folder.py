"""Trained agents as policies, from the folders of one's own trainings."""

import importlib
from pathlib import Path

from train.actor import Actor, ActorPolicy
from train.agents.agent_file import trained_policy
from train.run import HYPERPARAMETERS, Run, warn_of_pickle
from turning_env.files import digest_of_files
from turning_env.scoring.policy import PolicySpec


def load(folder: Path) -> PolicySpec:
    """Load the finished agent of one of your own runs. It is a pickle, which can run code: never load a stranger's.

    Raises:
        ValueError: the folder holds no finished training, or none of a known algorithm.
    """
    run = Run.read(folder)
    actor = load_actor(run)
    digest = digest_of_files(folder, folder.rglob("*"))
    return trained_policy(run, run.parameters["steps"], digest, lambda num_envs: ActorPolicy(actor, num_envs))


def load_actor(run: Run) -> Actor:
    """Return the actor of a finished training. Never load a stranger's: see ``load``.

    Raises:
        ValueError: the training is not finished, or of no known algorithm.
    """
    if not (HYPERPARAMETERS / f"{run.algorithm}.toml").is_file():
        known = ", ".join(sorted(path.stem for path in HYPERPARAMETERS.glob("*.toml")))
        raise ValueError(f"{run.folder} holds a training of {run.algorithm!r}, but there are {known}")
    if not run.policy.exists():
        raise ValueError(f"the training in {run.folder} is not finished: run its command again: {run.command}")
    warn_of_pickle(run.policy)
    actor: Actor = importlib.import_module(f"train.{run.algorithm}").ALGORITHM.actor(run.policy)
    return actor
