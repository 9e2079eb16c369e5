"""Loads, lives and costs of a cut by a scenario's laws, each formula once.

The functions take numbers or arrays that broadcast, and a ``Scenario`` or a ``ScenarioBatch`` where
they need no more than its fields. The environment's transition has compiled equations of its own
(``physics``). Searches for a best speed and feed differ in what they know and in how they search,
but they share two questions, and both are answered here:

* Limits: is the force at most its limit, and the power at most the limit times the spindle's
  capacity (``load_shares``)? The highest feed that keeps a limit is ``feed_at_limit``.
* Objective: what does the metal cost (``machining_cost``)?

      cost = time + edge price * used lives    [min of machine time]

  Per cm3, with the time 1 / (vc f ap), it is the cost of metal of Sharmazanashvili (2008). Per
  part, it is the cost of a part over the machine's rate. The reward charges the same terms.
"""

from typing import Any, NamedTuple

import numpy as np

from turning_env.numerics.conversions import cutting_speed_at
from turning_env.numerics.functions import hypotenuse, real_power

MIN_POWER = 1e-6
"""Lower bound of the power that is left for cutting [kW], so that quotients and roots exist."""


class Loads(NamedTuple):
    """Loads of a cut."""

    thrust_force: Any  # [N]
    power: Any  # [kW]


class LoadShares(NamedTuple):
    """Loads over their limits [-]."""

    thrust_force: Any
    power: Any

    @property
    def highest(self) -> Any:
        """The higher one; the cut keeps both limits if it is at most 1."""
        return np.maximum(self.thrust_force, self.power)


def removal_rate_at(cutting_speed: Any, feed: Any, depth_of_cut: Any) -> Any:
    """Return the material removal rate vc f ap [cm3/min]; arguments in m/min, mm/rev and mm."""
    return cutting_speed * feed * depth_of_cut


def power_capacity(cutting_speed: Any, base_cutting_speed: Any) -> Any:
    """Return the available over the rated power [-], min(1, n / n_b); see ``physics/spindle.py``.

    Args:
        cutting_speed: cutting speed [m/min].
        base_cutting_speed: that at the spindle's base speed [m/min]; 0: there is none.
    """
    has_base_speed = np.greater(base_cutting_speed, 0.0)
    base = np.where(has_base_speed, base_cutting_speed, cutting_speed)
    return np.minimum(cutting_speed / base, 1.0)


def capacity_at(scenario: Any, cutting_speed: Any) -> Any:
    """Return the available over the rated power [-] at cutting speeds [m/min]."""
    return power_capacity(cutting_speed, scenario.base_cutting_speed)


def idle_power_at(scenario: Any, cutting_speed: Any) -> Any:
    """Return the power of the idling spindle [kW] at cutting speeds [m/min]."""
    # P = 2 pi n M_0 with n = vc / (pi d); 30 converts m/min, mm and N m to kW.
    return scenario.spindle.idle_torque / (30.0 * scenario.workpiece.diameter) * cutting_speed


def cutting_power_limit(scenario: Any, cutting_speed: Any, tolerated: float = 1.0) -> Any:
    """Return the limit of the power that the cut itself takes [kW], at least ``MIN_POWER``.

    It is limit * capacity - idle power. ``tolerated``: factor on the limit [-].
    """
    available = scenario.limits.power * capacity_at(scenario, cutting_speed)
    left = tolerated * available - idle_power_at(scenario, cutting_speed)
    return np.maximum(left, MIN_POWER)


def loads_at(
    scenario: Any,
    cutting_speed: Any,
    feed: Any,
    depth_of_cut: Any,
    wear: Any,
    hardness: Any = 1.0,
) -> Loads:
    """Return the loads of a scenario's cut at a flank wear [mm]; the power includes idling.

    Cutting speed in m/min, feed in mm/rev, depth of cut in mm, hardness over nominal.
    """
    material = scenario.material
    force = material.thrust_force(cutting_speed, feed, depth_of_cut, wear=wear, hardness=hardness)
    power = material.power(cutting_speed, feed, depth_of_cut, wear=wear, hardness=hardness)
    return Loads(thrust_force=force, power=power + idle_power_at(scenario, cutting_speed))


