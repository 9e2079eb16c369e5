"""Compute which feeds and loads advice allows: one rule for all commands.

Feeds lie in the machine's range, below half the nose radius, and in the chip breaker's window if
chips can tangle. If a roughness is stated, they keep it.

Loads are those of a bar of nominal depth and hardness. If the scenario says that bars vary, a load
stays so far below its limit that such bars exceed it in no more than the allowed share of the time.
If the scenario states the strength of edges, the thrust force stays so far below it that edges
hardly ever break. If it states how the bar is held, or the overhang of the tool, the force bends
both together by no more than ``MAX_DEFLECTION``.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, special
from turning_shop import WorkshopError
from turning_shop.whatif import NO_LIMIT, Cuts

from turning_env.numerics.wear_term import term_of_factor
from turning_env.physics.slender_bar import CHUCK, SUPPORTS, compliance, rod_flexibility
from turning_env.scenario import Scenario
from turning_env.scenario.laws import (
    LoadShares,
    capacity_at,
    feed_at_limit,
    load_shares,
    load_spread,
)
from turning_env.scenario.power_law import wear_exponent
from turning_env.scenario.sections import FeedLimit

FEED_PER_NOSE = 0.5
"""Highest feed over the nose radius [-] (assumption: a rule of thumb for roughing)."""
MAX_DEFLECTION = 0.1
"""Largest deflection between bar and tool [mm] (assumption for roughing)."""
SLENDER = {"chuck": 3.0, "tailstock": 8.0}
"""Length over diameter above which bars often chatter, by their support [-].

Assumption: rules of thumb of the workshop.
"""
SLENDER_HOLDER = 4.0
"""Overhang over diameter above which holders of steel often chatter [-].

