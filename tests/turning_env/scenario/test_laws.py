"""The laws of a cut, by numbers worked by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.turning_env.playing import changed
from turning_env import PowerLaw, Scenario
from turning_env.physics.machinability import log_wear_coefficient
from turning_env.physics.records import parameter_records
from turning_env.physics.spindle import capacity, idle_power
from turning_env.physics.wear import life_share, log_wear
from turning_env.scenario.laws import (
    Loads,
    capacity_at,
    chatter_cutting_speed,
    cutting_power_limit,
    depth_spread,
    edge_price,
    feed_at_limit,
    hardness_spread,
    idle_power_at,
    life_rate,
    load_shares,
    load_spread,
    loads_at,
    machining_cost,
    power_capacity,
    removal_rate_at,
    used_life_at,
    wear_at,
)
from turning_env.scenario.scenario_batch import ScenarioBatch

# A bar of 100 mm diameter turns at 1000 rev/min with a cutting speed of 100 pi m/min.
SPEED = 100.0 * np.pi
LATHE = Scenario.load(
    {
        "base": "rough_turning",
        "name": "by_hand",
        "spindle": {"base_speed": 2000.0, "max_speed": 4000.0, "idle_torque": 10.0},
        "machine": {"chatter": 0.5, "chatter_speed": 1000.0},
        "limits": {"power": 5.0},
        "workpiece": {
            "diameter": 100.0,
            "depth_of_cut": 2.5,
            "depth_bar_spread": 0.3,
            "depth_along_spread": 0.4,
            "hardness_bar_spread": 0.06,
            "hardness_along_spread": 0.08,
        },
        "economics": {"edge_cost": 3.0, "edge_change_time": 0.5},
    }
)
WEAR = PowerLaw(coefficient=0.05, time=0.5)  # [mm]


def test_metal_is_removed_at_speed_times_feed_times_depth() -> None:
    # 100 m/min * 0.2 mm * 3 mm = 60 cm3/min
    assert removal_rate_at(100.0, 0.2, 3.0) == pytest.approx(60.0)


def test_a_spindle_below_its_base_speed_has_a_share_of_its_power() -> None:
    assert capacity_at(LATHE, SPEED) == pytest.approx(0.5)
    assert capacity_at(LATHE, 4.0 * SPEED) == 1.0


def test_spindles_without_a_base_speed_have_all_their_power() -> None:
    np.testing.assert_allclose(power_capacity(25.0, np.array([50.0, 0.0])), [0.5, 1.0])


def test_capacity_is_computed_for_many_scenarios_at_once() -> None:
    without = changed(LATHE, spindle={"base_speed": 0.0})
    batch = ScenarioBatch.of([LATHE, without])
    np.testing.assert_allclose(capacity_at(batch, SPEED), [0.5, 1.0])


def test_an_idling_spindle_takes_torque_times_angular_velocity() -> None:
    # 10 N m * 2 pi * 1000 / 60 s = 1047 W
    assert idle_power_at(LATHE, SPEED) == pytest.approx(1.047198, rel=1e-6)


def test_power_for_the_cut_is_the_available_power_less_idling() -> None:
    # 5 kW * 0.5 - 1.047 kW
    assert cutting_power_limit(LATHE, SPEED) == pytest.approx(1.452802, rel=1e-6)
    assert cutting_power_limit(LATHE, SPEED, tolerated=1.2) == pytest.approx(1.952802, rel=1e-6)


def test_the_power_of_a_cut_includes_idling() -> None:
    # Without exponents, every cut has 300 N and 2 kW.
    constant = {"feed": 0.0, "cutting_speed": 0.0, "depth_of_cut": 0.0, "wear": 0.0}
    material = {
        "thrust_force": constant | {"coefficient": 300.0, "hardness": 0.0},
        "power": constant | {"coefficient": 2.0, "hardness": 1.0},
    }
    loads = loads_at(changed(LATHE, material=material), SPEED, 0.2, 2.5, wear=0.1, hardness=1.5)
    assert loads.thrust_force == pytest.approx(300.0)
    # 2 kW * 1.5 + 1.047 kW
    assert loads.power == pytest.approx(4.047198, rel=1e-6)


def test_loads_are_compared_with_limits_and_the_higher_share_decides() -> None:
    limits = SimpleNamespace(thrust_force=600.0, power=5.0)
    shares = load_shares(Loads(thrust_force=300.0, power=3.0), limits, capacity=0.8)
    assert shares.thrust_force == pytest.approx(0.5)
    assert shares.power == pytest.approx(0.75)
    assert shares.highest == pytest.approx(0.75)


def test_the_feed_at_a_limit_inverts_the_law() -> None:
    law = PowerLaw(coefficient=1000.0, feed=0.5)
    feed = feed_at_limit(law, 500.0, law(100.0, 1.0, 2.5))
    assert feed == pytest.approx(0.25)
    assert law(100.0, feed, 2.5) == pytest.approx(500.0)


def test_no_feed_reaches_a_limit_of_a_load_that_does_not_grow_with_it() -> None:
    assert feed_at_limit(PowerLaw(coefficient=1000.0), 500.0, 1000.0) == np.inf


def test_spreads_of_bars_and_along_them_add_as_variances() -> None:
    work = LATHE.workpiece
    assert depth_spread(work) == pytest.approx(0.5)
    assert hardness_spread(work) == pytest.approx(0.1)
    # Depth varies by 0.5 / 2.5 = 0.2: sqrt((1 * 0.2)^2 + (2 * 0.1)^2) = 0.2 sqrt(2)
    law = PowerLaw(coefficient=1.0, depth_of_cut=1.0, hardness=2.0)
    assert load_spread(law, work) == pytest.approx(0.2 * np.sqrt(2.0))


def test_bars_chatter_at_the_cutting_speed_of_their_spindle_speed() -> None:
    assert chatter_cutting_speed(LATHE) == pytest.approx(SPEED)


def test_an_edge_lives_until_its_wear_reaches_the_criterion() -> None:
    # 0.05 sqrt(t) = 0.2 mm at t = 16 min
    assert life_rate(WEAR, 0.2, 100.0, 0.2, 2.5) == pytest.approx(1.0 / 16.0)


def test_a_harder_bar_shortens_the_life() -> None:
    # 0.05 * 2 sqrt(t) = 0.2 mm at t = 4 min
    law = PowerLaw(coefficient=0.05, time=0.5, hardness=1.0)
    assert life_rate(law, 0.2, 100.0, 0.2, 2.5, hardness=2.0) == pytest.approx(0.25)


def test_wear_is_the_criterion_times_a_power_of_the_used_life() -> None:
    scenario = SimpleNamespace(
        tool=SimpleNamespace(wear_criterion=0.4), material=SimpleNamespace(wear=WEAR)
    )
    assert wear_at(scenario, 0.25) == pytest.approx(0.2)
    assert used_life_at(scenario, 0.2) == pytest.approx(0.25)
    assert used_life_at(scenario, 0.0) == 0.0


def test_the_transition_has_the_same_laws() -> None:
    scenario = Scenario.load("rough_turning")
    p = parameter_records(scenario)[0]
    speed, feed, depth = 150.0, 0.3, scenario.workpiece.depth_of_cut
    log_coefficient = log_wear_coefficient(p, 0, np.log(speed), np.log(feed), np.log(depth), 0.0)
    criterion = scenario.tool.wear_criterion
    rate = life_rate(scenario.material.wear, criterion, speed, feed, depth)
    assert life_share(p, 0, log_coefficient, 2.0) == pytest.approx(2.0 * rate, rel=1e-12)
    assert np.exp(log_wear(p, 0, 0.3)) == pytest.approx(wear_at(scenario, 0.3), rel=1e-12)

    slow = parameter_records(LATHE)[0]
    for tried in (SPEED, 4.0 * SPEED):
        assert capacity(slow, 0, tried) == pytest.approx(capacity_at(LATHE, tried), rel=1e-12)
        assert idle_power(slow, 0, tried) == pytest.approx(idle_power_at(LATHE, tried), rel=1e-12)


def test_a_cut_costs_its_time_and_the_edges_that_it_uses() -> None:
    assert edge_price(LATHE) == pytest.approx(3.5)
    # 2 min + 0.4 edges * 3.5 min
    assert machining_cost(2.0, 0.4, edge_price(LATHE)) == pytest.approx(3.4)
