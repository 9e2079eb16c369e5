"""Rapid feed in air gaps, a low feed at entry, and then the feed of a target load, in the manner of OMATIVE ACM.

In air, the controller commands the highest override, and for a moment after the tool touches metal, the entry override. Then it
follows the feed at which the spindle has its target load: f (target / load)^(1/m), with f the actual feed and m the exponent of
feed in the nominal power law. The feed falls to that value at once and rises to it gradually. The laws and constants are
assumptions, because none are published.

It needs of the nominal model: the exponent of feed in the law of power.
"""

import numpy as np
from numpy.typing import NDArray

from baselines.load_override import LOWEST_OVERRIDE
from baselines.models.part_program import SPEED_AND_TARGET, PartProgram, override_rules, target_load
from baselines.rule import Range
from turning_env import read
from turning_env.numerics.functions import exp, log
from turning_env.physics.drives import lag_share
from turning_env.scoring.policy import Actions, Observations

ENTRY_TIME = 0.3
"""Duration of the entry override after the touch [s], at least one control interval: the power reading takes that long."""
MAX_CHANGE = 5.0
"""Largest log ratio of target feed to actual feed [-]: without load it would be infinite."""


class AirGapControl:
    """A feed override with different laws in air, at entry and in metal.

    Args:
        program: part program.
        num_envs: number of environments.
        target: load over the load at the power limit [-].
        entry: override when the tool touches metal [-].
        rise: rate at which the override rises to a higher one [1/s].
    """

    def __init__(self, program: PartProgram, num_envs: int, target: float, entry: float, rise: float) -> None:
        self._program = program
        self._target = target_load(program.scenario, target)
        self._entry = entry
        self._interval = program.scenario.control.interval
        self._rise_share = lag_share(self._interval, 1.0 / rise)
        self._time_in_metal = np.zeros(num_envs)  # since the touch [s]

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Start in air."""
        self._time_in_metal[mask] = 0.0

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, action size), for observations, shape (num_envs, entries)."""
        program, exponent = self._program, self._program.scenario.material.power.feed
        reading = read(observations, program.scenario)
        present = program.override(reading)
        load = np.maximum(reading.load, 1e-9)
        change = np.clip(log(self._target / load) / exponent, -MAX_CHANGE, MAX_CHANGE)
        wanted = np.maximum(reading.feed / program.feed * exp(change), LOWEST_OVERRIDE)
        wanted = np.minimum(wanted, program.override_max)
        override = np.where(wanted > present, present + self._rise_share * (wanted - present), wanted)

        entering = self._time_in_metal < ENTRY_TIME
        override[entering] = self._entry
        override[~reading.cutting] = program.override_max
        self._time_in_metal = np.where(reading.cutting, self._time_in_metal + self._interval, 0.0)
        return program.act(reading, override)


RULES = override_rules(
    "omative",
    "rapid feed in air, gentle entry, then the feed that the metal allows, in the manner of OMATIVE ACM",
    AirGapControl,
    {"target": Range(0.7, 1.0), "entry": Range(0.3, 2.0), "rise": Range(1.0, 50.0, logarithmic=True)},
    {**SPEED_AND_TARGET, "entry": 1.0, "rise": Range(0.1, 5.0, logarithmic=True)},
    lambda scenario: scenario.material.power.feed > 0,
    worth_tuning=True,
)
