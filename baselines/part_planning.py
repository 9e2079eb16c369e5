"""Plans of whole parts by the rules of the adaptive part programming paper (Sharmazanashvili 2008).

A plan divides an allowance into passes of equal depth and takes cutting speed and feed of each pass from a rule. Fixed-rule
adaptive control keeps the path for the drawing's allowance, and sets cutting speed and feed for the depth that each pass cuts.
Adaptive part programming makes a new path for the measured size of the blank. Neither knows the blank's run-out and hardness, so
both keep a margin to the limits. Blanks that are not probed count as drawn. They need of the nominal model: the laws of wear,
force and power, and prices.
"""

import numpy as np

from baselines.models.process import Process
from baselines.rule import Array, Range, Rule
from baselines.trivial import ConstantActions
from baselines.two_limits import ECONOMIC_OPTIMUM, MIN_DEPTH, TWO_LIMITS, set_point
from turning_env import Scenario, read
from turning_env.action import set_point_action
from turning_env.numerics.functions import exp, log, real_power
from turning_env.scoring.policy import Actions, Observations, Policy

_MIN_WEAR = (
    0.1  # wear of a fresh edge over the criterion [-]: without wear, nothing would limit the force
)


def plan(
    scenario: Scenario, passes: Array, allowance: Array, cutting_speed: Array, feed: Array
) -> Actions:
    """Return the actions, shape (num_envs, action size), of plans.

    They are a number of passes, from 1 to ``control.passes_max``, and the path's allowance [mm], shape (num_envs,), and cutting
    speed [m/min] and feed [mm/rev] of each pass, shape (num_envs, passes_max), or of all.
    """
    machine, passes_max = scenario.machine, scenario.control.passes_max
    actions = np.empty((len(passes), 2 + 2 * passes_max))
    actions[:, 0] = 2.0 * (passes - 0.5) / passes_max - 1.0
    actions[:, 1] = allowance / scenario.workpiece.depth_of_cut - 1.0
    actions[:, 2::2] = set_point_action(
        cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max
    )
    actions[:, 3::2] = set_point_action(feed, machine.feed_min, machine.feed_max)
    return np.clip(actions, -1.0, 1.0).astype(np.float32)


class RuledParts(Policy):
    """A policy that plans the cheapest number of passes, with cutting speed and feed by a rule at each pass's depth of cut.

    ``corrected``: whether the path is made for the measured size, not for the drawing's allowance. ``margin``: factor on the
    limits of force, power and torque [-]; ``first_margin``: likewise in the first pass, which cuts all unforeseen metal.
    """

    def __init__(
        self, scenario: Scenario, rule: str, corrected: bool, margin: float, first_margin: float
    ) -> None:
        self._scenario, self._rule, self._corrected = scenario, rule, corrected
        scales = 1.0 / np.array([first_margin] + [margin] * (scenario.control.passes_max - 1))
        self._process = Process.of(scenario).rescaled(scales, scales)

    def act(self, observations: Observations) -> Actions:
        scenario, criterion = self._scenario, self._scenario.tool.wear_criterion
        reading, drawn = (
            read(observations, scenario),
            np.full(len(observations), scenario.workpiece.depth_of_cut),
        )
        measured = reading.probed_depth if scenario.sensors.probe else drawn
        path = measured if self._corrected else drawn
        wear = np.clip(reading.nominal_wear, _MIN_WEAR * criterion, criterion)
        numbers = np.arange(1.0, scenario.control.passes_max + 1.0)
        costs = [
            self._passes(path, path, np.full(len(path), number), wear)[2] for number in numbers
        ]
        passes: Array = numbers[
            np.argmin(costs, axis=0)
        ]  # cheapest for a blank of the path's allowance
        speed, feed, _ = self._passes(measured, path, passes, wear)
        return plan(scenario, passes, path, speed, feed)

    def _passes(
        self, allowance: Array, path: Array, passes: Array, wear: Array
    ) -> tuple[Array, Array, Array]:
        """Return cutting speeds [m/min] and feeds [mm/rev], shape (num_envs, passes_max), and the total cost [min]."""
        workpiece, process = self._scenario.workpiece, self._process
        depths = pass_depths(allowance, path, passes, self._scenario.control.passes_max)
        speed, feed = set_point(self._rule, process, depths, wear=wear[:, np.newaxis])
        minutes = (
            np.pi
            * workpiece.diameter
            * (workpiece.bar_length + workpiece.approach)
            / (1000.0 * speed * feed)
        )
        life = exp(process.log_life(log(speed), log(feed), np.maximum(depths, MIN_DEPTH), 1.0))
        edges = np.where(depths > 0.0, minutes / life, 0.0)
        made = np.arange(depths.shape[1]) < passes[:, np.newaxis]
        cost = np.sum(
            made * (minutes + self._scenario.machine.return_time + process.edge_price * edges),
            axis=1,
        )
        for limit in process.further.values():  # a pass may be too deep for one at the lowest feed
            excess = np.maximum(
                limit.law(speed, feed, np.maximum(depths, MIN_DEPTH)) / limit.most - 1.0, 0.0
            )
            cost += self._scenario.economics.overload_price * np.sum(
                made * minutes * excess, axis=1
            )
        return speed, feed, cost


