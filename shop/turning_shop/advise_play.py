"""Play fixed parameters, rules and agents on the simulated machine, and compare their costs.

Fixed parameters are exactly those that ``advise`` advises. Rules and agents know the prices of the
scenario: the reward's price of an edge is that of ``advise``, and metal earns as much as the
advised cut costs.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from turning_shop import Values, WorkshopError, aligned
from turning_shop.advise import PartPlan, Prices, money, part_volume
from turning_shop.allowed import (
    NO_STRENGTH,
    allowed_loads,
    bending,
    feed_range,
    with_bending_as_limit,
)
from turning_shop.provenance import BARS_VARY, assumed_in_simulation
from turning_shop.units import METRIC, Units

from baselines import catalogue
from baselines.policy_spec import PolicySpec
from leaderboard.adapt import as_factory
from leaderboard.play import Episodes, play
from leaderboard.seeds import held_out_seeds
from leaderboard.statistics import Bootstrap, Estimate, severe_share
from turning_env.action import set_point_action
from turning_env.policy import Actions, Observations, PolicyFactory
from turning_env.scenario import Scenario
from turning_env.scenario.laws import depth_spread, hardness_spread

FIXED = "fixed parameters"  # the advice, whose edge is changed by plan
RULES = ("predictive", "constant_power_lead", "omative", "modified_fuzzy_override")
"""Rules that lead the leaderboards within the limits, of speed and feed and of overrides."""
MAX_EDGE_TIME = 600.0  # longest time of an edge that is played [min]
MAX_STEPS = 50_000
"""Largest number of steps that a rule or an agent plays with an edge.

If an edge lasts longer, the used share of it counts.
"""
MAX_EDGE_COST = 1e4  # largest price of an edge that a scenario may have [min]
PRICING_EDGES = 4  # edges that a rule plays to find the cost of its own parts
CLOCK_INTERVAL = 1.0
"""Control interval of fixed parameters [s]; sub-steps stay as long as the scenario's."""


@dataclass(frozen=True)
class PlayedPolicy:
    """One policy's result."""

    name: str
    removal_rate: float  # metal per minute, edge changes included [cm3/min]
    overload: float  # share of cutting time in severe overload [-]
    feasible: bool  # whether this share is allowed
    broken: int  # edges that broke
    cost: Estimate  # of a part
    saved: Estimate  # cost of a part less than with fixed parameters


@dataclass(frozen=True)
class PlayedAdvice:
    """Results of all policies, the fixed parameters first."""

    unit: str  # currency, or "min" of machine time
    edges: int  # played with each policy
    results: list[PlayedPolicy]
    notes: list[str]  # what was played, and under which assumptions

    def summary(self, units: Units = METRIC) -> Iterator[str]:
        """Yield lines of text: a table of results, and notes on them."""
        yield f"played on {self.edges} simulated edges each"
        rows = [
            ("", "mean MRR", "severe overload", "cost per part", "saved per part"),
            ("", units.name("cm3/min"), "%", f"{self.unit} (95 %)", f"{self.unit} (95 %)"),
        ]
        fixed = self.results[0]
        for result in self.results:
            overload = f"{100 * result.overload:.1f}"
            if not result.feasible:
                overload += " !"
            cost = f"{money(result.cost.value)} {_interval(result.cost, '-')}"
            # The interval of a saving may begin below 0, where a dash would look like a sign.
            saved = f"{money(result.saved.value)} {_interval(result.saved, ' to ')}"
            if result is fixed:
                saved = ""
            rate = units.cell(result.removal_rate, "cm3/min", ".1f")
            rows.append((result.name, rate, overload, cost, saved))
        yield from aligned(rows)
        if not all(result.feasible for result in self.results):
            yield "! in severe overload longer than limits.overload_allowance: not to be used"
        for note in self.notes:
            yield units.text(note)

    def headline(self) -> Iterator[str]:
        """Yield the results of the advice, and the savings over it, as sentences."""
        fixed = self.results[0]
        cost = f"{money(fixed.cost.value)} {self.unit} a part {_interval(fixed.cost, ' to ')}"
        overload = f"{100 * fixed.overload:.1f} % of the cutting time in severe overload"
        yield f"simulated with {self.edges} edges: {cost}, {overload}"
        if fixed.broken:
            yield (
                f"{fixed.broken} of {self.edges} simulated edges broke: "
                "see tool.edge_strength, edge_failure and mismatch"
            )
        if not fixed.feasible:
            yield (
                "in severe overload longer than limits.overload_allowance: not to be used as it is"
            )
        for result in self.results[1:]:
            saved = f"{money(result.saved.value)} {self.unit} a part"
            sentence = f"{result.name} saves {saved} {_interval(result.saved, ' to ')}"
            if result.broken:
                sentence += f", {result.broken} of {self.edges} edges broke"
            yield sentence


def _interval(estimate: Estimate, separator: str) -> str:
    """Return the interval of an amount of money in brackets."""
    return f"({money(estimate.low)}{separator}{money(estimate.high)})"


