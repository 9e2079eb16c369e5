"""Play fixed parameters, rules and agents on the simulated machine, and compare their costs per part.

Fixed parameters are exactly those that ``advise`` advises. Rules and agents are told the prices of the scenario: the reward's
price of an edge is that of ``advise``, and metal earns as much as the advised cut costs.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from turning_shop import WorkshopError, aligned
from turning_shop.advise import Plan, Prices, money, part_volume
from turning_shop.allowed import NO_STRENGTH, feed_range
from turning_shop.provenance import BARS_VARY, assumed_in_simulation

from turning_env.action import set_point_action
from turning_env.extras import provided
from turning_env.scenario import Scenario
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.play import Episodes, play
from turning_env.scoring.policy import Actions, Observations, PolicySpec
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.statistics import Bootstrap, Estimate, severe_share

FIXED = "fixed parameters"  # the advice, whose edge is changed by plan
RULES = "predictive", "constant_power_lead", "omative", "modified_fuzzy_override"
"""Rules that lead the leaderboards within the limits, of speed and feed and of overrides."""
LONGEST = 600.0  # largest time of an edge that is played [min]
MAX_STEPS = 50_000
"""Largest number of steps that a rule or an agent plays with an edge; of one that lasts longer, the used share counts."""
MAX_EDGE_COST = 1e4  # largest price of an edge that a scenario may have [min]
PRICING_EDGES = 4  # edges that a rule plays to find the cost of its own parts
CLOCK_INTERVAL = (
    1.0  # control interval of fixed parameters [s]; sub-steps stay as long as the scenario's
)


@dataclass(frozen=True)
class Result:
    """One policy's result."""

    name: str
    removal_rate: float  # metal per minute, edge changes included [cm3/min]
    overload: float  # share of cutting time in severe overload [-]
    feasible: bool  # whether this share is allowed
    broken: int  # edges that broke
    cost: Estimate  # of a part
    saved: Estimate  # cost of a part less than with fixed parameters


@dataclass(frozen=True)
class Played:
    """Results of all policies, the fixed parameters first."""

    unit: str  # currency, or "min" of machine time
    edges: int  # played with each policy
    results: list[Result]
    notes: list[str]  # what was played, and policies that were not, with the reasons

    def summary(self) -> Iterator[str]:
        """Yield lines of text."""
        yield f"played on {self.edges} simulated edges each"
        rows = [
            ("", "mean MRR", "severe overload", "cost per part", "saved per part"),
            ("", "cm3/min", "%", f"{self.unit} (95 %)", f"{self.unit} (95 %)"),
        ]
        for each in self.results:
            cost, saved = each.cost, each.saved
            rows.append((
                *(each.name, f"{each.removal_rate:.1f}", f"{100 * each.overload:.1f}" + " !" * (not each.feasible)),
                f"{money(cost.value)} ({money(cost.low)}-{money(cost.high)})",
                f"{money(saved.value)} ({money(saved.low)} to {money(saved.high)})" if each is not self.results[0] else "",
            ))  # fmt: skip
        yield from aligned(rows)
        if not all(each.feasible for each in self.results):
            yield "! in severe overload longer than limits.overload_allowance: not to be used"
        yield from self.notes

    def headline(self) -> Iterator[str]:
        """Yield what the simulation says of the advice, in sentences for sheet and page."""
        fixed = self.results[0]
        cost = f"{money(fixed.cost.value)} {self.unit} a part ({money(fixed.cost.low)} to {money(fixed.cost.high)})"
        yield f"simulated with {self.edges} edges: {cost}, {100 * fixed.overload:.1f} % of the cutting time in severe overload"
        if fixed.broken:
            yield f"{fixed.broken} of {self.edges} simulated edges broke: see tool.edge_strength, edge_failure and mismatch"
        if not fixed.feasible:
            yield "in severe overload longer than limits.overload_allowance: not to be used as it is"
        for each in self.results[1:]:
            broken = f", {each.broken} of {self.edges} edges broke" * bool(each.broken)
            saved = f"{money(each.saved.value)} {self.unit} a part ({money(each.saved.low)} to {money(each.saved.high)})"
            yield f"{each.name} saves {saved}{broken}"


