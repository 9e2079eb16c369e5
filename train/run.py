"""A training run: its settings and its files."""

import csv
import json
import math
import sys
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from turning_env import FAMILY_ID, IDS, Family, Scenario
from turning_env.files import replace_file
from turning_env.scenario.section import names_instead
from turning_env.scoring.policy import ScenarioId

HYPERPARAMETERS = Path(__file__).parent / "hyperparameters"
CURVE_COLUMNS = ("steps", "wall_time", "mean_return")
"""Columns of a learning curve: environment steps; seconds of training without interruptions; mean return [s] of the last 100
episodes, in which the agent explores. An algorithm may add columns of its own."""
TERMS = {
    "belief": False,
    "position": False,
    "frames": 1,
    "life_price": "flat",
    "hides_context": False,
    "asymmetric": False,
}
"""Values of ``train/terms.py``'s hyperparameters in a training that does not name them."""

OLD_NAMES = {
    "activation": "activation_fn",
    "batches_per_step": "gradient_steps",
    "critic_has_memory": "enable_critic_lstm",
    "critics": "n_critics",
    "discount": "gamma",
    "dropped_quantiles": "top_quantiles_to_drop_per_net",
    "entropy_coefficient": "ent_coef",
    "epochs": "n_epochs",
    "hidden_layers": "net_arch",
    "initial_entropy_coefficient": "initial_ent_coef",
    "initial_log_deviation": "log_std_init",
    "max_gradient_norm": "max_grad_norm",
    "memory": "buffer_size",
    "memory_cells": "lstm_hidden_size",
    "quantiles": "n_quantiles",
    "random_steps": "learning_starts",
    "rollout": "n_steps",
    "steps": "total_timesteps",
    "target_rate": "tau",
    "value_coefficient": "vf_coef",
}
"""Names of hyperparameters in older agent files, cards and runs, with their present names: Stable-Baselines3's."""


