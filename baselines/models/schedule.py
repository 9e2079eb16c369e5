"""The best use of an edge by known laws and forms: set points over its life, and when to change it.

The power laws of a nominal model have no phases of wear, no built-up edge and no failures but by
force. Where edges collapse, chip, notch or run in (``EdgeFailure``), or a bar chatters, the best
speed follows from dynamic programming over the used share D of an edge's life, in steps of 1 /
``LIVES``. With a price of time c, a set point is worth at D

    metal - overload - c time - edge / LIVES + q V(D + 1 / LIVES) + (1 - q) broken(D + 1 / LIVES)

at the rate of wear there, where q is the chance that the edge survives the step. V(D) is the
greatest such worth, or that of a change of the edge, if larger. Time is limited, so it costs what
it can earn: with the right c, a fresh edge is worth V(0) = 0. Bars are as expected. Their spreads
enter the expected excess over a limit and the chance to survive.

The closed form of ``edge_value.py`` has one equation per used life, but it cannot hold a chance to
survive. On unseen jobs of the family ``unmodelled``, ``known_forms``, which keeps to this schedule,
returns 274 s (188 to 364) more than the best rule without (docs/family_results.md has the command).
"""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.models.normal import probability
from baselines.rule import Array
from turning_env import PowerLaw, Scenario
from turning_env.numerics.functions import exp, hypotenuse, log, real_power
from turning_env.physics.wear import Phases, phase_factor
from turning_env.scenario.laws import (
    capacity_at,
    chatter_cutting_speed,
    life_rate,
    load_shares,
    load_spread,
    loads_at,
    removal_rate_at,
    wear_at,
)
from turning_env.scenario.sections import EdgeFailure

FORMS = "edge_failure.", "machine.chatter", "swarf."
"""Beginnings of the dotted names of the fields that a plan needs beside the power laws."""
LIVES = 40  # steps of the used life
SPEEDS = 24  # cutting speeds that are compared
FEEDS = 14  # feeds that are compared
BISECTIONS = 24  # of the price of time
MAX_TIME_PRICE = 5.0
MIN_SPEED = 1.5
"""Lowest speed over the machine's [-]: below, an edge earns nothing for long.

It was found on training jobs.
"""
SEVERITY = 1.2  # factor on the price of overload [-], that of ``self_tuning``
HOT_SPOTS = 3.0
"""Independent places of a bar per minute, each of which can be too hot [1/min] (assumption)."""
HEAT_MARGIN = 2.0
"""Factor on the standard deviation of the log temperature [-] (found on training jobs)."""
MIN_HEAT_SPREAD = 1e-3
MIN_POSITIVE = 1e-9  # in place of 0 in logarithms and divisions


class Schedule(NamedTuple):
    """The best use of an edge."""

    cutting_speed: Array  # [m/min] in each step of the used life, shape (LIVES,)
    feed: Array  # [mm/rev], likewise
    change_at: float  # used life at which to change the edge [-]
    time: float  # what a second can earn [s]


class Steps(NamedTuple):
    """Each step of life at each set point; arrays of shape (LIVES, SPEEDS, FEEDS)."""

    gain: Any  # value of metal less overload [s]
    time: Any  # [s]
    survival: Any  # chance that the edge survives [-]


class EdgePlan(NamedTuple):
    """The best use of an edge at a price of time."""

    worth: float  # of the fresh edge [s]
    set_points: NDArray[np.int64]  # place of the best set point in each step of life
    change: int  # step of life in which to change the edge


def has_forms(scenario: Scenario) -> bool:
    """Return whether edges are changed on command and the scenario has forms beside power laws."""
    forms = scenario.edge_failure != EdgeFailure() or scenario.machine.chatter > 0.0
    return forms and scenario.control.edge_changes == "commanded"


