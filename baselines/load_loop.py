"""A loop of a handful of numbers that holds a load target: the strongest simple opponent.

It neither estimates nor plans. The feed holds a target of the loads over the limits that hold at
the speed (``models/feed_loop.py``). The cutting speed is a share of the nominal optimum. All
numbers are relative to the nominal model, so a few of them play any lathe:

* ``load_loop`` plays one edge. Its eight numbers (``LoopNumbers``) were tuned on tuning seeds of
  ``rough_turning``.
* ``load_loop_jobs`` also decides when to change the edge. Its fourteen numbers (``JobNumbers``)
  were found by CMA-ES on training jobs of the family ``shop`` (``train/tune_loop.py``).

Uses from the nominal model the best cutting speeds and feed, the exponents of feed in the laws of
force and power, the chip breaker's window, the base speed, the edge's price and the spread of the
depth along a bar.
"""

from typing import Any, NamedTuple

import numpy as np

from baselines.models.feed_loop import (
    feed_gaps,
    held_in_air,
    log_feed_towards,
    shares_of,
    within_window,
)
from baselines.models.nominal_points import nominal_points
from baselines.rule import Array, Mask, Rule, Scenarios, TuningRange
from turning_env import Reading, Scenario, read
from turning_env.action import sets_speed_and_feed, towards
from turning_env.numerics.functions import exp, log
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.plan import MIDDLE
from turning_env.scenario.scenario_batch import ScenarioBatch

MAX_SLACK = 1.0  # highest absolute log ratio of force to power over their limits [-]
USUAL_EDGE_PRICE = 3.0  # price of an edge at which ``JobNumbers`` change nothing [min]
USUAL_DEPTH_SPREAD = 0.074  # likewise the spread of depth along a bar, over the depth [-]
MIN_DEPTH_SPREAD = 0.01  # lower bound of that spread [-], before its logarithm is taken
MIN_REMOVED_WEAR = 0.05  # lower bound of an edge's nominal wear over the criterion [-]
MAX_WEAR_RATIO = 5.0  # highest ratio of measured to nominal wear, or the inverse
FRESH = 0.02  # fall of the nominal wear over the criterion that shows a fresh edge [-]
ABOVE_BASE_SPEED = 0.01  # log ratio from which a speed is above the base speed [-]
MAX_BRAKE_GAP = 0.5  # largest gap of the feed that lowers the speed, in a step [-]
MAX_RELEASE_GAP = 0.1  # likewise that raises it again [-]


class LoopNumbers(NamedTuple):
    """The numbers of ``LoadLoop`` [-]: one for all environments, or one for each."""

    speed: Any
    """Log of the cutting speed over the nominal optimum."""
    speed_by_wear: Any
    """Change of it until the edge is worn out by the nominal model."""
    speed_by_slack: Any
    """Change of it per smoothed log ratio of force to power, over their limits."""
    smoothing: Any
    """Share of a new ratio in the smoothed one."""
    target: Any
    """Log of the load target."""
    target_by_wear: Any
    """Change of it until the edge is worn out by the nominal model."""
    gain_up: Any
    """Share of the way to the target feed in a step, if the feed rises."""
    gain_down: Any
    """Likewise if it falls."""


class JobNumbers(NamedTuple):
    """The numbers of ``JobLoop`` [-]: one for all environments, or one for each.

    The learned wear is the log of measured over nominal wear of the edges before.
    """

    speed: Any
    """Log of the cutting speed over the nominal plan's."""
    speed_by_learned: Any
    """Change of it per learned wear."""
    speed_by_price: Any
    """Change of it per log of the edge's price."""
    plan_share: Any
    """Share of the nominal plan's change of speed over the edge's life that is followed."""
    target: Any
    """Log of the load target."""
    target_by_spread: Any
    """Change of it per log of the spread of depth."""
    target_by_wear: Any
    """Change of it until the edge is worn out."""
    gain: Any
    """Share of the way to the target feed in a step, if the feed rises; twice that if it falls."""
    margin: Any
    """Log distance of the feed from the high end of its window; half of it from the low end."""
    change_at: Any
    """Wear over the criterion at which the edge is changed."""
    change_by_price: Any
    """Change of it per log of the edge's price."""
    learning: Any
    """Share of the last edge in the learned wear."""
    brake: Any
    """Fall of the log speed per gap of the feed, where power binds above the base speed."""
    lowest_feed: Any
    """Log of the feed over the nominal optimum from which on the speed falls instead."""


