"""The feed switch of a machine's panel: 16 grades of feed override instead of a continuous one.

A unit outside the machine's control sets the override through the panel's switch, whose position is a four-bit code (servo
current paper, section 5.2).
"""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Discrete
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorActionWrapper, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from turning_env.scenario import Scenario

FEED_GRADES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.5, 1.5)
"""Feed override at each position of the switch [-], as on a common control; the last two are equal."""

Float32s = NDArray[np.float32]


class FeedSwitch(gymnasium.ActionWrapper[Float32s, np.int64, Float32s], RecordConstructorArgs):
    """A wrapper that sets the feed override by a switch of 16 grades: `Discrete(16)` replaces `Box(-1, 1, (1,))`.

    Grades 0 to 13 are 0, 10, ..., 130 % of the programmed feed; 14 and 15 are both 150 %. Overrides are clipped to the
    scenario's `control.override_max`.

        FeedSwitch(gymnasium.make("RoughTurning-Override-v0"))

    Args:
        env: a RoughTurning environment whose only action is a feed override.

    Raises:
        ValueError: `env` is another environment; or `step` gets an action that is not a whole number from 0 to 15.
    """

    def __init__(self, env: gymnasium.Env[Float32s, Float32s]) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.ActionWrapper.__init__(self, env)
        self._actions = _override_actions(getattr(env.unwrapped, "scenario", None))
        self.action_space = Discrete(len(FEED_GRADES))

    def action(self, action: np.int64) -> Float32s:
        """Return the override action of a grade, shape (1,)."""
        if not self.action_space.contains(action):
            raise ValueError(f"a grade must be a whole number, 0 to {len(FEED_GRADES) - 1}, got {action!r}")
        return np.array(self._actions[int(action)])


class VectorFeedSwitch(VectorActionWrapper):  # not subscripted: it is generic only from Gymnasium 1.4 on
    """``FeedSwitch`` for many environments at once; actions are grades of shape (num_envs,).

    Args:
        env: a RoughTurning vector environment whose only action is a feed override.

    Raises:
        ValueError: `env` is another environment; or `step` gets actions that are not num_envs whole numbers from 0 to 15.
    """

    def __init__(self, env: VectorEnv[Float32s, Float32s, NDArray[Any]]) -> None:
        super().__init__(env)
        self._actions = _override_actions(getattr(env.unwrapped, "scenario", None))
        self.single_action_space = Discrete(len(FEED_GRADES))
        self.action_space = batch_space(self.single_action_space, env.num_envs)

    def actions(self, actions: NDArray[np.int64]) -> Float32s:
        """Return the override actions of grades, shape (num_envs, 1)."""
        grades = np.asarray(actions)
        right = grades.shape == (self.num_envs,) and np.issubdtype(grades.dtype, np.integer)
        if not right or grades.min() < 0 or grades.max() >= len(FEED_GRADES):
            raise ValueError(f"grades must be {self.num_envs} whole numbers, 0 to {len(FEED_GRADES) - 1}, got {actions!r}")
        return self._actions[grades]


def _override_actions(scenario: Scenario | None) -> Float32s:
    """Return the override action of each grade, shape (16, 1)."""
    if not isinstance(scenario, Scenario):
        raise ValueError("a feed switch needs a RoughTurning environment")
    control = scenario.control
    if control.action != "override" or control.edge_changes == "commanded":
        raise ValueError(
            f'a feed switch needs control.action "override" and no edge changes on command, but in scenario '
            f"{scenario.name!r} they are {control.action!r} and {control.edge_changes!r}"
        )
    overrides = np.minimum(FEED_GRADES, control.override_max)
    return (2.0 * overrides / control.override_max - 1.0).astype(np.float32)[:, np.newaxis]
