"""A load target as the action, held by a proportional feed loop.

    env = LoadTargetAction(gymnasium.make("RoughTurning-Family-v1"))
    envs = VectorLoadTargetAction(gymnasium.make_vec("RoughTurning-Family-v1", 512))
    venv = RoughTurningVecEnv("shop", 512, wrapper=VectorLoadTargetAction)  # Stable-Baselines3

A policy chooses how hard to cut, and the loop of ``models/feed_loop.py`` finds the feed for it in
every step. An action is a number a of -1 to 1 for each line:

    load target     T = exp(-0.15 + 0.40 a): load over the limit that holds at the speed
    cutting speed   V = V_nominal exp(-0.20 + 0.50 a)
    change of edge  at a nominal wear of 0.80 + 0.60 a over the criterion

The last is there only if edges are changed on command. The loop sets the feed f by the measured
loads L over their limits and the nominal laws' exponents b of feed:

    log f_command = log f + g min((log T - log L_power) / b_power, (log T - log L_force) / b_force)

with g = 0.35 upwards and 0.70 downwards, within the chip breaker's window. In air, the commanded
feed stays. The commands are reached as fast as one action allows.

The wrapper uses the best cutting speed on a half-worn edge V_nominal, the exponents, the window and
the base speed of the nominal model. A family's context holds all of them; if it is hidden, they are
further information.
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from baselines.models.feed_loop import (
    feed_gaps,
    held_in_air,
    log_feed_towards,
    shares_of,
    within_window,
)
from baselines.models.nominal_points import PointsOfEnvs, PointsOfModels
from turning_env import Scenario
from turning_env.action import sets_speed_and_feed, towards
from turning_env.numerics.functions import exp
from turning_env.policy import Actions, Observations

# Middle and half width of what an action of -1 to 1 means. They contain the best constants on
# training jobs of the family ``shop``.
LOG_TARGET = (-0.15, 0.40)
LOG_SPEED = (-0.20, 0.50)  # over the nominal optimum
CHANGE_WEAR = (0.80, 0.60)  # nominal wear over the criterion

GAIN_UP = 0.35  # share of the way to the target feed in a step, if the feed rises [-]
GAIN_DOWN = 0.70  # likewise if it falls


def action_names(scenario: Scenario) -> tuple[str, ...]:
    """Return the names of the numbers of an action, in order.

    Raise ValueError if the scenario's own actions do not set speed and feed.
    """
    if not sets_speed_and_feed(scenario):
        raise ValueError(
            "a load target needs actions that set cutting speed and feed, "
            f"but scenario {scenario.name!r} has control.action {scenario.control.action!r}"
        )
    names: tuple[str, ...] = ("load_target", "cutting_speed")
    if scenario.control.edge_changes == "commanded":
        names += ("change_wear",)
    return names


def space_of(scenario: Scenario) -> Any:
    """Return a new space of one environment's load targets; ValueError as ``action_names``."""
    return Box(-1.0, 1.0, shape=(len(action_names(scenario)),), dtype=np.float32)


def own_actions(models: PointsOfModels, load_targets: Any, observations: Observations) -> Actions:
    """Return the environments' own actions for load targets; shape (num_envs, 2 or 3) of both.

    Raise ValueError if the load targets are not finite, or have another shape.
    """
    scenario = models.scenario
    changes_edges = scenario.control.edge_changes == "commanded"
    given = np.asarray(load_targets, np.float64)
    shape = (len(observations), 3 if changes_edges else 2)
    if given.shape != shape or not np.isfinite(given).all():
        raise ValueError(f"load targets must be finite, of shape {shape}, got {load_targets!r}")
    columns = np.clip(given, -1.0, 1.0).T
    points = models.points
    reading = models.read(observations)

    log_target = _value(columns[0], LOG_TARGET)
    log_speed = points.log_speed + _value(columns[1], LOG_SPEED)
    gap = feed_gaps(shares_of(reading, scenario), points, log_target).least
    log_feed = log_feed_towards(reading, gap, GAIN_UP, GAIN_DOWN)
    log_feed = within_window(held_in_air(reading, log_feed), points)
    change_edge = None
    if changes_edges:
        change_at = _value(columns[2], CHANGE_WEAR) * scenario.tool.wear_criterion
        change_edge = reading.nominal_wear > change_at
    return towards(
        reading,
        scenario,
        cutting_speed=exp(log_speed),
        feed=exp(log_feed),
        change_edge=change_edge,
    )


class _Loops:
    """The feed loops of the environments of a wrapper."""

    def __init__(self, env: Any, num_envs: int) -> None:
        self._models = PointsOfEnvs(env, num_envs, "a load target")
        self.space = space_of(env.unwrapped.scenario)
        self._observations: Observations = np.zeros((num_envs, 0), np.float32)

    def observe(self, observations: Observations, infos: dict[str, Any]) -> None:
        """Take what a reset or a step has returned."""
        self._models.follow(infos)
        self._observations = observations

    def actions(self, load_targets: Any) -> Actions:
        """Return the environments' own actions; ValueError as ``own_actions``."""
        return own_actions(self._models, load_targets, self._observations)


def _value(action: NDArray[np.float64], range_of: tuple[float, float]) -> NDArray[np.float64]:
    """Return what actions of -1 to 1 mean."""
    middle, half_width = range_of
    return middle + half_width * action


class LoadTargetAction(
    gymnasium.Wrapper[Observations, Actions, Observations, Actions], RecordConstructorArgs
):
    """A wrapper whose actions are a load target, a speed, and a wear at which to change the edge.

    Wrappers of observations may be below it if they leave the environment's entries first.

    Raises:
        ValueError: the environment's actions do not set cutting speed and feed, or it is none of
            RoughTurning.
    """

    def __init__(self, env: gymnasium.Env[Observations, Actions]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.Wrapper.__init__(self, env)
        self._loops = _Loops(env, 1)
        self.action_space = self._loops.space

    def reset(self, **options: Any) -> tuple[Observations, dict[str, Any]]:
        observation, info = self.env.reset(**options)
        self._loops.observe(observation[np.newaxis], info)
        return observation, info

    def step(self, action: Actions) -> tuple[Observations, Any, bool, bool, dict[str, Any]]:
        (own_action,) = self._loops.actions(np.asarray(action)[np.newaxis])
        observation, reward, terminated, truncated, info = self.env.step(own_action)
        self._loops.observe(observation[np.newaxis], info)
        return observation, reward, terminated, truncated, info


# Not subscripted: VectorWrapper is generic only from Gymnasium 1.4 on.
class VectorLoadTargetAction(VectorWrapper):
    """``LoadTargetAction`` for a vector environment, in every mode of autoreset."""

    def __init__(self, env: VectorEnv[Observations, Actions, NDArray[Any]]) -> None:
        super().__init__(env)
        self._loops = _Loops(env, env.num_envs)
        self.single_action_space = self._loops.space
        self.action_space = batch_space(self.single_action_space, env.num_envs)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        observations, infos = self.env.reset(seed=seed, options=options)
        self._loops.observe(observations, infos)
        return observations, infos

    def step(self, actions: Actions) -> tuple[Observations, Any, Any, Any, dict[str, Any]]:
        result = self.env.step(self._loops.actions(actions))
        observations, *_, infos = result
        self._loops.observe(observations, infos)
        return result
