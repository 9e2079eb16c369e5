"""Figures 2 to 10 of Alaskari and Oraby (2018): choices of the grid search in one minute.

``life.py`` draws the whole life of the edge.
"""

from typing import Any

import numpy as np
from contourpy import contour_generator
from matplotlib.figure import Figure

from research.papers import rows
from research.papers.figures import legend, lettered
from research.papers.grid_search import (
    LIMITS,
    SCENARIO,
    Array,
    Responses,
    before,
    best_at_each_speed,
    chosen,
    plane,
)
from turning_env.rendering import plot_style as style

Look = dict[str, Any]

# File of the printed table of a minute, and its column of wear.
TABLES = {
    1: ("table1.csv", "wear_mm"),
    2: ("table2.csv", "total_wear_mm"),
}
RATES = (50, 100, 150, 200, 250)  # contours of removal rate [cm3/min]
_MARKED: Look = style.OURS | {"markersize": 3.4}
_OPEN: Look = _MARKED | {"markerfacecolor": "white"}
_RATE: Look = {"color": style.GREY, "linewidth": 0.6}
_WEAR: Look = {"color": style.GREEN, "linewidth": 1.0, "linestyle": "dotted"}
_POWER: Look = {"color": style.BLUE, "linewidth": 1.4, "linestyle": (0, (6, 1.5, 1, 1.5))}
_FORCE: Look = {"color": style.VERMILLION, "linewidth": 1.4, "linestyle": (0, (5, 1.5))}
_REGION = "#F5E6B8"
WEAR_STEPS = (0.001, 0.002, 0.005, 0.01, 0.02, 0.05)  # possible steps of the contours of wear [mm]


def printed(minute: int) -> dict[str, list[float]]:
    """Return the printed responses at the 16 cutting speeds by name, empty without a table."""
    if minute not in TABLES:
        return {}
    file, wear_column = TABLES[minute]
    table = rows(file)
    return {
        "thrust_force": [float(row["thrust_force_n"]) for row in table],
        "power": [float(row["power_kw"]) for row in table],
        "wear": [float(row[wear_column]) for row in table],
        "removal_rate": [float(row["mrr_mm3_min"]) / 1000.0 for row in table],
    }


def draw_best(minute: int) -> Figure:
    """Draw the responses at the best feed over cutting speed, with limits and printed points."""
    wear, start = before(minute)
    responses = best_at_each_speed(wear, start)
    within = responses.within
    points = printed(minute)
    labels = {
        "thrust_force": "thrust force [N]",
        "power": "power [kW]",
        "wear": "wear [mm]",
        "removal_rate": "removal rate [cm³/min]",
    }
    limits_by_name = {
        "thrust_force": LIMITS.force,
        "power": LIMITS.power,
        "wear": SCENARIO.tool.wear_criterion,
    }

    # The grid search chooses the pair that keeps the limits with the highest removal rate.
    best = None
    if within.any():
        best = int(np.argmax(np.where(within, responses.removal_rate, -1.0)))

    figure, panels = lettered((style.DOUBLE, 4.3), rows=2, columns=2, sharex=True)
    for axes, (name, label) in zip(panels, labels.items(), strict=True):
        values = getattr(responses, name)
        axes.plot(responses.speed, values, **_OPEN)
        filled = _MARKED | {"linestyle": "none"}
        axes.plot(responses.speed[within], values[within], **filled)
        if name in points:
            axes.plot(responses.speed, points[name], **style.PRINTED)
        if name in limits_by_name:
            axes.axhline(limits_by_name[name], **style.LIMIT)
        if best is not None:
            axes.plot(responses.speed[best], values[best], **style.CHOSEN)
        axes.set_ylabel(label)
        axes.margins(y=0.12)
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("cutting speed [m/min]")

    looks: dict[str, Look] = {}
    if best is not None:
        looks["best feed, limits kept"] = _MARKED
    if not within.all():
        looks["no feed keeps the limits"] = _OPEN
    if points:
        looks[f"printed in Table {minute}"] = style.PRINTED
    looks["limit"] = style.LIMIT
    if best is not None:
        looks["chosen pair"] = style.CHOSEN
    legend(figure, looks, columns=len(looks), columnspacing=1.5)
    return figure


def _limit_lines(responses: Responses, values: Array, limit: float) -> list[Array]:
    """Return the lines on which values equal a limit: (cutting speed, feed), shape (points, 2)."""
    contours = contour_generator(responses.speed, responses.feed, values)
    return [np.asarray(line) for line in contours.lines(limit)]


def _wear_contours(wear: Array) -> Array:
    """Return three to six round numbers within an ascending range of wear [mm]."""
    span = np.ptp(wear)
    step = next(step for step in WEAR_STEPS if span / step < 6.0)
    first = float(np.ceil(wear[0] / step) * step)
    last = float(wear[-1])
    contours: Array = np.round(np.arange(first, last, step), 4)
    return contours


def draw_plane(minute: int) -> Figure:
    """Draw contours of removal rate and wear, limits, the feasible region and the chosen pair."""
    wear, start = before(minute)
    responses = plane(wear, start)
    speed = responses.speed
    feed = responses.feed
    removal_rate = responses.removal_rate

    figure = Figure(figsize=(style.SINGLE, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(True)
    axes.contourf(speed, feed, responses.within, levels=(0.5, 1.5), colors=_REGION)

    # Wear at the highest feed, over cutting speed.
    wear_at_top = responses.wear[-1]
    wears = _wear_contours(wear_at_top).tolist()
    axes.contour(speed, feed, removal_rate, levels=RATES, **_contour_look(_RATE))
    axes.contour(speed, feed, responses.wear, levels=wears, **_contour_look(_WEAR))

    # Contours are named where they leave the plane: at its highest cutting speed (right) and at its
    # highest feed (top).
    right = axes.secondary_yaxis("right")
    top = axes.secondary_xaxis("top")
    rate_ticks = np.interp(RATES, removal_rate[:, -1], feed[:, -1])
    right.set_yticks(rate_ticks, [f"{rate:g}" for rate in RATES])
    right.set_ylabel("removal rate [cm³/min]")
    wear_ticks = np.interp(wears, wear_at_top, speed[-1])
    top.set_xticks(wear_ticks, [f"{value:g}" for value in wears])
    top.set_xlabel("wear [mm]")

    for line in _limit_lines(responses, responses.thrust_force, limit=LIMITS.force):
        axes.plot(line[:, 0], line[:, 1], **_FORCE)
    for line in _limit_lines(responses, responses.power, limit=LIMITS.power):
        axes.plot(line[:, 0], line[:, 1], **_POWER)

    looks = {
        "removal rate (right)": _RATE,
        "wear (top)": _WEAR,
        f"thrust force {LIMITS.force:.0f} N": _FORCE,
        f"power {LIMITS.power:g} kW": _POWER,
    }
    pair = chosen(wear, start)
    if pair is not None:
        axes.plot(*pair, **style.CHOSEN, clip_on=False, zorder=5)
        looks["all limits kept"] = {"facecolor": _REGION}
        looks["chosen pair"] = style.CHOSEN
    axes.set_xlabel("cutting speed [m/min]")
    axes.set_ylabel("feed [mm/rev]")
    legend(figure, looks, columns=2, columnspacing=1.0, handlelength=2.4)
    return figure


def _contour_look(look: Look) -> Look:
    """Return a line's look as options of ``Axes.contour``, whose names are plural."""
    return {f"{key}s": value for key, value in look.items()}
