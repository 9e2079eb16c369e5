"""Train with any algorithm: environments for each training seed, progress, checkpoints, the command line.

A run's folder holds ``run.json`` (the settings), ``checkpoint.zip`` (the state from which training resumes exactly),
``learning_curve.csv``, ``policy.zip`` (the finished agent) and TensorBoard logs. Load such files from your own trainings only:
they are pickles, which can run code.
"""

import argparse
import csv
import importlib
import shlex
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from optuna.distributions import BaseDistribution
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv
from tqdm import tqdm

from train.actor import Actor, ActorPolicy
from train.agents.agent_file import informed, trained_policy
from train.run import CURVE_COLUMNS, HYPERPARAMETERS, Run, overrides, trained_on, warn_of_pickle
from train.terms import Terms
from train.training_information import with_terms
from turning_env import FAMILY_ID, IDS, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.console import described, exits
from turning_env.files import digest_of_files, folder_lock, replace_file
from turning_env.scoring.play import Episodes, play, play_family
from turning_env.scoring.policy import PolicySpec
from turning_env.scoring.seeds import HELD_OUT_START, TUNING_START, tuning_seeds

SEED_STRIDE = 1_000_000  # environment i of training seed s plays seed s * SEED_STRIDE + i, so no two trainings share bars
SEEDS = (
    TUNING_START // SEED_STRIDE - 1
)  # training seeds are below this number; data sets have the episodes of this one
VALIDATION = "validation"  # split of a family on which agents are compared during development
CURVE_ROWS = 200  # approximate number of rows of a learning curve

ACTIVATIONS: dict[str, type[torch.nn.Module]] = {"relu": torch.nn.ReLU, "tanh": torch.nn.Tanh}


@dataclass(frozen=True)
class Algorithm:
    """A learning algorithm as training, tuning and export use it."""

    name: str  # name of its Python file, of its hyperparameter file, and in run.json
    model: type[BaseAlgorithm]
    new_model: Callable[
        [Run, VecEnv], BaseAlgorithm
    ]  # function that returns an untrained model for a run on given environments
    network: Callable[
        [Any], Actor
    ]  # function that returns the agent of a trained policy of Stable-Baselines3
    search: Mapping[str, BaseDistribution]  # hyperparameters to tune, with their ranges
    training_information: tuple[str, ...]
    """Inputs of the training beside observations, names in ``training_information.TRAINING_INPUTS``."""
    vec_env: Callable[..., RoughTurningVecEnv] = RoughTurningVecEnv
    """Function that makes the training environments from scenario, number of environments and reward scale."""
    families: bool = True  # whether it can learn on the jobs of a family
    extra_state: tuple[
        str, ...
    ] = ()  # attributes that a checkpoint holds besides those that Stable-Baselines3 saves
    callbacks: Callable[[Run], list[BaseCallback]] = (
        lambda run: []
    )  # further callbacks during training
    columns: Callable[[Any], dict[str, float]] = (
        lambda model: {}
    )  # further columns of the learning curve
    plays: Callable[[Scenario], bool] = lambda scenario: True  # whether it can learn on a scenario
    log_interval: int = 5  # rollouts (off-policy: episodes) between entries in the TensorBoard logs

    def actor(self, run: Run) -> Actor:
        """Load the finished agent of a run of your own."""
        model: Any = self.model.load(run.policy, device="cpu")
        return Terms.of(run).actor(self.network(model.policy)).eval()


class Recorder(BaseCallback):
    """A callback that writes learning curve and checkpoints, and shows a progress bar."""

    def __init__(self, run: Run, algorithm: Algorithm, checkpoint_every: int) -> None:
        super().__init__()
        self.run, self.algorithm, self.checkpoint_every = run, algorithm, checkpoint_every
        self.bar: Any = None

    def _on_training_start(self) -> None:
        run, done = self.run, self.num_timesteps
        known = run.read_learning_curve() if run.learning_curve.exists() else []
        # Rows beyond the checkpoint are trained again.
        self.rows = [row for row in known if row["steps"] <= done]
        self.start = time.monotonic() - (self.rows[-1]["wall_time"] if self.rows else 0.0)
        replace_file(run.learning_curve, self._write)
        self.last_checkpoint, label = done, f"{run.algorithm}, seed {run.seed}"
        self.bar = tqdm(
            total=run.parameters["total_timesteps"],
            initial=done,
            unit="step",
            unit_scale=True,
            desc=label,
            disable=None,
        )

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self.last_checkpoint >= self.checkpoint_every:
            self.last_checkpoint = self.num_timesteps
            save_checkpoint(self.model, self.run, self.algorithm)

    def _on_step(self) -> bool:
        # The last rollout is completed, so training takes a few more steps than requested.
        self.bar.update(min(self.num_timesteps, self.bar.total) - self.bar.n)
        return True

    def _on_rollout_end(self) -> None:
        self._add_row(self.run.parameters["total_timesteps"] / CURVE_ROWS)

    def _on_training_end(self) -> None:
        self._add_row(1)
        self.bar.close()

    def _add_row(self, min_steps: float) -> None:
        if not self.model.ep_info_buffer:
            return
        mean_return = float(np.mean([episode["r"] for episode in self.model.ep_info_buffer]))
        self.bar.set_postfix_str(f"return per episode {mean_return:.0f} s", refresh=False)
        if self.num_timesteps - (self.rows[-1]["steps"] if self.rows else 0.0) >= min_steps:
            values = float(self.num_timesteps), time.monotonic() - self.start, mean_return
            self.rows.append(
                dict(zip(CURVE_COLUMNS, values, strict=True)) | self.algorithm.columns(self.model)
            )
            replace_file(self.run.learning_curve, self._write)

    def _write(self, path: Path) -> None:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, self.rows[0] if self.rows else CURVE_COLUMNS)
            writer.writeheader()
            writer.writerows(self.rows)


