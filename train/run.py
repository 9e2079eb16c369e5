"""A training run: its settings and its files. It leaves the training itself to ``training.py``."""

import csv
import importlib
import json
import math
import sys
import tomllib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from baselines.policy_spec import ScenarioId
from leaderboard.agents.agent_file import training_family
from turning_env import FAMILY_ID, IDS, Family, Scenario
from turning_env.files import read_regular, write_file
from turning_env.scenario.arguments import refuse_family
from turning_env.scenario.section import names_instead

HYPERPARAMETERS = Path(__file__).parent / "hyperparameters"
ALGORITHMS = (
    "analytic_gradient",
    "bc",
    "dagger",
    "iql",
    "lagrangian_ppo",
    "linear_cma_es",
    "ppo",
    "recurrent_ppo",
    "sac",
    "simulator_gradient",
    "td3_bc",
    "tqc",
)
"""Names of the algorithms: each has a Python file of this name, which declares ``ALGORITHM``."""
CURVE_COLUMNS = ("steps", "wall_time", "mean_return")
"""Columns of a learning curve: environment steps; seconds of training without interruptions; mean
return [s] of the last 100 episodes, in which the agent explores. An algorithm may add columns."""
SHARES = ("gamma", "gae_lambda", "tau", "change_lambda")
"""Hyperparameters that are shares, at most 1."""


def _defaults(algorithm: str) -> dict[str, Any]:
    """Return the default hyperparameters, which an algorithm's Python file declares."""
    if algorithm not in ALGORITHMS:
        instead = names_instead(algorithm, ALGORITHMS, "python -m train.tune agent --help")
        raise ValueError(
            f"no algorithm is called {algorithm!r}; {instead} "
            "(a new one needs a line in ALGORITHMS of train/run.py)"
        )
    # Imported here, because the files of algorithms import this module.
    module = importlib.import_module(f"train.{algorithm}")
    return dict(module.ALGORITHM.defaults)


def _tables(algorithm: str) -> dict[str, dict[str, Any]]:
    """Return the hyperparameters that differ from the defaults, by id; without a file, none do."""
    path = HYPERPARAMETERS / f"{algorithm}.toml"
    return tomllib.loads(path.read_text("utf-8")) if path.is_file() else {}


def hyperparameters(algorithm: str, env_id: str) -> dict[str, Any]:
    """Return an algorithm's hyperparameters for an id.

    They are its defaults, updated with the id's table in its hyperparameter file, if it has one.

    Raises:
        ValueError: there is no such algorithm.
    """
    return _defaults(algorithm) | _tables(algorithm).get(env_id, {})


def examples(algorithm: str) -> dict[str, Any]:
    """Return a value of each hyperparameter of an algorithm: its default or, without one, an id's.

    Raises:
        ValueError: there is no such algorithm.
    """
    values = _defaults(algorithm)
    for table in _tables(algorithm).values():
        for name, value in table.items():
            values.setdefault(name, value)
    return values


def overrides(algorithm: str, settings: Iterable[str]) -> dict[str, Any]:
    """Parse hyperparameters ``KEY=VALUE``.

    Raises:
        ValueError: the algorithm has no such hyperparameter, or one of another type.
    """
    known = examples(algorithm)
    values = {}
    for name, value in settings_of(settings).items():
        if name not in known:
            instead = names_instead(name, known, f"python -m train.{algorithm} --help")
            raise ValueError(f"{algorithm} has no hyperparameter {name!r}; {instead}")
        values[name] = typed(name, value, known[name])
        if name in SHARES and values[name] > 1.0:
            raise ValueError(f"{name} is {values[name]!r}, but must be 0 to 1")
    return values


def settings_of(words: Iterable[str]) -> dict[str, Any]:
    """Return the values of settings ``KEY=VALUE``; a value is TOML, or a text without quotes."""
    values: dict[str, Any] = {}
    for word in words:
        name, _, text = (part.strip() for part in word.partition("="))
        try:
            values[name] = tomllib.loads(f"value = {text}")["value"]
        except ValueError:  # no TOML
            values[name] = text
    return values


def typed(name: str, value: Any, example: Any) -> Any:
    """Return a value with the type of an example.

    A negative value is allowed only if the example is negative.
    """
    if isinstance(example, list) and isinstance(value, list):
        # One negative entry in the example allows negative entries anywhere.
        return [typed(name, entry, min(example)) for entry in value]
    if isinstance(example, float) and type(value) is int:
        value = float(str(value))  # infinite if it is too large
    if type(example) is int and type(value) is float and value.is_integer():
        value = int(value)  # 1e6 is a float of TOML
    is_right = type(value) is type(example)
    if isinstance(example, bool):
        if not is_right:
            raise ValueError(f"{name} is {value!r}, but must be true or false")
        return value
    is_number = isinstance(example, int | float)
    if is_right and is_number:
        is_right = math.isfinite(value) and (value >= 0 or example < 0)
    if not is_right:
        range_text = " of 0 or more" if is_number and example >= 0 else ""
        raise ValueError(
            f"{name} is {value!r}, but must be a {type(example).__name__}{range_text}, "
            f"such as {example!r}"
        )
    return value


def trained_on(env_id: str, source: str | None) -> Scenario | Family:
    """Return the scenario, or with the family's id the family, on which to train.

    Args:
        env_id: environment id.
        source: name of a preset, or a TOML file; None: the id's own.

    Raises:
        ScenarioError: there is no such preset or file, or it is a family and the id another.
    """
    if env_id == FAMILY_ID:
        return Family.load(source or "shop")
    refuse_family(source)
    return Scenario.load(source or IDS[env_id])


