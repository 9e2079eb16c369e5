"""Power laws and their limits by hand, and the cost of metal against SciPy's minimum."""

import math
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from baselines.models.process import (
    ALIKE,
    MAX_LIFE,
    MIN_LIFE,
    Limit,
    LimitLine,
    Process,
    Scales,
    torque_limit,
)
from tests.turning_env.playing import changed
from turning_env import PowerLaw, Scenario

LAW = PowerLaw(
    coefficient=3.0,
    cutting_speed=0.5,
    feed=2.0,
    depth_of_cut=1.0,
    reference_depth_of_cut=1.0,
    time=0.25,
    wear=3.0,
    hardness=-1.0,
)


def number(value: Any) -> float:
    return float(np.asarray(value).item())


def test_a_line_gives_the_highest_feed_and_speed() -> None:
    line = LimitLine(cutting_speed=0.5, feed=2.0, room=np.array(5.0))
    assert number(line.highest_feed(np.array(2.0))) == pytest.approx((5.0 - 1.0) / 2.0)
    assert number(line.highest_cutting_speed(np.array(2.0))) == pytest.approx((5.0 - 4.0) / 0.5)


@pytest.mark.parametrize("exponent", [0.0, -1.0])
def test_a_limit_that_no_feed_reaches_has_no_highest_feed(exponent: float) -> None:
    line = LimitLine(cutting_speed=0.5, feed=exponent, room=np.array(5.0))
    assert number(line.highest_feed(np.array(2.0))) == math.inf
    speed = LimitLine(cutting_speed=exponent, feed=0.5, room=np.array(5.0))
    assert number(speed.highest_cutting_speed(np.array(2.0))) == math.inf


def test_lines_cross_where_both_limits_are_reached() -> None:
    # 2 x + y = 7 and 5 x + 3 y = 19 meet at (2, 3).
    first = LimitLine(cutting_speed=2.0, feed=1.0, room=np.array(7.0))
    second = LimitLine(cutting_speed=5.0, feed=3.0, room=np.array(19.0))
    speed, feed = first.crossing(second)
    assert (number(speed), number(feed)) == pytest.approx((2.0, 3.0))


def test_a_limit_leaves_room_by_its_law() -> None:
    line = Limit(LAW, 48.0, time=16.0).line(depth_of_cut=2.0, hardness=0.5, wear=0.5)
    assert (line.cutting_speed, line.feed) == (0.5, 2.0)
    # 3 * 2 * 16^(1/4) * 0.5^3 / 0.5 = 3 at one meter per minute and one millimetre: 48 / 3.
    assert number(line.room) == pytest.approx(math.log(16.0))
    # A fresh edge after one minute, unless another time is given.
    fresh = Limit(LAW, 48.0).line(depth_of_cut=2.0, hardness=1.0, wear=1.0)
    assert number(fresh.room) == pytest.approx(math.log(8.0))


@pytest.mark.parametrize(
    ("exponents", "parallel"),
    [
        pytest.param((1.0, 4.0), True, id="twice the exponents"),
        pytest.param((0.0, 0.0), True, id="none"),
        pytest.param((1.0, 3.9), False, id="others"),
        pytest.param((2.0, 0.5), False, id="exchanged"),
        pytest.param((0.5, 2.0 + 4.0 * ALIKE), False, id="just others"),
        pytest.param((0.5, 2.0 + 1.0 * ALIKE), True, id="alike but for rounding"),
    ],
)
def test_limits_with_proportional_exponents_fix_no_point(
    exponents: tuple[float, float], parallel: bool
) -> None:
    speed, feed = exponents
    other = Limit(LAW.model_copy(update={"cutting_speed": speed, "feed": feed}), 1.0)
    assert Limit(LAW, 1.0).parallel(other) == parallel
    assert other.parallel(Limit(LAW, 1.0)) == parallel


SCENARIO = changed(
    Scenario(),
    material={
        "wear": {
            "coefficient": 0.01,
            "cutting_speed": 0.75,
            "feed": 0.125,
            "depth_of_cut": 0.375,
            "reference_depth_of_cut": 2.5,
            "time": 0.25,
            "hardness": 0.5,
        }
    },
    tool={"wear_criterion": 0.4},
    economics={"edge_cost": 3.0, "edge_change_time": 2.0},
    machine={"cutting_speed_min": 40.0, "cutting_speed_max": 360.0, "feed_min": 0.1},
)


