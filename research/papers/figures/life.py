"""Figures 11 to 15 of Alaskari and Oraby (2018): the whole life of an edge.

They compare the grid search with tests at fixed speeds and feeds. ``minutes.py`` draws single
minutes of that life.
"""

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
    minutes = whole_life()
    responses: dict[str, list[float]] = {
        "thrust force [N]": [minute.thrust_force for minute in minutes],
        "power [kW]": [minute.power for minute in minutes],
        "removal rate [cm³/min]": [minute.removed for minute in minutes],
    }
    limits = {"thrust force [N]": LIMITS.force, "power [kW]": LIMITS.power}

    figure, panels = lettered((style.DOUBLE, 2.4), rows=1, columns=3)
    for axes, (label, values) in zip(panels, responses.items(), strict=True):
        _over_minutes(axes, label, values)
        highest = max(values)
        if label in limits:
            axes.axhline(limits[label], **style.LIMIT)
            highest = max(highest, limits[label])
        axes.set_ylim(0.0, 1.12 * highest)
    legend(figure, {"grid search, end of the minute": style.OURS, "limit": style.LIMIT}, columns=2)
    return figure


def draw_pairs() -> Figure:
    """Draw the chosen cutting speed and feed over the minutes, with those stated in the text."""
    figure, panels = lettered((style.SINGLE, 3.6), rows=2, columns=1, sharex=True)
    labels = ("cutting speed [m/min]", "feed [mm/rev]")
    stated_minutes = list(STATED)
    for index, (axes, label) in enumerate(zip(panels, labels, strict=True)):
        chosen_values = [minute.pair[index] for minute in whole_life()]
        stated_values = [pair[index] for pair in STATED.values()]
        _over_minutes(axes, label, chosen_values)
        axes.plot(stated_minutes, stated_values, **style.PRINTED)
        axes.margins(y=0.15)
        axes.tick_params(labelbottom=True)
    looks = {
        "grid search": style.OURS,
        "stated in the text": style.PRINTED,
    }
    legend(figure, looks, columns=2)
    return figure


def _over_minutes(axes: Axes, label: str, values: list[float]) -> None:
    count = len(values)
    minutes = np.arange(1, count + 1)
    axes.plot(minutes, values, **style.OURS)
    axes.set_xlim(0.0, count + 1.0)
    axes.set_xticks(range(0, count + 1, 2))
    axes.set_xlabel("cutting time [min]")
    axes.set_ylabel(label)


def draw_rivals() -> Figure:
    """Draw wear over time of the tests and the grid search, and the ratios of metal per minute."""
    figure, (wear_axes, ratio_axes) = lettered(
        (style.DOUBLE, 3.3), rows=1, columns=2, width_ratios=(1.6, 1.0)
    )
    _draw_wear(wear_axes)
    _draw_ratios(ratio_axes)
    return figure


def _draw_wear(axes: Axes) -> None:
    criterion = SCENARIO.tool.wear_criterion
    grid_search_wear = [minute.wear for minute in whole_life()]
    minutes = range(1, len(grid_search_wear) + 1)
    axes.plot(minutes, grid_search_wear, **style.OURS, label="grid search")

    by_life = sorted(rivals(), key=lambda rival: rival.nominal.life)
    labelled_speeds = set()
    for index, rival in enumerate(by_life):
        test = rival.test
        colour, dashes = _SPEEDS[test.cutting_speed]

        # The legend has one entry for all tests at a cutting speed.
        label = None
        if test.cutting_speed not in labelled_speeds:
            label = f"tests at {test.cutting_speed:.0f} m/min, models"
            labelled_speeds.add(test.cutting_speed)

        times = np.geomspace(1.0, rival.nominal.life, 50)
        wear_at_times = [wear(test, time) for time in times]
        axes.plot(times, wear_at_times, color=colour, linestyle=dashes, label=label)

        # Names of tests with similar lives would overlap at one height.
        axes.annotate(
            test.name,
            (times[-1], criterion),
            xytext=(0, 4 + 10 * (index % 2)),
            textcoords="offset points",
            ha="center",
            color=colour,
        )

    _draw_measured_lives(axes, criterion)
    axes.axhline(criterion, **style.LIMIT)
    axes.set_xscale("log")
    ticks = (1, 2, 5, 10, 20, 50, 100, 200)
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.minorticks_off()
    axes.set_ylim(0.0, 0.345)
    axes.set_xlabel("cutting time [min], log scale")
    axes.set_ylabel("wear [mm]")
    axes.legend(loc="lower right")


def _draw_measured_lives(axes: Axes, criterion: float) -> None:
    """Mark the lives that the paper states, at the wear at which they end."""
    lives: dict[str, float] = {}
    for rival in rivals():
        if rival.test.life is not None:
            lives[rival.test.name] = rival.test.life
    names = ", ".join(sorted(lives, key=lambda name: lives[name]))
    axes.plot(
        list(lives.values()),
        [criterion] * len(lives),
        **_MEASURED,
        label=f"lives in the paper: {names}",
    )


def _draw_ratios(axes: Axes) -> None:
    rate = adaptive_control().rate
    names = []
    ratios = []
    printed_ratios = []
    for rival in rivals():
        names.append(rival.test.name)
        ratios.append(rate / rival.nominal.rate)
        printed_ratios.append(rival.test.rate_ratio)
    positions = np.arange(len(names))

    markers_only = style.OURS | {"linestyle": "none"}
    axes.plot(positions, ratios, **markers_only, label="project")
    axes.plot(positions, printed_ratios, **style.PRINTED, label="paper")
    axes.axhline(1.0, color=style.GREY, linewidth=0.6)

    axes.set_yscale("log")
    axes.set_yticks((1, 2, 3, 5, 10), ("1", "2", "3", "5", "10"))
    axes.minorticks_off()
    axes.set_xticks(positions, names)
    axes.set_xlabel("test at fixed speed and feed")
    axes.set_ylabel("grid search over test,\nmetal per minute [-], log scale")
    axes.legend(loc="upper right")
