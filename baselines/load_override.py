"""Feed override by spindle load, in the manner of commercial controls.

The programmed feed is there to compare with. The controllers keep the load at a target, a share of
the power limit. The laws and constants are assumptions, because the makers publish none. Some use
an exponent of the nominal law of power, as their classes say; the others use nothing from the
nominal model.
"""

import math

import numpy as np

from baselines.fixed import FixedParameters
from baselines.models.part_program import (
    PROGRAM,
    SPEED_AND_TARGET,
    OverrideLaw,
    PartProgram,
    override_rules,
    target_load,
)
from baselines.rule import Array, Mask, Rule, TuningRange
from turning_env import Reading, read
from turning_env.action import sets_feed
from turning_env.numerics.functions import exp, log, real_power
from turning_env.physics.drives import lag_share
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.laws import capacity_at

LOWEST_OVERRIDE = 0.1
"""Lowest override of the commercial controls [-]: at zero feed, the edge would only rub."""

SETTLING_TIME = 0.5
"""Cutting time of an edge at which LearnedPower starts to learn [s]: before, the power rises."""
LEARNING_TIME = 1.5  # cutting time of an edge at which learning ends [s]
STOP = 1.25  # power at which the feed stops, over the extreme limit [-]
UNDERCUT = 0.3  # undercut limit over the learned power [-]
WEAR_TIME = 60.0  # time constant of the smoothing for the wear limit [s]

ENTRY_TIME = 0.3
"""Duration of the entry override after the touch [s], at least one step.

The power reading takes that long.
"""
MAX_CHANGE = 5.0
"""Largest log ratio of target feed to actual feed [-]: without load it would be infinite."""
MIN_LOAD = 1e-9  # in place of 0 where a load or power divides


def towards_load(override: Array, load: Array, target: Array | float, share: float) -> Array:
    """Return ``override * (1 + share * (1 - load / target))`` [-], at least ``LOWEST_OVERRIDE``.

    Loads change about in proportion to the override.
    """
    changed = override * (1.0 + share * (1.0 - load / target))
    return np.maximum(changed, LOWEST_OVERRIDE)


def constant_load(program: PartProgram, num_envs: int, target: float, gain: float) -> OverrideLaw:
    """Return a controller in the manner of FANUC iAdaptS.

    The override integrates the relative deviation of the load. The dithering of the feed against
    chatter is left out, because the model has no stability limit.

    Args:
        program: the part program, whose feed is overridden.
        num_envs: number of environments.
        target: load over the load at the power limit [-].
        gain: gain of the integration [1/s].
    """
    target_now = target_load(program.scenario, target)
    share = lag_share(program.scenario.control.interval, 1.0 / gain)

    def law(reading: Reading, override: Array) -> Array:
        return towards_load(override, reading.load, target=target_now, share=share)

    return OverrideLaw(program, law)


def one_line_law(program: PartProgram, num_envs: int) -> OverrideLaw:
    """Return the controller of override = 160 - 2 load [%], within 0 to 120 %.

    It is the example of multiplicative adaptive control in Siemens' guide to synchronised actions
    of a SINUMERIK 840D.
    """

    def law(reading: Reading, override: Array) -> Array:
        return np.clip(1.6 - 2.0 * reading.load, 0.0, 1.2)

    return OverrideLaw(program, law)


