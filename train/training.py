"""Train with any algorithm: environments for each training seed, progress, checkpoints, commands.

A run's folder holds ``run.json`` (the settings), ``checkpoint.zip`` (the state from which training
resumes exactly), ``learning_curve.csv``, ``policy.zip`` (the finished agent) and TensorBoard logs.
Load such files from your own trainings only: they are pickles, which can run code.

An algorithm's own file says how its model is made and learns (``Algorithm``). ``train/terms.py``
says what agents see and how rewards charge edge life.
"""

import argparse
import csv
import importlib
import shlex
import sys
import threading
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

from baselines.policy_spec import PolicySpec
from leaderboard.agents.agent_file import informed, trained_policy
from leaderboard.inputs import training_inputs
from leaderboard.play import Episodes, play, play_family
from leaderboard.seeds import HELD_OUT_START, TUNING_START, tuning_seeds
from leaderboard.statistics import Estimate
from train.actor import Actor, ActorPolicy
from train.run import (
    ALGORITHMS,
    CURVE_COLUMNS,
    Run,
    examples,
    overrides,
    trained_on,
    warn_of_pickle,
)
from train.terms import Terms
from turning_env import ALL_IDS, FAMILY_ID, Scenario
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.console import Parser, described, exits, whole_number
from turning_env.files import digest_of_files, folder_lock, replace_file
from turning_env.progress import progress
from turning_env.scenario.arguments import environment_id

SEED_STRIDE = 1_000_000
"""Environment i of training seed s plays seed s * SEED_STRIDE + i: no two trainings share bars."""
SEEDS = TUNING_START // SEED_STRIDE - 1
"""Training seeds are below this number; data sets have the episodes of this one."""
VALIDATION = "validation"
"""Split of a family on which agents are compared during development."""
CURVE_ROWS = 200
"""Approximate number of rows of a learning curve."""

ACTIVATIONS: dict[str, type[torch.nn.Module]] = {"relu": torch.nn.ReLU, "tanh": torch.nn.Tanh}


def no_callbacks(run: Run) -> list[BaseCallback]:
    """Return no callbacks."""
    return []


def no_columns(model: Any) -> dict[str, float]:
    """Return no columns of the learning curve."""
    return {}


def any_scenario(scenario: Scenario) -> bool:
    """Return True: the algorithm can learn on every scenario."""
    return True


@dataclass(frozen=True, kw_only=True)
class Algorithm:
    """A learning algorithm as training, tuning and export use it."""

    name: str
    """Name of its Python file, as in ``train.run.ALGORITHMS``."""
    model: type[BaseAlgorithm]
    """Class of its models, which loads them."""
    new_model: Callable[[Run, VecEnv], BaseAlgorithm]
    """Function that returns an untrained model for a run on given environments."""
    network: Callable[[Any], Actor]
    """Function that returns the agent of a trained policy of Stable-Baselines3."""
    defaults: Mapping[str, Any]
    """Hyperparameters with the names of Stable-Baselines3. Where an id is better off with others,
    ``train/hyperparameters/NAME.toml`` has a table of these."""
    search: Mapping[str, BaseDistribution]
    """Hyperparameters to tune, with their ranges."""
    training_information: tuple[str, ...]
    """Inputs of the training beside observations, names in ``TRAINING_INPUTS``."""
    vec_env: Callable[..., RoughTurningVecEnv] = RoughTurningVecEnv
    """Function that makes the environments; its arguments are those of ``RoughTurningVecEnv``."""
    families: bool = True
    """Whether it can learn on the jobs of a family."""
    single_scenarios: bool = True
    """Whether it can learn on one scenario."""
    plays: Callable[[Scenario], bool] = any_scenario
    """Function that returns whether it can learn on a scenario."""
    extra_state: tuple[str, ...] = ()
    """Attributes of a model that a checkpoint holds besides those that Stable-Baselines3 saves."""
    callbacks: Callable[[Run], list[BaseCallback]] = no_callbacks
    """Function that returns further callbacks during training."""
    columns: Callable[[Any], dict[str, float]] = no_columns
    """Function that returns further columns of the learning curve, for a model."""
    log_interval: int = 5
    """Rollouts (off-policy: episodes) between entries in the TensorBoard logs."""

    def actor(self, run: Run) -> Actor:
        """Load the finished agent of a run of your own."""
        model: Any = self.model.load(run.policy, device="cpu")
        return Terms.of(run).actor(self.network(model.policy)).eval()