def constant(scenario: Scenario, best: Plan) -> Callable[[Observations], Actions]:
    """Return a policy that sets a plan's speed and feed."""
    machine, cuts = scenario.machine, best.cuts
    speed = set_point_action(
        cuts.cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max
    )
    feed = set_point_action(cuts.feed, machine.feed_min, feed_range(scenario)[1])
    return lambda observations: np.tile(np.array([speed, feed], np.float32), (len(observations), 1))


def play_all(
    scenario: Scenario,
    best: Plan,
    agents: Sequence[str],
    edges: int,
    on_play: Callable[[str], object] = lambda name: None,
) -> Played:
    """Play advised parameters, agents, and in a clone the best rule, on simulated edges, one per seed, and bars that vary.

    Agents are ONNX files or ``module:object``. ``on_play`` is called with the name of each policy before it is played.

    Raises:
        WorkshopError: An agent or no rule can play this scenario.
    """
    seeds, control = held_out_seeds(edges), scenario.control
    own = _for_one_edge(
        scenario, best, control.action, min(LONGEST, MAX_STEPS * control.interval / 60.0)
    )
    on_play(FIXED)
    played = [(FIXED, play(as_factory(constant(scenario, best)), clocked(scenario, best), seeds))]
    notes = list(_assumptions(scenario))
    if not (found := provided("rules")):
        notes.append(
            "rules were not played: they are in a clone, from whose folder this command can play them"
        )
    for catalogue in found:
        name, _ = best_rule(catalogue, scenario, own)
        on_play(f"rule {name}")
        priced = _at_own_cost(catalogue, scenario, own, seeds[:PRICING_EDGES])
        _, spec = best_rule(catalogue, scenario, priced)
        played.append((f"rule {name}", play(spec.make, priced, seeds)))
    for agent in agents:
        name = f"agent {Path(agent).stem}"
        on_play(name)
        try:
            played.append((name, play(as_factory(agent), own, seeds)))
        except (TypeError, ValueError) as error:
            raise WorkshopError(f"--agent {agent}: {error}") from error
    results = _results(scenario, played)
    broken = [f"{each.broken} with {each.name}" for each in results if each.broken]
    if broken:
        notes.append(
            f"of {edges} edges broke {', '.join(broken)}: see tool.edge_strength, edge_failure and mismatch"
        )
    return Played(Prices.of(scenario).unit, edges, results, notes)


def _at_own_cost(
    catalogue: Any, scenario: Scenario, own: Scenario, seeds: Sequence[int]
) -> Scenario:
    """Return the scenario of a rule, in which metal earns as much as the rule's own parts cost.

    At this price, the policy of least cost per part earns 0 and every other one less (Dinkelbach's method for ratios). This is
    one step of the method, from the cost of the advised cut, on a few edges.
    """
    _, spec = best_rule(catalogue, scenario, own)
    result = _results(scenario, [("", play(spec.make, own, seeds))])[0]
    minutes = result.cost.value / Prices.of(scenario).minute
    economics = own.economics.model_copy(
        update={"reference_removal_rate": part_volume(scenario) / minutes}
    )
    return own.model_copy(update={"economics": economics})


def _assumptions(scenario: Scenario) -> Iterator[str]:
    """Yield notes on how bars and edges differ in the simulation, and on values that no file states."""
    work, tool = scenario.workpiece, scenario.tool
    depth = np.hypot(work.depth_bar_spread, work.depth_along_spread)
    hardness = 100 * np.hypot(work.hardness_bar_spread, work.hardness_along_spread)
    if depth or hardness:
        bars = f"bars vary in depth by {depth:.2g} mm and in hardness by {hardness:.2g} %"
    else:
        bars = (
            f"bars do not vary: state {', '.join(BARS_VARY)} to see what control saves when they do"
        )
    breaks = "edges do not break by force"
    if tool.edge_strength < NO_STRENGTH:
        breaks = f"half of the edges break at {tool.edge_strength:g} N"
    yield f"{bars}; edges differ in wear by {100 * tool.wear_factor_spread:.2g} % (standard deviations); {breaks}"
    if assumed := assumed_in_simulation(scenario):
        yield f"assumed for the simulation, as your files do not state them: {', '.join(assumed)}"


