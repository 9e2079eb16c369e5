"""What a scenario's laws say of cuts at constant speed, feed and depth."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from turning_env.scenario import Scenario

Values = NDArray[np.float64]


class Cuts(NamedTuple):
    """Cuts, each an array of the same shape. The edge was fresh and has cut at these parameters throughout."""

    cutting_speed: Values
    """[m/min]"""
    feed: Values
    """[mm/rev]"""
    depth_of_cut: Values
    """[mm]"""
    hardness: Values
    """Over nominal [-]."""
    time: Values
    """For which the edge has cut [min]."""
    wear: Values
    """Flank wear after that [mm]."""
    thrust_force: Values
    """At that wear [N]."""
    power: Values
    """At that wear [kW]."""
    tool_life: Values
    """From fresh to the wear criterion [min]."""
    removal_rate: Values
    """[cm3/min]"""
    spindle_speed: Values
    """At the workpiece's diameter [rev/min]."""
    wear_share: Values
    """Wear over the wear criterion [-]."""
    thrust_force_share: Values
    """Thrust force over its limit [-]."""
    power_share: Values
    """Spindle power over its limit [-]."""

    @property
    def within_limits(self) -> NDArray[np.bool_]:
        """Whether wear, force and power are all within their limits."""
        return np.asarray((self.wear_share <= 1) & (self.thrust_force_share <= 1) & (self.power_share <= 1))


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
    """Cuts of an edge that has cut for a ``time`` [min], or until it has a ``wear`` [mm]: exactly one of them is given.

    Args:
        scenario: Whose material, limits, wear criterion and diameter count; nothing else of it does.
        cutting_speed: [m/min]
        feed: [mm/rev]
        depth_of_cut: [mm]; the scenario's nominal depth if None.
        hardness: Over nominal [-].
        time: [min]
        wear: [mm]

    All are positive scalars or arrays that broadcast to one shape. A life too long to be a number is infinite.

    Raises:
        TypeError: both or none of time and wear are given.
    """
    if (time is None) == (wear is None):
        raise TypeError("either time or wear must be given, and not both")
    material, limits, criterion = scenario.material, scenario.limits, scenario.tool.wear_criterion
    depth_of_cut = scenario.workpiece.depth_of_cut if depth_of_cut is None else depth_of_cut
    given = [np.asarray(x, np.float64) for x in (cutting_speed, feed, depth_of_cut, hardness, wear if time is None else time)]
    speed, feeds, depth, hard, age = np.broadcast_arrays(*given)
    with np.errstate(over="ignore"):
        after_a_minute = material.wear(speed, feeds, depth, time=1.0, hardness=hard)
        if time is None:
            worn, age = age, _time_until(age, after_a_minute, material.wear.time)
        else:
            worn = material.wear(speed, feeds, depth, time=age, hardness=hard)
        life = _time_until(criterion, after_a_minute, material.wear.time)
        force = material.thrust_force(speed, feeds, depth, wear=worn, hardness=hard)
        power = material.power(speed, feeds, depth, wear=worn, hardness=hard)
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
        thrust_force_share=force / limits.thrust_force,
        power_share=power / limits.power,
    )


def _time_until(wear: Any, after_a_minute: Any, exponent: float) -> Any:
    """Time [min] after which a fresh edge has a wear, of the wear after a minute and the law's exponent of time."""
    return (wear / after_a_minute) ** (1.0 / exponent)
