"""Observations, and readings recovered from them."""

import numpy as np
import pytest

from tests.turning_env.playing import changed, fixed_actions, play
from turning_env import RoughTurningEnv, Scenario, read
from turning_env.physics.quantities import OBS


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
    assert reading.power == pytest.approx(record["measured_power"], rel=1e-5, abs=1e-5)
    assert reading.thrust_force == pytest.approx(
        record["measured_thrust_force"], rel=1e-5, abs=1e-3
    )
    assert np.array_equal(reading.cutting, record["cutting"])


def test_true_wear_hardness_and_depth_show_in_power_and_force_alone():
    tough = changed(Scenario(), tool={"edge_strength": 1e6, "wear_criterion": 5})
    names = (
        "hardness_bar_spread",
        "hardness_along_spread",
        "depth_bar_spread",
        "depth_along_spread",
    )
    uniform = changed(tough, tool={"wear_factor_spread": 0}, workpiece=dict.fromkeys(names, 0))
    records = [
        play(RoughTurningEnv(scenario), 4, fixed_actions(100, 1)[:, 0])
        for scenario in (tough, uniform)
    ]
    assert records[0]["wear"][-1] != pytest.approx(records[1]["wear"][-1], rel=0.01)
    differing = (records[0]["observation"] != records[1]["observation"]).any(axis=0)
    assert np.flatnonzero(differing).tolist() == [
        OBS.power,
        OBS.thrust_force,
        OBS.power_ratio,
        OBS.force_ratio,
    ]
