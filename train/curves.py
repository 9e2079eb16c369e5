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
import math
import sys
from collections.abc import Mapping
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, FixedLocator, NullLocator

from train.learning_curves import FILE, Curve, curves, read, scale
from turning_env.console import described, exits
from turning_env.scoring.statistics import CONFIDENCE
from turning_render import plot_style as style


def draw(found: Mapping[str, Curve], levels: Mapping[str, float]) -> Figure:
    """Return a figure with a line per algorithm and per level; call it within ``style.for_print``."""
    if len(found) > len(style.LINES):
        raise ValueError(f"{len(found)} algorithms do not fit on one figure: at most {len(style.LINES)}")
    figure = Figure(figsize=(style.DOUBLE, 4.4), layout="constrained")
    axes: Axes = figure.subplots()
    for (name, curve), (colour, dashes) in zip(found.items(), style.policy_looks(found), strict=True):
        seeds = f"{curve.seeds} seed{'s' if curve.seeds > 1 else ''}"
        axes.fill_between(curve.x, curve.low, curve.high, color=colour, alpha=0.2, linewidth=0.0)
        axes.plot(curve.x, curve.mean, color=colour, linestyle=dashes, label=f"{name}, {seeds}")
    for name, level in levels.items():
        axes.axhline(level, color=style.GREY, linewidth=0.8, linestyle=":", zorder=0)
        axes.annotate(f"{name} {level:g} s", (0.0, level), (4, 2), ("axes fraction", "data"), "offset points", color=style.GREY)
    linear, ticks = scale(found.values())
    axes.set_yscale("symlog", linthresh=linear)
    axes.yaxis.set_major_locator(FixedLocator(ticks))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")
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
    parser.add_argument("--out", type=Path, default=Path("docs/learning_curves.png"), metavar="FILE", help=out_help)
    level_help = "draw a horizontal line at this return [s]"
    parser.add_argument("--level", action="append", default=[], type=named_level, metavar="NAME=VALUE", help=level_help)
    again_help = "say that the runs repeat the trainings of the agents' files with the same settings"
    parser.add_argument("--again", action="store_true", help=again_help)
    parsed = parser.parse_args(arguments)
    found = read(parsed.sources, parsed.again)
    if parsed.out.suffix == ".json":
        found.write(parsed.out)
    else:
        with style.for_print():
            style.save(draw(curves(found.trainings), dict(parsed.level)), parsed.out)
    print(f"{parsed.out}: {found.env_id}, scenario {found.scenario.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
