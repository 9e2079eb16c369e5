"""Hold a constant spindle power with the feed, and compare it with a learned cut, in the manner of Caron TMAC.

Each edge cuts its first seconds at the programmed feed; their mean power is the learned power. Then the feed keeps the power
constant within four limits. The last three are relative to the learned power:

* Target: a share of the power limit, but at most the extreme limit.
* Extreme limit: well above it, the feed drops to the machine's lowest until the power has fallen.
* Undercut limit: below it, in air or where metal is missing, the feed is the programmed one.
* Wear limit: above it, the edge counts as worn out. If edges are changed on command, it is changed, and the next edge is learned.
  Otherwise the limit has no effect, because an episode goes on until the edge fails.

For the last two limits, power is converted to the programmed feed and speed by the exponents of the nominal power law. What
remains is the effect of depth of cut, hardness and wear. For the wear limit, smoothing averages over depth and hardness.

The laws and constants are assumptions, because none are published.

It needs of the nominal model: the exponents of speed and feed in the law of power.
"""

import math

import numpy as np
from numpy.typing import NDArray

from baselines.load_override import towards_load
from baselines.models.part_program import SPEED_AND_TARGET, PartProgram, override_rules
from baselines.rule import Range
from turning_env import read
from turning_env.numerics.functions import real_power
from turning_env.physics.drives import lag_share
from turning_env.physics.spindle import capacity_at
from turning_env.scoring.policy import Actions, Observations

SETTLING_TIME = 0.5
"""Cutting time of an edge at which learning starts [s]: until then, the power is still rising."""
LEARNING_TIME = 1.5
"""Cutting time of an edge at which learning ends [s]."""
STOP = 1.25
"""Power at which the feed stops, over the extreme limit [-]."""
UNDERCUT = 0.3
"""Undercut limit over the learned power [-]."""
WEAR_TIME = 60.0
"""Time constant of the smoothing for the wear limit [s]."""


class LearnedPower:
    """A feed override that holds the power constant, with limits relative to each edge's learned power.

    Args:
        program: part program.
        num_envs: number of environments.
        target: power over the power limit at the present speed [-].
        gain: gain of the integration [1/s].
        extreme: extreme limit over the learned power [-].
        wear: wear limit over the learned power [-].
    """

    def __init__(self, program: PartProgram, num_envs: int, target: float, gain: float, extreme: float, wear: float) -> None:
        scenario = program.scenario
        self._program = program
        self._power = target * scenario.limits.power
        self._extreme, self._wear = extreme, wear
        self._share = lag_share(scenario.control.interval, 1.0 / gain)
        self._wear_share = lag_share(scenario.control.interval, WEAR_TIME)
        self._cutting_time = np.zeros(num_envs)  # the edge's, at the last step [min]
        self._sum = np.zeros(num_envs)  # sum of powers while learning [kW]
        self._count = np.zeros(num_envs)
        self._growth = np.ones(num_envs)  # smoothed power over the learned power [-]

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget the edge."""
        self._cutting_time[mask] = 0.0
        self._sum[mask] = 0.0
        self._count[mask] = 0.0
        self._growth[mask] = 1.0

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, action size), for observations, shape (num_envs, entries)."""
        program, law = self._program, self._program.scenario.material.power
        reading = read(observations, program.scenario)
        self.reset(reading.cutting_time < self._cutting_time)  # a fresh edge
        self._cutting_time = reading.cutting_time
        at_program = (
            reading.power
            * real_power(program.feed / reading.feed, law.feed)
            * real_power(program.cutting_speed / reading.cutting_speed, law.cutting_speed)
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
        override = towards_load(
            program.override(reading), reading.power, np.maximum(np.minimum(power, extreme), 1e-9), self._share
        )
        override[reading.power > STOP * extreme] = 0.0
        undercut = at_program < UNDERCUT * learned_power
        override[undercut | ~learned] = 1.0

        watched = learned & reading.cutting & ~undercut
        growth = np.divide(at_program, learned_power, out=np.ones_like(learned_power), where=watched & (learned_power > 0.0))
        self._growth += np.where(watched, self._wear_share, 0.0) * (growth - self._growth)
        return program.act(reading, override, self._growth > self._wear)


RULES = override_rules(
    "tmac",
    "constant spindle power by feed, watched against a learned cut, in the manner of Caron TMAC",
    LearnedPower,
    {
        "target": Range(0.7, 1.0),
        "gain": Range(1.0, 40.0, logarithmic=True),
        "extreme": Range(2.0, 5.0),
        "wear": 1.5,  # a pass is too short to reach it
    },
    {**SPEED_AND_TARGET, "gain": 1.0, "extreme": 2.0, "wear": Range(1.2, 2.0)},
    changes_edges=True,
)
