"""The terms of the reward, worked out by hand."""

import pytest

from tests.turning_env.playing import UNDISTURBED, changed, infos

ACTION = [(0.0, 0.0)]
EDGE_PRICE = 60 * (4 + 2)
SCENARIO = changed(
    UNDISTURBED,
    economics={
        "reference_removal_rate": 100,
        "edge_cost": 4,
        "edge_change_time": 2,
        "breakage_downtime": 7,
        "overload_price": 5,
    },
    limits={"thrust_force": 1e6, "power": 1e4},
)


def test_metal_time_and_edge():
    """One minute at 125 m/min, 0.33 mm/rev and 2.5 mm."""
    (info,) = infos(SCENARIO, ACTION)
    removed = 125 * 0.33 * 2.5
    edge_price = EDGE_PRICE * info["used_life"]
    assert info["removed"] == pytest.approx(removed)
    assert info["reward_metal"] == pytest.approx(60 * info["removed"] / 100)
    assert info["reward_time"] == pytest.approx(-60)
    assert info["reward_edge"] == pytest.approx(-edge_price)
    assert info["excess"] == 0
    assert info["reward_overload"] == 0
    assert info["reward_breakage"] == 0


def test_overload_is_the_excess_over_each_limit():
    single_sub_step = changed(SCENARIO, control={"sub_steps": 1, "interval": 30})
    (free,) = infos(single_sub_step, ACTION)
    limits = {"thrust_force": free["thrust_force"] / 1.25, "power": free["power"] / 1.5}
    (info,) = infos(changed(single_sub_step, limits=limits), ACTION)
    overload_price = 5 * 30 * (0.25 + 0.5)
    assert info["excess_force"] == pytest.approx(0.25)
    assert info["excess_power"] == pytest.approx(0.5)
    assert info["reward_overload"] == pytest.approx(-overload_price)
    assert info["overload_time"] == pytest.approx(30)
    assert info["severe_overload_time"] == pytest.approx(30)


def test_overload_within_the_tolerance_is_not_severe():
    (free,) = infos(SCENARIO, ACTION)
    limits = {"power": free["power"] / 1.5, "overload_tolerance": 0.6}
    (info,) = infos(changed(SCENARIO, limits=limits), ACTION)
    assert info["overload_time"] == pytest.approx(60)
    assert info["severe_overload_time"] == 0


def test_a_broken_edge_pays_the_remaining_life_and_the_downtime():
    (info,) = infos(changed(SCENARIO, tool={"edge_strength": 100}), ACTION)
    remaining_life = 1 - info["used_life"]
    downtime = 60 * 7
    assert info["broken"]
    assert info["thrust_force"] > info["edge_strength"]
    assert info["reward_breakage"] == pytest.approx(-EDGE_PRICE * remaining_life - downtime)