class Recorder(BaseCallback):
    """A callback that writes learning curve and checkpoints, and shows its progress."""

    def __init__(self, run: Run, algorithm: Algorithm, checkpoint_every: int) -> None:
        super().__init__()
        self.run = run
        self.algorithm = algorithm
        self.checkpoint_every = checkpoint_every
        self.total_timesteps = run.parameters["total_timesteps"]
        self.bar: Any = None

    def _on_training_start(self) -> None:
        run = self.run
        rows = run.read_learning_curve() if run.learning_curve.exists() else []
        # Rows beyond the checkpoint are trained again.
        self.rows = [row for row in rows if row["steps"] <= self.num_timesteps]
        earlier_time = self.rows[-1]["wall_time"] if self.rows else 0.0
        self.start = time.monotonic() - earlier_time
        replace_file(run.learning_curve, self._write)
        self.last_checkpoint = self.num_timesteps
        # The default lock spans processes; a killed worker of a tuning would leave it behind.
        tqdm.set_lock(threading.RLock())
        self.bar = progress(
            total=self.total_timesteps,
            initial=self.num_timesteps,
            unit="step",
            unit_scale=True,
            desc=f"{run.algorithm}, seed {run.seed}",
        )

    def _on_rollout_start(self) -> None:
        # Between rollouts, the state is complete: nothing is under way in a buffer.
        if self.num_timesteps - self.last_checkpoint >= self.checkpoint_every:
            self.last_checkpoint = self.num_timesteps
            save_checkpoint(self.model, self.run, self.algorithm)

    def _on_step(self) -> bool:
        # The last rollout is completed, so training takes a few more steps than requested.
        self.bar.update(min(self.num_timesteps, self.bar.total) - self.bar.n)
        return True

    def _on_rollout_end(self) -> None:
        self._add_row(min_steps=self.total_timesteps / CURVE_ROWS)

    def _on_training_end(self) -> None:
        self._add_row(min_steps=1)
        self.bar.close()

    def _add_row(self, min_steps: float) -> None:
        """Show the mean return, and add a row to the learning curve.

        Rows are at least ``min_steps`` environment steps apart.
        """
        if not self.model.ep_info_buffer:
            return
        returns = [episode["r"] for episode in self.model.ep_info_buffer]
        mean_return = float(np.mean(returns))
        # As many decimals as tables show without an interval.
        decimals = Estimate(mean_return, low=mean_return, high=mean_return).decimals()
        shown = f"return per episode {mean_return:.{decimals}f} s"
        self.bar.set_postfix_str(shown, refresh=False)
        last_step = self.rows[-1]["steps"] if self.rows else 0.0
        if self.num_timesteps - last_step < min_steps:
            return
        row = {
            "steps": float(self.num_timesteps),
            "wall_time": time.monotonic() - self.start,
            "mean_return": mean_return,
        }
        self.rows.append(row | self.algorithm.columns(self.model))
        replace_file(self.run.learning_curve, self._write)

    def _write(self, path: Path) -> None:
        with path.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, self.rows[0] if self.rows else CURVE_COLUMNS)
            writer.writeheader()
            writer.writerows(self.rows)


def save_checkpoint(model: Any, run: Run, algorithm: Algorithm) -> None:
    """Write the model with its environments and the states of all random generators, atomically."""
    # Loading reseeds the action space, from which off-policy algorithms sample their first actions.
    names = ("action_space", *algorithm.extra_state)
    model.resume_state = {
        "vec_env": model.get_env(),
        "torch": torch.get_rng_state(),
        "numpy": np.random.get_state(),  # noqa: NPY002 - SB3 shuffles with it
        "attributes": {name: getattr(model, name) for name in names},
    }
    replace_file(run.checkpoint, model.save)


