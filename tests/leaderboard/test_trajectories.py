"""Thinning of long episodes, and the content of a file of trajectories."""

import numpy as np

from leaderboard.trajectories import MAX_STEPS, SERIES, steps_to_keep
from turning_env import Scenario


def test_thinning_loses_no_overload_and_prefers_metal() -> None:
    scenario, count = Scenario(), 5000
    trajectory = {name: np.ones(count) for name in ("minutes", *SERIES)}
    trajectory["depth_of_cut"][::7] = 0.0
    trajectory["thrust_force"][::7] = 0.0
    trajectory["power"][1234] = 2.0 * scenario.limits.power
    trajectory["thrust_force"][4321] = 2.0 * scenario.limits.thrust_force
    trajectory["depth_of_cut"][2000:2100] = 0.0
    steps = steps_to_keep(trajectory, scenario)
    assert len(steps) <= MAX_STEPS
    assert (np.diff(steps) > 0).all()
    assert {1234, 4321, count - 1} <= set(steps.tolist())
    in_air = steps[trajectory["depth_of_cut"][steps] == 0.0]
    assert ((in_air >= 2000) & (in_air < 2100)).all()
    assert in_air.size
