"""Adaptive feed within a limit of the servo's current (servo current paper).

The force that is estimated from the current is scaled to every grade of the feed switch, by the nominal model's exponent of feed.
Above the upper limit, a share of the force limit, the feed is lowered to the highest grade that stays within it. Below the lower
limit it is raised likewise; what lies between the two keeps the switch from chattering. (The paper says that the feed is adapted
to the calculated force of the coming cycle and to the given limit, but not by which law: assumption.)

In air, and in metal until the estimate has settled, the programmed feed is commanded.
"""

import math

import numpy as np
from numpy.typing import NDArray

from baselines.constant_force import FORCE_SHARE
from baselines.models.current_sensing import ForceEstimator
from baselines.models.part_program import PROGRAM, PartProgram, on_override, on_speed_and_feed
from baselines.rule import Parameters, Rule
from turning_env import Scenario, read
from turning_env.score.policy import Actions, Observations
from turning_env.wrappers import FEED_GRADES

HYSTERESIS, CUTOFF, WINDOW = 0.05, 0.8, 3
"""Of the switch and of the estimate (see below): a filter that lags no more than the loop bears (assumption)."""
_PROGRAMMED = FEED_GRADES.index(1.0)


class CurrentLimit:
    """Holds the estimated force below a share of its limit, through the 16 grades of the feed switch.

    Args:
        program: the programmed feed. Where there is a dynamometer, its force is filtered in place of the current.
        lanes: how many lanes it controls.
        force_share: upper limit over the force limit [-].
        hysteresis: distance of the lower from the upper limit, over the upper [-].
        cutoff: of the current's filter, over the Nyquist frequency [-]; above 0 and below 1.
        window: samples over which the current's root mean square is taken, 1 or more.

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
        self.settling_intervals = math.ceil(2.0 * self._estimator.delay)
        """For how many intervals of metal the estimate is not heeded."""
        self._intervals_in_metal = np.zeros(num_envs, np.int64)
        self._grade = np.full(num_envs, _PROGRAMMED)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """The tool is in air, the switch at the programmed feed."""
        self._estimator.reset(mask)
        self._intervals_in_metal[mask] = 0
        self._grade[mask] = _PROGRAMMED

    def act(self, observations: Observations) -> Actions:
        """Actions, shape (lanes, 1 to 3), for observations, shape (lanes, entries)."""
        scenario = self._program.scenario
        reading = read(observations, scenario)
        self.reset(~reading.cutting)
        self._intervals_in_metal += reading.cutting
        estimate = self._estimator.update(reading)
        feed_ratio = self._feeds / estimate.feed[:, np.newaxis]
        force = estimate.thrust_force[:, np.newaxis] * feed_ratio**scenario.material.thrust_force.feed  # (lanes, grades)
        lowest = (force <= self._lower).sum(axis=1) - 1
        highest = (force <= self._upper).sum(axis=1) - 1
        settled = self._intervals_in_metal > self.settling_intervals
        self._grade = np.where(settled, np.clip(self._grade, np.maximum(lowest, 0), np.maximum(highest, 0)), self._grade)
        return self._program.act(reading, self._overrides[self._grade])


def _build(scenario: Scenario, num_envs: int, parameters: Parameters) -> CurrentLimit:
    return CurrentLimit(PartProgram(scenario, parameters), num_envs, parameters["force_share"])


def _force_grows(scenario: Scenario) -> bool:
    return scenario.material.thrust_force.feed > 0.0


RULES = {
    "current_limit": Rule(
        "feed by a 16-grade switch within a limit of the force, as filtered servo current tells it (servo current paper)",
        _build,
        lambda scenario: on_override(scenario) and _force_grows(scenario),
        {"force_share": FORCE_SHARE},
    ),
    "current_limit_with_speed": Rule(
        "feed by a 16-grade switch within a limit of the force (servo current paper), with the program's speed and feed tuned",
        _build,
        lambda scenario: on_speed_and_feed(scenario) and _force_grows(scenario),
        {"force_share": FORCE_SHARE, **PROGRAM},
    ),
}
