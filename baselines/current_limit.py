"""Adapt the feed to a limit on the feed motor's current (servo current paper).

The force is estimated from the current and scaled to every grade of the feed switch by the nominal exponent of feed. If the force
is above the upper limit, a share of the force limit, the controller takes the highest grade within that limit. If it is below
the lower limit, the controller takes the lowest grade above that limit. The distance between the limits prevents chatter of the
switch. (The paper adapts the feed to the calculated force and the limit, but states no law: assumption.)

In air, and in metal until the estimate has settled, the controller commands the programmed feed.

It needs of the nominal model: the exponent of feed in the law of thrust force, and the motor's current per force.
"""

import math

import numpy as np
from numpy.typing import NDArray

from baselines.constant_force import FORCE_SHARE
from baselines.models.current_sensing import ForceEstimator
from baselines.models.part_program import PROGRAM, PartProgram, override_rules
from turning_env import read
from turning_env.numerics.functions import real_power
from turning_env.scoring.policy import Actions, Observations
from turning_env.wrappers import FEED_GRADES

HYSTERESIS, CUTOFF, WINDOW = 0.05, 0.8, 3
"""Defaults of ``CurrentLimit`` [-], [-], [samples]: the loop is stable with this filter's lag (assumption)."""
_PROGRAMMED = FEED_GRADES.index(1.0)


class CurrentLimit:
    """Control that keeps the estimated force below a share of its limit with the 16 grades of the feed switch.

    Args:
        program: part program. If the scenario measures the force, the force is filtered instead of the current.
        num_envs: number of environments.
        force_share: upper limit over the force limit [-].
        hysteresis: (upper limit - lower limit) / upper limit [-].
        cutoff: cut-off frequency of the current's filter over the Nyquist frequency [-]; above 0 and below 1.
        window: number of samples of the current's root mean square, 1 or more.

    Raises:
        ValueError: the thrust force does not grow with the feed.
    """

    def __init__(
        self,
        program: PartProgram,
        num_envs: int,
        force_share: float = 0.9,
        hysteresis: float = HYSTERESIS,
        cutoff: float = CUTOFF,
        window: int = WINDOW,
    ) -> None:
        scenario = program.scenario
        machine, law = scenario.machine, scenario.material.thrust_force
        if law.feed <= 0.0:
            raise ValueError(f"material.thrust_force.feed is {law.feed}, but where feed is to limit the force it must be above 0")
        self._program = program
        self._overrides = np.minimum(FEED_GRADES, program.override_max)
        self._feeds = np.clip(self._overrides * program.feed, machine.feed_min, machine.feed_max)
        self._upper = force_share * scenario.limits.thrust_force
        self._lower = self._upper * (1.0 - hysteresis)
        self._estimator = ForceEstimator(scenario, num_envs, cutoff, window)
        self.settling_steps = math.ceil(2.0 * self._estimator.delay)
        """Steps in metal during which the estimate is ignored."""
        self._steps_in_metal = np.zeros(num_envs, np.int64)
        self._grade = np.full(num_envs, _PROGRAMMED)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Start in air, with the switch at the programmed feed."""
        self._estimator.reset(mask)
        self._steps_in_metal[mask] = 0
        self._grade[mask] = _PROGRAMMED

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, action size), for observations, shape (num_envs, entries)."""
        scenario = self._program.scenario
        reading = read(observations, scenario)
        self.reset(~reading.cutting)
        self._steps_in_metal += reading.cutting
        force, feed = (estimate[:, np.newaxis] for estimate in self._estimator.update(reading))
        force = force * real_power(self._feeds / feed, scenario.material.thrust_force.feed)  # (num_envs, grades)
        lowest = (force <= self._lower).sum(axis=1) - 1
        highest = (force <= self._upper).sum(axis=1) - 1
        settled = self._steps_in_metal > self.settling_steps
        self._grade = np.where(settled, np.clip(self._grade, np.maximum(lowest, 0), np.maximum(highest, 0)), self._grade)
        return self._program.act(reading, self._overrides[self._grade])


RULES = override_rules(
    "current_limit",
    "feed by a 16-grade switch within a limit of the force, as filtered servo current tells it (servo current paper)",
    CurrentLimit,
    {"force_share": FORCE_SHARE},
    {"force_share": FORCE_SHARE, **PROGRAM},
    lambda scenario: scenario.material.thrust_force.feed > 0.0,
)
