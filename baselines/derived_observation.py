"""Inputs that follow from the observation and the nominal model, appended to observations.

    env = DerivedObservation(gymnasium.make("RoughTurning-Family-v1"))
    envs = VectorDerivedObservation(gymnasium.make_vec("RoughTurning-Family-v1", 512))

A network must otherwise learn differences and quotients of the context's numbers. ``ENTRIES`` are
functions of the observation and, on a family, of the context; if that is hidden, they are further
information.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from baselines.belief import at_end, with_final
from baselines.models.feed_loop import shares_of
from baselines.models.nominal_points import PointsOfEnvs, PointsOfModels
from turning_env.numerics.functions import log
from turning_env.physics.quantities import DEVIATION_SCALE, MAX_RATIO
from turning_env.policy import Actions, Observations

DISTANCE_SCALE = 3.0
"""Scale of log ratios: most distances are of order one then."""
MAX_DISTANCE = 10.0  # highest absolute value of a scaled log ratio
_DISTANCES = (
    "speed_over_optimum",
    "feed_over_optimum",
    "feed_over_lowest",
    "feed_below_highest",
    "speed_over_base_speed",
)
ENTRIES = ("highest_load", *_DISTANCES)
"""Names of the entries.

The load is ``5 * (load / limit - 1)``, from -5 to 15, of power or thrust force, whichever is
higher. The others are ``3 * log(ratio)``, limited to -10..10: of the commanded speed and feed to
the nominal optimum on a half-worn edge, of the commanded feed to the ends of the chip breaker's
window, and of the actual speed to the base speed (10 without one).
"""


def with_derived(models: PointsOfModels, observations: Observations) -> Observations:
    """Return observations, shape (num_envs, entries), and ``ENTRIES`` behind them."""
    points = models.points
    reading = models.read(observations)
    highest_load = shares_of(reading, models.scenario).highest
    log_speed = log(reading.commanded_cutting_speed)
    log_feed = log(reading.commanded_feed)
    # In the order of ``ENTRIES``.
    deviation = DEVIATION_SCALE * (np.minimum(highest_load, MAX_RATIO) - 1.0)
    ratios = [
        log_speed - points.log_speed,
        log_feed - points.log_feed,
        log_feed - points.log_lowest_feed,
        points.log_highest_feed - log_feed,
        log(reading.cutting_speed) - points.log_base_speed,
    ]
    distances = DISTANCE_SCALE * np.stack(ratios, axis=1)
    limited = np.clip(distances, -MAX_DISTANCE, MAX_DISTANCE)
    derived = np.concatenate([deviation[:, np.newaxis], limited], axis=1).astype(np.float32)
    return np.concatenate([observations, derived], axis=1)


def with_entries(space: Any) -> Any:
    """Return an observation space with ``ENTRIES`` behind its own."""
    lowest_load = -DEVIATION_SCALE
    highest_load = DEVIATION_SCALE * (MAX_RATIO - 1.0)
    low = [lowest_load] + [-MAX_DISTANCE] * len(_DISTANCES)
    high = [highest_load] + [MAX_DISTANCE] * len(_DISTANCES)
    return Box(
        np.concatenate([space.low, np.array(low, np.float32)]),
        np.concatenate([space.high, np.array(high, np.float32)]),
        dtype=np.float32,
    )


class DerivedObservation(
    gymnasium.Wrapper[Observations, Actions, Observations, Actions], RecordConstructorArgs
):
    """A wrapper that appends ``ENTRIES`` to observations.

    Raises:
        ValueError: this is no environment of RoughTurning.
    """

    def __init__(self, env: gymnasium.Env[Observations, Actions]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        self._models = PointsOfEnvs(env, 1, "a derived observation")
        self.observation_space = with_entries(env.observation_space)

    def reset(self, **options: Any) -> tuple[Observations, dict[str, Any]]:
        observation, info = self.env.reset(**options)
        self._models.follow(info)
        return with_derived(self._models, observation[np.newaxis])[0], info

    def step(self, action: Actions) -> tuple[Observations, Any, bool, bool, dict[str, Any]]:
        observation, reward, terminated, truncated, info = self.env.step(action)
        appended = with_derived(self._models, observation[np.newaxis])[0]
        return appended, reward, terminated, truncated, info


# Not subscripted: VectorWrapper is generic only from Gymnasium 1.4 on.
class VectorDerivedObservation(VectorWrapper):
    """``DerivedObservation`` for a vector environment, in every mode of autoreset."""

    def __init__(self, env: VectorEnv[Observations, Actions, NDArray[Any]]) -> None:
        super().__init__(env)
        self._models = PointsOfEnvs(env, env.num_envs, "a derived observation")
        self.single_observation_space = with_entries(env.single_observation_space)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        observations, infos = self.env.reset(seed=seed, options=options)
        self._models.follow(infos)
        return with_derived(self._models, observations), infos

    def step(self, actions: Actions) -> tuple[Observations, Any, Any, Any, dict[str, Any]]:
        observations, rewards, terminated, truncated, infos = self.env.step(actions)
        if "final_obs" in infos:
            # The last observations of episodes are of the jobs before, the others of the next ones.
            ended = terminated | truncated
            last = with_derived(self._models, at_end(observations, infos, ended))
            infos = with_final(infos, ended, last)
        self._models.follow(infos)
        return with_derived(self._models, observations), rewards, terminated, truncated, infos