class LearnedPower(Policy):
    """Constant power within limits relative to each edge's learned power, like Caron TMAC.

    Each edge cuts its first seconds at the programmed feed; their mean power is the learned power.
    Then there are four limits:

    * Target: a share of the power limit at the present speed, but at most the extreme limit.
    * Extreme limit: well above it, the feed drops to the lowest until the power has fallen.
    * Undercut limit: below it, in air or where metal is missing, the feed is the programmed one.
    * Wear limit: above it, the edge counts as worn out. If edges are changed on command, it is
      changed, and the next edge is learned. Otherwise the limit has no effect: an episode goes on
      until the edge fails.

    For the last two, power is converted to the programmed feed and speed by the exponents of the
    nominal law of power, which is all that it uses from the nominal model. What remains is the
    effect of depth of cut, hardness and wear. For the wear limit, smoothing averages over depth and
    hardness.

    Args:
        program: the part program, whose feed is overridden.
        num_envs: number of environments.
        target: target over the power limit [-].
        gain: gain with which the override integrates [1/s].
        extreme: extreme limit over the learned power [-].
        wear: wear limit over the learned power [-].
    """

    def __init__(
        self,
        program: PartProgram,
        num_envs: int,
        target: float,
        gain: float,
        extreme: float,
        wear: float,
    ) -> None:
        interval = program.scenario.control.interval
        self._program = program
        self._extreme = extreme
        self._wear = wear
        self._target_power = target * program.scenario.limits.power
        self._share = lag_share(interval, 1.0 / gain)
        self._wear_share = lag_share(interval, WEAR_TIME)
        # One number for the edge of each environment.
        self._cutting_time = np.zeros(num_envs)  # at the last step [min]
        self._power_sum = np.zeros(num_envs)  # of the powers while it learns [kW]
        self._power_count = np.zeros(num_envs)
        self._growth = np.ones(num_envs)  # smoothed power over the learned power [-]

    def reset(self, mask: Mask) -> None:
        self._cutting_time[mask] = 0.0
        self._power_sum[mask] = 0.0
        self._power_count[mask] = 0.0
        self._growth[mask] = 1.0

    def act(self, observations: Observations) -> Actions:
        program = self._program
        reading = read(observations, program.scenario)
        fresh_edge = reading.cutting_time < self._cutting_time
        self.reset(fresh_edge)
        self._cutting_time = reading.cutting_time
        power = self._power_at_program(reading)
        learned_power = self._learn(reading, power)
        learned = np.isfinite(learned_power)

        extreme = self._extreme * learned_power
        target = self._target_power * capacity_at(program.scenario, reading.cutting_speed)
        target = np.maximum(np.minimum(target, extreme), MIN_LOAD)
        override = towards_load(
            program.override(reading),
            reading.power,
            target=target,
            share=self._share,
        )
        override[reading.power > STOP * extreme] = 0.0
        # While it learns, and where metal is missing, the feed is the programmed one.
        undercut = power < UNDERCUT * learned_power
        override[undercut | ~learned] = 1.0

        watched = learned & reading.cutting & ~undercut
        growth = np.ones_like(learned_power)
        np.divide(power, learned_power, out=growth, where=watched & (learned_power > 0.0))
        share = np.where(watched, self._wear_share, 0.0)
        self._growth += share * (growth - self._growth)
        worn = self._growth > self._wear
        return program.act(reading, override, change_edge=worn)

    def _power_at_program(self, reading: Reading) -> Array:
        """Return the power [kW] that the cut would take at the programmed feed and speed."""
        program = self._program
        law = program.scenario.material.power
        feed_ratio = program.feed / reading.feed
        speed_ratio = program.cutting_speed / reading.cutting_speed
        power = reading.power * real_power(feed_ratio, law.feed)
        return np.asarray(power * real_power(speed_ratio, law.cutting_speed))

    def _learn(self, reading: Reading, power: Array) -> Array:
        """Learn from a power; return the learned power [kW], inf while an edge learns."""
        seconds = 60.0 * reading.cutting_time
        young = seconds < LEARNING_TIME
        has_settled = seconds >= SETTLING_TIME
        # An edge that has learned nothing in its youth learns later.
        needs_power = young | (self._power_count == 0.0)
        learns = reading.cutting & has_settled & needs_power
        self._power_sum += np.where(learns, power, 0.0)
        self._power_count += learns
        learned = ~young & (self._power_count > 0.0)
        mean = self._power_sum / np.maximum(self._power_count, 1.0)
        return np.where(learned, mean, math.inf)