def best_rule(catalogue: Any, scenario: Scenario, own: Scenario) -> tuple[str, PolicySpec]:
    """Return name and rule, to play ``own``: the first of ``RULES`` that is tuned for the scenario or needs no tuning."""
    for name in RULES:
        with suppress(
            ValueError
        ):  # raised by a rule that cannot play the scenario, or is not tuned for it
            return name, catalogue.spec(name, own, scenario)
    raise WorkshopError(f"no rule that ships can play {scenario.name!r}")


def clocked(scenario: Scenario, best: Plan) -> Scenario:
    """Return the scenario with episodes as long as a plan uses an edge. Plain bars have no return between them."""
    minutes = float(best.parts * (best.cycle_time - scenario.machine.return_time))
    longer = math.ceil(min(CLOCK_INTERVAL, 60.0 * minutes) / scenario.control.interval)
    return _for_one_edge(scenario, best, "set_point", minutes, longer)


def _for_one_edge(
    scenario: Scenario, best: Plan, action: str, minutes: float, longer: int = 1
) -> Scenario:
    """Return the scenario with episodes of one edge each, and steps ``longer`` times as long, in sub-steps of the same length.

    Feeds are those of ``feed_range``, and speed and feed begin at the advice, unless an override is of a programmed feed. The
    reward has the scenario's prices: at the advised cut, metal earns exactly what time and edges cost.
    """
    values, control, prices = scenario.model_dump(), scenario.control, Prices.of(scenario)
    values["control"] |= {"action": action, "edge_changes": "end", "time_limit": minutes}
    values["control"] |= {
        "interval": longer * control.interval,
        "sub_steps": longer * control.sub_steps,
    }
    if action != "override":
        values["control"]["initial_cutting_speed"] = float(best.cuts.cutting_speed)
        values["control"]["initial_feed"] = float(best.cuts.feed)
        values["machine"]["feed_max"] = feed_range(scenario)[1]
    values["workpiece"] |= {"bars": 0}
    values["economics"]["edge_cost"] = min(prices.edge / prices.minute, MAX_EDGE_COST)
    cost_minutes = float(best.cost) / prices.minute  # of a part, edges and their changes included
    values["economics"]["reference_removal_rate"] = part_volume(scenario) / cost_minutes
    return Scenario.model_validate(values)


def _overload(episodes: Episodes) -> float:
    return severe_share(episodes["severe_overload_time"], episodes["engaged_time"])


def _results(scenario: Scenario, played: list[tuple[str, Episodes]]) -> list[Result]:
    """Return each policy's cost of a part, and what it saves over the first."""
    prices, allowed, volume = (
        Prices.of(scenario),
        scenario.limits.overload_allowance,
        part_volume(scenario),
    )
    bootstrap = Bootstrap(len(played[0][1]["time"]))
    results: list[Result] = []
    for name, episodes in played:
        # An episode ends when its edge is worn out, broken or changed by plan, or before if the edge lasts too long to play.
        left_over = np.where(episodes["truncated"] > 0.0, 1.0 - episodes["used_life"], 0.0)
        edges = 1.0 - left_over * (name != FIXED)
        downtime = scenario.economics.breakage_downtime * episodes["edges_broken"]
        returns = scenario.machine.return_time * episodes["removed"] / volume
        minutes = episodes["time"] / 60.0 + returns + prices.change_time * edges + downtime
        # Means over seeds, the first of the seeds that were played, the others of resamples.
        time, spent, metal = (
            np.append(values.mean(), bootstrap.means(values[np.newaxis], ""))
            for values in (
                minutes,
                prices.minute * minutes + prices.edge * edges,
                episodes["removed"],
            )
        )
        costs = spent / metal * volume
        if not results:
            first = costs
        overload = _overload(episodes)
        results.append(
            Result(
                name=name,
                removal_rate=float(metal[0] / time[0]),
                overload=overload,
                feasible=overload <= allowed,
                broken=int(episodes["edges_broken"].sum()),
                cost=Estimate.of(costs[0], costs[1:]),
                saved=Estimate.of(first[0] - costs[0], (first - costs)[1:]),
            )
        )
    return results