def current_names(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of a training under their present names."""
    current = {}
    for name, value in parameters.items():
        # A number called "memory" was the size of a replay buffer; analytic_gradient has a switch of that name.
        is_switch = name == "memory" and isinstance(value, bool)
        current[name if is_switch else OLD_NAMES.get(name, name)] = value
    return current


def _tables(algorithm: str) -> dict[str, dict[str, Any]]:
    return tomllib.loads((HYPERPARAMETERS / f"{algorithm}.toml").read_text("utf-8"))


def hyperparameters(algorithm: str, env_id: str) -> dict[str, Any]:
    """Return an algorithm's hyperparameters for an id: the defaults of its file, updated with the id's table."""
    tables = _tables(algorithm)
    return tables["default"] | tables.get(env_id, {})


def overrides(algorithm: str, settings: Iterable[str]) -> dict[str, Any]:
    """Parse hyperparameters ``KEY=VALUE``; ValueError if the algorithm's file has no such, or one of another type."""
    tables = _tables(algorithm)
    default = tables.pop("default")
    examples = {name: value for table in tables.values() for name, value in table.items()} | default
    values = {}
    for setting in settings:
        name, _, text = (part.strip() for part in setting.partition("="))
        if name not in examples:
            name = OLD_NAMES.get(name, name)
        if name not in examples:
            instead = names_instead(name, examples, f"cat train/hyperparameters/{algorithm}.toml")
            raise ValueError(f"{algorithm} has no hyperparameter {name!r}; {instead}")
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except ValueError:  # no TOML: a text without quotation marks
            value = text
        values[name] = _typed(name, value, examples[name])
    return values


def _typed(name: str, value: Any, example: Any) -> Any:
    """Return a value with the type of an example; a negative value is allowed only if the example is negative."""
    if isinstance(example, list) and isinstance(value, list):
        return [_typed(name, each, min(example)) for each in value]
    if isinstance(example, float) and type(value) is int:
        value = float(str(value))  # infinite if it is too large
    is_number = isinstance(example, int | float)
    if type(value) is not type(example) or (
        is_number and not (math.isfinite(value) and (value >= 0 or example < 0))
    ):
        least = " of 0 or more" if is_number and example >= 0 else ""
        raise ValueError(
            f"{name} is {value!r}, but must be a {type(example).__name__}{least}, such as {example!r}"
        )
    return value


def trained_on(env_id: str, source: str | None) -> Scenario | Family:
    """Return the scenario, or with the family's id the family, of a preset's name or a TOML file; None: the id's own."""
    return (
        Family.load(source or "shop")
        if env_id == FAMILY_ID
        else Scenario.load(source or IDS[env_id])
    )


def family_of(env_id: str, parameters: Mapping[str, Any]) -> Family | None:
    """Return the family that a run's parameters name, if its id plays one."""
    return Family.load(parameters["family"]) if env_id == FAMILY_ID else None


def _described(source: Scenario | Family) -> tuple[Scenario, dict[str, Any]]:
    """Return a run's scenario, and the parameters that name a family and the nominal model's numbers in its observations."""
    if not isinstance(source, Family):
        return source, {}
    return source.job(0).scenario, {
        "family": source.portable(),
        "context": {"names": list(source.context_names)},
    }


def warn_of_pickle(path: Path) -> None:
    """Warn on standard error that loading a pickle can run code."""
    print(
        f"warning: {path} is a pickle, which can run code: load only what you have trained yourself",
        file=sys.stderr,
    )


@dataclass(frozen=True)
class Run:
    """A training of one algorithm on one scenario with one seed."""

    algorithm: str
    env_id: str
    scenario: Scenario  # scenario; for a family, its first training job
    seed: int
    parameters: dict[
        str, Any
    ]  # the algorithm's hyperparameters; for a family also its values and the names of its context
    command: str  # the command line that started it
    folder: Path

    @classmethod
    def plan(
        cls,
        algorithm: str,
        env_id: str,
        scenario: Scenario | Family,
        seed: int,
        runs: Path,
        command: str,
        given: dict[str, Any],
    ) -> "Run":
        """Return a run in its own folder below ``runs``, with the hyperparameter file's values updated with those given."""
        folder = runs / env_id / scenario.name / f"{algorithm}-seed{seed}"
        job, family = _described(scenario)
        return cls(
            algorithm,
            env_id,
            job,
            seed,
            hyperparameters(algorithm, env_id) | given | family,
            command,
            folder,
        )

    @classmethod
    def elsewhere(
        cls, algorithm: str, env_id: str, scenario: Scenario | Family, steps: int, command: str
    ) -> "Run":
        """Return a run that stands for a training by other programs, without a folder."""
        job, family = _described(scenario)
        return cls(algorithm, env_id, job, 0, {"total_timesteps": steps} | family, command, Path())

    @classmethod
    def read(cls, folder: Path) -> "Run":
        """Return the run that a folder holds. Raise ValueError if the folder holds no run, or its description cannot be read."""
        path = folder / "run.json"
        if not path.is_file():
            hint = (
                ": train.export makes an agent file of a model of Stable-Baselines3"
                if folder.suffix == ".zip"
                else ""
            )
            raise ValueError(f"{folder} holds no training run: there is no run.json{hint}")
        try:
            values = json.loads(path.read_text("utf-8"))
            values["scenario"] = Scenario.model_validate(values["scenario"])
            values["parameters"] = current_names(values["parameters"])
            return cls(**values, folder=folder)
        except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"{path} describes no training run: {error}") from error

    @property
    def family(self) -> Family | None:
        """The family whose jobs are played, if any."""
        return family_of(self.env_id, self.parameters)

    @property
    def task(self) -> ScenarioId:
        """Identity of the scenario or family of the training."""
        trained = self.family or self.scenario
        return ScenarioId(name=trained.name, digest=trained.digest())

    @property
    def checkpoint(self) -> Path:
        """Path of the state of an unfinished training."""
        return self.folder / "checkpoint.zip"

    @property
    def policy(self) -> Path:
        """The finished agent."""
        return self.folder / "policy.zip"

    @property
    def learning_curve(self) -> Path:
        """Path of the learning curve, which has at least the columns ``CURVE_COLUMNS``."""
        return self.folder / "learning_curve.csv"

    @property
    def name(self) -> str:
        """Name of the agent: its algorithm's, followed by the scenario's if it was trained on one that is not the id's own."""
        own = trained_on(self.env_id, None).digest() == self.task.digest
        return self.algorithm if own else f"{self.algorithm}_{self.task.name}"

    def read_learning_curve(self) -> list[dict[str, float]]:
        """Return the rows of the learning curve in order of time; ValueError if there is none, or a damaged one."""
        path = self.learning_curve
        if not path.is_file():
            raise ValueError(f"{self.folder} holds no {path.name}: train it anew")
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            if missing := set(CURVE_COLUMNS) - set(reader.fieldnames or ()):
                raise ValueError(f"{path} lacks the column {', '.join(sorted(missing))}")
            try:
                return [{name: float(value) for name, value in row.items()} for row in reader]
            except (TypeError, ValueError) as error:
                raise ValueError(f"{path} holds a row that is not numbers: {error}") from error

    def begin(self) -> None:
        """Make the folder and write ``run.json``; ValueError if it holds a run with other settings."""
        if (self.folder / "run.json").exists():
            found = Run.read(self.folder)
            if (found.scenario, found.parameters) != (self.scenario, self.parameters):
                raise ValueError(
                    f"{self.folder} holds a training with other settings: delete it, or choose other --runs"
                )
            return
        values = vars(self) | {"scenario": self.scenario.model_dump()}
        del values["folder"]
        replace_file(
            self.folder / "run.json",
            lambda path: path.write_text(json.dumps(values, indent=1), "utf-8"),
        )