@lru_cache(maxsize=4096)
def schedule(scenario: Scenario) -> Schedule:
    """Return the best use of an edge, by the scenario's own laws and forms."""
    min_speed = MIN_SPEED * scenario.machine.cutting_speed_min
    min_feed, max_feed = scenario.feed_range
    log_speeds = np.linspace(log(min_speed), log(scenario.cutting_speed_max), SPEEDS)
    speed = exp(log_speeds)[:, np.newaxis]
    feed = exp(np.linspace(log(min_feed), log(max_feed), FEEDS))
    shape = (LIVES, SPEEDS, FEEDS)
    steps = Steps(*[np.broadcast_to(values, shape) for values in _steps(scenario, speed, feed)])

    # A fresh edge is worth less, the more a second costs. Find the price at which it is worth 0.
    low = 0.0
    high = MAX_TIME_PRICE
    for _ in range(BISECTIONS):
        price = 0.5 * (low + high)
        plan = _best_use(scenario, steps, price)
        if plan.worth > 0.0:
            low = price
        else:
            high = price
    speed_index, feed_index = np.divmod(plan.set_points, FEEDS)
    return Schedule(
        cutting_speed=speed[speed_index, 0],
        feed=feed[feed_index],
        change_at=plan.change / LIVES,
        time=price,
    )


def _best_use(scenario: Scenario, steps: Steps, price: float) -> EdgePlan:
    """Return the best use of an edge at a price of time, by going backward from its end of life."""
    economics = scenario.economics
    change_time = economics.edge_change_time
    edge = 60.0 * economics.edge_cost  # [s]
    gain = steps.gain - price * steps.time
    set_points = np.zeros(LIVES, np.int64)
    change = LIVES
    # A worn-out edge stops the lathe unplanned.
    worth = -60.0 * price * (change_time + economics.unplanned_stop)
    for step in range(LIVES - 1, -1, -1):
        # A broken edge loses its unused life.
        unused = edge * (1.0 - (step + 1.0) / LIVES)
        downtime = change_time + economics.breakage_downtime
        broken = -unused - 60.0 * price * downtime
        survival = steps.survival[step]
        expected = gain[step] - edge / LIVES + survival * (worth - broken) + broken
        worths = expected.ravel()
        best = worths.argmax()
        set_points[step] = best
        worth = float(worths[best])
        unused_at_start = edge * (1.0 - step / LIVES)
        changed = -unused_at_start - 60.0 * price * change_time
        if step > 0 and changed > worth:
            worth = changed
            change = step
    return EdgePlan(worth, set_points, change=change)


def _steps(scenario: Scenario, speed: Array, feed: Array) -> Steps:
    """Return gain, time and survival of each step of an edge's life, at each set point.

    The arrays of set points broadcast to one shape.
    """
    cut = _Responses(scenario, speed, feed)
    life = np.arange(LIVES + 1.0)[:, np.newaxis, np.newaxis] / LIVES
    start = np.maximum(life[:-1], MIN_POSITIVE)
    end = life[1:]
    middle = 0.5 * (life[:-1] + end)
    life_rate = cut.life_rate(middle)
    minutes = 1.0 / (LIVES * life_rate)
    survival = exp(-cut.hazard(middle, end) * minutes)
    # Force and notch break an edge that is weaker than they are. The edge survived the step's
    # start.
    chance_at_start = cut.strength_chance(start)
    chance_at_end = cut.strength_chance(end)
    stronger = np.minimum(chance_at_end / chance_at_start, 1.0)
    return Steps(
        gain=60.0 * cut.value_rate(middle) * minutes,
        time=60.0 * minutes,
        survival=survival * stronger,
    )


