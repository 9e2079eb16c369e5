"""Learning curves as data: read from run folders, thinned in files beside agents and results, averaged over training seeds."""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from train.run import Run
from turning_env.files import replace_file
from turning_env.scoring.policy import ScenarioId
from turning_env.scoring.statistics import CONFIDENCE, KEY, RESAMPLES

POINTS = 100
FILE = "learning_curves.json"
"""Name of the file of learning curves beside agents and beside results."""
_DIGITS = 4  # significant ones, enough to draw
_TICKS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)
"""Ticks of returns, over the bound of the axis's linear part."""

Floats = NDArray[np.float64]


class Training(BaseModel):
    """Learning curve of one training."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    first: float
    """Environment steps of its first value."""
    last: float
    mean_return: list[float] = Field(min_length=1)
    """Mean return [s] at equal distances from ``first`` to ``last``."""
    again: bool = False
    """Whether the agent's file comes from an earlier training with the same settings."""

    @classmethod
    def of(cls, run: Run, again: bool = False) -> Self:
        """Return the learning curve of a run.

        Raises:
            ValueError: the folder holds none.
        """
        rows = run.read_learning_curve()
        if not rows:
            raise ValueError(f"no episode has ended yet in the training in {run.folder}")
        x = [row["steps"] for row in rows]
        returns = np.interp(np.linspace(x[0], x[-1], POINTS), x, [row["mean_return"] for row in rows])
        return cls(first=x[0], last=x[-1], mean_return=[float(f"{value:.{_DIGITS}g}") for value in returns], again=again)

    def at(self, x: Floats) -> Floats:
        """Return the mean returns at ``x``."""
        return np.interp(x, np.linspace(self.first, self.last, len(self.mean_return)), self.mean_return)


class Trainings(BaseModel):
    """Learning curves of agents on one task, over environment steps."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    env_id: str
    scenario: ScenarioId
    trainings: dict[str, Training]
    """Curves by name and training seed, such as ``ppo-seed0``."""

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file.

        Raises:
            ValueError: it cannot be read, or holds no learning curves.
        """
        try:
            return cls.model_validate_json(path.read_bytes())
        except (OSError, ValidationError) as error:
            raise ValueError(f"{path} holds no learning curves: {error}") from error

    def write(self, path: Path) -> None:
        """Write a file, all of it or nothing: a line per training."""
        lines = (
            f"  {json.dumps(label)}: {each.model_dump_json(exclude_defaults=True)}"
            for label, each in sorted(self.trainings.items())
        )
        head = f' "env_id": {json.dumps(self.env_id)},\n "scenario": {self.scenario.model_dump_json()},\n "trainings": {{\n'
        text = "{\n" + head + ",\n".join(lines) + "\n }\n}\n"
        replace_file(path, lambda partial: partial.write_text(text, "utf-8"))


class Curve(NamedTuple):
    """Learning curve of one algorithm: arrays of shape (POINTS,)."""

    seeds: int
    again: bool
    """Whether some were trained again: see ``Training``."""
    x: Floats
    """Environment steps."""
    mean: Floats
    """Mean return over training seeds [s]."""
    low: Floats
    """Lower end of its interval [s]; with one training seed, the mean."""
    high: Floats


def read(sources: Sequence[Path], again: bool = False) -> Trainings:
    """Return the learning curves of files and of run folders, which take the place of curves of the same name in the files.

    Raises:
        ValueError: a source holds no learning curve, or they cannot be compared. The message names them.
    """
    in_files, in_runs = dict[str, Training](), dict[str, Training]()
    tasks: dict[tuple[str, ScenarioId], Path] = {}
    runs: dict[str, Run] = {}
    for source in sources:
        if source.suffix == ".json":
            held, known = Trainings.read(source), in_files
            task, new = (held.env_id, held.scenario), held.trainings
        else:
            run, known = Run.read(source), in_runs
            first = runs.setdefault(run.algorithm, run)
            if run.parameters != first.parameters:
                raise ValueError(f"{first.folder} and {source} are trainings with different hyperparameters")
            task = (run.env_id, ScenarioId.of(run.scenario))
            new = {f"{run.algorithm}-seed{run.seed}": Training.of(run, again)}
        tasks.setdefault(task, source)
        if len(tasks) > 1:
            raise ValueError("{} and {} are trainings on different tasks".format(*tasks.values()))
        if twice := known.keys() & new:
            raise ValueError(f"{min(twice)} is given more than once")
        known.update(new)
    (env_id, scenario), *_ = tasks
    return Trainings(env_id=env_id, scenario=scenario, trainings=in_files | in_runs)


def curves(trainings: Mapping[str, Training]) -> dict[str, Curve]:
    """Return the curves of some trainings by algorithm, in their order.

    Raises:
        ValueError: those of an algorithm do not overlap.
    """
    groups: dict[str, list[Training]] = {}
    for label, training in trainings.items():
        groups.setdefault(label.rpartition("-seed")[0], []).append(training)
    return {name: curve(name, group) for name, group in groups.items()}


def curve(name: str, group: Sequence[Training]) -> Curve:
    """Return the mean curve over the common steps of one algorithm's trainings, with its bootstrap interval over training seeds.

    Raises:
        ValueError: they do not overlap.
    """
    start, end = max(each.first for each in group), min(each.last for each in group)
    if start > end:
        raise ValueError(f"the curves of {name} do not overlap: resume the unfinished trainings")
    x, count = np.linspace(start, end, POINTS), len(group)
    values = np.array([each.at(x) for each in group])
    resamples = np.random.default_rng(KEY).integers(count, size=(RESAMPLES, count))
    weights = np.stack([(resamples == seed).mean(axis=1) for seed in range(count)], axis=1)
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(weights @ values, [tail, 1.0 - tail], axis=0)
    return Curve(count, any(each.again for each in group), x, values.mean(axis=0), low, high)


def scale(found: Iterable[Curve]) -> tuple[float, list[float]]:
    """Return the bound of the linear part of an axis of returns, and its ticks.

    The axis is linear up to the decade of the final returns and logarithmic beyond, because the first returns are far away.
    """
    linear = 10.0 ** math.floor(math.log10(max(*(abs(each.mean[-1]) for each in found), 1e-3)))
    return linear, [0.0, *(sign * share * linear for share in _TICKS for sign in (-1.0, 1.0))]
