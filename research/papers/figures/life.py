"""Figures 11 to 15 of Alaskari and Oraby (2018): the whole life of an edge, by the grid search and at fixed speeds and feeds."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from research.papers.figures import legend, lettered
from research.papers.grid_search import LIMITS, SCENARIO, whole_life
from research.papers.reproduce.alaskari_oraby import STATED, adaptive_control, rivals
from research.papers.verification import wear
from turning_env.rendering import plot_style as style

_SPEEDS = {100.0: style.LINES[1], 145.0: style.LINES[2], 206.0: style.LINES[6]}
_MEASURED: dict[str, Any] = style.PRINTED | {"marker": "s"}


def draw_responses() -> Figure:
    """Draw force, power and removal rate over the minutes, with their limits."""
    run, (force, power, _) = whole_life(), LIMITS
    subjects = (
        ("thrust force [N]", [minute.thrust_force for minute in run], force),
        ("power [kW]", [minute.power for minute in run], power),
        ("removal rate [cm³/min]", [minute.removed for minute in run], None),
    )
    figure, panels = lettered((style.DOUBLE, 2.4), 1, 3)
    for axes, (label, values, limit) in zip(panels, subjects, strict=True):
        _over_minutes(axes, label, values)
        if limit is not None:
            axes.axhline(limit, **style.LIMIT)
        axes.set_ylim(0.0, 1.12 * max(*values, limit or 0.0))
    legend(figure, {"grid search, end of the minute": style.OURS, "limit": style.LIMIT}, 2)
    return figure


def draw_pairs() -> Figure:
    """Draw the chosen cutting speed and feed over the minutes, with the values that the text states."""
    figure, panels = lettered((style.SINGLE, 3.6), 2, 1, sharex=True)
    for place, (axes, name, unit) in enumerate(
        zip(panels, ("cutting speed", "feed"), ("m/min", "mm/rev"), strict=True)
    ):
        _over_minutes(axes, f"{name} [{unit}]", [minute.pair[place] for minute in whole_life()])
        axes.plot(list(STATED), [stated[place] for stated in STATED.values()], **style.PRINTED)
        axes.margins(y=0.15)
        axes.tick_params(labelbottom=True)
    legend(figure, {"grid search": style.OURS, "stated in the text": style.PRINTED}, 2)
    return figure


def _over_minutes(axes: Axes, label: str, values: list[float]) -> None:
    axes.plot(np.arange(1, len(values) + 1), values, **style.OURS)
    axes.set_xlim(0.0, len(values) + 1.0)
    axes.set_xticks(range(0, len(values) + 1, 2))
    axes.set_xlabel("cutting time [min]")
    axes.set_ylabel(label)


def draw_rivals() -> Figure:
    """Draw wear over time of the tests and of the grid search; and the ratios of metal per minute."""
    figure, (left, right) = lettered((style.DOUBLE, 3.3), 1, 2, width_ratios=(1.6, 1.0))
    _draw_wear(left)
    _draw_ratios(right)
    return figure


def _draw_wear(axes: Axes) -> None:
    criterion = SCENARIO.tool.wear_criterion
    worn = [minute.wear for minute in whole_life()]
    axes.plot(range(1, len(worn) + 1), worn, **style.OURS, label="grid search")
    labelled = set()
    for place, rival in enumerate(sorted(rivals(), key=lambda rival: rival.nominal.life)):
        test, (colour, dashes) = rival.test, _SPEEDS[rival.test.cutting_speed]
        minutes = np.geomspace(1.0, rival.nominal.life, 50)
        label = (
            None
            if test.cutting_speed in labelled
            else f"tests at {test.cutting_speed:.0f} m/min, models"
        )
        labelled.add(test.cutting_speed)
        axes.plot(
            minutes,
            [wear(test, minute) for minute in minutes],
            color=colour,
            linestyle=dashes,
            label=label,
        )
        offset: dict[str, Any] = {
            "xytext": (0, 4 + 10 * (place % 2)),
            "textcoords": "offset points",
        }
        axes.annotate(test.name, (minutes[-1], criterion), **offset, ha="center", color=colour)
    lives = {rival.test.name: rival.test.life for rival in rivals() if rival.test.life is not None}
    label = f"lives in the paper: {', '.join(sorted(lives, key=lambda name: lives[name]))}"
    axes.plot(list(lives.values()), [criterion] * len(lives), **_MEASURED, label=label)
    axes.axhline(criterion, **style.LIMIT)
    axes.set_xscale("log")
    axes.set_xticks(ticks := (1, 2, 5, 10, 20, 50, 100, 200), map(str, ticks))
    axes.minorticks_off()
    axes.set_ylim(0.0, 0.345)
    axes.set_xlabel("cutting time [min], log scale")
    axes.set_ylabel("wear [mm]")
    axes.legend(loc="lower right")


def _draw_ratios(axes: Axes) -> None:
    rate, names = adaptive_control().rate, [rival.test.name for rival in rivals()]
    places = np.arange(len(names))
    axes.plot(
        places,
        [rate / rival.nominal.rate for rival in rivals()],
        **style.OURS | {"linestyle": "none"},
        label="project",
    )
    axes.plot(places, [rival.test.rate_ratio for rival in rivals()], **style.PRINTED, label="paper")
    axes.axhline(1.0, color=style.GREY, linewidth=0.6)
    axes.set_yscale("log")
    axes.set_yticks((1, 2, 3, 5, 10), ("1", "2", "3", "5", "10"))
    axes.minorticks_off()
    axes.set_xticks(places, names)
    axes.set_xlabel("test at fixed speed and feed")
    axes.set_ylabel("grid search over test,\nmetal per minute [-], log scale")
    axes.legend(loc="upper right")
