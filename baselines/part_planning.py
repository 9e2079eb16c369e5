"""Plans of whole parts by the rules of the adaptive part programming paper (Sharmazanashvili 2008).

A plan divides an allowance into passes of equal depth and takes cutting speed and feed of each pass
from a rule. Fixed-rule adaptive control keeps the path for the drawing's allowance, and sets
cutting speed and feed for the depth that each pass cuts. Adaptive part programming makes a new path
for the measured size of the blank. Neither knows the blank's run-out and hardness, so both keep a
margin to the limits. Blanks that are not probed count as drawn. Both use from the nominal model:
the laws of wear, force and power, and prices.
"""

from typing import NamedTuple

import numpy as np

from baselines.models.process import Process
from baselines.rule import Array, Rule, TuningRange
from baselines.trivial import ConstantActions
from baselines.two_limits import ECONOMIC_OPTIMUM, MIN_DEPTH, TWO_LIMITS, set_point
from turning_env import Scenario, read
from turning_env.action import set_point_action
from turning_env.numerics.functions import exp, log, real_power
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.laws import machining_cost

MIN_WEAR = 0.1
"""Wear of a fresh edge over the criterion [-]: without wear, nothing would limit the force."""


class Passes(NamedTuple):
    """Set points of the passes of a part, and their cost."""

    cutting_speed: Array  # [m/min], shape (num_envs, passes_max)
    feed: Array  # [mm/rev], likewise
    cost: Array  # of the part [min], shape (num_envs,)


def plan(
    scenario: Scenario, passes: Array, allowance: Array, cutting_speed: Array, feed: Array
) -> Actions:
    """Return the actions of plans, shape (num_envs, action size).

    Args:
        scenario: task.
        passes: number of passes, from 1 to ``control.passes_max``, shape (num_envs,).
        allowance: allowance of the path [mm], shape (num_envs,).
        cutting_speed: cutting speed of each pass [m/min], shape (num_envs, passes_max), or of all.
        feed: feed of each pass [mm/rev], likewise.
    """
    machine = scenario.machine
    passes_max = scenario.control.passes_max
    actions = np.empty((len(passes), 2 + 2 * passes_max))
    actions[:, 0] = 2.0 * (passes - 0.5) / passes_max - 1.0
    actions[:, 1] = allowance / scenario.workpiece.depth_of_cut - 1.0
    actions[:, 2::2] = set_point_action(
        cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max
    )
    actions[:, 3::2] = set_point_action(feed, machine.feed_min, machine.feed_max)
    return np.clip(actions, -1.0, 1.0).astype(np.float32)


class RuledParts(Policy):
    """A policy that plans the cheapest number of passes, with cutting speed and feed by a rule.

    Args:
        scenario: nominal model.
        rule: name of the rule of ``two_limits.set_point``, applied at each pass's depth of cut.
        corrected: whether the path is made for the measured size, not for the drawing's allowance.
        margin: factor on the limits of force, power and torque [-].
        first_margin: likewise in the first pass, which cuts all unforeseen metal.
    """

    def __init__(
        self, scenario: Scenario, rule: str, corrected: bool, margin: float, first_margin: float
    ) -> None:
        self._scenario = scenario
        self._rule = rule
        self._corrected = corrected
        margins = np.full(scenario.control.passes_max, margin)
        margins[0] = first_margin
        self._process = Process.of(scenario).rescaled(1.0 / margins, 1.0 / margins)

    def act(self, observations: Observations) -> Actions:
        scenario = self._scenario
        criterion = scenario.tool.wear_criterion
        reading = read(observations, scenario)
        drawn = np.full(len(observations), scenario.workpiece.depth_of_cut)
        measured = reading.probed_depth if scenario.sensors.probe else drawn
        path = measured if self._corrected else drawn
        wear = np.clip(reading.nominal_wear, MIN_WEAR * criterion, criterion)

        # The number of passes is the cheapest for a blank of the path's allowance.
        numbers = np.arange(1.0, scenario.control.passes_max + 1.0)
        costs = []
        for number in numbers:
            passes = np.full(len(path), number)
            costs.append(self._passes(path, path, passes=passes, wear=wear).cost)
        passes = numbers[np.argmin(costs, axis=0)]
        planned = self._passes(measured, path, passes=passes, wear=wear)
        return plan(
            scenario,
            passes,
            allowance=path,
            cutting_speed=planned.cutting_speed,
            feed=planned.feed,
        )

    def _passes(self, allowance: Array, path: Array, passes: Array, wear: Array) -> Passes:
        """Return the set points of a number of passes on a path [mm], and the part's cost."""
        workpiece = self._scenario.workpiece
        process = self._process
        passes_max = self._scenario.control.passes_max
        depths = pass_depths(allowance, path, passes, passes_max)
        positive_depths = np.maximum(depths, MIN_DEPTH)
        speed, feed = set_point(self._rule, process, depths, wear=wear[:, np.newaxis])

        length = workpiece.bar_length + workpiece.approach
        surface = np.pi * workpiece.diameter * length  # [mm2]
        surface_rate = 1000.0 * speed * feed  # [mm2/min]
        minutes = surface / surface_rate
        log_life = process.log_life(
            log(speed),
            log(feed),
            depth_of_cut=positive_depths,
            hardness=1.0,
        )
        edges = np.where(depths > 0.0, minutes / exp(log_life), 0.0)
        made = np.arange(passes_max) < passes[:, np.newaxis]
        with_return = minutes + self._scenario.machine.return_time
        costs = machining_cost(with_return, edges, process.edge_price)
        cost = np.sum(made * costs, axis=1)
        # Even at the lowest feed, a pass may be too deep for a further limit.
        for limit in process.further.values():
            response = limit.law(speed, feed, positive_depths)
            excess = np.maximum(response / limit.most - 1.0, 0.0)
            overload = np.sum(made * minutes * excess, axis=1)
            cost += self._scenario.economics.overload_price * overload
        return Passes(speed, feed, cost=cost)