def load_checkpoint(run: Run, algorithm: Algorithm) -> Any:
    """Return the model of the last checkpoint, from which training continues exactly.

    Raises:
        ValueError: the checkpoint is damaged.
    """
    warn_of_pickle(run.checkpoint)
    try:
        model: Any = algorithm.model.load(run.checkpoint, device="cpu")
        state = model.resume_state
    except Exception as error:  # garbled bytes can raise anything
        raise ValueError(
            f"{run.checkpoint} cannot be read: {error}; delete it to train from the start"
        ) from error
    # The environments go on within their episodes, so they must not be reset.
    model.set_env(state["vec_env"], force_reset=False)
    for name, value in state["attributes"].items():
        setattr(model, name, value)
    torch.set_rng_state(state["torch"])
    np.random.set_state(state["numpy"])  # noqa: NPY002 - see save_checkpoint
    return model


def new_model(run: Run, algorithm: Algorithm) -> Any:
    """Return an untrained model on freshly seeded environments.

    Its first actions vary about ``initial_actions`` of the hyperparameters, if there are any.

    Raises:
        ValueError: the hyperparameters cannot be used.
    """
    try:
        model, vec_env = _model_and_environments(run, algorithm)
    except ValueError as error:
        raise ValueError(f"{algorithm.name} cannot be made: {error}") from error
    except Exception as error:  # libraries raise many types for hyperparameters they cannot use
        raise ValueError(
            f"{algorithm.name} cannot be made with these hyperparameters: {error!r}"
        ) from error
    # Seeds take effect when the environments are reset, at the start of learning.
    vec_env.seed(run.seed * SEED_STRIDE)
    return model


def _model_and_environments(run: Run, algorithm: Algorithm) -> tuple[Any, RoughTurningVecEnv]:
    p = run.parameters
    terms = Terms.of(run)
    make_vec_env = terms.with_life_price(algorithm.vec_env)
    vec_env = make_vec_env(
        run.family or run.scenario, p["num_envs"], p["reward_scale"], terms.wrapped
    )
    model: Any = algorithm.new_model(run, vec_env)
    # The last layer starts near 0, so its bias is the mean of the first actions. Stated are the
    # environment's own; load targets begin in the middle of their ranges.
    means = None if terms.inputs.load_target else p.get("initial_actions")
    if means:
        model.policy.action_net.bias.data[: len(means)] = torch.tensor(means)
    return model, vec_env


def check_trainable(run: Run, algorithm: Algorithm) -> None:
    """Raise ValueError if an algorithm cannot learn on a run's task, or its numbers are no good."""
    if not algorithm.plays(run.scenario):
        raise ValueError(
            f"{algorithm.name} cannot learn on scenario {run.scenario.name!r}: "
            "it lacks its actions or its aim"
        )
    if run.family and not algorithm.families:
        raise ValueError(f"{algorithm.name} learns on one scenario, not on the jobs of a family")
    if not run.family and not algorithm.single_scenarios:
        raise ValueError(
            f"{algorithm.name} learns on the jobs of a family, not on scenario "
            f"{run.scenario.name!r}: choose --env {FAMILY_ID}"
        )
    if run.seed not in range(SEEDS):
        raise ValueError(
            f"the training seed is {run.seed}, but must be 0 to {SEEDS - 1}: episode seeds from "
            f"{SEEDS * SEED_STRIDE} are for data sets and tuning, from {HELD_OUT_START} for scoring"
        )
    total_timesteps = run.parameters["total_timesteps"]
    if total_timesteps < 1:
        raise ValueError(f"total_timesteps is {total_timesteps}, but must be at least 1")


