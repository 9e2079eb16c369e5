"""Play recommendations, rules and agents on the simulated machine, and compare their costs by the year."""

import bisect
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env import IDS
from turning_env.extras import provided
from turning_env.scenario import Scenario
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.play import Episodes, play, play_spec
from turning_env.scoring.policy import Actions, Observations, PolicySpec
from turning_env.scoring.score import shipped
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.statistics import Bootstrap, Estimate, severe_share
from turning_shop import WorkshopError, aligned
from turning_shop.advise import Advice, Prices, Step, part_volume

CLOCKED = "fixed parameters", "schedule by time"
"""Recommendations, whose edge is changed by the clock."""
MARGINS = (1.0, 0.92, 0.85, 0.78, 0.72, 0.66, 0.6, 0.5, 0.4)
"""Factors of the recommended feed, of which the first is used that keeps the scenario's limits often enough."""
LONGEST = 600.0
"""Largest time of an edge that is played [min]."""
MAX_STEPS = 50_000
"""Largest number of steps that a rule or an agent plays with an edge; of one that lasts longer, the used share counts."""
CLOCK_INTERVAL = 1.0
"""Shortest control interval by which speed and feed follow the clock [s]; sub-steps stay as long as the scenario's."""


@dataclass(frozen=True)
class Year:
    """One policy's year.

    Attributes:
        name: The policy.
        feed_factor: Factor of the recommended feed that keeps the limits in play [-]; 1 for a policy that chooses by itself.
        removal_rate: Metal per minute, edge changes included [cm3/min].
        overload: Share of cutting time in overload [-].
        feasible: Whether this share is allowed.
        cost: Cost of a year of the fixed parameters' metal.
        saved: Cost of this year less than with fixed parameters.
    """

    name: str
    feed_factor: float
    removal_rate: float
    overload: float
    feasible: bool
    cost: Estimate
    saved: Estimate


@dataclass(frozen=True)
class Played:
    """Results of all policies, the fixed parameters first.

    Attributes:
        unit: Currency, or "h" of machine time.
        hours: Hours of a year, in which the fixed parameters' metal is cut.
        edges: Number of edges played with each policy.
        years: One per policy.
        notes: Policies that were not played, with the reasons.
    """

    unit: str
    hours: float
    edges: int
    years: list[Year]
    notes: list[str]

    def summary(self) -> Iterator[str]:
        """Yield lines of text."""
        yield f"played on {self.edges} simulated edges each; a year is the metal of {self.hours:g} h with fixed parameters"
        rows = [
            ("", "feed", "MRR", "overload", "cost of a year", "saved in a year"),
            ("", "%", "cm3/min", "%", self.unit, f"{self.unit} (95 %)"),
        ]
        for year in self.years:
            cost, saved = year.cost, year.saved
            rows.append((
                year.name,
                f"{100 * year.feed_factor:.0f}",
                f"{year.removal_rate:.1f}",
                f"{100 * year.overload:.1f}" + " !" * (not year.feasible),
                f"{cost.value:.0f} ({cost.low:.0f}-{cost.high:.0f})",
                f"{saved.value:.0f} ({saved.low:.0f} to {saved.high:.0f})" if year is not self.years[0] else "",
            ))  # fmt: skip
        yield from aligned(rows)
        if not all(year.feasible for year in self.years):
            yield "! in overload longer than limits.overload_allowance: not to be used"
        yield from self.notes