JOB_START = JobNumbers(
    speed=-0.15,
    speed_by_learned=-0.3,
    speed_by_price=0.0,
    plan_share=0.0,
    target=-0.15,
    target_by_spread=0.0,
    target_by_wear=0.0,
    gain=0.35,
    margin=0.03,
    change_at=0.8,
    change_by_price=0.0,
    learning=0.5,
    brake=0.2,
    lowest_feed=-0.3,
)
"""The numbers at which the search starts (chosen by hand)."""
JOB_SCALE = JobNumbers(
    speed=0.12,
    speed_by_learned=0.2,
    speed_by_price=0.08,
    plan_share=0.4,
    target=0.06,
    target_by_spread=0.05,
    target_by_wear=0.05,
    gain=0.12,
    margin=0.03,
    change_at=0.08,
    change_by_price=0.08,
    learning=0.2,
    brake=0.05,
    lowest_feed=0.15,
)
"""Scales of the numbers in the search (assumption)."""
TUNED_ON_JOBS = JobNumbers(
    speed=-0.199,
    speed_by_learned=-0.733,
    speed_by_price=0.0207,
    plan_share=0.949,
    target=-0.00874,
    target_by_spread=-0.000272,
    target_by_wear=-0.00468,
    gain=0.366,
    margin=0.0058,
    change_at=1,
    change_by_price=0.0646,
    learning=0.32,
    brake=0.267,
    lowest_feed=-0.49,
)
"""Numbers found on training jobs of ``shop``, in five minutes of a core.

``python -m train.tune loop --generations 80 --candidates 16``.
"""


def side_by_side(scenario: Scenarios, num_envs: int) -> ScenarioBatch:
    """Return one nominal model for each environment."""
    models = [scenario] * num_envs if isinstance(scenario, Scenario) else list(scenario)
    return ScenarioBatch.of(models)


class LoadLoop(Policy):
    """The loop for one edge.

    Args:
        scenario: nominal model, or one for each environment.
        num_envs: number of environments.
        numbers: its numbers.
    """

    def __init__(self, scenario: Scenarios, num_envs: int, numbers: LoopNumbers) -> None:
        self._scenario = side_by_side(scenario, num_envs)
        self._points = nominal_points(self._scenario)
        self._numbers = numbers
        self._slack = np.zeros(num_envs)

    def reset(self, mask: Mask) -> None:
        self._slack[mask] = 0.0

    def act(self, observations: Observations) -> Actions:
        numbers = self._numbers
        points = self._points
        reading = read(observations, self._scenario)
        wear = reading.nominal_wear / self._scenario.tool.wear_criterion
        loads = shares_of(reading, self._scenario)
        log_target = numbers.target + numbers.target_by_wear * wear
        gaps = feed_gaps(loads, points, log_target)

        # Force falls and power grows with speed, so the speed can shift load between them.
        log_power = log_target - gaps.power * points.power_exponent
        log_force = log_target - gaps.thrust_force * points.force_exponent
        slack = np.clip(log_force - log_power, -MAX_SLACK, MAX_SLACK)
        share = np.where(reading.cutting, numbers.smoothing, 0.0)
        self._slack += share * (slack - self._slack)
        log_speed = (
            points.log_speed
            + numbers.speed
            + numbers.speed_by_wear * wear
            + numbers.speed_by_slack * self._slack
        )

        log_feed = log_feed_towards(reading, gaps.least, numbers.gain_up, numbers.gain_down)
        log_feed = within_window(held_in_air(reading, log_feed), points)
        return towards(reading, self._scenario, cutting_speed=exp(log_speed), feed=exp(log_feed))


