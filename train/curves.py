"""Plot learning curves: mean return of each algorithm over environment steps.

    python -m train.curves runs/RoughTurning-v0/*/*-seed* --out curves.png --level predictive=-75
    python -m train.curves runs/RoughTurning-v0/*/*-seed* --out my-agents/learning_curves.json
    python -m train.curves agents/RoughTurning-v0/rough_turning/learning_curves.json

A line is the mean over an algorithm's training seeds, its band the 95 % bootstrap interval over
them. Returns are those of the training episodes, in which the agent explores. ``--level`` adds a
horizontal line for comparison, such as a controller's return.

If ``--out`` ends in .json, the command writes the curves themselves, thinned, one line per
training. You can draw such files again, and give them with run folders. The curves of run folders
replace those of the same name.
"""

import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from baselines.policy_spec import ScenarioId
from leaderboard.statistics import CONFIDENCE, KEY, RESAMPLES
from train.run import Run
from turning_env.console import Parser, described, exits
from turning_env.files import read_regular, write_file
from turning_env.rendering import plot_style as style

FILE = "learning_curves.json"
"""Name of the file of learning curves beside agents."""
POINTS = 100
_DIGITS = 4  # significant ones, enough to draw

Floats = NDArray[np.float64]


class LearningCurve(BaseModel):
    """Learning curve of one training."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    first: float  # environment steps of its first value
    last: float
    mean_return: list[float] = Field(min_length=1)
    """Mean return [s] at equal distances from first to last."""

    @classmethod
    def of(cls, run: Run) -> Self:
        """Return the learning curve of a run.

        Raises:
            ValueError: the folder holds no learning curve.
        """
        rows = run.read_learning_curve()
        if not rows:
            raise ValueError(f"no episode has ended yet in the training in {run.folder}")
        steps = [row["steps"] for row in rows]
        mean_returns = [row["mean_return"] for row in rows]
        grid = np.linspace(steps[0], steps[-1], POINTS)
        thinned = np.interp(grid, steps, mean_returns)
        return cls(
            first=steps[0],
            last=steps[-1],
            mean_return=[float(f"{value:.{_DIGITS}g}") for value in thinned],
        )

    def at(self, steps: Floats) -> Floats:
        """Return the mean returns [s] at some environment steps."""
        grid = np.linspace(self.first, self.last, len(self.mean_return))
        return np.interp(steps, grid, self.mean_return)


class Trainings(BaseModel):
    """Learning curves of agents that were trained on one task."""

    model_config = ConfigDict(frozen=True)

    env_id: str
    scenario: ScenarioId  # the scenario or the family
    trainings: dict[str, LearningCurve]  # curves by name and training seed, such as ppo-seed0

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file.

        Raises:
            ValueError: the file cannot be read, or holds no learning curves.
        """
        try:
            return cls.model_validate_json(read_regular(path))
        except OSError as error:
            raise ValueError(f"{path} cannot be read: {error.strerror}") from error
        except ValidationError as error:
            raise ValueError(f"{path} holds no learning curves: {error}") from error

    def write(self, path: Path) -> None:
        """Write a file, all of it or nothing: one line per training."""
        lines = [
            f"  {json.dumps(label)}: {training.model_dump_json()}"
            for label, training in sorted(self.trainings.items())
        ]
        text = (
            "{\n"
            f' "env_id": {json.dumps(self.env_id)},\n'
            f' "scenario": {self.scenario.model_dump_json()},\n'
            ' "trainings": {\n' + ",\n".join(lines) + "\n }\n}\n"
        )
        write_file(path, text)


class Curve(NamedTuple):
    """Learning curve of one algorithm: arrays of shape (POINTS,)."""

    seeds: int  # number of training seeds
    steps: Floats  # environment steps
    mean: Floats  # mean return over training seeds [s]
    low: Floats  # lower end of its interval [s]; with one training seed, the mean
    high: Floats


def read(sources: Sequence[Path], name: str | None = None) -> Trainings:
    """Return the curves of files and of run folders.

    The curves of run folders replace those of the same name in files.

    Args:
        sources: paths of files and of run folders.
        name: name of the agent of the run folders; None: its algorithm's.

    Raises:
        ValueError: the trainings are not comparable, or one is given more than once.
    """
    from_files: dict[str, LearningCurve] = {}
    from_runs: dict[str, LearningCurve] = {}
    tasks: dict[tuple[str, ScenarioId], Path] = {}
    runs: dict[str, Run] = {}
    for source in sources:
        if source.suffix == ".json":
            file = Trainings.read(source)
            task = (file.env_id, file.scenario)
            _add(from_files, file.trainings)
        else:
            run = Run.read(source)
            first = runs.setdefault(run.algorithm, run)
            if run.parameters != first.parameters:
                raise ValueError(
                    f"{first.folder} and {source} are trainings with different hyperparameters"
                )
            task = (run.env_id, run.task)
            label = f"{name or run.algorithm}-seed{run.seed}"
            _add(from_runs, {label: LearningCurve.of(run)})
        tasks.setdefault(task, source)
        if len(tasks) > 1:
            first_source, other_source = tasks.values()
            raise ValueError(f"{first_source} and {other_source} are trainings on different tasks")
    env_id, scenario = next(iter(tasks))
    return Trainings(env_id=env_id, scenario=scenario, trainings=from_files | from_runs)


