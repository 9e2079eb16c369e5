"""Feed override by spindle load, in the manner of commercial controls; and the programmed feed, to compare with.

They keep the load at a target, a share of the power limit. The laws and constants are assumptions, because the makers publish
none. Some need an exponent of the nominal law of power, as their classes say; the others need nothing of the nominal model.
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
from baselines.rule import Array, Mask, Range, Rule
from turning_env import read
from turning_env.action import sets_feed
from turning_env.numerics.functions import exp, log, real_power
from turning_env.physics.drives import lag_share
from turning_env.physics.spindle import capacity_at
from turning_env.scoring.policy import Actions, Observations, Policy

LOWEST_OVERRIDE = (
    0.1  # lowest override of the commercial controls [-]: at zero feed, the edge would only rub
)

SETTLING_TIME = 0.5  # cutting time of an edge at which LearnedPower starts to learn [s]: until then, the power is still rising
LEARNING_TIME = 1.5  # cutting time of an edge at which learning ends [s]
STOP = 1.25  # power at which the feed stops, over the extreme limit [-]
UNDERCUT = 0.3  # undercut limit over the learned power [-]
WEAR_TIME = 60.0  # time constant of the smoothing for the wear limit [s]

ENTRY_TIME = 0.3  # duration of the entry override after the touch [s], at least one step: the power reading takes that long
MAX_CHANGE = (
    5.0  # largest log ratio of target feed to actual feed [-]: without load it would be infinite
)


def towards_load(override: Array, load: Array, target: Array | float, share: float) -> Array:
    """Return ``override * (1 + share * (1 - load / target))`` [-], at least ``LOWEST_OVERRIDE``: loads change in proportion."""
    return np.maximum(override * (1.0 + share * (1.0 - load / target)), LOWEST_OVERRIDE)


def constant_load(program: PartProgram, num_envs: int, target: float, gain: float) -> OverrideLaw:
    """Return a controller in the manner of FANUC iAdaptS: the override integrates the relative deviation of the load.

    The dithering of the feed against chatter is left out, because the model has no stability limit. ``target``: load over the
    load at the power limit [-]; ``gain``: of the integration [1/s].
    """
    aim, share = (
        target_load(program.scenario, target),
        lag_share(program.scenario.control.interval, 1.0 / gain),
    )
    return OverrideLaw(
        program, lambda reading, override: towards_load(override, reading.load, aim, share)
    )


def one_line_law(program: PartProgram, num_envs: int) -> OverrideLaw:
    """Return the controller of a law without target: override = 160 - 2 load [%], within 0 to 120 %.

    It is the example of multiplicative adaptive control in Siemens' guide to synchronised actions of a SINUMERIK 840D.
    """
    return OverrideLaw(
        program, lambda reading, override: np.clip(1.6 - 2.0 * reading.load, 0.0, 1.2)
    )


class LearnedPower(Policy):
    """Constant power within limits relative to each edge's learned power, in the manner of Caron TMAC.

    Each edge cuts its first seconds at the programmed feed; their mean power is the learned power. Then there are four limits:

    * ``target``: a share [-] of the power limit at the present speed, but at most the extreme limit; ``gain`` [1/s] integrates.
    * ``extreme`` limit over the learned power [-]: well above it, the feed drops to the lowest until the power has fallen.
    * Undercut limit: below it, in air or where metal is missing, the feed is the programmed one.
    * ``wear`` limit over the learned power [-]: above it, the edge counts as worn out. If edges are changed on command, it is
      changed, and the next edge is learned. Otherwise the limit has no effect: an episode goes on until the edge fails.

    For the last two, power is converted to the programmed feed and speed by the exponents of the nominal law of power, which is
    all that it needs of the nominal model. What remains is the effect of depth of cut, hardness and wear. For the wear limit,
    smoothing averages over depth and hardness.
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
        self._program, self._extreme, self._wear = program, extreme, wear
        self._power = target * program.scenario.limits.power
        interval = program.scenario.control.interval
        self._share, self._wear_share = (
            lag_share(interval, 1.0 / gain),
            lag_share(interval, WEAR_TIME),
        )
        # Of each edge: cutting time at the last step [min]; sum [kW] and number of powers while learning.
        self._cutting_time, self._sum, self._count = np.zeros((3, num_envs))
        self._growth = np.ones(num_envs)  # smoothed power over the learned power [-]

    def reset(self, mask: Mask) -> None:
        for numbers, start in (
            (self._cutting_time, 0.0),
            (self._sum, 0.0),
            (self._count, 0.0),
            (self._growth, 1.0),
        ):
            numbers[mask] = start

    def act(self, observations: Observations) -> Actions:
        program, law = self._program, self._program.scenario.material.power
        reading = read(observations, program.scenario)
        self.reset(reading.cutting_time < self._cutting_time)  # a fresh edge
        self._cutting_time = reading.cutting_time
        at_program = reading.power * real_power(program.feed / reading.feed, law.feed)
        at_program = at_program * real_power(
            program.cutting_speed / reading.cutting_speed, law.cutting_speed
        )
        seconds = 60.0 * reading.cutting_time
        young = seconds < LEARNING_TIME
        learns = reading.cutting & (seconds >= SETTLING_TIME) & (young | (self._count == 0.0))
        self._sum += np.where(learns, at_program, 0.0)
        self._count += learns
        learned = ~young & (self._count > 0.0)
        learned_power = np.where(learned, self._sum / np.maximum(self._count, 1.0), math.inf)

        extreme = self._extreme * learned_power
        power = self._power * capacity_at(program.scenario, reading.cutting_speed)
        target = np.maximum(np.minimum(power, extreme), 1e-9)
        override = towards_load(program.override(reading), reading.power, target, self._share)
        override[reading.power > STOP * extreme] = 0.0
        undercut = at_program < UNDERCUT * learned_power
        override[undercut | ~learned] = 1.0

        watched = learned & reading.cutting & ~undercut
        growth = np.divide(
            at_program,
            learned_power,
            out=np.ones_like(learned_power),
            where=watched & (learned_power > 0.0),
        )
        self._growth += np.where(watched, self._wear_share, 0.0) * (growth - self._growth)
        return program.act(reading, override, self._growth > self._wear)


