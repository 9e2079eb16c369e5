"""Observations, and readings recovered from them."""

import numpy as np
import pytest

from tests.turning_env.playing import changed, fixed_actions, play
from turning_env import RoughTurningEnv, Scenario, read
from turning_env.physics.quantities import OBS

SPREADS = (
    "hardness_bar_spread",
    "hardness_along_spread",
    "depth_bar_spread",
    "depth_along_spread",
)


def test_reading_turns_observations_back_into_physical_units():
    record = play(RoughTurningEnv(), 3, fixed_actions(300, 1)[:, 0])
    reading = read(record["observation"], Scenario())
    for name in (
        "cutting_speed",
        "feed",
        "commanded_cutting_speed",
        "commanded_feed",
        "cutting_time",
    ):
        assert getattr(reading, name) == pytest.approx(record[name], rel=1e-5, abs=1e-5), name
    measured_force = record["measured_thrust_force"]
    assert reading.power == pytest.approx(record["measured_power"], rel=1e-5, abs=1e-5)
    assert reading.thrust_force == pytest.approx(measured_force, rel=1e-5, abs=1e-3)
    assert np.array_equal(reading.cutting, record["cutting"])


def test_true_wear_hardness_and_depth_show_in_power_and_force_alone():
    varied = changed(Scenario(), tool={"edge_strength": 1e6, "wear_criterion": 5})
    uniform = changed(varied, tool={"wear_factor_spread": 0}, workpiece=dict.fromkeys(SPREADS, 0))
    actions = fixed_actions(100, 1)[:, 0]
    record = play(RoughTurningEnv(varied), 4, actions)
    uniform_record = play(RoughTurningEnv(uniform), 4, actions)
    assert record["wear"][-1] != pytest.approx(uniform_record["wear"][-1], rel=0.01)
    differing = (record["observation"] != uniform_record["observation"]).any(axis=0)
    assert np.flatnonzero(differing).tolist() == [
        OBS.power,
        OBS.thrust_force,
        OBS.power_ratio,
        OBS.force_ratio,
    ]