def train(
    run: Run, algorithm: Algorithm, checkpoint_every: int = 500_000, wait: bool = False
) -> Path:
    """Train or resume, unless training is finished; return the path of the finished agent.

    Args:
        run: the training.
        algorithm: its algorithm.
        checkpoint_every: environment steps between two checkpoints.
        wait: whether to wait while another process trains in the run's folder.

    Raises:
        ValueError: this cannot be trained, the folder holds a training with other settings, or
            another process trains there.
    """
    check_trainable(run, algorithm)
    with folder_lock(run.folder, wait):
        # Networks are small: more threads would wait for one another.
        torch.set_num_threads(1)
        # Validation of distributions takes a third of the time of a family's PPO.
        torch.distributions.Distribution.set_default_validate_args(False)

        is_finished = run.policy.exists()
        is_resumed = run.checkpoint.exists()
        model = None
        if not (is_finished or is_resumed):
            # Before run.json is written, as the hyperparameters may be refused.
            model = new_model(run, algorithm)
        run.begin()
        if is_finished:
            return run.policy
        if model is None:
            model = load_checkpoint(run, algorithm)

        recorder = Recorder(run, algorithm, checkpoint_every)
        model.learn(
            run.parameters["total_timesteps"] - model.num_timesteps,
            callback=[*algorithm.callbacks(run), recorder],
            log_interval=algorithm.log_interval,
            tb_log_name=algorithm.name,
            reset_num_timesteps=not is_resumed,
        )
        # The finished agent needs neither its environments nor the state of an earlier checkpoint.
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
    """Return the actor of a finished training of your own.

    It is a pickle, which can run code: never load a stranger's.

    Raises:
        ValueError: the training is not finished, or its algorithm is unknown.
    """
    if run.algorithm not in ALGORITHMS:
        raise ValueError(
            f"{run.folder} holds a training of {run.algorithm!r}, "
            f"but there are {', '.join(ALGORITHMS)}"
        )
    if not run.policy.exists():
        raise ValueError(
            f"the training in {run.folder} is not finished: run its command again: {run.command}"
        )
    warn_of_pickle(run.policy)
    return algorithm_of(run.algorithm).actor(run)


def stating_information(run: Run) -> Run:
    """Return a run of yours whose parameters also state the inputs of its training.

    Its agent's file states the same.
    """
    declared = algorithm_of(run.algorithm).training_information
    inputs = list(training_inputs(declared, run.parameters))
    return replace(run, parameters=run.parameters | {"training_information": inputs})


def load_agent(folder: Path) -> PolicySpec:
    """Return the finished agent of one of your own run folders, as a policy.

    It raises the same errors as ``load_actor``.
    """
    run = Run.read(folder)
    actor = load_actor(run)
    return trained_policy(
        about=stating_information(run),
        trained_steps=run.parameters["total_timesteps"],
        sha256=digest_of_files(folder, folder.rglob("*")),
        make=lambda num_envs: ActorPolicy(actor, num_envs),
    )


def play_agent(folder: Path, episodes: int) -> Episodes:
    """Play a run's finished agent on the first tuning seeds.

    On a family, play it on all jobs of the split ``VALIDATION`` instead.
    """
    run = Run.read(folder)
    agent = load_agent(folder)
    if run.family is None:
        return play(informed(agent, run.scenario), run.scenario, tuning_seeds(episodes))
    jobs = range(run.family.held_out_jobs)
    scenarios = [run.family.job(number, VALIDATION).scenario for number in jobs]
    return play_family(run.family, VALIDATION, jobs, informed(agent, scenarios))


def add_task(parser: argparse.ArgumentParser) -> None:
    """Add the options that training and tuning share."""
    parser.add_argument(
        "--env",
        type=environment_id,
        default=ALL_IDS[0],
        choices=ALL_IDS,
        help="environment id (default: %(default)s)",
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
def command_line(
    algorithm: Algorithm, description: str | None, arguments: list[str] | None = None
) -> int:
    """Run an algorithm's command line, whose help shows a description.

    Train one agent for one training seed, print its path, and return the exit status.
    """
    program = f"python -m train.{algorithm.name}"
    parser = Parser(prog=program, **described(description))
    add_task(parser)
    parser.add_argument("--seed", type=int, default=0, help="training seed (default: %(default)s)")
    parser.add_argument(
        "--total-timesteps",
        "--steps",
        type=whole_number,
        metavar="N",
        help="environment steps of the training; short for --set total_timesteps=N",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help=f"set a hyperparameter: {', '.join(examples(algorithm.name))}; "
        "repeat the option to set several",
    )
    if arguments is None:
        arguments = sys.argv[1:]
    parsed = parser.parse_args(arguments)
    given = overrides(algorithm.name, parsed.set)
    if parsed.total_timesteps is not None:
        given["total_timesteps"] = parsed.total_timesteps
    run = Run.plan(
        algorithm=algorithm.name,
        env_id=parsed.env,
        scenario=trained_on(parsed.env, parsed.scenario),
        seed=parsed.seed,
        runs=parsed.runs,
        command=f"{program} {shlex.join(arguments)}".strip(),
        given=given,
    )
    print(train(run, algorithm))
    return 0
