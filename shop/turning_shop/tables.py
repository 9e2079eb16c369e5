"""Show cuts and the intervals of their predictions: records for programs, a table for people.

``whatif.py`` predicts the cuts and ``prediction.py`` the intervals.
"""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_shop import aligned
from turning_shop.units import METRIC, Units
from turning_shop.whatif import Cuts

if TYPE_CHECKING:
    # It imports SciPy, which commands load only if they need it.
    from turning_shop.prediction import Prediction


def records(cuts: Cuts, prediction: "Prediction | None" = None) -> list[dict[str, Any]]:
    """Return one record per cut, in the units of ``Cuts``.

    Names of intervals end in _low and _high. Numbers that are not finite are None.
    """
    columns: dict[str, NDArray[Any]] = cuts._asdict()
    columns["within_limits"] = cuts.within_limits
    if prediction:
        for name, low in prediction.low.items():
            columns[f"{name}_low"] = low
            columns[f"{name}_high"] = prediction.high[name]
        columns["extrapolated"] = prediction.extrapolated
    rows: list[dict[str, Any]] = [{} for _ in range(cuts.wear.size)]
    for name, values in columns.items():
        numbers = values.ravel().tolist()
        for row, value in zip(rows, numbers, strict=True):
            row[name] = value if np.isfinite(value) else None
    return rows


class _Shown(NamedTuple):
    """A column of the table."""

    heading: str
    unit: str
    form: str  # format of a number
    factor: int = 1  # to the unit


_TABLE = {
    "cutting_speed": _Shown("speed", "m/min", form="g"),
    "feed": _Shown("feed", "mm/rev", form="g"),
    "depth_of_cut": _Shown("depth", "mm", form="g"),
    "hardness": _Shown("hardness", "-", form="g"),
    "time": _Shown("time", "min", form=".2f"),
    "wear": _Shown("wear", "mm", form=".3f"),
    "wear_share": _Shown("of limit", "%", form=".0f", factor=100),
    "thrust_force": _Shown("thrust", "N", form=".0f"),
    "thrust_force_share": _Shown("of limit", "%", form=".0f", factor=100),
    "power": _Shown("power", "kW", form=".2f"),
    "power_share": _Shown("of limit", "%", form=".0f", factor=100),
    "tool_life": _Shown("tool life", "min", form=".1f"),
    "removal_rate": _Shown("MRR", "cm3/min", form=".1f"),
    "spindle_speed": _Shown("spindle", "rev/min", form=".0f"),
}


_LIMITED = ("thrust_force_share", "power_share")


def cuts_table(
    cuts: Cuts,
    prediction: "Prediction | None" = None,
    units: Units = METRIC,
    bending_force: float = math.inf,
    longest_life: float = math.inf,
) -> Iterator[str]:
    """Yield an aligned table with units, and with intervals if laws were fitted.

    A star marks cuts that extrapolate. The last column names the limits that are exceeded, and
    "bending" if the thrust exceeds ``bending_force`` [N], at which bar and tool bend too far. Lives
    beyond ``longest_life`` [min] are not printed: wear does not limit such edges.
    """
    columns = []
    for name, shown in _TABLE.items():
        unit = units.name(shown.unit)
        column = [shown.heading, unit]
        most = longest_life if name in ("time", "tool_life") else math.inf
        for value in getattr(cuts, name).ravel():
            cell = _cell(value, shown, units, most)
            # The share of a load's limit is 0 if the limit is off.
            if name in _LIMITED and value == 0.0:
                cell = "off"
            column.append(cell)
        columns.append(column)
        if prediction and name in prediction.low and np.isfinite(prediction.low[name]).any():
            interval = ["95 %", unit]
            lows = prediction.low[name].ravel()
            highs = prediction.high[name].ravel()
            for low, high in zip(lows, highs, strict=True):
                low_cell = _cell(low, shown, units, most)
                high_cell = _cell(high, shown, units, most)
                interval.append(low_cell if low > most else f"{low_cell}-{high_cell}")
            columns.append(interval)
    if prediction:
        marks = ["*" if extrapolated else "" for extrapolated in prediction.extrapolated.ravel()]
        columns.append(["", "", *marks])
    columns.append(["exceeded", "", *_exceeded(cuts, bending_force)])
    rows = list(zip(*columns, strict=True))
    yield from aligned(rows)


def _cell(value: float, shown: _Shown, units: Units, most: float) -> str:
    """Return a number of the table; one above ``most`` is not printed."""
    if value > most:
        return f">{most:g}"
    return units.cell(shown.factor * value, shown.unit, shown.form)


def _exceeded(cuts: Cuts, bending_force: float) -> Iterator[str]:
    """Yield the names of the limits that each cut exceeds."""
    shares = {
        "wear": cuts.wear_share,
        "thrust": cuts.thrust_force_share,
        "bending": cuts.thrust_force / bending_force,
        "power": cuts.power_share,
    }
    for index in range(cuts.wear.size):
        exceeded = [name for name, share in shares.items() if share.flat[index] > 1]
        yield ", ".join(exceeded)
