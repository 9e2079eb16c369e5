"""Figures 13 to 15 of Alaskari and Oraby (2018): the grid search against fixed speeds and feeds."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from papers.figures.minutes import paper_run
from papers.figures.optima import PAPER
from papers.figures.plate import Plate
from papers.reproduce.alaskari_oraby import adaptive_control, rival_checks, rivals, whole_run
from papers.verification import wear
from turning_env.workshop import plot_style as style

_SPEEDS = {100.0: style.LINES[1], 145.0: style.LINES[2], 206.0: style.LINES[6]}
_MEASURED: dict[str, Any] = style.PRINTED | {"marker": "s"}


def draw() -> Figure:
    """Wear over time of the tests and of the grid search; and the ratios of metal per minute."""
    figure = Figure(figsize=(style.DOUBLE, 3.3), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
    style.letter(left, "a")
    style.letter(right, "b")
    _draw_wear(left)
    _draw_ratios(right)
    return figure


def _draw_wear(axes: Axes) -> None:
    criterion = paper_run().scenario.tool.wear_criterion
    worn = [interval.wear for interval in whole_run()]
    axes.plot(range(1, len(worn) + 1), worn, **style.OURS, label="grid search")
    labelled = set()
    for place, rival in enumerate(sorted(rivals(), key=lambda rival: rival.nominal.life)):
        test, (colour, dashes) = rival.test, _SPEEDS[rival.test.cutting_speed]
        minutes = np.geomspace(1.0, rival.nominal.life, 50)
        label = None if test.cutting_speed in labelled else f"tests at {test.cutting_speed:.0f} m/min, models"
        labelled.add(test.cutting_speed)
        axes.plot(minutes, [wear(test, minute) for minute in minutes], color=colour, linestyle=dashes, label=label)
        axes.annotate(
            test.name,
            (minutes[-1], criterion),
            xytext=(0, 4 + 10 * (place % 2)),
            textcoords="offset points",
            ha="center",
            color=colour,
        )
    lives = {rival.test.name: rival.test.life for rival in rivals() if rival.test.life is not None}
    label = f"lives in the paper: {', '.join(sorted(lives, key=lambda name: lives[name]))}"
    axes.plot(list(lives.values()), [criterion] * len(lives), **_MEASURED, label=label)
    axes.axhline(criterion, **style.LIMIT)
    axes.set_xscale("log")
    axes.set_xticks((1, 2, 5, 10, 20, 50, 100, 200), ("1", "2", "5", "10", "20", "50", "100", "200"))
    axes.minorticks_off()
    axes.set_ylim(0.0, 0.345)
    axes.set_xlabel("cutting time [min], log scale")
    axes.set_ylabel("wear [mm]")
    axes.legend(loc="lower right")


def _draw_ratios(axes: Axes) -> None:
    rate, names = adaptive_control().rate, [rival.test.name for rival in rivals()]
    places = np.arange(len(names))
    axes.plot(places, [rate / rival.nominal.rate for rival in rivals()], **style.OURS | {"linestyle": "none"}, label="project")
    axes.plot(places, [rival.test.rate_ratio for rival in rivals()], **style.PRINTED, label="paper")
    axes.axhline(1.0, color=style.GREY, linewidth=0.6)
    axes.set_yscale("log")
    axes.set_yticks((1, 2, 3, 5, 10), ("1", "2", "3", "5", "10"))
    axes.minorticks_off()
    axes.set_xticks(places, names)
    axes.set_xlabel("test at fixed speed and feed")
    axes.set_ylabel("grid search over test,\nmetal per minute [-], log scale")
    axes.legend(loc="upper right")


PLATES = (
    Plate(
        "grid_search_13",
        f"{PAPER}, Figures 13 to 15",
        "The grid search against tests at fixed speed and feed: a) wear over cutting time, by the models; squares: when the "
        "paper's edges of T4, T5, T8 and T9 were worn out; b) metal per minute of the grid search over that of each test.",
        draw,
        rival_checks,
        "The figures that gave the tests' parameters are lost: feeds follow from the stated ratios at 2.5 mm depth of cut; "
        "of T6 and T7 nothing is known but their speed.",
    ),
)
