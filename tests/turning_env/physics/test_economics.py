"""The terms of the reward, worked out by hand."""

import pytest

from tests.turning_env.playing import UNDISTURBED, changed, infos

ACTION = [(0.0, 0.0)]
PRICES = {
    "reference_removal_rate": 100,
    "edge_cost": 4,
    "edge_change_time": 2,
    "breakage_downtime": 7,
    "overload_price": 5,
}
SCENARIO = changed(UNDISTURBED, economics=PRICES, limits={"thrust_force": 1e6, "power": 1e4})


def test_metal_time_and_edge():
    info = infos(SCENARIO, ACTION)[0]  # one minute at 125 m/min, 0.33 mm/rev, 2.5 mm
    assert info["removed"] == pytest.approx(125 * 0.33 * 2.5)
    assert info["reward_metal"] == pytest.approx(60 * info["removed"] / 100)
    assert info["reward_time"] == pytest.approx(-60)
    assert info["reward_edge"] == pytest.approx(-60 * (4 + 2) * info["used_life"])
    assert (info["cost"], info["reward_overload"], info["reward_breakage"]) == (0, 0, 0)


def test_overload_is_the_excess_over_each_limit():
    one_step = changed(SCENARIO, control={"sub_steps": 1, "interval": 30})
    at_work = infos(one_step, ACTION)[0]
    limits = {"thrust_force": at_work["thrust_force"] / 1.25, "power": at_work["power"] / 1.5}
    info = infos(changed(one_step, limits=limits), ACTION)[0]
    assert (info["cost_force"], info["cost_power"]) == (pytest.approx(0.25), pytest.approx(0.5))
    assert info["reward_overload"] == pytest.approx(-5 * 30 * (0.25 + 0.5))
    assert info["overload_time"] == info["severe_overload_time"] == pytest.approx(30)
    tolerated = infos(changed(one_step, limits=limits | {"overload_tolerance": 0.6}), ACTION)[0]
    assert (tolerated["overload_time"], tolerated["severe_overload_time"]) == (pytest.approx(30), 0)


def test_a_broken_edge_pays_what_is_left_and_the_downtime():
    info = infos(changed(SCENARIO, tool={"edge_strength": 100}), ACTION)[0]
    assert info["broken"]
    assert info["thrust_force"] > info["edge_strength"]
    assert info["reward_breakage"] == pytest.approx(
        -60 * (4 + 2) * (1 - info["used_life"]) - 60 * 7
    )