class Clock:
    """A policy that sets speed and feed by the cutting time of the edge."""

    def __init__(self, scenario: Scenario, steps: Sequence[Step], factor: float, num_envs: int) -> None:
        machine = scenario.machine
        self._ends = 60.0 * np.cumsum([step.minutes for step in steps])[:-1]
        speed, feed = (np.array([getattr(step, name) for step in steps]) for name in ("cutting_speed", "feed"))
        feed = np.clip(factor * feed, machine.feed_min, machine.feed_max)
        self._actions = np.column_stack([
            2.0 * (speed - machine.cutting_speed_min) / (machine.cutting_speed_max - machine.cutting_speed_min) - 1.0,
            2.0 * (feed - machine.feed_min) / (machine.feed_max - machine.feed_min) - 1.0,
        ]).clip(-1.0, 1.0).astype(np.float32)  # fmt: skip
        self._age: NDArray[np.float64] = np.zeros(num_envs)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self._age[mask] = 0.0

    def tell(self, infos: dict[str, Any]) -> None:
        if "engaged_time" in infos:
            self._age += infos["engaged_time"]

    def act(self, observations: Observations) -> Actions:
        return np.asarray(self._actions[np.searchsorted(self._ends, self._age, side="right")])


def play_all(
    scenario: Scenario,
    advice: Sequence[Advice],
    agents: Sequence[str],
    rule: str | None,
    hours: float,
    edges: int,
    on_play: Callable[[str], object] = lambda name: None,
    max_steps: int = MAX_STEPS,
) -> Played:
    """Play the fixed parameters and the schedule of least cost, agents, and a rule if this is a clone.

    Args:
        scenario: The machine, with the model mismatch that it states.
        advice: Returned by ``advise``.
        agents: ONNX files or ``module:object``; they must take the scenario's observations and actions.
        rule: A rule of ``baselines``, played if that package can be imported; if None, the best: see ``best_rule``.
        hours: Hours of work in a year.
        edges: Number of edges, one per seed.
        on_play: Called with the name of each policy before it is played.
        max_steps: Largest number of steps that a rule or an agent plays with an edge; of one that lasts longer, the used share
            counts.

    Raises:
        WorkshopError: An agent or the rule cannot play this scenario.
    """
    seeds, control = held_out_seeds(edges), scenario.control
    own = _for_one_edge(scenario, control.action, min(LONGEST, max_steps * control.interval / 60.0))
    played: list[tuple[str, float, Episodes]] = []
    notes = []
    for each in advice:
        if each.aim == "least cost":
            name = CLOCKED[len(each.steps) > 1]
            on_play(name)
            # Its edge is changed by the clock, so an episode lasts as long as an edge.
            played.append((name, *_with_margin(clocked(scenario, each), each.steps, seeds)))
    if not (found := provided("rules")):
        notes.append("rules were not played: they are in a clone, from whose folder this command can play them")
    for catalogue in found:
        try:
            name, spec = best_rule(catalogue, scenario, own) if rule is None else (rule, catalogue.spec(rule, own, scenario))
        except (KeyError, ValueError) as error:
            raise WorkshopError(f"--rule {rule}: {error.args[0]}") from error
        on_play(f"rule {name}")
        played.append((f"rule {name}", 1.0, play_spec(spec, own, seeds)))
    for agent in agents:
        name = f"agent {Path(agent).stem}"
        on_play(name)
        try:
            played.append((name, 1.0, play(as_factory(agent), own, seeds)))
        except (TypeError, ValueError) as error:
            raise WorkshopError(f"--agent {agent}: {error}") from error
    unit = Prices.of(scenario).unit
    return Played("h" if unit == "min" else unit, hours, edges, _years(scenario, played, hours), notes)


def best_rule(catalogue: Any, scenario: Scenario, own: Scenario) -> tuple[str, PolicySpec]:
    """Return name and rule, to play ``own``: the best of those that are tuned for the scenario or need no tuning.

    Feasible rules are ranked by their return on the leaderboard of the id most like the scenario. So no seed that is played
    here affects the choice.
    """
    usual = "RoughTurning-Override-v0" if scenario.control.action == "override" else "RoughTurning-v0"
    env_id = next((env_id for env_id, preset in IDS.items() if preset == scenario.name), usual)
    allowed = Scenario.load(IDS[env_id]).limits.overload_allowance
    for each in sorted(shipped(env_id), key=lambda each: -float(each.returns.mean())):
        if each.kind == "rule" and severe_share(each.severe.ravel(), each.engaged.ravel()) <= allowed:
            with suppress(ValueError):  # raised by a rule that cannot play the scenario, or is not tuned for it
                return each.name, catalogue.spec(each.name, own, scenario)
    raise ValueError(f"no rule that ships can play {scenario.name!r}")


