"""Thinning of long episodes."""

import numpy as np
import pytest

from leaderboard.trajectories import MAX_STEPS, SERIES, steps_to_keep
from turning_env import Scenario

COUNT = 5000
OVERLOAD_OF_POWER = 1234
OVERLOAD_OF_FORCE = 4321
GAP = range(2000, 2100)  # steps in air one after the other


@pytest.fixture(scope="module")
def trajectory() -> dict[str, np.ndarray]:
    """A long episode with every seventh step in air, a gap, and two overloads of one step each."""
    limits = Scenario().limits
    trajectory = {name: np.ones(COUNT) for name in ("minutes", *SERIES)}
    trajectory["depth_of_cut"][::7] = 0.0
    trajectory["thrust_force"][::7] = 0.0
    trajectory["depth_of_cut"][GAP.start : GAP.stop] = 0.0
    trajectory["power"][OVERLOAD_OF_POWER] = 2.0 * limits.power
    trajectory["thrust_force"][OVERLOAD_OF_FORCE] = 2.0 * limits.thrust_force
    return trajectory


def test_a_thinned_trajectory_is_short_and_in_order(trajectory: dict[str, np.ndarray]) -> None:
    steps = steps_to_keep(trajectory, Scenario())
    assert len(steps) <= MAX_STEPS
    assert (np.diff(steps) > 0).all()
    assert steps[-1] == COUNT - 1


def test_no_overload_is_lost(trajectory: dict[str, np.ndarray]) -> None:
    steps = steps_to_keep(trajectory, Scenario())
    assert OVERLOAD_OF_POWER in steps
    assert OVERLOAD_OF_FORCE in steps


def test_steps_in_air_are_kept_only_where_there_is_no_metal(
    trajectory: dict[str, np.ndarray],
) -> None:
    steps = steps_to_keep(trajectory, Scenario())
    in_air = steps[trajectory["depth_of_cut"][steps] == 0.0]
    assert in_air.size
    assert set(in_air.tolist()) <= set(GAP)


def test_a_short_trajectory_is_kept_whole() -> None:
    short = {name: np.ones(MAX_STEPS) for name in ("minutes", *SERIES)}
    assert steps_to_keep(short, Scenario()).tolist() == list(range(MAX_STEPS))