def pass_depths(allowance: Array, path: Array, passes: Array, passes_max: int) -> Array:
    """Return the depth of each pass [mm], 0 in air and after the last pass.

    Args:
        allowance: allowance of the blank [mm], shape (num_envs,).
        path: allowance for which the path is made [mm], shape (num_envs,).
        passes: number of passes, shape (num_envs,).
        passes_max: highest number of passes.

    Returns:
        Depths, shape (num_envs, passes_max).
    """
    number = np.arange(passes_max)
    pitch = (path / passes)[:, np.newaxis]
    remaining = passes[:, np.newaxis]
    # Metal over the finished surface after each pass, and before it: the first meets all of it.
    after = np.maximum(remaining - 1.0 - number, 0.0) * pitch
    before = np.where(number == 0, np.inf, (remaining - number) * pitch)
    met = np.minimum(allowance[:, np.newaxis], before)
    return np.maximum(met - after, 0.0)


def _fixed_plan(
    scenario: Scenario, num_envs: int, passes: float, cutting_speed: float, feed: float
) -> ConstantActions:
    """Return the policy with the same passes and set point for every part, as in an NC program.

    Cutting speed and feed are given as shares of their log ranges.
    """
    machine = scenario.machine
    number = float(min(max(round(passes), 1), scenario.control.passes_max))
    speed_span = machine.cutting_speed_max / machine.cutting_speed_min
    feed_span = machine.feed_max / machine.feed_min
    action = plan(
        scenario,
        np.array([number]),
        allowance=np.array([scenario.workpiece.depth_of_cut]),
        cutting_speed=machine.cutting_speed_min * real_power(speed_span, cutting_speed),
        feed=machine.feed_min * real_power(feed_span, feed),
    )
    return ConstantActions(action)


def _parts_rule(rule: str, corrected: bool) -> Rule:
    """Return the catalogue's entry of ``RuledParts`` with a rule of ``two_limits``."""
    name = "the economic optimum" if rule == ECONOMIC_OPTIMUM else f"[{rule}]"
    path = "made for the measured size" if corrected else "as drawn"
    kind = "adaptive part programming" if corrected else "fixed rule"

    def build(scenario: Scenario, num_envs: int, **parameters: float) -> RuledParts:
        return RuledParts(scenario, rule, corrected=corrected, **parameters)

    def plays(scenario: Scenario) -> bool:
        knows_size = scenario.sensors.probe or not corrected
        return scenario.control.action == "part" and knows_size

    return Rule(
        f"{kind}: speed and feed by {name}, path {path} (Sharmazanashvili 2008); margins tuned",
        build,
        plays=plays,
        parameters={"margin": TuningRange(0.6, 1.1), "first_margin": TuningRange(0.3, 1.1)},
        worth_tuning=rule in ("MT", "PN") and not corrected,
        published=True,
    )


RULES: dict[str, Rule] = {
    "parts_fixed_tuned": Rule(
        "the best passes, speed and feed for all parts on the tuning seeds; "
        "speed and feed as shares of their log ranges",
        _fixed_plan,
        plays=lambda scenario: scenario.control.action == "part",
        parameters={
            "passes": TuningRange(0.5, 4.5),
            "cutting_speed": TuningRange(0.0, 1.0),
            "feed": TuningRange(0.0, 1.0),
        },
        worth_tuning=True,
    ),
}
_NAMED = {rule: rule.lower() for rule in TWO_LIMITS} | {ECONOMIC_OPTIMUM: "economic"}
for _rule, _name in _NAMED.items():
    RULES[f"parts_{_name}"] = _parts_rule(_rule, corrected=False)
for _rule, _name in _NAMED.items():
    RULES[f"parts_app_{_name}"] = _parts_rule(_rule, corrected=True)