def clocked(scenario: Scenario, advice: Advice) -> Scenario:
    """Return the scenario with episodes as long as a recommendation uses an edge. Plain bars have no return between them."""
    minutes = advice.parts[0] * (advice.cycle_time - scenario.machine.return_time)
    longer = math.ceil(min(CLOCK_INTERVAL, 60.0 * minutes) / scenario.control.interval)
    return _for_one_edge(scenario, "set_point", minutes, longer)


def _for_one_edge(scenario: Scenario, action: str, minutes: float, longer: int = 1) -> Scenario:
    """Return the scenario with episodes of one edge each, and steps ``longer`` times as long, in sub-steps of the same length."""
    values, control = scenario.model_dump(), scenario.control
    values["control"] |= {"action": action, "edge_changes": "end", "time_limit": minutes}
    values["control"] |= {"interval": longer * control.interval, "sub_steps": longer * control.sub_steps}
    values["workpiece"] |= {"bars": 0}
    return Scenario.model_validate(values)


def _with_margin(scenario: Scenario, steps: Sequence[Step], seeds: Sequence[int]) -> tuple[float, Episodes]:
    """Return the highest feed factor of ``MARGINS`` that keeps the limits often enough, else the lowest, and its episodes."""

    @cache
    def played(factor: float) -> Episodes:
        return play(partial(Clock, scenario, steps, factor), scenario, seeds, tell=True)

    def keeps_limits(factor: float) -> bool:
        return _overload(played(factor)) <= scenario.limits.overload_allowance

    factor = MARGINS[bisect.bisect_left(MARGINS[:-1], True, key=keeps_limits)]  # overload grows with the feed
    return factor, played(factor)


def _overload(episodes: Episodes) -> float:
    return severe_share(episodes["severe_overload_time"], episodes["engaged_time"])


def _years(scenario: Scenario, played: list[tuple[str, float, Episodes]], hours: float) -> list[Year]:
    """Return each policy's costs of cutting the metal that the first cuts in the given hours."""
    prices, allowed = Prices.of(scenario), scenario.limits.overload_allowance
    scale = 1.0 / 60.0 if prices.unit == "min" else 1.0  # hours of machine time if there is no money
    bootstrap = Bootstrap(len(played[0][2]["time"]))
    years: list[Year] = []
    for name, factor, episodes in played:
        # An episode ends when its edge is worn out, broken or changed by the clock, or before if the edge lasts too long to play.
        left_over = np.where(episodes["truncated"] > 0.0, 1.0 - episodes["used_life"], 0.0)
        edges = 1.0 - left_over * (name not in CLOCKED)
        downtime = scenario.economics.breakage_downtime * episodes["edges_broken"]
        returns = scenario.machine.return_time * episodes["removed"] / part_volume(scenario)
        minutes = episodes["time"] / 60.0 + returns + prices.change_time * edges + downtime
        # Means over seeds, the first of the seeds that were played, the others of resamples.
        time, spent, metal = (
            np.append(values.mean(), bootstrap.means(values[np.newaxis], ""))
            for values in (minutes, prices.minute * minutes + prices.edge * edges, episodes["removed"])
        )
        if not years:
            wanted = 60.0 * hours * metal / time
        costs = scale * wanted * spent / metal
        if not years:
            first = costs
        overload = _overload(episodes)
        estimates = (Estimate.of(values[0], values[1:]) for values in (costs, first - costs))
        years.append(Year(name, factor, float(metal[0] / time[0]), overload, overload <= allowed, *estimates))
    return years
