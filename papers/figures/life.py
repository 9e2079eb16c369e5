"""Figures 11 to 15 of Alaskari and Oraby (2018): the whole life of an edge, by the grid search and at fixed speeds and feeds."""

import re
from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from papers.figures.paper_figure import GRID_SEARCH, PaperFigure, legend, lettered
from papers.figures.responses import paper_run
from papers.reproduce.alaskari_oraby import adaptive_control, life_checks, rival_checks, rivals, whole_life
from papers.reproduce.checks import Check, claim
from papers.verification import wear
from turning_render import plot_style as style

_SPEEDS = {100.0: style.LINES[1], 145.0: style.LINES[2], 206.0: style.LINES[6]}
_MEASURED: dict[str, Any] = style.PRINTED | {"marker": "s"}


def stated(quantity: str) -> dict[int, float]:
    """Return what the paper's text says of some minutes: of ``cutting speed`` [m/min] or ``feed`` [mm/rev]."""
    matches = [(re.fullmatch(rf"\w+ (\d+): {quantity} \[.*\]", check.what), check.paper) for check in life_checks()]
    return {int(match[1]): value for match, value in matches if match}


def draw_responses() -> Figure:
    """Draw force, power and removal rate over the minutes, with their limits."""
    run, limits = whole_life(), paper_run().scenario.limits
    subjects = (
        ("thrust force [N]", [minute.thrust_force for minute in run], limits.thrust_force),
        ("power [kW]", [minute.power for minute in run], limits.power),
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
    """Draw the chosen cutting speed and feed over the minutes, with what the text states."""
    figure, panels = lettered((style.SINGLE, 3.6), 2, 1, sharex=True)
    for place, (axes, name, unit) in enumerate(zip(panels, ("cutting speed", "feed"), ("m/min", "mm/rev"), strict=True)):
        _over_minutes(axes, f"{name} [{unit}]", [minute.pair[place] for minute in whole_life()])
        printed = stated(name)
        axes.plot(list(printed), list(printed.values()), **style.PRINTED)
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
    criterion = paper_run().scenario.tool.wear_criterion
    worn = [minute.wear for minute in whole_life()]
    axes.plot(range(1, len(worn) + 1), worn, **style.OURS, label="grid search")
    labelled = set()
    for place, rival in enumerate(sorted(rivals(), key=lambda rival: rival.nominal.life)):
        test, (colour, dashes) = rival.test, _SPEEDS[rival.test.cutting_speed]
        minutes = np.geomspace(1.0, rival.nominal.life, 50)
        label = None if test.cutting_speed in labelled else f"tests at {test.cutting_speed:.0f} m/min, models"
        labelled.add(test.cutting_speed)
        axes.plot(minutes, [wear(test, minute) for minute in minutes], color=colour, linestyle=dashes, label=label)
        offset: dict[str, Any] = {"xytext": (0, 4 + 10 * (place % 2)), "textcoords": "offset points"}
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


def response_checks() -> Iterable[Check]:
    """Compare with what the text says of Figure 11."""
    run, limits = whole_life(), paper_run().scenario.limits
    rates = [minute.removed for minute in run]
    yield claim("the removal rate falls from minute to minute, or stays", bool(np.all(np.diff(rates) < 1e-9)))
    kept = [minute.thrust_force <= limits.thrust_force and minute.power <= limits.power for minute in run]
    yield claim("force and power are within their limits in every minute", all(kept))
    shares = [minute.power / limits.power for minute in run]
    yield claim("the power available is used (99 %) except in late stages, minutes 11 to 14", min(shares[:10]) > 0.985)
    yield from (check for check in life_checks() if check.what.startswith("mean removal rate"))


def pair_checks() -> Iterable[Check]:
    """Compare with what the text says of Figure 12."""
    pattern = r"\w+ \d+: (cutting speed|feed) \[.*\]|\w+ until .*"
    yield from (check for check in life_checks() if re.fullmatch(pattern, check.what))
    speeds, feeds = np.array([minute.pair for minute in whole_life()]).T
    for what, values, low, high in (("cutting speed [m/min]", speeds, 140.0, 200.0), ("feed [mm/rev]", feeds, 0.205, 0.58)):
        yield Check(f"lowest {what}", low, float(values.min()), 1e-9)
        yield Check(f"highest {what}", high, float(values.max()), 1e-9)
    yield claim("feed falls from minute to minute, or stays", bool(np.all(np.diff(feeds) < 1e-9)))
    yield claim(
        "cutting speed tends to rise: never falls after the second minute (140 m/min after 150, as in Tables 1 and 2)",
        bool(np.all(np.diff(speeds[1:]) > -1e-9)),
    )


FIGURES = (
    PaperFigure(
        "grid_search_11",
        f"{GRID_SEARCH}, Figure 11",
        "The grid search over the life of an edge: a) thrust force, b) power, c) removal rate in each minute.",
        draw_responses,
        response_checks,
    ),
    PaperFigure(
        "grid_search_12",
        f"{GRID_SEARCH}, Figure 12",
        "The pair that the grid search chooses in each minute of an edge's life: a) cutting speed, b) feed.",
        draw_pairs,
        pair_checks,
    ),
    PaperFigure(
        "grid_search_13",
        f"{GRID_SEARCH}, Figures 13 to 15",
        "The grid search and tests at fixed speed and feed: a) wear over cutting time by the models, with squares where the "
        "paper's edges of T4, T5, T8 and T9 were worn out; b) metal per minute of the grid search over that of each test.",
        draw_rivals,
        rival_checks,
        "The figures with the tests' parameters are lost. Feeds follow from the stated ratios at 2.5 mm depth of cut. "
        "For T6 and T7, only the speed is known.",
    ),
)
