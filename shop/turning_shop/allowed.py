"""Compute which feeds and loads advice allows: one rule for all commands.

Feeds lie in the machine's range, below half the nose radius, and in the chip breaker's window if
chips can tangle.

Loads are those of a bar of nominal depth and hardness. If the scenario says that bars vary, a load
stays so far below its limit that such bars exceed it in no more than the allowed share of the time.
If the scenario states the strength of edges, the thrust force stays so far below it that edges
hardly ever break.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special
from turning_shop import WorkshopError
from turning_shop.whatif import NO_LIMIT, Cuts

from turning_env.numerics.wear_term import term_of_factor, wear_term_slope
from turning_env.physics.spindle import capacity_at
from turning_env.scenario import Scenario

FEED_PER_NOSE = 0.5
"""Highest feed over the nose radius [-] (assumption: a rule of thumb for roughing)."""
NO_STRENGTH = 1e6
"""Edge strength [N] that counts as none stated: the largest that a scenario may have.

Such edges do not break.
"""
STRENGTH_DEVIATIONS = 2.5
"""Standard deviations of edge strength and thrust force together between the two [-].

An edge meets the hardest and thickest of many places. Of 256 simulated edges, at most 5 broke in
each of seven scenarios; at 2.0, up to 9 did.
"""
LASTING_DEVIATIONS = 1.96
"""Standard deviations of edges by which the change comes early [-]: 97.5 % last."""
MIN_ALLOWANCE = 1e-4  # smallest share of time in overload that a margin is computed for [-]
MOMENTS = 200  # moments of an edge's life at which the share of time in overload is computed


def feed_range(scenario: Scenario) -> tuple[float, float]:
    """Return the lowest and the highest feed that advice may choose [mm/rev].

    Raises:
        WorkshopError: The nose radius allows no feed of the machine.
    """
    low, high = scenario.feed_range
    radius = scenario.tool.nose_radius
    if radius:
        high = min(high, FEED_PER_NOSE * radius)
    if low >= high:
        raise WorkshopError(
            f"no feed is left: feeds begin at {low:g} mm/rev and end at {high:g} mm/rev, "
            "by the machine's range, the window of chips if swarf.tangle_rate is above 0, "
            f"and half of tool.nose_radius, which is {radius:g} mm (0: unknown)"
        )
    return float(low), float(high)


def needed_nose_radius(feed: float) -> float:
    """Return the smallest nose radius [mm] of an insert for a feed [mm/rev]."""
    return feed / FEED_PER_NOSE


class Allowed(NamedTuple):
    """Largest loads at the change of the edge, in a bar of nominal depth and hardness.

    They are infinite without a limit.
    """

    thrust_force: float  # [N]
    power: float  # [kW], at and above the spindle's base speed
    overload_factors: dict[str, float]  # of limits that are on: the allowed load over the limit [-]
    by_strength: bool  # whether the thrust force is bound by the strength of edges

    def keeps(self, scenario: Scenario, cuts: Cuts) -> NDArray[np.bool_]:
        """Return which cuts keep the loads and the wear criterion."""
        force_kept = cuts.thrust_force <= self.thrust_force
        power_kept = cuts.power <= self.power * capacity_at(scenario, cuts.cutting_speed)
        return np.asarray((cuts.wear_share <= 1.0) & force_kept & power_kept)


def allowed_loads(scenario: Scenario) -> Allowed:
    """Return the largest loads that advice allows."""
    tool = scenario.tool
    limits = {}
    for name, no_limit in NO_LIMIT.items():
        limit = getattr(scenario.limits, name)
        if limit < no_limit:
            limits[name] = limit
    factors = {name: _overload_factor(scenario, name, len(limits)) for name in limits}
    loads = {name: factors[name] * limit for name, limit in limits.items()}
    force = loads.get("thrust_force", math.inf)
    by_strength = False
    if tool.edge_strength < NO_STRENGTH:
        # Strength and force are log-normal and independent, so that their variances add.
        spread = math.hypot(tool.edge_strength_spread, load_spread(scenario, "thrust_force"))
        bearable = tool.edge_strength * math.exp(-STRENGTH_DEVIATIONS * spread)
        by_strength = bearable < force
        force = min(force, bearable)
    return Allowed(
        thrust_force=force,
        power=loads.get("power", math.inf),
        overload_factors=factors,
        by_strength=by_strength,
    )


def limited_by_strength(scenario: Scenario) -> tuple[Scenario, str]:
    """Return a scenario that limits the thrust force by its edges' strength, and a note on it.

    The scenario is unchanged and the note is empty if it is a preset, if no file states the
    strength of edges, or if the limit of the thrust force is lower.
    """
    allowed = allowed_loads(scenario)
    if scenario.file is None or not allowed.by_strength:
        return scenario, ""
    limits = scenario.limits.model_copy(update={"thrust_force": allowed.thrust_force})
    strength = f"half of the edges break at {scenario.tool.edge_strength:g} N, tool.edge_strength"
    note = (
        f"the thrust force is limited to {allowed.thrust_force:.0f} N: "
        f"{strength}, and bars and edges vary"
    )
    return scenario.model_copy(update={"limits": limits}), note


def load_spread(scenario: Scenario, name: str) -> float:
    """Return the log standard deviation of a load from place to place of the bars [-].

    Bars vary in depth and hardness, which the load follows with its exponents.
    """
    work = scenario.workpiece
    law = getattr(scenario.material, name)
    depth = math.hypot(work.depth_bar_spread, work.depth_along_spread) / work.depth_of_cut
    hardness = math.hypot(work.hardness_bar_spread, work.hardness_along_spread)
    return math.hypot(law.depth_of_cut * depth, law.hardness * hardness)


def _overload_factor(scenario: Scenario, name: str, num_limits: int) -> float:
    """Return the largest load of a nominal bar at the edge change over its limit [-].

    During an edge's life, with g the exponent of time in wear and e that of U, the term of wear,

        load = load at the change * (U(wear) / U(wear at the change))^e
        wear = wear at the change * (time / life)^g

    Bars that vary multiply it by a log-normal number. The share of time above
    limit * (1 + tolerance) is the mean of the normal distribution over the life. The limits share
    the allowance equally. Most edges are changed before they reach the wear at the change, which
    97.5 % of edges do not exceed.
    """
    limits = scenario.limits
    law = getattr(scenario.material, name)
    bar_spread = load_spread(scenario, name)
    allowance = max(limits.overload_allowance / num_limits, MIN_ALLOWANCE)
    if bar_spread == 0.0 or allowance >= 0.5:
        return 1.0
    # U is the wear or 1 + b wear: turning_env/numerics/wear_term.py.
    log_wear = math.log(scenario.tool.wear_criterion)
    slope = float(wear_term_slope(law.wear_growth, log_wear))
    edge_spread = law.wear * slope * scenario.tool.wear_factor_spread
    spread = math.hypot(bar_spread, edge_spread)
    used_life = (np.arange(MOMENTS) + 0.5) / MOMENTS
    # The usual edge is changed before it reaches the wear at the change.
    at_change = -LASTING_DEVIATIONS * edge_spread
    log_wear_share = scenario.material.wear.time * np.log(used_life)
    log_load = at_change + law.wear * term_of_factor(law.wear_growth, log_wear, log_wear_share)

    def excess_time(log_factor: float) -> float:
        """Return the share of time in overload above the allowance [-]."""
        in_overload = special.ndtr((log_factor + log_load) / spread)
        return float(in_overload.mean()) - allowance

    # Five standard deviations beyond the lowest and the highest load, the share is 0 or 1.
    largest = float(np.abs(log_load).max())
    log_factor = optimize.brentq(
        excess_time,
        -5.0 * spread - largest,
        5.0 * spread + largest,
    )
    return min(1.0, (1.0 + limits.overload_tolerance) * math.exp(log_factor))