def save_checkpoint(model: Any, run: Run, algorithm: Algorithm) -> None:
    """Write the model with its environments and the states of all random generators, atomically."""
    model.resume_state = {
        "vec_env": model.get_env(),
        "torch": torch.get_rng_state(),
        "numpy": np.random.get_state(),  # noqa: NPY002 - SB3 shuffles with it
        # Loading reseeds the action space, from which off-policy algorithms sample their first actions.
        "attributes": {
            name: getattr(model, name) for name in ("action_space", *algorithm.extra_state)
        },
    }
    replace_file(run.checkpoint, model.save)


def load_checkpoint(run: Run, algorithm: Algorithm) -> Any:
    """Return the model of the last checkpoint; training continues exactly. Raise ValueError if it is damaged."""
    warn_of_pickle(run.checkpoint)
    try:
        model: Any = algorithm.model.load(run.checkpoint, device="cpu")
        state = model.resume_state
    except Exception as error:  # garbled bytes can raise anything
        raise ValueError(
            f"{run.checkpoint} cannot be read: {error}; delete it to begin the training anew"
        ) from error
    model.set_env(state["vec_env"], force_reset=False)
    for name, value in state["attributes"].items():
        setattr(model, name, value)
    torch.set_rng_state(state["torch"])
    np.random.set_state(state["numpy"])  # noqa: NPY002
    return model


def new_model(run: Run, algorithm: Algorithm) -> Any:
    """Return an untrained model on freshly seeded environments. Raise ValueError if the hyperparameters cannot be used.

    Its first actions vary about ``initial_actions`` of the hyperparameters, if there are any.
    """
    try:
        terms, p = Terms.of(run), run.parameters
        make = terms.charged(algorithm.vec_env)
        vec_env = make(run.family or run.scenario, p["num_envs"], p["reward_scale"], terms.shown)
        model: Any = algorithm.new_model(run, vec_env)
        if means := p.get("initial_actions"):
            model.policy.action_net.bias.data[: len(means)] = torch.tensor(means)
    except (
        Exception
    ) as error:  # libraries raise many types for hyperparameters that they cannot use
        raise ValueError(
            f"{algorithm.name} cannot be made with these hyperparameters: {error!r}"
        ) from error
    vec_env.seed(run.seed * SEED_STRIDE)
    return model


def train(
    run: Run, algorithm: Algorithm, checkpoint_every: int = 500_000, wait: bool = False
) -> Path:
    """Train or resume, unless training is finished; return the path of the finished agent.

    Checkpoints are ``checkpoint_every`` environment steps apart. If another process trains in the run's folder, ``wait`` or raise
    ValueError. ValueError also says what cannot be trained, or that the folder holds a training with other settings.
    """
    if not algorithm.plays(run.scenario):
        raise ValueError(
            f"{algorithm.name} cannot learn on scenario {run.scenario.name!r}: it lacks its actions or its aim"
        )
    if run.family and not algorithm.families:
        raise ValueError(f"{algorithm.name} learns on one scenario, not on the jobs of a family")
    if run.seed not in range(SEEDS):
        apart = f"episode seeds from {SEEDS * SEED_STRIDE} are for data sets and tuning, from {HELD_OUT_START} for scoring"
        raise ValueError(f"the training seed is {run.seed}, but must be 0 to {SEEDS - 1}: {apart}")
    if run.parameters["total_timesteps"] < 1:
        raise ValueError(
            f"total_timesteps is {run.parameters['total_timesteps']}, but must be at least 1"
        )
    with folder_lock(run.folder, wait):
        torch.set_num_threads(1)
        torch.distributions.Distribution.set_default_validate_args(
            False
        )  # a third of the time of a family's PPO
        resumed, finished = run.checkpoint.exists(), run.policy.exists()
        model = (
            None if resumed or finished else new_model(run, algorithm)
        )  # before run.json is written: it may be refused
        run.begin()
        if finished:
            return run.policy
        model = model or load_checkpoint(run, algorithm)
        model.learn(
            run.parameters["total_timesteps"] - model.num_timesteps,
            callback=[*algorithm.callbacks(run), Recorder(run, algorithm, checkpoint_every)],
            log_interval=algorithm.log_interval,
            tb_log_name=algorithm.name,
            reset_num_timesteps=not resumed,
        )
        model.env = None
        model.__dict__.pop("resume_state", None)
        replace_file(run.policy, model.save)
        run.checkpoint.unlink(missing_ok=True)
        return run.policy


