"""Actions to try, and what must hold of everything that an environment tells."""

from typing import Any

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

from turning_env import RoughTurningEnv, Scenario
from turning_env.physics.records import action_size

SEEDS = st.sampled_from((0, 2**64 - 1)) | st.integers(0, 2**64 - 1)
NUMBERS = st.sampled_from((-1.0, 0.0, 1.0, 1e300, -1e300, 5e-324)) | st.floats(-1.5, 1.5)
"""Numbers of an action, also such as are clipped."""


def action(scenario: Scenario) -> st.SearchStrategy[NDArray[np.float64]]:
    """Actions of one lane."""
    size = action_size(scenario)
    return st.lists(NUMBERS, min_size=size, max_size=size).map(np.array)


def assert_sound(env: RoughTurningEnv, observation: Any, reward: float, info: dict[str, Any]) -> None:
    """Nothing is NaN or infinite, and the observation lies in its space."""
    assert env.observation_space.contains(observation), observation
    assert np.isfinite(reward), reward
    unsound = {name: value for name, value in info.items() if not np.isfinite(value)}
    assert not unsound
