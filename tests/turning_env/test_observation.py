"""Observations, and readings recovered from them."""

import numpy as np
import pytest

from tests.turning_env.playing import changed, fixed_actions, play
from turning_env import RoughTurningEnv, Scenario, read
from turning_env.physics.quantities import OBS, layout

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


def test_the_hidden_state_is_observed_if_asked_for():
    scenario = changed(Scenario(), sensors={"observes_all": True})
    actions = fixed_actions(100, 1)[:, 0]
    record = play(RoughTurningEnv(scenario), 4, actions)
    plain_record = play(RoughTurningEnv(), 4, actions)
    columns = record["observation"].astype(float).T
    shown = dict(zip(layout(scenario), columns, strict=True))
    # The twin is the same lathe.
    assert np.array_equal(record["observation"][:, :11], plain_record["observation"])
    in_metal = record["cutting"]
    assert 0 < in_metal.sum() < len(in_metal)
    assert not shown["hardness"][~in_metal].any()
    assert not shown["depth_of_cut"][~in_metal].any()
    depth_ratio = record["depth_of_cut"] / scenario.workpiece.depth_of_cut
    assert shown["hardness"][in_metal] == pytest.approx(
        5 * (record["hardness"] - 1)[in_metal], abs=1e-5
    )
    assert shown["depth_of_cut"][in_metal] == pytest.approx(
        5 * (depth_ratio - 1)[in_metal], abs=1e-5
    )
    assert shown["wear"] == pytest.approx(record["wear"] / scenario.tool.wear_criterion, abs=1e-6)
    assert shown["wear_factor"] == pytest.approx(5 * (record["wear_factor"] - 1), abs=1e-5)
    strength_ratio = record["edge_strength"] / scenario.limits.thrust_force
    assert shown["edge_strength"] == pytest.approx(5 * (strength_ratio - 1), abs=1e-5)
