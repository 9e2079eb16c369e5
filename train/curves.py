"""Plot learning curves: mean return of each algorithm over environment steps, over its training seeds.

    python -m train.curves runs/RoughTurning-v0/rough_turning/*-seed* --out curves.png --level predictive=-75
    python -m train.curves runs/RoughTurning-v0/rough_turning/*-seed* --out my-agents/learning_curves.json
    python -m train.curves agents/RoughTurning-v0/rough_turning/learning_curves.json

A line is the mean over an algorithm's training seeds, its band the 95 % bootstrap interval over them. Returns are those of the
training episodes, in which the agent explores. ``--level`` adds a horizontal line for comparison, such as a controller's return.
An ``--out`` that ends in .json gets the curves themselves, thinned, a line per training. Such files can be drawn, too, or given
with run folders, which replace the curves of the same name.
"""

import argparse
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

from train.run import Run
from turning_env.console import described, exits
from turning_env.files import replace_file
from turning_env.rendering import plot_style as style
from turning_env.scoring.policy import ScenarioId
from turning_env.scoring.statistics import CONFIDENCE, KEY, RESAMPLES

FILE = "learning_curves.json"  # name of the file of learning curves beside agents
POINTS = 100
_DIGITS = 4  # significant ones, enough to draw

Floats = NDArray[np.float64]


class Training(BaseModel):
    """Learning curve of one training."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    first: float  # environment steps of its first value
    last: float
    mean_return: list[float] = Field(
        min_length=1
    )  # mean return [s] at equal distances from first to last

    @classmethod
    def of(cls, run: Run) -> Self:
        """Return the learning curve of a run. Raise ValueError if the folder holds none."""
        rows = run.read_learning_curve()
        if not rows:
            raise ValueError(f"no episode has ended yet in the training in {run.folder}")
        steps = [row["steps"] for row in rows]
        returns = np.interp(
            np.linspace(steps[0], steps[-1], POINTS), steps, [row["mean_return"] for row in rows]
        )
        return cls(
            first=steps[0],
            last=steps[-1],
            mean_return=[float(f"{value:.{_DIGITS}g}") for value in returns],
        )

    def at(self, steps: Floats) -> Floats:
        """Return the mean returns [s] at some environment steps."""
        return np.interp(
            steps, np.linspace(self.first, self.last, len(self.mean_return)), self.mean_return
        )


class Trainings(BaseModel):
    """Learning curves of agents that were trained on one task."""

    model_config = ConfigDict(frozen=True)

    env_id: str
    scenario: ScenarioId  # the scenario or the family
    trainings: dict[str, Training]  # curves by name and training seed, such as ppo-seed0

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file. Raise ValueError if it cannot be read, or holds no learning curves."""
        try:
            return cls.model_validate_json(path.read_bytes())
        except (OSError, ValidationError) as error:
            raise ValueError(f"{path} holds no learning curves: {error}") from error

    def write(self, path: Path) -> None:
        """Write a file, all of it or nothing: a line per training."""
        lines = (
            f"  {json.dumps(label)}: {each.model_dump_json()}"
            for label, each in sorted(self.trainings.items())
        )
        head = f' "env_id": {json.dumps(self.env_id)},\n "scenario": {self.scenario.model_dump_json()},\n "trainings": {{\n'
        text = "{\n" + head + ",\n".join(lines) + "\n }\n}\n"
        replace_file(path, lambda partial: partial.write_text(text, "utf-8"))


class Curve(NamedTuple):
    """Learning curve of one algorithm: arrays of shape (POINTS,)."""

    seeds: int  # number of training seeds
    steps: Floats  # environment steps
    mean: Floats  # mean return over training seeds [s]
    low: Floats  # lower end of its interval [s]; with one training seed, the mean
    high: Floats


