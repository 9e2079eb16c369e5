"""Predict cuts at constant speed, feed and depth from a scenario's laws, and print them as a table.

Values are nominal: they ignore model mismatch. Laws that were fitted to measurements give intervals too (``prediction.py``).
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from turning_shop import Values, aligned

from turning_env.physics.spindle import capacity_at, idle_power_at
from turning_env.scenario import Scenario

if TYPE_CHECKING:
    from turning_shop.prediction import Prediction


NO_LIMIT = {"thrust_force": 1e6, "power": 1e4}
"""Limits [N], [kW] that count as none: the largest that a scenario may have. Shares of them are 0."""
CHANGES = np.arange(1, 11) / 10
"""Flank wears at which an edge change is tried, over the wear criterion [-]."""


class Cuts(NamedTuple):
    """Cuts by an edge that has cut at the same speed, feed and depth since it was fresh: arrays of one shape.

    Attributes:
        cutting_speed, feed, depth_of_cut: The settings [m/min], [mm/rev], [mm].
        hardness: Hardness of the bar over nominal [-].
        time, wear: Cutting time of the edge [min] and its flank wear after that time [mm].
        thrust_force, power: Thrust force [N] and spindle power [kW], with the idle power, at that wear.
        tool_life: Cutting time from fresh to the wear criterion [min].
        removal_rate: Material removal rate [cm3/min].
        spindle_speed: Spindle speed at the workpiece's diameter [rev/min].
        wear_share, thrust_force_share, power_share: Wear over the wear criterion, force and power over their limits [-].
    """

    cutting_speed: Values
    feed: Values
    depth_of_cut: Values
    hardness: Values
    time: Values
    wear: Values
    thrust_force: Values
    power: Values
    tool_life: Values
    removal_rate: Values
    spindle_speed: Values
    wear_share: Values
    thrust_force_share: Values
    power_share: Values

    @property
    def within_limits(self) -> NDArray[np.bool_]:
        """Whether wear, force and power are within their limits."""
        return np.asarray(
            (self.wear_share <= 1) & (self.thrust_force_share <= 1) & (self.power_share <= 1)
        )


def what_if(
    scenario: Scenario,
    cutting_speed: ArrayLike,
    feed: ArrayLike,
    depth_of_cut: ArrayLike | None = None,
    hardness: ArrayLike = 1.0,
    *,
    time: ArrayLike | None = None,
    wear: ArrayLike | None = None,
) -> Cuts:
    """Predict cuts by an edge of a cutting ``time`` or a ``wear``; give exactly one of them.

    All values are positive scalars or arrays that broadcast to one shape, in the units of ``Cuts``. The depth of cut is the
    scenario's nominal one if it is None. A tool life that overflows is infinite.

    Raises:
        TypeError: Both or neither of time and wear are given.
    """
    if (time is None) == (wear is None):
        raise TypeError("either time or wear must be given, and not both")
    material, limits, criterion = scenario.material, scenario.limits, scenario.tool.wear_criterion
    depth_of_cut = scenario.workpiece.depth_of_cut if depth_of_cut is None else depth_of_cut
    given = [
        np.asarray(x, np.float64)
        for x in (cutting_speed, feed, depth_of_cut, hardness, wear if time is None else time)
    ]
    speed, feeds, depth, hard, age = np.broadcast_arrays(*given)
    with np.errstate(over="ignore"):
        after_a_minute = material.wear(speed, feeds, depth, time=1.0, hardness=hard)
        if time is None:
            worn, age = age, (age / after_a_minute) ** (1.0 / material.wear.time)
        else:
            worn = material.wear(speed, feeds, depth, time=age, hardness=hard)
        life = (criterion / after_a_minute) ** (1.0 / material.wear.time)
        force = material.thrust_force(speed, feeds, depth, wear=worn, hardness=hard)
        power = material.power(speed, feeds, depth, wear=worn, hardness=hard) + idle_power_at(
            scenario, speed
        )
    return Cuts(
        cutting_speed=speed,
        feed=feeds,
        depth_of_cut=depth,
        hardness=hard,
        time=age,
        wear=worn,
        thrust_force=force,
        power=power,
        tool_life=life,
        removal_rate=speed * feeds * depth,  # m/min mm mm is cm3/min
        spindle_speed=1000.0 * speed / (np.pi * scenario.workpiece.diameter),
        wear_share=worn / criterion,
        thrust_force_share=force
        / limits.thrust_force
        * (limits.thrust_force < NO_LIMIT["thrust_force"]),
        power_share=power
        / (limits.power * capacity_at(scenario, speed))
        * (limits.power < NO_LIMIT["power"]),
    )


def records(cuts: Cuts, prediction: "Prediction | None" = None) -> list[dict[str, Any]]:
    """Return one record per cut, in the units of ``Cuts``; names of intervals end in _low and _high; None is not finite."""
    columns: dict[str, NDArray[Any]] = cuts._asdict() | {"within_limits": cuts.within_limits}
    if prediction:
        for name in prediction.low:
            columns |= {f"{name}_low": prediction.low[name], f"{name}_high": prediction.high[name]}
        columns["extrapolated"] = prediction.extrapolated
    rows = [
        [value if np.isfinite(value) else None for value in values.ravel().tolist()]
        for values in columns.values()
    ]
    return [dict(zip(columns, row, strict=True)) for row in zip(*rows, strict=True)]


_TABLE = {
    "cutting_speed": ("speed", "m/min", "g", 1),
    "feed": ("feed", "mm/rev", "g", 1),
    "depth_of_cut": ("depth", "mm", "g", 1),
    "hardness": ("hardness", "-", "g", 1),
    "time": ("time", "min", ".2f", 1),
    "wear": ("wear", "mm", ".3f", 1),
    "wear_share": ("of limit", "%", ".0f", 100),
    "thrust_force": ("thrust", "N", ".0f", 1),
    "thrust_force_share": ("of limit", "%", ".0f", 100),
    "power": ("power", "kW", ".2f", 1),
    "power_share": ("of limit", "%", ".0f", 100),
    "tool_life": ("tool life", "min", ".1f", 1),
    "removal_rate": ("MRR", "cm3/min", ".1f", 1),
    "spindle_speed": ("spindle", "rev/min", ".0f", 1),
}
"""Heading, unit, format and factor of each column of the text table."""


def table(cuts: Cuts, prediction: "Prediction | None" = None) -> Iterator[str]:
    """Yield an aligned table with units, intervals if laws were fitted, and in the last column the limits that are exceeded.

    A star marks cuts that extrapolate.
    """
    columns = []
    for name, (heading, unit, shape, factor) in _TABLE.items():
        values = getattr(cuts, name).ravel()  # 0 are shares of limits that are off
        columns.append(
            [
                heading,
                unit,
                *(format(factor * value, shape) if value else "off" for value in values),
            ]
        )
        if prediction and np.isfinite(prediction.low.get(name, np.nan)).any():
            ends = zip(prediction.low[name].ravel(), prediction.high[name].ravel(), strict=True)
            columns.append(["95 %", unit, *(f"{low:{shape}}-{high:{shape}}" for low, high in ends)])
    if prediction:
        columns.append(["", "", *("*" * int(beyond) for beyond in prediction.extrapolated.ravel())])
    shares = {"wear": cuts.wear_share, "thrust": cuts.thrust_force_share, "power": cuts.power_share}
    over = np.stack([share.ravel() for share in shares.values()], axis=1) > 1
    columns.append(["exceeded", "", *(", ".join(np.array(list(shares))[row]) for row in over)])
    yield from aligned(list(zip(*columns, strict=True)))