class JobLoop(Policy):
    """The loop for many edges of a job.

    Args:
        scenario: nominal model, or one for each environment.
        num_envs: number of environments.
        numbers: its numbers.
    """

    def __init__(self, scenario: Scenarios, num_envs: int, numbers: JobNumbers) -> None:
        nominal = side_by_side(scenario, num_envs)
        work = nominal.workpiece
        depth_spread = np.maximum(work.depth_along_spread / work.depth_of_cut, MIN_DEPTH_SPREAD)
        points = nominal_points(nominal)
        self._scenario = nominal
        self._points = points
        self._numbers = numbers
        self._log_price = log(nominal.economics.edge_cost / USUAL_EDGE_PRICE)
        self._log_spread = log(depth_spread / USUAL_DEPTH_SPREAD)
        lowest_speed = log(nominal.machine.cutting_speed_min)
        self._lowest_log_speed = np.maximum(points.log_base_speed, lowest_speed)

        # The state of each environment.
        self._learned_wear = np.zeros(num_envs)  # log of measured over nominal wear
        self._last_wear = np.zeros(num_envs)  # nominal wear over the criterion, a step ago
        self._slower = np.zeros(num_envs)  # change of the log speed where power binds, at most 0

    def reset(self, mask: Mask) -> None:
        self._learned_wear[mask] = 0.0
        self._last_wear[mask] = 0.0
        self._slower[mask] = 0.0

    def act(self, observations: Observations) -> Actions:
        numbers = self._numbers
        reading = read(observations, self._scenario)
        nominal_wear = reading.nominal_wear / self._scenario.tool.wear_criterion
        self._learn(reading, nominal_wear)
        wear = np.clip(nominal_wear * exp(self._learned_wear), 0.0, 1.0)

        log_speed = (
            self._planned_log_speed(wear)
            + numbers.speed
            + numbers.speed_by_learned * self._learned_wear
            + numbers.speed_by_price * self._log_price
        )
        log_feed = self._log_feed(reading, wear, log_speed)
        change_at = numbers.change_at + numbers.change_by_price * self._log_price
        return towards(
            reading,
            self._scenario,
            cutting_speed=exp(log_speed + self._slower),
            feed=exp(log_feed),
            change_edge=wear > change_at,
        )

    def _learn(self, reading: Reading, nominal_wear: Array) -> None:
        """Learn how fast edges wear from one that has been taken out and inspected."""
        # Edges that are not inspected have a wear of NaN.
        removed_wear = np.nan_to_num(reading.removed_wear) / self._scenario.tool.wear_criterion
        fresh = (nominal_wear < self._last_wear - FRESH) & (removed_wear > 0.0)
        if fresh.any():
            ratio = removed_wear / np.maximum(self._last_wear, MIN_REMOVED_WEAR)
            log_ratio = log(np.clip(ratio, 1.0 / MAX_WEAR_RATIO, MAX_WEAR_RATIO))
            share = np.where(fresh, np.clip(self._numbers.learning, 0.0, 1.0), 0.0)
            self._learned_wear += share * (log_ratio - self._learned_wear)
        self._last_wear = nominal_wear

    def _planned_log_speed(self, wear: Array) -> Array:
        """Return the log speed that follows a share of the nominal plan's course over wear."""
        start = self._points.log_speeds[:, 0]
        middle = self._points.log_speeds[:, MIDDLE]
        end = self._points.log_speeds[:, -1]
        early = start + (middle - start) * 2.0 * wear
        late = middle + (end - middle) * (2.0 * wear - 1.0)
        planned = np.where(wear < 0.5, early, late)
        return np.asarray(middle + self._numbers.plan_share * (planned - middle))

    def _log_feed(self, reading: Reading, wear: Array, log_speed: Array) -> Array:
        """Return the log feed, and set by how much the speed is lowered instead of it."""
        numbers = self._numbers
        points = self._points
        loads = shares_of(reading, self._scenario)
        log_target = (
            numbers.target
            + numbers.target_by_spread * self._log_spread
            + numbers.target_by_wear * wear
        )
        gaps = feed_gaps(loads, points, log_target)
        down = np.minimum(2.0 * numbers.gain, 1.0)
        by_power = log_feed_towards(reading, gaps.power, numbers.gain, down)
        by_force = log_feed_towards(reading, gaps.thrust_force, numbers.gain, down)

        # Above the base speed the limit of power does not depend on speed. Metal for power is
        # cheapest at high feeds, so where power binds, the feed stays and the speed falls.
        above = log(reading.cutting_speed) > points.log_base_speed + ABOVE_BASE_SPEED
        lowest = np.where(above, points.log_feed + numbers.lowest_feed, -np.inf)
        lowest = self._within_window(lowest)
        brakes = np.where(by_power < lowest, np.maximum(gaps.power, -MAX_BRAKE_GAP), 0.0)
        releases = np.minimum(gaps.power, MAX_RELEASE_GAP)
        change = np.where(gaps.power < 0.0, brakes, releases)
        slower = self._slower + np.where(reading.cutting, np.abs(numbers.brake) * change, 0.0)
        most = np.minimum(self._lowest_log_speed - log_speed, 0.0)
        self._slower = np.clip(slower, most, 0.0)

        log_feed = np.minimum(by_force, np.maximum(by_power, lowest))
        return self._within_window(held_in_air(reading, log_feed))

    def _within_window(self, log_feed: Array) -> Array:
        margin = self._numbers.margin
        return within_window(log_feed, self._points, 0.5 * margin, margin)


def _build(scenario: Scenarios, num_envs: int, **numbers: float) -> LoadLoop:
    return LoadLoop(scenario, num_envs, LoopNumbers(**numbers))


def _build_for_jobs(scenario: Scenarios, num_envs: int, **numbers: float) -> JobLoop:
    return JobLoop(scenario, num_envs, JobNumbers(**numbers))


def _plays_one_edge(scenario: Scenario) -> bool:
    one_edge = scenario.control.edge_changes == "end"
    return sets_speed_and_feed(scenario) and scenario.control.aim == "removal" and one_edge


def _plays_jobs(scenario: Scenario) -> bool:
    return sets_speed_and_feed(scenario) and scenario.control.edge_changes == "commanded"


RULES = {
    "load_loop": Rule(
        "a proportional feed loop on a load target, with a speed relative to the nominal optimum",
        _build,
        plays=_plays_one_edge,
        parameters={
            "speed": TuningRange(-0.4, 0.4),
            "speed_by_wear": TuningRange(-0.3, 0.3),
            "speed_by_slack": TuningRange(-0.3, 0.3),
            "smoothing": TuningRange(0.01, 0.3, logarithmic=True),
            "target": TuningRange(-0.3, 0.1),
            "target_by_wear": TuningRange(-0.15, 0.15),
            "gain_up": TuningRange(0.2, 1.0),
            "gain_down": TuningRange(0.3, 1.5),
        },
        together=True,
        tuned_on="rough_turning",
    ),
    "load_loop_jobs": Rule(
        "load_loop for many edges: it learns how fast they wear, and decides when to change them",
        _build_for_jobs,
        plays=_plays_jobs,
        parameters=TUNED_ON_JOBS._asdict(),
        changes_edges=True,
        together=True,
    ),
}
