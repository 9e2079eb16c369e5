"""Figures 2, 4, 8 and 9 of Alaskari and Oraby (2018): what the grid search finds at each cutting speed in a minute."""

from collections.abc import Callable, Iterable

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from papers.figures.minutes import best_at_each_speed, paper_run
from papers.figures.plate import Plate
from papers.reproduce.alaskari_oraby import rows, table_1, table_2
from papers.reproduce.checks import Check, claim
from turning_env.workshop import plot_style as style

PAPER = "Alaskari and Oraby (2018)"
TABLES = {1: "table1.csv", 2: "table2.csv"}
"""Printed tables, by minute."""
_WEAR_COLUMNS = {1: "wear_mm", 2: "total_wear_mm"}


def printed(minute: int) -> dict[str, list[float]]:
    """What the paper prints at the 16 cutting speeds, by panel; nothing where it has no table."""
    if minute not in TABLES:
        return {}
    table = rows(TABLES[minute])
    columns = {"force": "thrust_force_n", "power": "power_kw", "wear": _WEAR_COLUMNS[minute], "rate": "mrr_mm3_min"}
    values = {panel: [float(row[column]) for row in table] for panel, column in columns.items()}
    return values | {"rate": [rate / 1000.0 for rate in values["rate"]]}


def draw(minute: int) -> Figure:
    """Force, power, wear and removal rate over cutting speed, with limits and printed points."""
    found, scenario, points = best_at_each_speed(minute), paper_run().scenario, printed(minute)
    panels = {
        "force": ("thrust force [N]", found.thrust_force, scenario.limits.thrust_force),
        "power": ("power [kW]", found.power, scenario.limits.power),
        "wear": ("wear [mm]", found.wear, scenario.tool.wear_criterion),
        "rate": ("removal rate [cm³/min]", found.removal_rate, None),
    }
    figure = Figure(figsize=(style.DOUBLE, 4.3), layout="constrained")
    best = int(np.argmax(np.where(found.within, found.removal_rate, -1.0))) if found.within.any() else None
    for axes, letter, (name, (label, values, limit)) in zip(
        figure.subplots(2, 2, sharex=True).flat, "abcd", panels.items(), strict=True
    ):
        style.letter(axes, letter)
        axes.plot(found.speed, values, **style.OURS | {"markerfacecolor": "white", "markersize": 3.4})
        axes.plot(found.speed[found.within], values[found.within], **style.OURS | {"linestyle": "none", "markersize": 3.4})
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
    handles = _legend(minute, bool(found.within.any()))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), columnspacing=1.5)
    return figure


def _legend(minute: int, any_within: bool) -> list[Line2D]:
    found = best_at_each_speed(minute)
    handles = []
    if any_within:
        handles.append(Line2D([], [], **style.OURS | {"markersize": 3.4}, label="best feed, limits kept"))
    if not found.within.all():
        label = "no feed keeps the limits"
        handles.append(Line2D([], [], **style.OURS | {"markersize": 3.4, "markerfacecolor": "white"}, label=label))
    if minute in TABLES:
        handles.append(Line2D([], [], **style.PRINTED, label=f"printed in Table {minute}"))
    handles.append(Line2D([], [], **style.LIMIT, label="limit"))
    if any_within:
        handles.append(Line2D([], [], **style.CHOSEN, label="chosen pair"))
    return handles


def late_checks() -> Iterable[Check]:
    """What the text says of Figure 8."""
    found, limit = best_at_each_speed(14), paper_run().scenario.limits.thrust_force
    slow = found.speed <= 100.0
    yield claim("minute 14: force above its limit up to 100 m/min", bool(np.all(found.thrust_force[slow] > limit)))
    yield claim("minute 14: force within its limit above 100 m/min", bool(np.all(found.thrust_force[~slow] <= limit)))
    yield claim("minute 14: power rises with cutting speed", bool(np.all(np.diff(found.power[~slow]) > 0.0)))


def last_checks() -> Iterable[Check]:
    """What the text says of Figure 9."""
    found, scenario = best_at_each_speed(15), paper_run().scenario
    yield claim("minute 15: wear above 0.3 mm at all cutting speeds", bool(np.all(found.wear > scenario.tool.wear_criterion)))
    yield claim("minute 15: power below its limit", bool(np.all(found.power < scenario.limits.power)))
    yield claim(
        "minute 15: force well below its limit",
        bool(np.all(found.thrust_force < 0.95 * scenario.limits.thrust_force)),
        not_reproduced="the paper does not say at what feeds; here they are the highest that keep force and power, where any do",
    )


def _plate(figure: int, minute: int, checks: Callable[[], Iterable[Check]], what: str, remark: str) -> Plate:
    caption = f"{what}: a) thrust force, b) power, c) wear at the end of the minute, d) removal rate."
    return Plate(f"grid_search_{figure:02d}", f"{PAPER}, Figure {figure}", caption, lambda: draw(minute), checks, remark)


_BEST = "the highest feed that keeps all limits at each cutting speed"
_ADDED = "Panel d is added; the copy used lacks the curves themselves, so that printed tables and text are compared."
PLATES = (
    _plate(
        2,
        1,
        lambda: table_1(paper_run()),
        f"The grid search before the first minute, with {_BEST}",
        _ADDED,
    ),
    _plate(
        4,
        2,
        lambda: table_2(paper_run()),
        f"The grid search before the second minute, with {_BEST}",
        _ADDED,
    ),
    _plate(
        8,
        14,
        late_checks,
        f"The grid search before the fourteenth minute, the last, with {_BEST}; "
        "open markers: no feed keeps the force, the lowest is shown",
        _ADDED,
    ),
    _plate(
        9,
        15,
        last_checks,
        "The grid search before the fifteenth minute, where no pair is left, with the highest feed that keeps force and power at "
        "each cutting speed, or the lowest",
        _ADDED,
    ),
)
