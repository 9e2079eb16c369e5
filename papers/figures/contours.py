"""Figures 3, 6, 7 and 10 of Alaskari and Oraby (2018): the plane of cutting speed and feed, with all that bounds it."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from contourpy import contour_generator
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from papers.figures.minutes import paper_run, plane, sides, wear_before
from papers.figures.optima import PAPER
from papers.figures.plate import Plate
from papers.reproduce.checks import Check, claim
from turning_env.workshop import plot_style as style

RATES = (50, 100, 150, 200, 250)
"""Contours of removal rate [cm3/min]."""
_RATE: dict[str, Any] = {"colors": style.GREY, "linewidths": 0.6}
_WEAR: dict[str, Any] = {"colors": style.GREEN, "linewidths": 1.0, "linestyles": "dotted"}
_POWER: dict[str, Any] = {"color": style.BLUE, "linewidth": 1.4, "linestyle": (0, (6, 1.5, 1, 1.5))}
_FORCE: dict[str, Any] = {"color": style.VERMILLION, "linewidth": 1.4, "linestyle": (0, (5, 1.5))}
_REGION = "#F5E6B8"


def limits(minute: int) -> list[tuple[dict[str, Any], NDArray[np.float64]]]:
    """Where force and power reach their limits: looks, and points (cutting speed, feed), shape (points, 2)."""
    found, most = plane(minute), paper_run().scenario.limits
    lines = []
    for values, limit, look in ((found.thrust_force, most.thrust_force, _FORCE), (found.power, most.power, _POWER)):
        lines += [(look, np.asarray(path)) for path in contour_generator(found.speed, found.feed, values).lines(limit)]
    return lines


def draw(minute: int) -> Figure:
    """Contours of removal rate and wear, limits of force, power and wear, the feasible region, and the chosen pair."""
    found, run = plane(minute), paper_run()
    figure = Figure(figsize=(style.SINGLE, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(True)
    axes.contourf(found.speed, found.feed, found.within, levels=(0.5, 1.5), colors=_REGION)
    wears = _wear_levels(found.wear[-1])
    axes.contour(found.speed, found.feed, found.removal_rate, levels=RATES, **_RATE)
    axes.contour(found.speed, found.feed, found.wear, levels=wears, **_WEAR)
    # Lines are named where they leave the plane: at its highest cutting speed, and at its highest feed.
    right, top = axes.secondary_yaxis("right"), axes.secondary_xaxis("top")
    right.set_yticks(np.interp(RATES, found.removal_rate[:, -1], found.feed[:, -1]), [f"{rate:g}" for rate in RATES])
    right.set_ylabel("removal rate [cm³/min]")
    top.set_xticks(np.interp(wears, found.wear[-1], found.speed[-1]), [f"{wear:g}" for wear in wears])
    top.set_xlabel("wear [mm]")
    for look, path in limits(minute):
        axes.plot(*path.T, **look)
    pair = run.chosen(wear_before(minute), minute - 1.0)
    if pair is not None:
        axes.plot(*pair, **style.CHOSEN, clip_on=False, zorder=5)
    axes.set_xlabel("cutting speed [m/min]")
    axes.set_ylabel("feed [mm/rev]")
    figure.legend(handles=_legend(pair is not None), loc="outside lower center", ncols=2, columnspacing=1.0, handlelength=2.4)
    return figure


def _wear_levels(wear: NDArray[np.float64]) -> list[float]:
    """Round numbers, three to six, between the ends of what grows."""
    step = next(step for step in (0.001, 0.002, 0.005, 0.01, 0.02, 0.05) if np.ptp(wear) / step < 6.0)
    return [float(level) for level in np.round(np.arange(np.ceil(wear[0] / step) * step, wear[-1], step), 4)]


def limit_handles() -> list[Line2D]:
    """The limits of force and power in a legend."""
    most = paper_run().scenario.limits
    return [
        Line2D([], [], **_FORCE, label=f"thrust force {most.thrust_force:.0f} N"),
        Line2D([], [], **_POWER, label=f"power {most.power:g} kW"),
    ]


def _legend(any_within: bool) -> list[Line2D | Patch]:
    handles: list[Line2D | Patch] = [
        Line2D([], [], color=style.GREY, linewidth=0.6, label="removal rate (right)"),
        Line2D([], [], color=style.GREEN, linewidth=1.0, linestyle="dotted", label="wear (top)"),
        *limit_handles(),
    ]
    if any_within:
        handles += [Patch(facecolor=_REGION, label="all limits kept"), Line2D([], [], **style.CHOSEN, label="chosen pair")]
    return handles


def corner_check(minute: int, letters: str, not_reproduced: str = "") -> Check:
    """How many corners the region has that the paper names by letters."""
    what = f"minute {minute}: corners of the feasible region, {letters}"
    return Check(what, float(len(letters) - 1), float(sides(minute)), not_reproduced=not_reproduced)


def pair_checks(minute: int, speed: float, feed: float) -> Iterable[Check]:
    """The pair that the text gives."""
    pair = paper_run().chosen(wear_before(minute), minute - 1.0)
    assert pair is not None
    yield Check(f"minute {minute}: cutting speed [m/min]", speed, pair[0], 1e-9)
    yield Check(f"minute {minute}: feed [mm/rev]", feed, pair[1], 1e-9)


def first_checks() -> Iterable[Check]:
    """What the text says of Figure 3."""
    yield from pair_checks(1, 150.0, 0.58)
    reason = "the force of a new edge lies below its limit everywhere: ranges and power alone bound the region"
    yield corner_check(1, "ABCDEFA", reason)


def second_checks() -> Iterable[Check]:
    """What the text says of Figure 6."""
    yield from pair_checks(2, 140.0, 0.58)
    yield corner_check(2, "ABCDEFA")


def late_checks() -> Iterable[Check]:
    """What the text says of Figure 7."""
    yield from pair_checks(14, 200.0, 0.205)
    yield corner_check(14, "ABCA")


def last_checks() -> Iterable[Check]:
    """What the text says of Figure 10."""
    found = plane(15)
    yield claim("minute 15: the feasible region has vanished", not found.within.any())
    criterion = paper_run().scenario.tool.wear_criterion
    yield claim("minute 15: wear above its criterion on the whole plane", bool(np.all(found.wear > criterion)))


def _plate(figure: int, minute: int, checks: Callable[[], Iterable[Check]], what: str) -> Plate:
    caption = (
        f"{what}: contours of removal rate and of wear at the end of the minute, and the limits of thrust force and power, "
        "over cutting speed and feed."
    )
    remark = "The chosen pair lies on the search's grid (10 m/min, 0.005 mm/rev), so just inside the limit that it meets."
    remark = remark if minute < 15 else ""
    return Plate(f"grid_search_{figure:02d}", f"{PAPER}, Figure {figure}", caption, lambda: draw(minute), checks, remark)


PLATES = (
    _plate(3, 1, first_checks, "What the grid search chooses from for the first minute"),
    _plate(6, 2, second_checks, "What the grid search chooses from for the second minute"),
    _plate(7, 14, late_checks, "What the grid search chooses from for the fourteenth minute, when the worn edge leaves a corner"),
    _plate(10, 15, last_checks, "What is left for the fifteenth minute, nothing, as the edge would be worn out at any pair"),
)