def load_shares(loads: Any, limits: Any, capacity: Any) -> LoadShares:
    """Return loads over their limits.

    Args:
        loads: has ``thrust_force`` [N] and ``power`` [kW], the spindle's with its idle power.
        limits: has limits of both.
        capacity: available over rated power [-].
    """
    return LoadShares(
        thrust_force=loads.thrust_force / limits.thrust_force,
        power=loads.power / (limits.power * capacity),
    )


def feed_at_limit(law: Any, most: Any, at_unit_feed: Any) -> Any:
    """Return the feed at which a response reaches a limit, or inf if it does not grow with feed.

    R(f) = R(1) f^b, so f = (limit / R(1))^(1/b) [mm/rev].

    Args:
        law: the response's law.
        most: its limit, in the unit of the law.
        at_unit_feed: response at 1 mm/rev, in the same unit.
    """
    share = np.asarray(most / at_unit_feed)
    if law.feed > 0.0:
        return real_power(share, 1.0 / law.feed)
    return np.full_like(share, np.inf)


def depth_spread(workpiece: Any) -> Any:
    """Return the standard deviation of the depth of cut from place to place of all bars [mm]."""
    return hypotenuse(workpiece.depth_bar_spread, workpiece.depth_along_spread)


def hardness_spread(workpiece: Any) -> Any:
    """Return the standard deviation of the log hardness from place to place of all bars [-]."""
    return hypotenuse(workpiece.hardness_bar_spread, workpiece.hardness_along_spread)


def load_spread(law: Any, workpiece: Any) -> Any:
    """Return the standard deviation of a log response from place to place of all bars [-].

    Depth and hardness vary independently, and the response follows them with its exponents c and
    h: sqrt((c s_ap / ap)^2 + (h s_H)^2), to first order in the spreads.
    """
    relative_depth_spread = depth_spread(workpiece) / workpiece.depth_of_cut
    return hypotenuse(
        law.depth_of_cut * relative_depth_spread, law.hardness * hardness_spread(workpiece)
    )


def chatter_cutting_speed(scenario: Any) -> Any:
    """Return the cutting speed at the spindle speed at which bars chatter most [m/min]."""
    return cutting_speed_at(scenario.machine.chatter_speed, scenario.workpiece.diameter)


def life_rate(
    law: Any, wear: Any, cutting_speed: Any, feed: Any, depth_of_cut: Any, hardness: Any = 1.0
) -> Any:
    """Return 1 / T [1/min], with T the time in which a fresh edge reaches a flank wear.

    W = K t^n (Alaskari and Oraby 2018), so 1 / T = (K / W)^(1/n).

    Args:
        law: law of wear, whose K is the wear after a minute.
        wear: flank wear [mm]; at the wear criterion, T is the tool life.
        cutting_speed: cutting speed [m/min].
        feed: feed [mm/rev].
        depth_of_cut: depth of cut [mm].
        hardness: over nominal [-].
    """
    after_a_minute = law(cutting_speed, feed, depth_of_cut, hardness=hardness)
    return real_power(after_a_minute / wear, 1.0 / law.time)


def used_life_at(scenario: Any, wear: Any) -> Any:
    """Return the used share of an edge's life D = (W / W_max)^(1/n) [-] at a flank wear W [mm]."""
    return real_power(wear / scenario.tool.wear_criterion, 1.0 / scenario.material.wear.time)


def wear_at(scenario: Any, used_life: Any) -> Any:
    """Return the flank wear W_max D^n [mm] at a used share D of an edge's life [-]."""
    return scenario.tool.wear_criterion * real_power(used_life, scenario.material.wear.time)


def edge_price(scenario: Any) -> Any:
    """Return the price of an edge and of its change, in machine time [min]."""
    return scenario.economics.edge_cost + scenario.economics.edge_change_time


def machining_cost(time: Any, used_lives: Any, price_of_edge: Any) -> Any:
    """Return time + price of an edge * used lives [min of machine time].

    All times have one unit, minutes or seconds.

    Args:
        time: time of the cut, edge changes left out.
        used_lives: edges that it uses [-].
        price_of_edge: price of an edge and of its change.
    """
    return time + price_of_edge * used_lives