def read(sources: Sequence[Path], name: str | None = None) -> Trainings:
    """Return the curves of files and of run folders, which replace those of the same name; ValueError if not comparable.

    ``name``: that of the agent of the run folders; None: its algorithm's.
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
                raise ValueError(
                    f"{first.folder} and {source} are trainings with different hyperparameters"
                )
            task, new = (
                (run.env_id, run.task),
                {f"{name or run.algorithm}-seed{run.seed}": Training.of(run)},
            )
        tasks.setdefault(task, source)
        if len(tasks) > 1:
            raise ValueError("{} and {} are trainings on different tasks".format(*tasks.values()))
        if twice := known.keys() & new:
            raise ValueError(f"{min(twice)} is given more than once")
        known.update(new)
    (env_id, scenario), *_ = tasks
    return Trainings(env_id=env_id, scenario=scenario, trainings=in_files | in_runs)


def curves(trainings: Mapping[str, Training]) -> dict[str, Curve]:
    """Return each algorithm's mean curve over the common steps of its trainings, with its bootstrap interval over seeds."""
    groups: dict[str, list[Training]] = {}
    for label, training in trainings.items():
        groups.setdefault(label.rpartition("-seed")[0], []).append(training)
    found = {}
    for name, group in groups.items():
        start, end = max(each.first for each in group), min(each.last for each in group)
        if start > end:
            raise ValueError(
                f"the curves of {name} do not overlap: resume the unfinished trainings"
            )
        steps, count = np.linspace(start, end, POINTS), len(group)
        values = np.array([each.at(steps) for each in group])
        resamples = np.random.default_rng(KEY).integers(count, size=(RESAMPLES, count))
        weights = np.stack([(resamples == seed).mean(axis=1) for seed in range(count)], axis=1)
        low, high = np.quantile(
            weights @ values, [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE], axis=0
        )
        found[name] = Curve(count, steps, values.mean(axis=0), low, high)
    return found


def draw(found: Mapping[str, Curve], levels: Mapping[str, float]) -> Figure:
    """Return a figure with a line per algorithm and per level; call it within ``style.for_print``."""
    if len(found) > len(style.LINES):
        raise ValueError(
            f"{len(found)} algorithms do not fit on one figure: at most {len(style.LINES)}"
        )
    figure = Figure(figsize=(style.DOUBLE, 4.4), layout="constrained")
    axes: Axes = figure.subplots()
    for (name, curve), (colour, dashes) in zip(
        found.items(), style.policy_looks(found), strict=True
    ):
        seeds = f"{curve.seeds} seed{'s' if curve.seeds > 1 else ''}"
        axes.fill_between(
            curve.steps, curve.low, curve.high, color=colour, alpha=0.2, linewidth=0.0
        )
        axes.plot(curve.steps, curve.mean, color=colour, linestyle=dashes, label=f"{name}, {seeds}")
    for name, level in levels.items():
        axes.axhline(level, color=style.GREY, linewidth=0.8, linestyle=":", zorder=0)
        axes.annotate(
            f"{name} {level:g} s",
            (0.0, level),
            (4, 2),
            ("axes fraction", "data"),
            "offset points",
            color=style.GREY,
        )
    # The first returns are far away: linear up to the decade of the final returns, and logarithmic beyond.
    linear = 10.0 ** math.floor(
        math.log10(max(*(abs(each.mean[-1]) for each in found.values()), 1e-3))
    )
    axes.set_yscale("symlog", linthresh=linear, subs=[2, 5])
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    axes.set_ylabel(
        f"mean return per training episode [s]\n{CONFIDENCE:.0%} interval; linear up to ±{linear:g}, logarithmic beyond"
    )
    axes.set_xlabel("environment steps")
    axes.xaxis.set_major_formatter(EngFormatter())
    axes.set_xlim(left=0.0)
    axes.grid()
    axes.legend(loc="lower right", frameon=True, framealpha=1.0, edgecolor="none")
    return figure


def named_level(text: str) -> tuple[str, float]:
    """Return the name and the return [s] of ``NAME=VALUE``."""
    name, separator, value = text.rpartition("=")
    if not (separator and name and math.isfinite(level := float(value))):
        raise ValueError
    return name, level


@exits(ValueError)
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m train.curves", **described(__doc__))
    sources_help = f"folders of trainings on one task, or a file of their curves such as {FILE}"
    parser.add_argument("sources", nargs="+", type=Path, metavar="RUN_FOLDER", help=sources_help)
    out_help = "picture to write: PNG, SVG or PDF, by its suffix; or JSON, the curves themselves (default: %(default)s)"
    parser.add_argument(
        "--out", type=Path, default=Path("docs/learning_curves.png"), metavar="FILE", help=out_help
    )
    parser.add_argument(
        "--name", help="name of the agent of the folders (default: its algorithm's)"
    )
    level_help = "draw a horizontal line at this return [s]"
    parser.add_argument(
        "--level",
        action="append",
        default=[],
        type=named_level,
        metavar="NAME=VALUE",
        help=level_help,
    )
    parsed = parser.parse_args(arguments)
    found = read(parsed.sources, parsed.name)
    if parsed.out.suffix == ".json":
        found.write(parsed.out)
    else:
        with style.for_print():
            style.save(draw(curves(found.trainings), dict(parsed.level)), parsed.out)
    print(f"{parsed.out}: {found.env_id}, {found.scenario.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
