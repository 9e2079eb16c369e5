"""Plot learning curves: mean return of each algorithm over environment steps or time, over its training seeds.

    python -m train.curves runs/RoughTurning-v0/rough_turning/*-seed* --out docs/learning_curves.png --level predictive=-75

A line is the mean over an algorithm's training seeds, its band the 95 % bootstrap interval over them. Returns are those of the
training episodes, in which the agent explores. ``--level`` adds a horizontal line for comparison, such as a controller's return.
"""

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, FixedLocator, NullLocator
from numpy.typing import NDArray

from train.run import Run
from turning_env.console import described, exits
from turning_env.scoring.overload import CONFIDENCE, KEY, RESAMPLES
from turning_env.workshop import plot_style as style

POINTS = 200
_TICKS = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0)
"""Ticks of returns, over the bound of the axis's linear part."""

AXES = {"steps": "environment steps", "wall_time": "training time [s]"}

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Curve:
    """Learning curve of one algorithm: arrays of shape (POINTS,)."""

    seeds: int
    x: Floats
    """Environment steps, or training time [s]."""
    mean: Floats
    """Mean return over training seeds [s]."""
    low: Floats
    """Lower end of its interval [s]; with one training seed, the mean."""
    high: Floats
    """Upper end, likewise."""


def curves(folders: Sequence[Path], against: str) -> tuple[str, dict[str, Curve]]:
    """Return a title with the runs' task, and their curves by algorithm in the order of the folders.

    Raises:
        ValueError: a folder holds no run or no learning curve, or runs cannot be compared. The message names them.
    """
    runs = [Run.read(folder) for folder in folders]
    tasks = {(run.env_id, run.scenario.digest()): run for run in runs}
    if len(tasks) > 1:
        one, other, *_ = tasks.values()
        raise ValueError(f"{one.folder} and {other.folder} are trainings on different tasks")
    groups = {name: [run for run in runs if run.algorithm == name] for name in dict.fromkeys(run.algorithm for run in runs)}
    if len(groups) > len(style.LINES):
        raise ValueError(f"{len(groups)} algorithms do not fit on one figure: at most {len(style.LINES)}")
    return f"{runs[0].env_id}, scenario {runs[0].scenario.name}", {name: _curve(group, against) for name, group in groups.items()}


def _curve(runs: Sequence[Run], against: str) -> Curve:
    first = runs[0]
    for run in runs[1:]:
        if run.parameters != first.parameters:
            raise ValueError(f"{first.folder} and {run.folder} are trainings with different hyperparameters")
    if len({run.seed for run in runs}) < len(runs):
        raise ValueError(f"a training seed of {first.algorithm} is given more than once")
    tables = []
    for run in runs:
        rows = run.read_learning_curve()
        if not rows:
            raise ValueError(f"no episode has ended yet in the training in {run.folder}")
        tables.append([np.array([row[name] for row in rows]) for name in (against, "mean_return")])
    start, end = max(x[0] for x, _ in tables), min(x[-1] for x, _ in tables)
    if start > end:
        raise ValueError(f"the curves of {first.algorithm} do not overlap: resume the unfinished trainings")
    x = np.linspace(start, end, POINTS)
    values = np.array([np.interp(x, steps, returns) for steps, returns in tables])
    low, high = interval(values)
    return Curve(len(runs), x, values.mean(axis=0), low, high)


def interval(values: Floats) -> tuple[Floats, Floats]:
    """Return the percentile bootstrap interval of the mean over axis 0 (training seeds), one per entry of axis 1."""
    count = len(values)
    resamples = np.random.default_rng(KEY).integers(count, size=(RESAMPLES, count))
    weights = np.stack([(resamples == seed).mean(axis=1) for seed in range(count)], axis=1)
    tail = (1.0 - CONFIDENCE) / 2.0
    low, high = np.quantile(weights @ values, [tail, 1.0 - tail], axis=0)
    return low, high


def draw(found: Mapping[str, Curve], levels: Mapping[str, float], against: str) -> Figure:
    """Return a figure with a line per algorithm and per level; call it within ``style.for_print``."""
    figure = Figure(figsize=(style.DOUBLE, 4.4), layout="constrained")
    axes: Axes = figure.subplots()
    for (name, curve), (colour, dashes) in zip(found.items(), style.policy_looks(found), strict=True):
        seeds = f"{curve.seeds} seed{'s' if curve.seeds > 1 else ''}"
        axes.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.2, linewidth=0.0)
        axes.plot(curve.x, curve.mean, color=colour, linestyle=dashes, label=f"{name}, {seeds}")
    for name, level in levels.items():
        axes.axhline(level, color=style.GREY, linewidth=0.8, linestyle=":", zorder=0)
        axes.annotate(
            f"{name} {level:g} s",
            (0.0, level),
            xycoords=("axes fraction", "data"),
            xytext=(4, 2),
            textcoords="offset points",
            color=style.GREY,
        )
    # Linear up to the decade of the final returns; logarithmic beyond, because the first returns are far away.
    final = max(max(abs(curve.mean[-1]) for curve in found.values()), 1e-3)
    linear = 10.0 ** math.floor(math.log10(final))
    ticks = [0.0, *(sign * share * linear for share in _TICKS for sign in (-1.0, 1.0))]
    axes.set_yscale("symlog", linthresh=linear)
    axes.yaxis.set_major_locator(FixedLocator(ticks))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")
    scale = f"linear up to ±{linear:g}, logarithmic beyond"
    axes.set_ylabel(f"mean return per training episode [s]\n{CONFIDENCE:.0%} interval; {scale}")
    axes.set_xlabel(AXES[against])
    axes.xaxis.set_major_formatter(EngFormatter())
    axes.set_xlim(left=0.0)
    axes.grid()
    axes.legend(loc="lower right", frameon=True, framealpha=1.0, edgecolor="none")
    return figure


def _level(text: str) -> tuple[str, float]:
    """Return the name and the return [s] of ``NAME=VALUE``.

    Raises:
        ValueError: the text has another form.
    """
    name, separator, value = text.rpartition("=")
    try:
        level = float(value)
    except ValueError:
        level = math.nan
    if not (separator and name and math.isfinite(level)):
        raise ValueError(f"--level is {text!r}, but must be NAME=VALUE with a return in s")
    return name, level


@exits(ValueError)
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m train.curves", **described(__doc__))
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN_FOLDER", help="folders of trainings on one task")
    out_help = "picture to write: PNG, SVG or PDF, by its suffix (default: %(default)s)"
    parser.add_argument("--out", type=Path, default=Path("docs/learning_curves.png"), metavar="PICTURE", help=out_help)
    level_help = "draw a horizontal line at this return [s]"
    parser.add_argument("--level", action="append", default=[], metavar="NAME=VALUE", help=level_help)
    parser.add_argument("--against", choices=list(AXES), default="steps", help="horizontal axis (default: %(default)s)")
    parsed = parser.parse_args(arguments)
    levels = dict(map(_level, parsed.level))
    title, found = curves(parsed.runs, parsed.against)
    with style.for_print():
        style.save(draw(found, levels, parsed.against), parsed.out)
    print(f"{parsed.out}: {title}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
