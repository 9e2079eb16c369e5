"""Numbers of inputs per property, seeds and actions to try, and the checks of every step."""

from typing import Any

import numpy as np
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from turning_env import RoughTurningEnv, Scenario
from turning_env.physics.quantities import action_size

SEEDS = st.sampled_from((0, 2**64 - 1)) | st.integers(0, 2**64 - 1)
NUMBERS = st.sampled_from((-1.0, 0.0, 1.0, 1e300, -1e300, 5e-324)) | st.floats(-1.5, 1.5)
"""Numbers of an action, also such as are clipped."""


def action(scenario: Scenario) -> st.SearchStrategy[NDArray[np.float64]]:
    """Return actions of one environment."""
    size = action_size(scenario)
    return st.lists(NUMBERS, min_size=size, max_size=size).map(np.array)


def assert_sound(
    env: RoughTurningEnv, observation: Any, reward: float, info: dict[str, Any]
) -> None:
    """Assert that nothing is NaN or infinite, and that the observation lies in its space."""
    assert env.observation_space.contains(observation), observation
    assert np.isfinite(reward), reward
    unsound = {name: value for name, value in info.items() if not np.isfinite(value)}
    assert not unsound


def tried(short: int, soak: int) -> Any:
    """Return settings for a property: ``short`` inputs in the suite, ``soak`` in a soak.

    A soak sets ``HYPOTHESIS_PROFILE`` to ``soak``.

    A file in pytest's ``tmp_path`` is written anew for every input, so the folder may be shared.
    """
    soaking = settings.get_current_profile_name() == "soak"
    return settings(
        max_examples=soak if soaking else short,
        suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
    )
