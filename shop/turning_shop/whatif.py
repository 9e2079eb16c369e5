"""Predict cuts at constant speed, feed and depth from a scenario's laws.

Values are nominal: they ignore model mismatch. ``prediction.py`` adds intervals to laws that were
fitted to measurements, and ``tables.py`` prints cuts.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from turning_shop import Values

from turning_env.numerics.conversions import spindle_speed_at
from turning_env.scenario import Scenario
from turning_env.scenario.laws import (
    capacity_at,
    life_rate,
    load_shares,
    loads_at,
    removal_rate_at,
)

NO_LIMIT = {"thrust_force": 1e6, "power": 1e4}
"""Limits [N], [kW] that count as none: the largest that a scenario may have. Their share is 0."""
CHANGES = np.arange(1, 11) / 10
"""Flank wears at which an edge change is tried, over the wear criterion [-]."""


class Cuts(NamedTuple):
    """Cuts by an edge at the same speed, feed and depth since it was fresh: arrays of one shape.

    Attributes:
        cutting_speed, feed, depth_of_cut: The settings [m/min], [mm/rev], [mm].
        hardness: Hardness of the bar over nominal [-].
        time, wear: Cutting time of the edge [min] and its flank wear after that time [mm].
        thrust_force, power: Thrust force [N] and spindle power [kW], with the idle power, at that
            wear.
        tool_life: Cutting time from fresh to the wear criterion [min].
        removal_rate: Material removal rate [cm3/min].
        spindle_speed: Spindle speed at the workpiece's diameter [rev/min].
        wear_share, thrust_force_share, power_share: Wear over the wear criterion, force and power
            over their limits [-].
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
        loads_kept = (self.thrust_force_share <= 1) & (self.power_share <= 1)
        return np.asarray((self.wear_share <= 1) & loads_kept)


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

    All values are positive scalars or arrays that broadcast to one shape, in the units of ``Cuts``.
    The depth of cut is the scenario's nominal one if it is None. Tool lives are at most 1e308 min.

    Raises:
        TypeError: Both or neither of time and wear are given.
    """
    if (time is None) == (wear is None):
        raise TypeError("either time or wear must be given, and not both")
    if depth_of_cut is None:
        depth_of_cut = scenario.workpiece.depth_of_cut
    given_age = wear if time is None else time
    given = (cutting_speed, feed, depth_of_cut, hardness, given_age)
    arrays = np.broadcast_arrays(*(np.asarray(values, np.float64) for values in given))
    names = ("cutting_speed", "feed", "depth_of_cut", "hardness")
    settings = dict(zip(names, arrays[:-1], strict=True))
    age = arrays[-1]
    speed = settings["cutting_speed"]

    material = scenario.material
    criterion = scenario.tool.wear_criterion
    with np.errstate(over="ignore", divide="ignore"):
        if time is None:
            edge_wear = age
            # The rate to a wear of 0 is infinite: a fresh edge has cut for no time.
            edge_time = np.where(age > 0.0, 1.0 / life_rate(material.wear, age, **settings), 0.0)
        else:
            edge_wear = material.wear(**settings, time=age)
            edge_time = age
        life = 1.0 / life_rate(material.wear, criterion, **settings)
        loads = loads_at(scenario, **settings, wear=edge_wear)

    limits = scenario.limits
    has_force_limit = limits.thrust_force < NO_LIMIT["thrust_force"]
    has_power_limit = limits.power < NO_LIMIT["power"]
    shares = load_shares(loads, limits, capacity=capacity_at(scenario, speed))
    return Cuts(
        **settings,
        time=edge_time,
        wear=edge_wear,
        thrust_force=loads.thrust_force,
        power=loads.power,
        tool_life=life,
        removal_rate=removal_rate_at(speed, settings["feed"], settings["depth_of_cut"]),
        spindle_speed=spindle_speed_at(speed, scenario.workpiece.diameter),
        wear_share=edge_wear / criterion,
        thrust_force_share=shares.thrust_force * has_force_limit,
        power_share=shares.power * has_power_limit,
    )
