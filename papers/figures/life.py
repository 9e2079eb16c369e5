"""Figures 11 and 12 of Alaskari and Oraby (2018): the whole life of the grid search's edge, minute by minute."""

import re
from collections.abc import Iterable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from papers.figures.minutes import paper_run
from papers.figures.optima import PAPER
from papers.figures.plate import Plate
from papers.reproduce.alaskari_oraby import run_checks, whole_run
from papers.reproduce.checks import Check, claim
from turning_env.workshop import plot_style as style


def stated(quantity: str) -> dict[int, float]:
    """What the paper's text says of some minutes: of ``cutting speed`` [m/min] or ``feed`` [mm/rev]."""
    found = {}
    for check in run_checks():
        if match := re.fullmatch(rf"interval (\d+): {quantity} \[.*\]", check.what):
            found[int(match[1])] = check.paper
    return found


def draw_responses() -> Figure:
    """Force, power and removal rate over the minutes, with their limits."""
    intervals, limits = whole_run(), paper_run().scenario.limits
    panels = (
        ("thrust force [N]", [interval.thrust_force for interval in intervals], limits.thrust_force),
        ("power [kW]", [interval.power for interval in intervals], limits.power),
        ("removal rate [cm³/min]", [interval.removed for interval in intervals], None),
    )
    figure = Figure(figsize=(style.DOUBLE, 2.4), layout="constrained")
    for axes, letter, (label, values, limit) in zip(figure.subplots(1, 3), "abc", panels, strict=True):
        style.letter(axes, letter)
        _over_minutes(axes, values)
        if limit is not None:
            axes.axhline(limit, **style.LIMIT)
        axes.set_ylim(0.0, 1.12 * max(*values, limit or 0.0))
        axes.set_ylabel(label)
        axes.set_xlabel("cutting time [min]")
    handles = [Line2D([], [], **style.OURS, label="grid search, end of the minute"), Line2D([], [], **style.LIMIT, label="limit")]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def draw_pairs() -> Figure:
    """The chosen cutting speed and feed over the minutes, with what the text states."""
    intervals = whole_run()
    figure = Figure(figsize=(style.SINGLE, 3.6), layout="constrained")
    panels = (("cutting speed", "cutting speed [m/min]", 0), ("feed", "feed [mm/rev]", 1))
    for axes, letter, (name, label, place) in zip(figure.subplots(2, 1, sharex=True), "ab", panels, strict=True):
        style.letter(axes, letter)
        _over_minutes(axes, [interval.pair[place] for interval in intervals])
        printed = stated(name)
        axes.plot(list(printed), list(printed.values()), **style.PRINTED)
        axes.set_ylabel(label)
        axes.margins(y=0.15)
        axes.set_xlabel("cutting time [min]")
        axes.tick_params(labelbottom=True)
    handles = [
        Line2D([], [], **style.OURS, label="grid search"),
        Line2D([], [], **style.PRINTED, label="stated in the text"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=2)
    return figure


def _over_minutes(axes: Axes, values: list[float]) -> None:
    minutes = np.arange(1, len(values) + 1)
    axes.plot(minutes, values, **style.OURS)
    axes.set_xlim(0.0, len(values) + 1.0)
    axes.set_xticks(range(0, len(values) + 1, 2))


def response_checks() -> Iterable[Check]:
    """What the text says of Figure 11."""
    intervals, limits = whole_run(), paper_run().scenario.limits
    rates = [interval.removed for interval in intervals]
    yield claim("the removal rate falls from minute to minute, or stays", bool(np.all(np.diff(rates) < 1e-9)))
    kept = [interval.thrust_force <= limits.thrust_force and interval.power <= limits.power for interval in intervals]
    yield claim("force and power are within their limits in every minute", all(kept))
    shares = [interval.power / limits.power for interval in intervals]
    yield claim("the power available is used (99 %) except in late stages, minutes 11 to 14", min(shares[:10]) > 0.985)
    yield from (check for check in run_checks() if check.what.startswith("mean removal rate"))


def pair_checks() -> Iterable[Check]:
    """What the text says of Figure 12."""
    pattern = r"interval \d+: (cutting speed|feed) \[.*\]"
    yield from (check for check in run_checks() if re.fullmatch(pattern, check.what))
    yield from (check for check in run_checks() if check.what.startswith("intervals until"))
    speeds, feeds = np.array([interval.pair for interval in whole_run()]).T
    yield Check("lowest cutting speed [m/min]", 140.0, float(speeds.min()), 1e-9)
    yield Check("highest cutting speed [m/min]", 200.0, float(speeds.max()), 1e-9)
    yield Check("lowest feed [mm/rev]", 0.205, float(feeds.min()), 1e-9)
    yield Check("highest feed [mm/rev]", 0.58, float(feeds.max()), 1e-9)
    yield claim("feed falls from minute to minute, or stays", bool(np.all(np.diff(feeds) < 1e-9)))
    yield claim(
        "cutting speed continuously tends to rise",
        bool(np.all(np.diff(speeds) > -1e-9)),
        not_reproduced="it falls once, from the first minute to the second, as the paper's own Tables 1 and 2 say",
    )


PLATES = (
    Plate(
        "grid_search_11",
        f"{PAPER}, Figure 11",
        "The grid search through the life of an edge: a) thrust force, b) power, c) removal rate in each minute.",
        draw_responses,
        response_checks,
    ),
    Plate(
        "grid_search_12",
        f"{PAPER}, Figure 12",
        "The pair that the grid search chooses in each minute of an edge's life: a) cutting speed, b) feed.",
        draw_pairs,
        pair_checks,
    ),
)