Assumption: a rule of thumb of tool makers. Holders of cemented carbide reach 6.
"""
SLENDER_CARBIDE = 6.0
CARBIDE_MODULUS = 400_000.0  # from which a shank counts as cemented carbide [N/mm2]
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
PLACES = 201  # along the bar at which its deflection is computed
MOMENTS = 200  # moments of an edge's life at which the share of time in overload is computed


class FeedEnd(NamedTuple):
    """An upper end of the feeds."""

    feed: float  # [mm/rev]
    reason: str  # for people


def feed_ends(scenario: Scenario) -> list[FeedEnd]:
    """Return the upper ends of the feeds, the lowest first."""
    _, by_machine = scenario.feed_range
    ends = [FeedEnd(float(by_machine), "the end of the machine's range or of the chip window")]
    radius = scenario.tool.nose_radius
    if radius:
        by_nose = FEED_PER_NOSE * radius
        ends.append(FeedEnd(by_nose, f"half of tool.nose_radius, {radius:g} mm"))
    limit = scenario.limits.roughness
    if limit.bounds and limit.feed > 0.0:
        at_unit_feed = limit(1.0, 1.0, scenario.workpiece.depth_of_cut)
        by_roughness = feed_at_limit(limit, limit.most, at_unit_feed=at_unit_feed)
        reason = f"limits.roughness, {1000 * limit.most:g} um"
        ends.append(FeedEnd(float(by_roughness), reason))
    return sorted(ends)


def feed_range(scenario: Scenario) -> tuple[float, float]:
    """Return the lowest and the highest feed that advice may choose [mm/rev].

    Raises:
        WorkshopError: No feed of the machine is left.
    """
    low, _ = scenario.feed_range
    end = feed_ends(scenario)[0]
    if low >= end.feed:
        raise WorkshopError(
            f"no feed is left: feeds begin at {low:g} mm/rev, by machine.feed_min or the window of "
            f"chips, and end at {end.feed:.3g} mm/rev, by {end.reason}"
        )
    return float(low), end.feed


def theoretical_roughness(feed: float, nose_radius: float) -> float:
    """Return Rt = f^2 / (8 r) [um] at a feed [mm/rev] and a nose radius [mm]."""
    return 1000.0 * feed**2 / (8.0 * nose_radius)


WIPER_SHARE = 0.5
"""Roughness behind a wiper over the theoretical one [-] (makers' guides: about half)."""


def with_roughness(scenario: Scenario, roughness: float, wiper: bool = False) -> Scenario:
    """Return a scenario that limits the theoretical roughness Rt [um], also behind a wiper.

    Raises:
        WorkshopError: The nose radius is not stated.
    """
    radius = scenario.tool.nose_radius
    if not radius:
        raise WorkshopError("--roughness needs the nose radius: --nose-radius or tool.nose_radius")
    coefficient = 1.0 / (8.0 * radius)
    if wiper:
        coefficient *= WIPER_SHARE
    limit = FeedLimit(coefficient=coefficient, feed=2.0, most=roughness / 1000.0)
    limits = scenario.limits.model_copy(update={"roughness": limit})
    return scenario.model_copy(update={"limits": limits})


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
    by_deflection: bool  # whether it is bound by the deflection of bar and tool

    def keeps(self, scenario: Scenario, cuts: Cuts) -> NDArray[np.bool_]:
        """Return which cuts keep the loads and the wear criterion."""
        shares = self.shares(scenario, cuts)
        return np.asarray((cuts.wear_share <= 1.0) & (shares.highest <= 1.0))

    def shares(self, scenario: Scenario, cuts: Cuts) -> LoadShares:
        """Return the loads of cuts over the allowed ones."""
        return load_shares(cuts, self, capacity=capacity_at(scenario, cuts.cutting_speed))


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
        force_spread = load_spread(scenario.material.thrust_force, scenario.workpiece)
        spread = math.hypot(tool.edge_strength_spread, force_spread)
        bearable = tool.edge_strength * math.exp(-STRENGTH_DEVIATIONS * spread)
        by_strength = bearable < force
        force = min(force, bearable)
    at_deflection = bending_force_of_bar(scenario)
    by_deflection = at_deflection < force
    return Allowed(
        thrust_force=min(force, at_deflection),
        power=loads.get("power", math.inf),
        overload_factors=factors,
        by_strength=by_strength and not by_deflection,
        by_deflection=by_deflection,
    )


def bending_force_of_bar(scenario: Scenario) -> float:
    """Return ``bending_force`` of the scenario's own bar [N]."""
    work = scenario.workpiece
    length = work.overhang or work.bar_length
    return bending_force(scenario, diameter=work.diameter, length=length)


def bending_force(scenario: Scenario, diameter: float, length: float) -> float:
    """Return the thrust force that bends bar and tool by ``MAX_DEFLECTION`` [N].

    It is infinite if both are rigid. The bar is solid, with a diameter and a free length [mm].
    Radial forces bend both as beams, one after the other, so that their compliances add.
    """
    work = scenario.workpiece
    of_bar = _bar_compliance(scenario, diameter, length)
    largest = (of_bar + _holder_compliance(scenario)) * work.radial_share
    return MAX_DEFLECTION / largest if largest > 0.0 else math.inf


def _bar_compliance(scenario: Scenario, diameter: float, length: float) -> float:
    """Return the largest deflection over radial force along a bar [mm/N]."""
    work = scenario.workpiece
    if work.support == "rigid":
        return 0.0
    along = length * np.linspace(0.0, 1.0, PLACES)
    flexibility = rod_flexibility(diameter, work.elastic_modulus)
    compliances = compliance(SUPPORTS[work.support], along, length, flexibility)
    return float(compliances.max())


def _holder_compliance(scenario: Scenario) -> float:
    """Return the deflection over radial force at the tip of the tool [mm/N]; 0 if it is rigid."""
    tool = scenario.tool
    if not tool.overhang:
        return 0.0
    # A holder is a cantilever like a bar in a chuck, loaded at its free end.
    flexibility = rod_flexibility(tool.shank_diameter, tool.shank_modulus)
    return float(compliance(CHUCK, 0.0, tool.overhang, flexibility))


def bending_parts(scenario: Scenario) -> str:
    """Return what may bend, for people: bar, tool or both; empty if both are rigid."""
    bar_bends = scenario.workpiece.support != "rigid"
    if bar_bends and scenario.tool.overhang:
        return "bar and tool"
    if scenario.tool.overhang:
        return "the tool"
    return "the bar" if bar_bends else ""


def bending(scenario: Scenario) -> str:
    """Return what bends at ``bending_force``, and how far, for people."""
    parts = bending_parts(scenario)
    verb = "bend" if parts == "bar and tool" else "bends"
    return f"{parts} {verb} by {MAX_DEFLECTION:g} mm"


def bending_fields(scenario: Scenario) -> str:
    """Return the fields that make bar or tool bend, with their values, for people."""
    work = scenario.workpiece
    tool = scenario.tool
    fields = []
    if work.support != "rigid":
        fields.append(f"workpiece.support, {work.support}")
    if tool.overhang:
        fields.append(f"tool.overhang, {tool.overhang:g} mm of {tool.shank_diameter:g} mm diameter")
    return "; ".join(fields)


def without_bending(scenario: Scenario) -> Scenario:
    """Return a scenario whose bar and tool do not bend."""
    work = scenario.workpiece.model_copy(update={"support": "rigid"})
    tool = scenario.tool.model_copy(update={"overhang": 0.0})
    return scenario.model_copy(update={"workpiece": work, "tool": tool})


def with_bending_as_limit(scenario: Scenario) -> Scenario:
    """Return a scenario whose limit of the thrust force allows the force that bends bar and tool.

    It is for the simulation, whose controllers know limits of load alone. The scenario is unchanged
    if bending does not bind. If bars vary, the limit is as far above the allowed force as for other
    limits.
    """
    allowed = allowed_loads(scenario)
    if not allowed.by_deflection:
        return scenario
    limited = _with_thrust_limit(scenario, allowed.thrust_force)
    factors = allowed_loads(without_bending(limited)).overload_factors
    return _with_thrust_limit(scenario, allowed.thrust_force / factors["thrust_force"])


def _with_thrust_limit(scenario: Scenario, force: float) -> Scenario:
    """Return a scenario with another limit of the thrust force [N]."""
    limits = scenario.limits.model_copy(update={"thrust_force": force})
    return scenario.model_copy(update={"limits": limits})


def limited_by_strength(scenario: Scenario) -> tuple[Scenario, str]:
    """Return a scenario that limits the thrust force by its edges' strength, and a note on it.

    The scenario is unchanged and the note is empty if it is a preset, if no file states the
    strength of edges, or if the limit of the thrust force is lower.
    """
    # A program has another bar, whose bending ``limited_by_bending`` adds.
    allowed = allowed_loads(without_bending(scenario))
    if scenario.file is None or not allowed.by_strength:
        return scenario, ""
    strength = f"half of the edges break at {scenario.tool.edge_strength:g} N, tool.edge_strength"
    note = (
        f"the thrust force is limited to {allowed.thrust_force:.0f} N: "
        f"{strength}, and bars and edges vary"
    )
    return _with_thrust_limit(scenario, allowed.thrust_force), note


def limited_by_bending(scenario: Scenario, diameter: float, length: float) -> tuple[Scenario, str]:
    """Return a scenario that limits the thrust force by bending of bar and tool, and a note on it.

    The scenario is unchanged and the note is empty if it is a preset, if no file states how the bar
    is held nor the overhang of the tool, or if the limit of the thrust force is lower.

    Args:
        scenario: the machine, how it holds the bar, and the tool.
        diameter: of the bar [mm].
        length: of the bar [mm], which is free from the chuck unless workpiece.overhang is stated.
    """
    overhang = scenario.workpiece.overhang
    free_length = overhang or length
    force = bending_force(scenario, diameter=diameter, length=free_length)
    if scenario.file is None or force >= scenario.limits.thrust_force:
        return scenario, ""

    note = f"the thrust force is limited to {force:.0f} N, at which {bending(scenario)}: "
    note += bending_fields(scenario)
    if scenario.workpiece.support != "rigid":
        assumed = ""
        if not overhang:
            assumed = ", its whole length (assumption: workpiece.overhang)"
        note += f"; the bar has {diameter:g} mm diameter and is free over "
        note += f"{free_length:g} mm{assumed}"
    return _with_thrust_limit(scenario, force), note


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
    bar_spread = load_spread(law, scenario.workpiece)
    allowance = max(limits.overload_allowance / num_limits, MIN_ALLOWANCE)
    if bar_spread == 0.0 or allowance >= 0.5:
        return 1.0
    # U is the wear or 1 + b wear: turning_env/numerics/wear_term.py.
    log_wear = math.log(scenario.tool.wear_criterion)
    edge_spread = float(wear_exponent(law, log_wear)) * scenario.tool.wear_factor_spread
    spread = math.hypot(bar_spread, edge_spread)
    used_life = (np.arange(MOMENTS) + 0.5) / MOMENTS
    # The usual edge is changed before it reaches the wear at the change.
    at_change = -LASTING_DEVIATIONS * edge_spread
    log_wear_share = scenario.material.wear.time * np.log(used_life)
    log_term = term_of_factor(law.wear_growth, log_wear, log_wear_share)
    log_load = at_change + law.wear * log_term

    def excess_time(log_factor: float) -> float:
        """Return the share of time in overload above the allowance [-]."""
        # Exact, unlike the rules' ``normal.probability``, which has the same bits on all
        # processors: an allowance may be as small as ``MIN_ALLOWANCE``.
        in_overload = special.ndtr((log_factor + log_load) / spread)
        return float(in_overload.mean()) - allowance

    # Five standard deviations beyond the lowest and the highest load, the share is 0 or 1.
    largest = float(np.abs(log_load).max())
    log_factor = optimize.brentq(
        excess_time,
        -5.0 * spread - largest,
        5.0 * spread + largest,
    )
    factor = (1.0 + limits.overload_tolerance) * math.exp(log_factor)
    return min(1.0, factor)