def algorithm_of(name: str) -> Algorithm:
    """Return the algorithm with a name."""
    algorithm: Algorithm = importlib.import_module(f"train.{name}").ALGORITHM
    return algorithm


def load_actor(run: Run) -> Actor:
    """Return the actor of a finished training of your own. It is a pickle, which can run code: never load a stranger's."""
    if not (HYPERPARAMETERS / f"{run.algorithm}.toml").is_file():
        known = ", ".join(sorted(path.stem for path in HYPERPARAMETERS.glob("*.toml")))
        raise ValueError(
            f"{run.folder} holds a training of {run.algorithm!r}, but there are {known}"
        )
    if not run.policy.exists():
        raise ValueError(
            f"the training in {run.folder} is not finished: run its command again: {run.command}"
        )
    warn_of_pickle(run.policy)
    return algorithm_of(run.algorithm).actor(run)


def stating_information(run: Run) -> Run:
    """Return a run of yours whose parameters also state the inputs of its training, as its agent's file does."""
    declared = algorithm_of(run.algorithm).training_information
    stated = {"training_information": list(with_terms(declared, run.parameters))}
    return replace(run, parameters=run.parameters | stated)


def load_agent(folder: Path) -> PolicySpec:
    """Return the finished agent of one of your own run folders, as a policy; raises as ``load_actor``."""
    run = Run.read(folder)
    actor = load_actor(run)
    digest = digest_of_files(folder, folder.rglob("*"))
    return trained_policy(
        stating_information(run),
        run.parameters["total_timesteps"],
        digest,
        lambda num_envs: ActorPolicy(actor, num_envs),
    )


def play_agent(folder: Path, episodes: int) -> Episodes:
    """Play a run's finished agent on the first tuning seeds, or on all jobs of its family's split ``VALIDATION``."""
    run, agent = Run.read(folder), load_agent(folder)
    if run.family is None:
        return play(informed(agent, run.scenario), run.scenario, tuning_seeds(episodes))
    jobs = range(run.family.held_out_jobs)
    scenarios = [run.family.job(number, VALIDATION).scenario for number in jobs]
    return play_family(run.family, VALIDATION, jobs, informed(agent, scenarios))


def add_task(parser: argparse.ArgumentParser) -> None:
    """Add the options that training and tuning share."""
    ids = [*IDS, FAMILY_ID]
    parser.add_argument(
        "--env", default=ids[0], choices=ids, help="environment id (default: %(default)s)"
    )
    parser.add_argument(
        "--scenario",
        help="preset or TOML file of a scenario, or of a family (default: the id's own)",
    )
    parser.add_argument(
        "--runs", type=Path, default=Path("runs"), help="folder of all runs (default: %(default)s)"
    )


@exits(
    ValueError,
    interrupted="interrupted: run the same command again to resume from the last checkpoint",
)
def command_line(algorithm: Algorithm, arguments: list[str] | None = None) -> int:
    """Run an algorithm's command line: train one agent for one training seed; print its path and return the exit status."""
    program = f"python -m train.{algorithm.name}"
    module = importlib.import_module(f"train.{algorithm.name}")
    parser = argparse.ArgumentParser(prog=program, **described(module.__doc__))
    add_task(parser)
    parser.add_argument("--seed", type=int, default=0, help="training seed (default: %(default)s)")
    parser.add_argument(
        "--total-timesteps",
        "--steps",
        type=int,
        metavar="N",
        help="environment steps of the training; short for --set total_timesteps=N",
    )
    set_help = f"set a hyperparameter of train/hyperparameters/{algorithm.name}.toml; repeat the option to set several"
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help=set_help)
    parsed = parser.parse_args(arguments)
    command = f"{program} {shlex.join(sys.argv[1:] if arguments is None else arguments)}".strip()
    scenario = trained_on(parsed.env, parsed.scenario)
    given = overrides(algorithm.name, parsed.set) | (
        {} if parsed.total_timesteps is None else {"total_timesteps": parsed.total_timesteps}
    )
    print(
        train(
            Run.plan(
                algorithm.name, parsed.env, scenario, parsed.seed, parsed.runs, command, given
            ),
            algorithm,
        )
    )
    return 0