class _Play(NamedTuple):
    """A policy's name and the episodes that it played."""

    name: str
    episodes: Episodes


def constant(scenario: Scenario, plan: PartPlan) -> Callable[[Observations], Actions]:
    """Return a policy that sets a plan's speed and feed."""
    machine = scenario.machine
    speed = set_point_action(
        plan.cuts.cutting_speed,
        machine.cutting_speed_min,
        high=machine.cutting_speed_max,
    )
    _, highest_feed = feed_range(scenario)
    feed = set_point_action(plan.cuts.feed, machine.feed_min, high=highest_feed)
    action = np.array([speed, feed], np.float32)
    return lambda observations: np.tile(action, (len(observations), 1))


def play_all(
    scenario: Scenario,
    plan: PartPlan,
    agents: Sequence[str],
    edges: int,
    on_play: Callable[[str], object] = lambda name: None,
) -> PlayedAdvice:
    """Play advised parameters, the best rule and agents on simulated edges and bars that vary.

    Args:
        scenario: the machine, the tool and the bars.
        plan: the advice, which is played as it is.
        agents: ONNX files, or ``module:object``.
        edges: number of edges, one per seed.
        on_play: called with the name of each policy before it is played.

    Raises:
        WorkshopError: An agent or no rule can play this scenario.
    """
    seeds = held_out_seeds(edges)
    control = scenario.control
    max_minutes = min(MAX_EDGE_TIME, MAX_STEPS * control.interval / 60.0)
    one_edge = _for_one_edge(scenario, plan, action=control.action, minutes=max_minutes)

    agent_policies = {agent: _policy_of(agent) for agent in agents}

    on_play(FIXED)
    fixed = as_factory(constant(scenario, plan))
    plays = [_Play(FIXED, play(fixed, clocked(scenario, plan), seeds))]
    notes = list(_assumptions(scenario))

    rule_name = f"rule {best_rule(scenario, one_edge).name}"
    on_play(rule_name)
    priced = _at_own_cost(scenario, one_edge, seeds[:PRICING_EDGES])
    rule = best_rule(scenario, priced)
    plays.append(_Play(rule_name, play(rule.make, priced, seeds)))

    for agent, policy in agent_policies.items():
        agent_name = f"agent {Path(agent).stem}"
        on_play(agent_name)
        try:
            plays.append(_Play(agent_name, play(policy, one_edge, seeds)))
        except (TypeError, ValueError) as error:
            raise WorkshopError(f"--agent {agent}: {error}") from error

    results = _results(scenario, plays)
    broken = [f"{result.broken} with {result.name}" for result in results if result.broken]
    if broken:
        notes.append(
            f"of {edges} edges broke {', '.join(broken)}: "
            "see tool.edge_strength, edge_failure and mismatch"
        )
    return PlayedAdvice(Prices.of(scenario).unit, edges, results=results, notes=notes)


def _policy_of(agent: str) -> PolicyFactory:
    """Return an agent's policy; WorkshopError if it is none, OSError if there is no such file."""
    try:
        return as_factory(agent)
    except (TypeError, ValueError) as error:
        raise WorkshopError(f"--agent {agent}: {error}") from error


def _at_own_cost(scenario: Scenario, one_edge: Scenario, seeds: Sequence[int]) -> Scenario:
    """Return ``one_edge`` with metal that earns as much as the best rule's own parts cost.

    At this price, the policy of least cost per part earns 0 and every other one less (Dinkelbach's
    method for ratios). This is one step of the method, from the cost of the advised cut, on a few
    edges.
    """
    rule = best_rule(scenario, one_edge)
    episodes = play(rule.make, one_edge, seeds)
    (result,) = _results(scenario, [_Play(rule.name, episodes)])
    minutes = result.cost.value / Prices.of(scenario).minute
    changes = {"reference_removal_rate": part_volume(scenario) / minutes}
    economics = one_edge.economics.model_copy(update=changes)
    return one_edge.model_copy(update={"economics": economics})


def _assumptions(scenario: Scenario) -> Iterator[str]:
    """Yield notes on how bars and edges differ in the simulation, and on values not stated."""
    work = scenario.workpiece
    tool = scenario.tool
    depth = depth_spread(work)
    hardness = 100 * hardness_spread(work)
    if depth or hardness:
        bars = f"bars vary in depth by {depth:.2g} mm and in hardness by {hardness:.2g} %"
    else:
        unstated = ", ".join(BARS_VARY)
        bars = f"bars do not vary: state {unstated} to see what control saves when they do"
    wear = f"edges differ in wear by {100 * tool.wear_factor_spread:.2g} % (standard deviations)"
    if tool.edge_strength < NO_STRENGTH:
        breaks = f"half of the edges break at {tool.edge_strength:g} N"
    else:
        breaks = "edges do not break by force"
    yield f"{bars}; {wear}; {breaks}"
    allowed = allowed_loads(scenario)
    if allowed.by_deflection:
        yield (
            f"{bending(scenario)} at {allowed.thrust_force:.0f} N: that limits the thrust force "
            "of every control in the simulation"
        )
    assumed = assumed_in_simulation(scenario)
    if assumed:
        yield f"assumed for the simulation, as your files do not state them: {', '.join(assumed)}"