def test_a_process_has_no_speed_that_the_spindle_does_not_reach() -> None:
    """At 600 rev/min a bar of 100 mm moves at 60 pi m/min, less than the machine's 360."""
    slow = changed(SCENARIO, workpiece={"diameter": 100.0}, spindle={"max_speed": 600.0})
    assert Process.of(slow).cutting_speed_range == pytest.approx((40.0, 60.0 * math.pi))


def test_the_process_of_a_scenario_has_its_laws_limits_and_prices() -> None:
    process = Process.of(SCENARIO)
    assert process.wear == SCENARIO.material.wear
    assert process.wear_criterion == 0.4
    assert process.thrust_force.most == SCENARIO.limits.thrust_force
    assert process.power.most == SCENARIO.limits.power
    assert process.power.law == SCENARIO.material.power
    assert process.cutting_speed_range == (40.0, 360.0)
    assert process.feed_range == SCENARIO.feed_range
    assert process.edge_price == 5.0
    assert process.further == {}
    # W = W_max (t / T)^n is W_max / (1 + n) on average.
    assert process.mean_wear == pytest.approx(0.32)
    assert process.life_exponents == pytest.approx((3.0, 0.5, 1.5))


def test_a_limit_of_torque_of_the_scenario_holds() -> None:
    law = {"coefficient": 300.0, "feed": 0.8, "depth_of_cut": 1.0, "most": 200.0}
    process = Process.of(changed(SCENARIO, limits={"torque": law, "roughness": law}))
    assert set(process.further) == {"torque", "roughness"}
    assert process.torque == process.further["torque"]
    assert process.torque.most == 200.0
    assert process.torque.law.coefficient == 300.0


@pytest.mark.parametrize(
    ("base_speed", "full_power_from"),
    [
        # 100 mm at 1000 / pi rev/min; without a base speed the geometric middle of 40 and 360.
        (1000.0 / math.pi, 100.0),
        (0.0, 120.0),
    ],
)
def test_the_limit_of_torque_follows_from_full_power(
    base_speed: float, full_power_from: float
) -> None:
    scenario = changed(
        SCENARIO,
        spindle={"base_speed": base_speed},
        workpiece={"diameter": 100.0},
        limits={"power": 6.0},
    )
    limit = torque_limit(scenario)
    # M = P / omega, with omega = 2 v / d: 6 kW at that speed.
    omega = 2.0 * full_power_from / 60.0 / 0.1  # [rad/s]
    assert limit.most == pytest.approx(6000.0 / omega)
    power = number(scenario.material.power(150.0, 0.3, 2.0, wear=0.2))
    torque = number(limit.law(150.0, 0.3, 2.0, wear=0.2))
    assert torque == pytest.approx(1000.0 * power / (2.0 * 150.0 / 60.0 / 0.1))
    assert Process.of(scenario).torque == limit


def test_scaled_loads_meet_their_limits_earlier() -> None:
    law = {"coefficient": 3.0, "feed": 0.8, "depth_of_cut": 1.0, "most": 200.0}
    limits = dict.fromkeys(("torque", "roughness", "radial_force"), law)
    process = Process.of(changed(SCENARIO, limits=limits))
    scaled = process.rescaled(force_scale=2.0, power_scale=4.0)
    assert scaled.thrust_force.most == SCENARIO.limits.thrust_force / 2.0
    assert scaled.power.most == SCENARIO.limits.power / 4.0
    assert scaled.torque.most == 50.0
    most = {name: limit.most for name, limit in scaled.further.items()}
    assert most == {"torque": 50.0, "roughness": 200.0, "radial_force": 100.0}
    assert scaled.thrust_force.law == process.thrust_force.law


def test_life_and_cost_by_hand() -> None:
    process = Process.of(SCENARIO)
    life = number(process.log_life(math.log(100.0), math.log(0.2), 2.0, 1.2))
    wear = 0.01 * 100.0**0.75 * 0.2**0.125 * (2.0 / 2.5) ** 0.375 * 1.2**0.5
    assert math.exp(life) == pytest.approx((0.4 / wear) ** 4)
    cost = number(process.log_cost(math.log(100.0), math.log(0.2), 2.0, 1.2))
    # (1 + gamma / T) / (V S t), with gamma = 5 min.
    expected = (1.0 + 5.0 / math.exp(life)) / (100.0 * 0.2 * 2.0)
    assert math.exp(cost) == pytest.approx(expected)