class _Responses:
    """Responses to set points at used lives [-], as arrays that broadcast.

    Args:
        scenario: laws and forms.
        speed: cutting speeds [m/min], shape (SPEEDS, 1).
        feed: feeds [mm/rev], shape (FEEDS,).
    """

    def __init__(self, scenario: Scenario, speed: Array, feed: Array) -> None:
        machine = scenario.machine
        self._scenario = scenario
        self._material = scenario.material
        self._failure = scenario.edge_failure
        self._criterion = scenario.tool.wear_criterion
        self._strength = scenario.tool.edge_strength
        self._strength_spread = scenario.tool.edge_strength_spread
        self._speed = speed
        self._feed = feed
        self._depth = scenario.workpiece.depth_of_cut
        # Chatter adds a dynamic force around the bar's critical spindle speed
        # (``physics/slender_bar.py``; at the nominal depth).
        off = log(speed / chatter_cutting_speed(scenario)) / machine.chatter_width
        self._dynamic = 1.0 + machine.chatter * exp(-off * off)

    def life_rate(self, used_life: Array) -> Any:
        """Return the rate at which the life is used [1/min]."""
        failure = self._failure
        wear = wear_at(self._scenario, used_life)
        rate = life_rate(self._material.wear, self._criterion, self._speed, self._feed, self._depth)
        phases = Phases(
            tertiary_wear=failure.tertiary_wear,
            tertiary_rate=failure.tertiary_rate,
            running_in=failure.running_in,
            running_in_wear=failure.running_in_wear,
            built_up_edge=failure.built_up_edge,
            log_built_up_speed=log(failure.built_up_speed),
            built_up_width=failure.built_up_width,
        )
        return rate * phase_factor(phases, wear, log(self._speed))

    def value_rate(self, used_life: Array) -> Any:
        """Return the value of metal less the price of overload [s per s]."""
        scenario = self._scenario
        economics = scenario.economics
        material = self._material
        wear = wear_at(scenario, used_life)
        loads = loads_at(scenario, self._speed, self._feed, self._depth, wear=wear)
        capacity = capacity_at(scenario, self._speed)
        shares = load_shares(loads, scenario.limits, capacity=capacity)
        # Loads half a standard deviation above the expected stand for all bars.
        force = self._dynamic * shares.thrust_force * exp(0.5 * self._spread(material.thrust_force))
        power = shares.power * exp(0.5 * self._spread(material.power))
        over = np.maximum(force - 1.0, 0.0) + np.maximum(power - 1.0, 0.0)
        removal_rate = removal_rate_at(self._speed, self._feed, self._depth)
        metal = removal_rate / economics.reference_removal_rate
        return metal - SEVERITY * economics.overload_price * over

    def hazard(self, middle: Array, end: Array) -> Any:
        """Return the rate of chipping and of collapse by heat [1/min]."""
        failure = self._failure
        force_spread = self._spread(self._material.thrust_force)
        log_force = log(self._force(middle) / self._strength)
        load = log_force + 0.5 * force_spread**2
        relative_wear = wear_at(self._scenario, middle) / self._criterion
        by_load = exp(failure.chipping_load_exponent * load)
        by_wear = real_power(relative_wear, failure.chipping_wear_exponent)
        chipping = failure.chipping_rate * by_load * by_wear
        if failure.collapse_temperature <= 0.0:
            return chipping
        law = failure.temperature
        wear = wear_at(self._scenario, end)
        temperature = law(self._speed, self._feed, self._depth, wear=wear)
        hotter = log(temperature / failure.collapse_temperature)
        spread = HEAT_MARGIN * self._spread(law) + MIN_HEAT_SPREAD
        by_hot_spots = HOT_SPOTS * probability(hotter / spread).below
        # If even the mean is this far above the critical temperature, the edge collapses at once.
        collapse = np.where(hotter > spread, np.inf, by_hot_spots)
        return chipping + collapse

    def strength_chance(self, used_life: Array) -> Any:
        """Return the chance that an edge is stronger than force and notch [-], above 0."""
        force_spread = self._spread(self._material.thrust_force)
        spread = hypotenuse(force_spread, self._strength_spread)
        reserve = log(self._strength / self._force(used_life))
        stronger_than_force = probability(reserve / spread).below

        notch = np.maximum(self._failure.notch_growth * used_life, MIN_POSITIVE)
        notch_spread = max(self._strength_spread, MIN_POSITIVE)
        stronger_than_notch = probability(-log(notch) / notch_spread).below
        return stronger_than_force * stronger_than_notch + MIN_POSITIVE

    def _force(self, used_life: Array) -> Any:
        """Return the thrust force [N], with that of chatter."""
        wear = wear_at(self._scenario, used_life)
        force = self._material.thrust_force(self._speed, self._feed, self._depth, wear=wear)
        return force * self._dynamic

    def _spread(self, law: PowerLaw) -> Any:
        """Return the standard deviation of a log response over bars."""
        return load_spread(law, self._scenario.workpiece)