def best_rule(scenario: Scenario, played: Scenario) -> PolicySpec:
    """Return the first of ``RULES`` that is tuned for a scenario or needs no tuning.

    ``played`` is the scenario that the rule plays: the same machine, with episodes of one edge.

    Raises:
        WorkshopError: No rule can play it.
    """
    for name in RULES:
        # A rule raises ValueError if it cannot play the scenario, or is not tuned for it.
        with suppress(ValueError):
            return catalogue.spec(name, played, tuned_on=scenario)
    raise WorkshopError(f"no rule that ships can play {scenario.name!r}")


def clocked(scenario: Scenario, plan: PartPlan) -> Scenario:
    """Return the scenario in which fixed parameters play: episodes as long as a plan uses an edge.

    Nothing is decided meanwhile, so steps of about ``CLOCK_INTERVAL`` save time.
    """
    # Plain bars have no return between them in the simulation.
    minutes = float(plan.parts * (plan.cycle_time - scenario.machine.return_time))
    interval = min(CLOCK_INTERVAL, 60.0 * minutes)
    return _for_one_edge(
        scenario,
        plan,
        action="set_point",
        minutes=minutes,
        stretch=math.ceil(interval / scenario.control.interval),
    )


def _for_one_edge(
    scenario: Scenario, plan: PartPlan, action: str, minutes: float, stretch: int = 1
) -> Scenario:
    """Return the scenario with episodes of one edge each, of ``minutes`` at most.

    Steps are ``stretch`` times as long, in sub-steps of the same length. Feeds are those of
    ``feed_range``, and speed and feed begin at the advice, unless an override is of a programmed
    feed. The reward has the scenario's prices: at the advised cut, metal earns exactly what time
    and edges cost.
    """
    prices = Prices.of(scenario)
    values = with_bending_as_limit(scenario).model_dump()
    control = values["control"]
    control["action"] = action
    control["edge_changes"] = "end"
    control["time_limit"] = minutes
    control["interval"] = stretch * scenario.control.interval
    control["sub_steps"] = stretch * scenario.control.sub_steps
    if action != "override":
        control["initial_cutting_speed"] = float(plan.cuts.cutting_speed)
        control["initial_feed"] = float(plan.cuts.feed)
        _, values["machine"]["feed_max"] = feed_range(scenario)
    values["workpiece"]["bars"] = 0  # as many as the edge lasts
    economics = values["economics"]
    economics["edge_cost"] = min(prices.edge / prices.minute, MAX_EDGE_COST)
    part_minutes = float(plan.cost) / prices.minute  # edges and their changes included
    economics["reference_removal_rate"] = part_volume(scenario) / part_minutes
    return Scenario.model_validate(values)


def _results(scenario: Scenario, plays: list[_Play]) -> list[PlayedPolicy]:
    """Return each policy's cost of a part, and its saving over the first policy."""
    prices = Prices.of(scenario)
    volume = part_volume(scenario)
    bootstrap = Bootstrap(len(plays[0].episodes["time"]))

    def means(values: Values) -> Values:
        """Return the mean over the seeds that were played, then those of their resamples."""
        return np.append(values.mean(), bootstrap.means(values[np.newaxis], ""))

    results: list[PlayedPolicy] = []
    for name, episodes in plays:
        # An episode ends when its edge is worn out, broken or changed by plan, or before if the
        # edge lasts too long to play. Then only the used share counts.
        used_edges = np.ones_like(episodes["time"])
        if name != FIXED:
            unused = np.where(episodes["truncated"] > 0.0, 1.0 - episodes["used_life"], 0.0)
            used_edges = 1.0 - unused
        downtime = scenario.economics.breakage_downtime * episodes["edges_broken"]
        returns = scenario.machine.return_time * episodes["removed"] / volume
        changes = prices.change_time * used_edges
        minutes = episodes["time"] / 60.0 + returns + changes + downtime

        time = means(minutes)
        spent = means(prices.minute * minutes + prices.edge * used_edges)
        metal = means(episodes["removed"])
        costs = spent / metal * volume
        if not results:
            fixed_costs = costs
        savings = fixed_costs - costs
        overload = severe_share(episodes["severe_overload_time"], episodes["engaged_time"])
        results.append(
            PlayedPolicy(
                name=name,
                removal_rate=float(metal[0] / time[0]),
                overload=overload,
                feasible=overload <= scenario.limits.overload_allowance,
                broken=int(episodes["edges_broken"].sum()),
                cost=Estimate.of(costs[0], costs[1:]),
                saved=Estimate.of(savings[0], savings[1:]),
            )
        )
    return results