@pytest.mark.parametrize("price", [0.0, 0.5])
def test_cheap_edges_cost_their_time_and_free_ones_none(price: float) -> None:
    cheap = changed(SCENARIO, economics={"edge_cost": price, "edge_change_time": 0.0})
    process = Process.of(cheap)
    at = (math.log(200.0), math.log(0.2), 2.0, 1.0)
    life = math.exp(number(process.log_life(*at)))
    assert math.exp(number(process.log_cost(*at))) == pytest.approx((1.0 + price / life) / 80.0)


@pytest.mark.parametrize(
    ("alpha", "beta"),
    [
        pytest.param(1.0, 0.25, id="power"),
        pytest.param(0.25, 1.0, id="force that grows with feed"),
        pytest.param(-0.5, 0.75, id="force that falls with speed"),
    ],
)
def test_along_a_limit_the_cost_is_least_at_the_economic_life(alpha: float, beta: float) -> None:
    """Compared with SciPy's minimum of the cost over the speed, with the feed on the limit."""
    process = Process.of(SCENARIO)
    limit = Limit(LAW.model_copy(update={"cutting_speed": alpha, "feed": beta}), 50.0)
    line = limit.line(2.5, 1.0, 1.0)

    def cost(log_speed: float) -> float:
        log_feed = number(line.highest_feed(np.array(log_speed)))
        return number(process.log_cost(log_speed, log_feed, 2.5, 1.0))

    # mu = 3 and nu = 0.5.
    growth = (0.5 * alpha - 3.0 * beta) / (alpha - beta)
    expected = 5.0 * (growth - 1.0)
    found = process.economic_life(limit)
    if growth < 0.0:
        assert found == math.inf
    else:
        assert found == pytest.approx(max(expected, 0.0))
    if found > 0.0 and math.isfinite(found):
        best = minimize_scalar(cost, bounds=(-5.0, 15.0), method="bounded").x
        feed = number(line.highest_feed(np.array(best)))
        life = number(process.log_life(best, feed, 2.5, 1.0))
        assert math.exp(life) == pytest.approx(found, rel=1e-3)


@pytest.mark.parametrize(
    ("alpha", "beta", "life"),
    [
        # The growth is (0.5 alpha - 3 beta) / (alpha - beta).
        pytest.param(-1.0, 1.0, 3.75, id="growth of 1.75"),
        pytest.param(1.0, 0.1, 0.0, id="growth of 2 / 9: cheapest at the end"),
        pytest.param(1.0, 0.5, math.inf, id="growth below 0: as slow as can be"),
        pytest.param(0.75, 0.75, math.inf, id="same removal all along"),
        pytest.param(0.75, 0.75 + 0.5 * ALIKE, math.inf, id="the same but for rounding"),
        pytest.param(6.0, 1.0, 0.0, id="growth of 0"),
    ],
)
def test_economic_lives_by_hand(alpha: float, beta: float, life: float) -> None:
    process = Process.of(SCENARIO)
    limit = Limit(LAW.model_copy(update={"cutting_speed": alpha, "feed": beta}), 50.0)
    assert process.economic_life(limit) == pytest.approx(life)
    bounded = process.life_limit(limit)
    assert bounded.law == SCENARIO.material.wear
    assert bounded.most == 0.4
    assert bounded.time == pytest.approx(min(max(life, MIN_LIFE), MAX_LIFE))
    assert (MIN_LIFE, MAX_LIFE) == (1e-6, 1e6)


def test_scales_follow_ratios_where_the_mask_lets_them() -> None:
    scales = Scales(3, smoothing=0.25)
    mask = np.array([True, False, True])
    force, power = scales.follow(mask, np.array([2.0, 2.0, 0.0]), np.array([3.0, 3.0, 0.0]))
    assert force == pytest.approx([1.25, 1.0, 0.75])
    assert power == pytest.approx([1.5, 1.0, 0.75])
    force, power = scales.follow(mask, np.array([2.0, 2.0, 0.0]), np.array([3.0, 3.0, 0.0]))
    assert force == pytest.approx([1.25 + 0.25 * 0.75, 1.0, 0.5625])
    scales.reset(np.array([True, False, False]))
    nothing = np.zeros(3, np.bool_)
    force, power = scales.follow(nothing, np.full(3, 9.0), np.full(3, 9.0))
    assert force == pytest.approx([1.0, 1.0, 0.5625])
    assert power == pytest.approx([1.0, 1.0, 0.5625])


def test_no_scale_falls_below_a_tenth() -> None:
    scales = Scales(1, smoothing=1.0)
    force, power = scales.follow(np.ones(1, np.bool_), np.array([0.01]), np.array([0.02]))
    assert (force[0], power[0]) == (0.1, 0.1)
