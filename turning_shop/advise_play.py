"""Play fixed parameters, rules and agents on the simulated machine, and compare their costs per part."""

import bisect
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from turning_env.action import set_point_action
from turning_env.extras import provided
from turning_env.scenario import Scenario
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.play import Episodes, play
from turning_env.scoring.policy import Actions, Observations, PolicySpec
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.statistics import Bootstrap, Estimate, severe_share
from turning_shop import WorkshopError, aligned
from turning_shop.advise import Plan, Prices, money, part_volume, plan
from turning_shop.prediction import Evidence

FIXED = "fixed parameters"  # the advice, whose edge is changed by plan
RULES = "predictive", "constant_power_lead", "omative", "modified_fuzzy_override"
"""Rules that lead the leaderboards within the limits, of speed and feed and of overrides."""
MARGINS = (1.0, 0.92, 0.85, 0.78, 0.72, 0.66, 0.6, 0.5, 0.4)
"""Factors of the advised feed, of which the first is used that keeps the scenario's limits often enough."""
LONGEST = 600.0  # largest time of an edge that is played [min]
MAX_STEPS = 50_000
"""Largest number of steps that a rule or an agent plays with an edge; of one that lasts longer, the used share counts."""
CLOCK_INTERVAL = 1.0  # control interval of fixed parameters [s]; sub-steps stay as long as the scenario's


@dataclass(frozen=True)
class Result:
    """One policy's result."""

    name: str
    removal_rate: float  # metal per minute, edge changes included [cm3/min]
    overload: float  # share of cutting time in overload [-]
    feasible: bool  # whether this share is allowed
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
            ("", "mean MRR", "overload", "cost per part", "saved per part"),
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
            yield "! in overload longer than limits.overload_allowance: not to be used"
        yield from self.notes


def constant(scenario: Scenario, best: Plan) -> Callable[[Observations], Actions]:
    """Return a policy that sets a plan's speed and feed."""
    machine, cuts = scenario.machine, best.cuts
    speed = set_point_action(cuts.cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max)
    feed = set_point_action(cuts.feed, machine.feed_min, machine.feed_max)
    return lambda observations: np.tile(np.array([speed, feed], np.float32), (len(observations), 1))


def play_all(
    scenario: Scenario,
    evidence: Evidence,
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
    own = _for_one_edge(scenario, control.action, min(LONGEST, MAX_STEPS * control.interval / 60.0))
    on_play(FIXED)
    slower, episodes = _with_margin(scenario, evidence, best, seeds)
    played: list[tuple[str, Episodes]] = [(FIXED, episodes)]
    work = scenario.workpiece
    depth = np.hypot(work.depth_bar_spread, work.depth_along_spread)
    hardness = 100 * np.hypot(work.hardness_bar_spread, work.hardness_along_spread)
    notes = [f"bars vary in depth by {depth:.2g} mm and in hardness by {hardness:.2g} %, the scenario's standard deviations"]
    if broken := int(episodes["edges_broken"].sum()):
        notes.append(f"{broken} of {edges} edges broke with fixed parameters: see tool.edge_strength")
    if slower is not best:
        notes.append(
            f"on such bars, the advised {best.cuts.feed:g} mm/rev is longer in overload than limits.overload_allowance, so fixed "
            f"parameters are played at {slower.where}: {money(slower.cost)} {Prices.of(scenario).unit} a part by the laws"
        )
    if not (found := provided("rules")):
        notes.append("rules were not played: they are in a clone, from whose folder this command can play them")
    for catalogue in found:
        name, spec = best_rule(catalogue, scenario, own)
        on_play(f"rule {name}")
        played.append((f"rule {name}", play(spec.make, own, seeds)))
    for agent in agents:
        name = f"agent {Path(agent).stem}"
        on_play(name)
        try:
            played.append((name, play(as_factory(agent), own, seeds)))
        except (TypeError, ValueError) as error:
            raise WorkshopError(f"--agent {agent}: {error}") from error
    return Played(Prices.of(scenario).unit, edges, _results(scenario, played), notes)


def best_rule(catalogue: Any, scenario: Scenario, own: Scenario) -> tuple[str, PolicySpec]:
    """Return name and rule, to play ``own``: the first of ``RULES`` that is tuned for the scenario or needs no tuning."""
    for name in RULES:
        with suppress(ValueError):  # raised by a rule that cannot play the scenario, or is not tuned for it
            return name, catalogue.spec(name, own, scenario)
    raise WorkshopError(f"no rule that ships can play {scenario.name!r}")


def clocked(scenario: Scenario, best: Plan) -> Scenario:
    """Return the scenario with episodes as long as a plan uses an edge. Plain bars have no return between them."""
    minutes = float(best.parts * (best.cycle_time - scenario.machine.return_time))
    longer = math.ceil(min(CLOCK_INTERVAL, 60.0 * minutes) / scenario.control.interval)
    return _for_one_edge(scenario, "set_point", minutes, longer)


def _for_one_edge(scenario: Scenario, action: str, minutes: float, longer: int = 1) -> Scenario:
    """Return the scenario with episodes of one edge each, and steps ``longer`` times as long, in sub-steps of the same length."""
    values, control = scenario.model_dump(), scenario.control
    values["control"] |= {"action": action, "edge_changes": "end", "time_limit": minutes}
    values["control"] |= {"interval": longer * control.interval, "sub_steps": longer * control.sub_steps}
    values["workpiece"] |= {"bars": 0}
    return Scenario.model_validate(values)


def _with_margin(scenario: Scenario, evidence: Evidence, best: Plan, seeds: Sequence[int]) -> tuple[Plan, Episodes]:
    """Return the plan of the highest feed, by the factors in ``MARGINS``, that keeps the limits often enough, and its play."""

    @cache
    def played(factor: float) -> tuple[Plan, Episodes]:
        feed = max(factor * best.cuts.feed, scenario.machine.feed_min)
        slower = best if factor == 1.0 else plan(scenario, evidence, best.cuts.cutting_speed, feed, best.cuts.wear)
        return slower, play(as_factory(constant(scenario, slower)), clocked(scenario, slower), seeds)

    def keeps_limits(factor: float) -> bool:
        return _overload(played(factor)[1]) <= scenario.limits.overload_allowance

    return played(MARGINS[bisect.bisect_left(MARGINS[:-1], True, key=keeps_limits)])  # overload grows with the feed


def _overload(episodes: Episodes) -> float:
    return severe_share(episodes["severe_overload_time"], episodes["engaged_time"])


def _results(scenario: Scenario, played: list[tuple[str, Episodes]]) -> list[Result]:
    """Return each policy's cost of a part, and what it saves over the first."""
    prices, allowed, volume = Prices.of(scenario), scenario.limits.overload_allowance, part_volume(scenario)
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
            for values in (minutes, prices.minute * minutes + prices.edge * edges, episodes["removed"])
        )
        costs = spent / metal * volume
        if not results:
            first = costs
        overload = _overload(episodes)
        estimates = (Estimate.of(values[0], values[1:]) for values in (costs, first - costs))
        results.append(Result(name, float(metal[0] / time[0]), overload, overload <= allowed, *estimates))
    return results
