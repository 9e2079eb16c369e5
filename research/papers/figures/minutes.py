"""Figures 2 to 10 of Alaskari and Oraby (2018): the choices of the grid search in one minute of its edge's life."""

from typing import Any

import numpy as np
from contourpy import contour_generator
from matplotlib.figure import Figure
from numpy.typing import NDArray

from research.papers import rows
from research.papers.figures import legend, lettered
from research.papers.grid_search import LIMITS, SCENARIO, before, best_at_each_speed, chosen, plane
from turning_env.rendering import plot_style as style

Look = dict[str, Any]

TABLES = {
    1: ("table1.csv", "wear_mm"),
    2: ("table2.csv", "total_wear_mm"),
}  # printed tables and their columns of wear, by minute
RATES = (50, 100, 150, 200, 250)  # contours of removal rate [cm3/min]
_MARKED: Look = style.OURS | {"markersize": 3.4}
_OPEN: Look = _MARKED | {"markerfacecolor": "white"}
_RATE: Look = {"color": style.GREY, "linewidth": 0.6}
_WEAR: Look = {"color": style.GREEN, "linewidth": 1.0, "linestyle": "dotted"}
_POWER: Look = {"color": style.BLUE, "linewidth": 1.4, "linestyle": (0, (6, 1.5, 1, 1.5))}
_FORCE: Look = {"color": style.VERMILLION, "linewidth": 1.4, "linestyle": (0, (5, 1.5))}
_REGION = "#F5E6B8"


def printed(minute: int) -> dict[str, list[float]]:
    """Return the printed responses at the 16 cutting speeds, by name; none if the paper has no table."""
    if minute not in TABLES:
        return {}
    file, wear = TABLES[minute]
    columns = {
        "thrust_force": "thrust_force_n",
        "power": "power_kw",
        "wear": wear,
        "removal_rate": "mrr_mm3_min",
    }
    values = {name: [float(row[column]) for row in rows(file)] for name, column in columns.items()}
    return values | {"removal_rate": [rate / 1000.0 for rate in values["removal_rate"]]}


def draw_best(minute: int) -> Figure:
    """Draw force, power, wear and removal rate at the best feed over cutting speed, with limits and printed points."""
    found, points = best_at_each_speed(*before(minute)), printed(minute)
    subjects = (
        ("thrust_force", "thrust force [N]", LIMITS[0]),
        ("power", "power [kW]", LIMITS[1]),
        ("wear", "wear [mm]", SCENARIO.tool.wear_criterion),
        ("removal_rate", "removal rate [cm³/min]", None),
    )
    figure, panels = lettered((style.DOUBLE, 4.3), 2, 2, sharex=True)
    best = (
        int(np.argmax(np.where(found.within, found.removal_rate, -1.0)))
        if found.within.any()
        else None
    )
    for axes, (name, label, limit) in zip(panels, subjects, strict=True):
        values = getattr(found, name)
        axes.plot(found.speed, values, **_OPEN)
        axes.plot(
            found.speed[found.within], values[found.within], **_MARKED | {"linestyle": "none"}
        )
        if name in points:
            axes.plot(found.speed, points[name], **style.PRINTED)
        if limit is not None:
            axes.axhline(limit, **style.LIMIT)
        if best is not None:
            axes.plot(found.speed[best], values[best], **style.CHOSEN)
        axes.set_ylabel(label)
        axes.margins(y=0.12)
        axes.tick_params(labelbottom=True)
        axes.set_xlabel("cutting speed [m/min]")
    looks: dict[str, Look] = {} if best is None else {"best feed, limits kept": _MARKED}
    if not found.within.all():
        looks["no feed keeps the limits"] = _OPEN
    if points:
        looks[f"printed in Table {minute}"] = style.PRINTED
    looks |= {"limit": style.LIMIT} | ({} if best is None else {"chosen pair": style.CHOSEN})
    legend(figure, looks, len(looks), columnspacing=1.5)
    return figure


def limits(minute: int) -> list[tuple[Look, NDArray[np.float64]]]:
    """Return the lines of the limits of force and power: looks, and points (cutting speed, feed), shape (points, 2)."""
    found, lines = plane(*before(minute)), []
    for values, limit, look in (
        (found.thrust_force, LIMITS[0], _FORCE),
        (found.power, LIMITS[1], _POWER),
    ):
        lines += [
            (look, np.asarray(path))
            for path in contour_generator(found.speed, found.feed, values).lines(limit)
        ]
    return lines


def draw_plane(minute: int) -> Figure:
    """Draw contours of removal rate and wear, limits of force, power and wear, the feasible region, and the chosen pair."""
    found = plane(*before(minute))
    figure = Figure(figsize=(style.SINGLE, 4.0), layout="constrained")
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(True)
    axes.contourf(found.speed, found.feed, found.within, levels=(0.5, 1.5), colors=_REGION)
    # Contours of wear at three to six round numbers.
    wear = found.wear[-1]
    step = next(
        step for step in (0.001, 0.002, 0.005, 0.01, 0.02, 0.05) if np.ptp(wear) / step < 6.0
    )
    wears = np.round(np.arange(np.ceil(wear[0] / step) * step, wear[-1], step), 4).tolist()
    for values, levels, look in ((found.removal_rate, RATES, _RATE), (found.wear, wears, _WEAR)):
        contours = {f"{key}s": value for key, value in look.items()}
        axes.contour(found.speed, found.feed, values, levels=levels, **contours)
    # Lines are named where they leave the plane: at its highest cutting speed, and at its highest feed.
    right, top = axes.secondary_yaxis("right"), axes.secondary_xaxis("top")
    right.set_yticks(
        np.interp(RATES, found.removal_rate[:, -1], found.feed[:, -1]),
        [f"{rate:g}" for rate in RATES],
    )
    right.set_ylabel("removal rate [cm³/min]")
    top.set_xticks(np.interp(wears, wear, found.speed[-1]), [f"{each:g}" for each in wears])
    top.set_xlabel("wear [mm]")
    for look, path in limits(minute):
        axes.plot(*path.T, **look)
    looks = {"removal rate (right)": _RATE, "wear (top)": _WEAR}
    looks |= {f"thrust force {LIMITS[0]:.0f} N": _FORCE, f"power {LIMITS[1]:g} kW": _POWER}
    if (pair := chosen(*before(minute))) is not None:
        axes.plot(*pair, **style.CHOSEN, clip_on=False, zorder=5)
        looks |= {"all limits kept": {"facecolor": _REGION}, "chosen pair": style.CHOSEN}
    axes.set_xlabel("cutting speed [m/min]")
    axes.set_ylabel("feed [mm/rev]")
    legend(figure, looks, 2, columnspacing=1.0, handlelength=2.4)
    return figure