class AirGapControl(Policy):
    """Different laws in air, at entry and in metal, in the manner of OMATIVE ACM.

    In air, it commands the highest override, and for a moment after the tool touches metal, the ``entry`` override [-]. Then it
    follows the feed at which the spindle has its ``target`` load, over that at the power limit [-]: f (target / load)^(1/m), with
    f the actual feed and m the exponent of feed in the nominal law of power, which is all that it needs of the nominal model. The
    override falls to that value at once and rises to it at the rate ``rise`` [1/s].
    """

    def __init__(
        self, program: PartProgram, num_envs: int, target: float, entry: float, rise: float
    ) -> None:
        self._program, self._entry, self._interval = (
            program,
            entry,
            program.scenario.control.interval,
        )
        self._target = target_load(program.scenario, target)
        self._rise_share = lag_share(self._interval, 1.0 / rise)
        self._time_in_metal = np.zeros(num_envs)  # since the touch [s]

    def reset(self, mask: Mask) -> None:
        self._time_in_metal[mask] = 0.0

    def act(self, observations: Observations) -> Actions:
        program = self._program
        reading = read(observations, program.scenario)
        present, log_ratio = (
            program.override(reading),
            log(self._target / np.maximum(reading.load, 1e-9)),
        )
        change = np.clip(log_ratio / program.scenario.material.power.feed, -MAX_CHANGE, MAX_CHANGE)
        wanted = np.maximum(reading.feed / program.feed * exp(change), LOWEST_OVERRIDE)
        wanted = np.minimum(wanted, program.override_max)
        override = np.where(
            wanted > present, present + self._rise_share * (wanted - present), wanted
        )
        override[self._time_in_metal < ENTRY_TIME] = self._entry
        override[~reading.cutting] = program.override_max
        self._time_in_metal = np.where(reading.cutting, self._time_in_metal + self._interval, 0.0)
        return program.act(reading, override)


_TARGET = Range(0.7, 1.0)
_GAIN = Range(1.0, 40.0, logarithmic=True)
_SLOW = Range(0.1, 5.0, logarithmic=True)

RULES = {
    "programmed_feed": Rule(
        "the scenario's programmed speed and feed, uncontrolled",
        lambda scenario, num_envs: FixedParameters.programmed(scenario),
        sets_feed,
        {},
    ),
    **override_rules(
        "one_line_law",
        "override = 160 - 2 load, in per cent, within 0 to 120 %",
        one_line_law,
        {},
        PROGRAM,
    ),
    **override_rules(
        "iadapts",
        "constant spindle load by feed, in the manner of FANUC iAdaptS",
        constant_load,
        {"target": _TARGET, "gain": _GAIN},
        {**SPEED_AND_TARGET, "gain": _SLOW},
        worth_tuning=True,
    ),
    **override_rules(
        "tmac",
        "constant spindle power by feed, watched against a learned cut, in the manner of Caron TMAC",
        LearnedPower,
        {
            "target": _TARGET,
            "gain": _GAIN,
            "extreme": Range(2.0, 5.0),
            "wear": 1.5,
        },  # a pass is too short to reach the last
        {**SPEED_AND_TARGET, "gain": 1.0, "extreme": 2.0, "wear": Range(1.2, 2.0)},
        changes_edges=True,
    ),
    **override_rules(
        "omative",
        "rapid feed in air, gentle entry, then the feed that the metal allows, in the manner of OMATIVE ACM",
        AirGapControl,
        {"target": _TARGET, "entry": Range(0.3, 2.0), "rise": Range(1.0, 50.0, logarithmic=True)},
        {**SPEED_AND_TARGET, "entry": 1.0, "rise": _SLOW},
        lambda scenario: scenario.material.power.feed > 0,
        worth_tuning=True,
    ),
}
