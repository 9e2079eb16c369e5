"""Numbers of nominal models that loops and derived observations are set by.

They are the best set points, the window of feeds, the base speed, and the exponents of feed.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from baselines.models.nominal_models import NominalModels, new_jobs, scenario_of
from baselines.rule import Array
from turning_env import Reading, Scenario
from turning_env.numerics.functions import log
from turning_env.observation import read
from turning_env.policy import Observations
from turning_env.scenario.family import CHUNK, DrawnJobs, fields_of
from turning_env.scenario.plan import MIDDLE, plan_of
from turning_env.scenario.scenario_batch import ScenarioBatch

MIN_EXPONENT = 0.2
"""Lower bound of a law's exponent of feed [-]: small ones would make steps of any size."""


class NominalPoints(NamedTuple):
    """Numbers of nominal models; logarithms of speeds in m/min and of feeds in mm/rev.

    Fields have the shape (num_envs,) but for ``log_speeds``, (num_envs, ``USED_LIVES``).
    """

    log_speeds: Array  # best cutting speeds at ``plan.USED_LIVES``
    log_feed: Array  # best feed on a half-worn edge
    log_base_speed: Array  # cutting speed at the spindle's base speed; -inf if it has none
    log_lowest_feed: Array  # of the chip breaker's window, within the machine's range
    log_highest_feed: Array
    power_exponent: Array  # of feed in the law of power, at least ``MIN_EXPONENT``
    force_exponent: Array  # likewise of thrust force

    @property
    def log_speed(self) -> Array:
        """Best cutting speed on a half-worn edge."""
        return self.log_speeds[:, MIDDLE]

    def set(self, env_index: int, others: "NominalPoints", row: int) -> None:
        """Give an environment the numbers of another nominal model, in a row of others."""
        for numbers, new in zip(self, others, strict=True):
            numbers[env_index] = new[row]


def nominal_points(scenario: ScenarioBatch) -> NominalPoints:
    """Return the numbers of nominal models side by side."""
    num_envs = scenario.num_scenarios

    def of_each(value: Array | float) -> Array:
        """Return a number of each environment, in an array of its own."""
        return np.array(np.broadcast_to(value, num_envs), np.float64)

    plan = plan_of(scenario)
    lowest_feed, highest_feed = scenario.feed_range
    base_speed = of_each(scenario.base_cutting_speed)
    has_base_speed = base_speed > 0.0
    log_base_speed = log(np.where(has_base_speed, base_speed, 1.0))
    material = scenario.material
    return NominalPoints(
        log_speeds=log(plan.speed),
        log_feed=log(plan.feed[:, MIDDLE]),
        log_base_speed=np.where(has_base_speed, log_base_speed, -np.inf),
        log_lowest_feed=log(of_each(lowest_feed)),
        log_highest_feed=log(of_each(highest_feed)),
        power_exponent=np.maximum(of_each(material.power.feed), MIN_EXPONENT),
        force_exponent=np.maximum(of_each(material.thrust_force.feed), MIN_EXPONENT),
    )


class _DrawnPoints(NamedTuple):
    """A chunk of a family's jobs, which are drawn together, and the points of all of them."""

    jobs: DrawnJobs
    points: NominalPoints


class PointsOfModels:
    """Nominal models of environments, and their points.

    Args:
        models: nominal model of each environment.

    Attributes:
        scenario: the nominal models side by side.
        points: their numbers.
    """

    def __init__(self, models: Sequence[Scenario]) -> None:
        self._models = NominalModels(models)
        self.scenario = self._models.scenario
        self.points = nominal_points(self.scenario)

    def read(self, observations: Observations) -> Reading:
        """Return the readings of observations, whose first entries are the environment's own."""
        return read(observations[:, : self._models.entries], self.scenario)


class PointsOfEnvs(PointsOfModels):
    """Nominal models of the environments of a wrapper, and their points.

    Args:
        env: environment, or vector environment, perhaps in wrappers.
        num_envs: number of environments.
        needed_by: what needs the environment, for the error.

    Raises:
        ValueError: this is not an environment of RoughTurning.
    """

    def __init__(self, env: Any, num_envs: int, needed_by: str) -> None:
        nominal = scenario_of(env, needed_by).nominal()
        super().__init__([nominal] * num_envs)
        self._env = env.unwrapped
        self._jobs = np.full(num_envs, -1)
        self._drawn: dict[int, _DrawnPoints] = {}

    def follow(self, infos: dict[str, Any]) -> None:
        """Take the nominal models of the jobs that environments play after a reset or a step."""
        for env_index in new_jobs(self._env, infos, self._jobs):
            chunk, row = divmod(int(self._jobs[env_index]), CHUNK)
            if chunk not in self._drawn:
                jobs = self._env.family.draw(self._env.split, chunk)
                self._drawn[chunk] = _DrawnPoints(jobs, nominal_points(jobs.nominal))
            drawn = self._drawn[chunk]
            self._models.set(env_index, fields_of(drawn.jobs.nominal_fields, row))
            self.points.set(env_index, drawn.points, row)