def _scenario_of(source: Scenario | Family) -> Scenario:
    """Return a run's scenario; of a family, that of its first training job."""
    return source.job(0).scenario if isinstance(source, Family) else source


def _family_parameters(source: Scenario | Family) -> dict[str, Any]:
    """Return the parameters that state a family, and the numbers of nominal models it shows."""
    if not isinstance(source, Family):
        return {}
    return {"family": source.portable(), "context": {"names": list(source.context_names)}}


def warn_of_pickle(path: Path) -> None:
    """Print a warning to stderr that loading a pickle can run code."""
    print(
        f"warning: {path} is a pickle, which can run code: "
        "load only what you have trained yourself",
        file=sys.stderr,
    )


@dataclass(frozen=True)
class Run:
    """A training of one algorithm on one scenario with one seed."""

    algorithm: str
    env_id: str
    scenario: Scenario
    """The scenario of the training; for a family, that of its first training job."""
    seed: int
    parameters: dict[str, Any]
    """The algorithm's hyperparameters; for a family also its values and its context's names."""
    command: str
    """The command line that started it."""
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
        """Return a run in its own folder below ``runs``.

        Its hyperparameters are the algorithm's for the id, updated with those given.
        """
        defaults = hyperparameters(algorithm, env_id)
        return cls(
            algorithm=algorithm,
            env_id=env_id,
            scenario=_scenario_of(scenario),
            seed=seed,
            parameters=defaults | given | _family_parameters(scenario),
            command=command,
            folder=runs / env_id / scenario.name / f"{algorithm}-seed{seed}",
        )

    @classmethod
    def elsewhere(
        cls, algorithm: str, env_id: str, scenario: Scenario | Family, steps: int, command: str
    ) -> "Run":
        """Return a run that stands for a training by other programs, without a folder."""
        return cls(
            algorithm=algorithm,
            env_id=env_id,
            scenario=_scenario_of(scenario),
            seed=0,
            parameters={"total_timesteps": steps} | _family_parameters(scenario),
            command=command,
            folder=Path(),
        )

    @classmethod
    def read(cls, folder: Path) -> "Run":
        """Return the run that a folder holds.

        Raises:
            ValueError: the folder holds no run, or its description cannot be read.
        """
        path = folder / "run.json"
        if not path.is_file():
            hint = ""
            if folder.suffix == ".zip":
                hint = ": train.export makes an agent file of a model of Stable-Baselines3"
            # Someone may give the folder of all runs: runs/ID/SCENARIO/ALGORITHM-seedN.
            deeper = sorted(folder.glob("*/*/*/run.json"))
            if deeper:
                hint = f", but in {deeper[0].parent}"
            raise ValueError(f"{folder} holds no training run: there is no run.json{hint}")
        try:
            values = json.loads(read_regular(path))
            values["scenario"] = Scenario.model_validate(values["scenario"])
            return cls(**values, folder=folder)
        except OSError as error:
            raise ValueError(f"{path} cannot be read: {error.strerror}") from error
        except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"{path} describes no training run: {error}") from error

    @property
    def family(self) -> Family | None:
        """The family whose jobs are played, if any."""
        return training_family(self.env_id, self.parameters)

    @property
    def task(self) -> ScenarioId:
        """Identity of the scenario or family of the training."""
        source = self.family or self.scenario
        return ScenarioId(name=source.name, digest=source.digest())

    @property
    def checkpoint(self) -> Path:
        """Path of the state of an unfinished training."""
        return self.folder / "checkpoint.zip"

    @property
    def policy(self) -> Path:
        """Path of the finished agent."""
        return self.folder / "policy.zip"

    @property
    def learning_curve(self) -> Path:
        """Path of the learning curve, which has at least the columns ``CURVE_COLUMNS``."""
        return self.folder / "learning_curve.csv"

    @property
    def name(self) -> str:
        """Name of the agent: its algorithm's.

        The scenario's name follows unless it is the id's own scenario.
        """
        own_task = trained_on(self.env_id, None)
        if own_task.digest() == self.task.digest:
            return self.algorithm
        return f"{self.algorithm}_{self.task.name}"

    def read_learning_curve(self) -> list[dict[str, float]]:
        """Return the rows of the learning curve in order of time.

        Raises:
            ValueError: there is no learning curve, or a damaged one.
        """
        path = self.learning_curve
        if not path.is_file():
            raise ValueError(f"{self.folder} holds no {path.name}: train again")
        with path.open(encoding="utf-8", newline="") as file:
            reader = csv.DictReader(file)
            missing = set(CURVE_COLUMNS) - set(reader.fieldnames or ())
            if missing:
                raise ValueError(f"{path} lacks the column {', '.join(sorted(missing))}")
            try:
                return [{name: float(value) for name, value in row.items()} for row in reader]
            except (TypeError, ValueError) as error:
                raise ValueError(f"{path} holds a row that is not numbers: {error}") from error

    def begin(self) -> None:
        """Make the folder and write ``run.json``.

        Raises:
            ValueError: the folder holds a run with other settings.
        """
        path = self.folder / "run.json"
        if path.exists():
            present = Run.read(self.folder)
            if present.scenario != self.scenario or present.parameters != self.parameters:
                raise ValueError(
                    f"{self.folder} holds a training with other settings: "
                    "delete it, or choose other --runs"
                )
            return
        values = vars(self) | {"scenario": self.scenario.model_dump()}
        del values["folder"]
        text = json.dumps(values, indent=1)
        write_file(path, text)