class AirGapControl(Policy):
    """Different laws in air, at entry and in metal, in the manner of OMATIVE ACM.

    In air, it commands the highest override, and for a moment after the tool touches metal, the
    entry override. Then it follows the feed at which the spindle has its target load:
    f (target / load)^(1/m), with f the actual feed and m the exponent of feed in the nominal law of
    power, which is all that it uses from the nominal model. The override falls to that value at
    once and rises to it gradually.

    Args:
        program: the part program, whose feed is overridden.
        num_envs: number of environments.
        target: target load over the load at the power limit [-].
        entry: override at entry [-].
        rise: rate at which the override rises [1/s].
    """

    def __init__(
        self, program: PartProgram, num_envs: int, target: float, entry: float, rise: float
    ) -> None:
        self._program = program
        self._entry = entry
        self._interval = program.scenario.control.interval
        self._target = target_load(program.scenario, target)
        self._rise_share = lag_share(self._interval, 1.0 / rise)
        self._time_in_metal = np.zeros(num_envs)  # since the touch [s]

    def reset(self, mask: Mask) -> None:
        self._time_in_metal[mask] = 0.0

    def act(self, observations: Observations) -> Actions:
        program = self._program
        reading = read(observations, program.scenario)
        present = program.override(reading)
        log_ratio = log(self._target / np.maximum(reading.load, MIN_LOAD))
        change = np.clip(log_ratio / program.scenario.material.power.feed, -MAX_CHANGE, MAX_CHANGE)
        wanted = np.maximum(reading.feed / program.feed * exp(change), LOWEST_OVERRIDE)
        wanted = np.minimum(wanted, program.override_max)
        risen = present + self._rise_share * (wanted - present)
        override = np.where(wanted > present, risen, wanted)
        override[self._time_in_metal < ENTRY_TIME] = self._entry
        override[~reading.cutting] = program.override_max
        self._time_in_metal = np.where(reading.cutting, self._time_in_metal + self._interval, 0.0)
        return program.act(reading, override)


_TARGET = TuningRange(0.7, 1.0)
_GAIN = TuningRange(1.0, 40.0, logarithmic=True)
_SLOW = TuningRange(0.1, 5.0, logarithmic=True)

RULES = {
    "programmed_feed": Rule(
        "the scenario's programmed speed and feed, uncontrolled",
        lambda scenario, num_envs: FixedParameters.programmed(scenario),
        plays=sets_feed,
        parameters={},
    ),
    **override_rules(
        "one_line_law",
        "override = 160 - 2 load, in per cent, within 0 to 120 %",
        controller=one_line_law,
        parameters={},
        with_speed=PROGRAM,
    ),
    **override_rules(
        "iadapts",
        "constant spindle load by feed, in the manner of FANUC iAdaptS",
        controller=constant_load,
        parameters={"target": _TARGET, "gain": _GAIN},
        with_speed={**SPEED_AND_TARGET, "gain": _SLOW},
        worth_tuning=True,
    ),
    **override_rules(
        "tmac",
        "constant spindle power by feed, watched against a learned cut, "
        "in the manner of Caron TMAC",
        controller=LearnedPower,
        parameters={
            "target": _TARGET,
            "gain": _GAIN,
            "extreme": TuningRange(2.0, 5.0),
            "wear": 1.5,  # a pass is too short to reach it
        },
        with_speed={**SPEED_AND_TARGET, "gain": 1.0, "extreme": 2.0, "wear": TuningRange(1.2, 2.0)},
        changes_edges=True,
    ),
    **override_rules(
        "omative",
        "rapid feed in air, gentle entry, then the feed that the metal allows, "
        "in the manner of OMATIVE ACM",
        controller=AirGapControl,
        parameters={
            "target": _TARGET,
            "entry": TuningRange(0.3, 2.0),
            "rise": TuningRange(1.0, 50.0, logarithmic=True),
        },
        with_speed={**SPEED_AND_TARGET, "entry": 1.0, "rise": _SLOW},
        plays=lambda scenario: scenario.material.power.feed > 0,
        worth_tuning=True,
    ),
}