def _add(trainings: dict[str, LearningCurve], more: Mapping[str, LearningCurve]) -> None:
    """Add trainings to others. Raise ValueError if one is there already."""
    twice = trainings.keys() & more
    if twice:
        raise ValueError(f"{min(twice)} is given more than once")
    trainings.update(more)


def curves(trainings: Mapping[str, LearningCurve]) -> dict[str, Curve]:
    """Return each algorithm's mean curve over the common steps of its trainings.

    Raises:
        ValueError: the trainings of an algorithm have no steps in common.
    """
    # Labels are a name and a training seed, such as ppo-seed0.
    groups: dict[str, list[LearningCurve]] = {}
    for label, training in trainings.items():
        groups.setdefault(label.rpartition("-seed")[0], []).append(training)
    return {name: _mean_curve(name, group) for name, group in groups.items()}


def _mean_curve(name: str, group: Sequence[LearningCurve]) -> Curve:
    """Return the mean of some trainings, with its bootstrap interval over training seeds."""
    start = max(training.first for training in group)
    end = min(training.last for training in group)
    if start > end:
        raise ValueError(f"the curves of {name} do not overlap: resume the unfinished trainings")
    steps = np.linspace(start, end, POINTS)
    values = np.array([training.at(steps) for training in group])

    # A resample draws as many trainings as there are; its mean weights each by how often it is
    # drawn.
    count = len(group)
    resamples = np.random.default_rng(KEY).integers(count, size=(RESAMPLES, count))
    weights = np.stack([(resamples == index).mean(axis=1) for index in range(count)], axis=1)
    tails = [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE]
    low, high = np.quantile(weights @ values, tails, axis=0)
    return Curve(seeds=count, steps=steps, mean=values.mean(axis=0), low=low, high=high)


def draw(algorithm_curves: Mapping[str, Curve], levels: Mapping[str, float]) -> Figure:
    """Return a figure with a line per algorithm and per level; call it within ``style.for_print``.

    Raises:
        ValueError: there are more algorithms than line styles.
    """
    if len(algorithm_curves) > len(style.LINES):
        raise ValueError(
            f"{len(algorithm_curves)} algorithms do not fit on one figure: "
            f"at most {len(style.LINES)}"
        )
    figure = Figure(figsize=(style.DOUBLE, 4.4), layout="constrained")
    axes: Axes = figure.subplots()
    # The first returns are far away: the scale is linear up to the decade of the final returns,
    # and logarithmic beyond. It is set first, as margins follow from it.
    largest = max(1e-3, *(abs(curve.mean[-1]) for curve in algorithm_curves.values()))
    linear = 10.0 ** math.floor(math.log10(largest))
    axes.set_yscale("symlog", linthresh=linear, subs=[2, 5])

    looks = style.policy_looks(algorithm_curves)
    for (name, curve), (colour, dashes) in zip(algorithm_curves.items(), looks, strict=True):
        seeds = "1 seed" if curve.seeds == 1 else f"{curve.seeds} seeds"
        axes.fill_between(
            curve.steps, curve.low, curve.high, color=colour, alpha=0.2, linewidth=0.0
        )
        axes.plot(curve.steps, curve.mean, color=colour, linestyle=dashes, label=f"{name}, {seeds}")
    for name, level in levels.items():
        axes.axhline(level, color=style.GREY, linewidth=0.8, linestyle=":", zorder=0)
        axes.annotate(
            f"{name} {level:g} s",
            xy=(0.0, level),
            xytext=(4, 2),
            xycoords=("axes fraction", "data"),
            textcoords="offset points",
            color=style.GREY,
        )

    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.set_ylabel(
        "mean return per training episode [s]\n"
        f"{CONFIDENCE:.0%} interval; linear up to ±{linear:g}, logarithmic beyond"
    )
    axes.set_xlabel("environment steps")
    axes.xaxis.set_major_formatter(EngFormatter())
    axes.set_xlim(left=0.0)
    axes.grid()
    axes.legend(loc="lower right", frameon=True, framealpha=1.0, edgecolor="none")
    return figure


def named_level(text: str) -> tuple[str, float]:
    """Return the name and the return [s] of ``NAME=VALUE``; raise ValueError for another text."""
    name, separator, value = text.rpartition("=")
    level = float(value)
    if not separator or not name or not math.isfinite(level):
        raise ValueError
    return name, level


@exits(ValueError)
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = Parser(prog="python -m train.curves", **described(__doc__))
    parser.add_argument(
        "sources",
        nargs="+",
        type=Path,
        metavar="RUN_FOLDER",
        help=f"folders of trainings on one task, or a file of their curves such as {FILE}",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("docs/learning_curves.png"),
        metavar="FILE",
        help="picture to write: PNG, SVG or PDF, by its suffix; or JSON, the curves themselves "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--name", help="name of the agent of the folders (default: its algorithm's)"
    )
    parser.add_argument(
        "--level",
        action="append",
        default=[],
        type=named_level,
        metavar="NAME=VALUE",
        help="draw a horizontal line at this return [s]",
    )
    parsed = parser.parse_args(arguments)
    trainings = read(parsed.sources, parsed.name)
    if parsed.out.suffix == ".json":
        trainings.write(parsed.out)
    else:
        with style.for_print():
            figure = draw(curves(trainings.trainings), dict(parsed.level))
            style.save(figure, parsed.out)
    print(f"{parsed.out}: {trainings.env_id}, {trainings.scenario.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