def pass_depths(allowance: Array, path: Array, passes: Array, passes_max: int) -> Array:
    """Return the depth of each pass [mm], shape (num_envs, passes_max), 0 in air and after the last pass.

    ``allowance``: of the blank [mm]; ``path``: the allowance for which the path is made [mm]; all of shape (num_envs,).
    """
    number = np.arange(passes_max)
    pitch = (path / passes)[:, np.newaxis]
    floors = np.maximum(passes[:, np.newaxis] - 1.0 - number, 0.0) * pitch
    ceilings = np.where(number == 0, np.inf, (passes[:, np.newaxis] - number) * pitch)
    return np.maximum(np.minimum(allowance[:, np.newaxis], ceilings) - floors, 0.0)


def _fixed(
    scenario: Scenario, num_envs: int, passes: float, cutting_speed: float, feed: float
) -> ConstantActions:
    """Return the policy with the same passes, cutting speed and feed for every part, as in an NC program."""
    machine, passes_max = scenario.machine, scenario.control.passes_max
    number = np.array([float(min(max(round(passes), 1), passes_max))])
    speeds = machine.cutting_speed_min * real_power(
        machine.cutting_speed_max / machine.cutting_speed_min, cutting_speed
    )
    feeds = machine.feed_min * real_power(machine.feed_max / machine.feed_min, feed)
    return ConstantActions(
        plan(scenario, number, np.array([scenario.workpiece.depth_of_cut]), speeds, feeds)
    )


def _ruled(rule: str, corrected: bool) -> Rule:
    name = "the economic optimum" if rule == ECONOMIC_OPTIMUM else f"[{rule}]"
    path = "made for the measured size" if corrected else "as drawn"
    kind = "adaptive part programming" if corrected else "fixed rule"
    return Rule(
        f"{kind}: speed and feed by {name}, path {path} (Sharmazanashvili 2008); margins tuned",
        lambda scenario, num_envs, **parameters: RuledParts(
            scenario, rule, corrected, **parameters
        ),
        lambda scenario: (
            scenario.control.action == "part" and (scenario.sensors.probe or not corrected)
        ),
        {"margin": Range(0.6, 1.1), "first_margin": Range(0.3, 1.1)},
        worth_tuning=rule in ("MT", "PN") and not corrected,
    )


_NAMED = {rule: rule.lower() for rule in TWO_LIMITS} | {ECONOMIC_OPTIMUM: "economic"}

RULES: dict[str, Rule] = {
    "parts_fixed_tuned": Rule(
        "the best passes, speed and feed for all parts on the tuning seeds; speed and feed as shares of their log ranges",
        _fixed,
        lambda scenario: scenario.control.action == "part",
        {"passes": Range(0.5, 4.5), "cutting_speed": Range(0.0, 1.0), "feed": Range(0.0, 1.0)},
        worth_tuning=True,
    ),
    **{f"parts_{name}": _ruled(rule, corrected=False) for rule, name in _NAMED.items()},
    **{f"parts_app_{name}": _ruled(rule, corrected=True) for rule, name in _NAMED.items()},
}
