"""The spindle's torque over speed, idling, highest speed and short-time overload.

The numbers are worked out by hand.
"""

import math

import numpy as np
import pytest

from tests.turning_env.physics.one_env import ENV, put, records_of
from tests.turning_env.playing import UNDISTURBED, changed, fixed_actions, play
from turning_env import RoughTurningEnv, Scenario, read
from turning_env.action import set_point_action
from turning_env.physics.spindle import (
    allowed_share,
    capacity,
    cool_down,
    heat_up,
    idle_power,
)
from turning_env.scenario.laws import capacity_at, idle_power_at

_POWER = UNDISTURBED.material.power.model_dump() | {"wear": 0.0}
STEADY = changed(UNDISTURBED, control={"interval": 1.0}, material={"power": _POWER})
"""Constant power at constant speed and feed; bars of 100 mm."""
BASE = 100 * math.pi / 10
"""Cutting speed at 100 rev/min [m/min]."""


def cut(scenario, speed, steps=3):
    machine = scenario.machine
    speed_action = set_point_action(speed, machine.cutting_speed_min, machine.cutting_speed_max)
    actions = np.tile(np.array([speed_action, 0.0], np.float32), (steps, 1))
    return play(RoughTurningEnv(scenario), 0, actions)


def last(record):
    """Return the last row of a record."""
    return {name: values[-1] for name, values in record.items()}


def with_spindle(**spindle):
    return changed(STEADY, spindle=spindle)


@pytest.mark.parametrize(
    ("speed", "capacity"),
    [
        pytest.param(4 * BASE, 1.0, id="above the base speed"),
        pytest.param(3.0 * BASE, 1.0, id="at the base speed"),
        pytest.param(2.4 * BASE, 0.8, id="below"),
        pytest.param(1.8 * BASE, 0.6, id="far below"),
    ],
)
def test_below_the_base_speed_limit_and_available_torque_are_constant(speed, capacity):
    power = last(cut(STEADY, speed))["power"]
    # The rated power is 7.5 kW, the limit half of the power.
    available = 7.5 * capacity
    expected_excess = 2 / capacity - 1
    slow_spindle = with_spindle(base_speed=300.0, reading="torque")
    by_torque = changed(slow_spindle, limits={"power": 0.5 * power})
    record = last(cut(by_torque, speed))
    reading = read(record["observation"][np.newaxis], by_torque)
    assert record["power"] == power
    assert record["spindle_load"] == pytest.approx(power / available, rel=1e-6)
    assert record["excess_power"] == pytest.approx(expected_excess, rel=1e-6)
    assert reading.load == pytest.approx(record["measured_power"] / available, rel=1e-6)
    assert reading.power == pytest.approx(record["measured_power"], rel=1e-5)

    by_power = last(cut(changed(by_torque, spindle={"reading": "power"}), speed))
    assert by_power["spindle_load"] == pytest.approx(power / 7.5)
    assert by_power["excess_power"] == record["excess_power"]


def test_the_idle_torque_adds_to_that_of_the_cut_and_is_predicted():
    idle_torque = 10.0  # [N m]
    scenario = with_spindle(idle_torque=idle_torque)
    without = last(cut(STEADY, 3 * BASE))
    record = last(cut(scenario, 3 * BASE))
    added_torque = record["torque"] - without["torque"]
    added_power = record["power"] - without["power"]
    angular_velocity = 2 * math.pi * 300 / 60  # at 300 rev/min [rad/s]
    idle_power = idle_torque * angular_velocity / 1000  # [kW]
    assert added_torque == pytest.approx(idle_torque)
    assert added_power == pytest.approx(idle_power, rel=1e-6)
    assert record["measured_power"] == pytest.approx(record["power"])
    reading = read(record["observation"][np.newaxis], scenario)
    assert reading.power_ratio == pytest.approx(1.0)


def test_the_spindle_idles_in_air():
    scenario = changed(Scenario(), spindle={"idle_torque": 10.0}, sensors={"power_noise": 0.0})
    record = play(RoughTurningEnv(scenario), seed=1, actions=fixed_actions(1, 1)[:, 0])
    # P = M omega = M 2 v / d: 10 N m at 125 m/min and 100 mm.
    idle_power = 10.0 * 125 / 3000
    assert not record["cutting"][0]
    assert record["power"][0] == pytest.approx(idle_power)


@pytest.mark.parametrize("diameter", [100.0, 50.0])
def test_the_highest_speed_limits_the_cutting_speed_by_the_diameter(diameter):
    scenario = changed(
        with_spindle(max_speed=500.0),
        workpiece={"diameter": diameter},
        control={"initial_cutting_speed": 60.0},
    )
    assert scenario.cutting_speed_max == pytest.approx(math.pi * diameter / 2)
    assert cut(scenario, 200.0)["spindle_speed"][1:] == pytest.approx(500.0)
    assert cut(scenario, 60.0)["cutting_speed"][1:] == pytest.approx(60.0, rel=1e-6)


@pytest.mark.compiled
def test_short_overload_is_allowed_until_the_motor_is_hot():
    power = last(cut(STEADY, 4 * BASE))["power"]
    rated = power / 1.25
    limited = changed(STEADY, machine={"rated_power": rated}, limits={"power": rated * 1.01})
    overloadable = changed(
        limited,
        spindle={"short_time_load": 1.25, "thermal_time_constant": 0.5, "base_speed": 399.0},
    )
    excess = 1.25 / 1.01 - 1

    record = cut(overloadable, 4 * BASE, steps=60)
    minutes = np.cumsum(record["time"]) / 60
    heat = 1.25**2 * (1 - np.exp(-minutes / 0.5))
    hot = heat >= 1.0
    assert record["spindle_heat"] == pytest.approx(heat, rel=1e-9)
    assert 0 < hot.sum() < len(hot)
    assert record["overload_time"][~hot].sum() == 0.0
    # A step after which the motor is hot makes the next one cost.
    was_hot = hot[:-1]
    excesses = record["excess_power"][1:]
    assert excesses[was_hot] == pytest.approx(excess)


def test_without_short_overload_every_excess_costs_and_no_heat_is_counted():
    power = last(cut(STEADY, 4 * BASE))["power"]
    rated = power / 1.25
    limited = changed(STEADY, machine={"rated_power": rated}, limits={"power": rated * 1.01})
    record = cut(limited, 4 * BASE, steps=5)
    excess = 1.25 / 1.01 - 1
    assert record["excess_power"][1:] == pytest.approx(excess)
    assert not record["spindle_heat"].any()


@pytest.mark.parametrize(("speed", "available"), [(50.0, 0.5), (100.0, 1.0), (250.0, 1.0)])
def test_the_available_power_rises_up_to_the_base_speed(speed, available):
    # 1000 / pi rev/min at a diameter of 100 mm are 100 m/min.
    scenario = changed(
        Scenario(), spindle={"base_speed": 1000.0 / math.pi}, workpiece={"diameter": 100.0}
    )
    p = records_of(capacity_per_speed=0.01).p
    assert capacity(p, ENV, speed) == pytest.approx(available)
    assert capacity_at(scenario, speed) == pytest.approx(available)
    assert capacity_at(Scenario(), speed) == 1.0


def test_the_idle_power_is_torque_times_angular_velocity():
    scenario = changed(Scenario(), spindle={"idle_torque": 6.0}, workpiece={"diameter": 80.0})
    # 120 m/min at 80 mm are 477.46 rev/min = 50 rad/s: 300 W.
    p = records_of(scenario).p
    assert idle_power_at(scenario, 120.0) == pytest.approx(0.3)
    assert idle_power(p, ENV, 120.0) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("heat", "share"),
    [
        pytest.param(0.99, 1.4 * 0.5, id="cold"),
        pytest.param(1.0, 0.5, id="hot"),
        pytest.param(1.2, 0.5, id="hotter"),
    ],
)
def test_a_cold_motor_may_be_overloaded(heat, share):
    records = records_of(short_time_load=1.4, capacity_per_speed=0.01)
    put(records.state, spindle_heat=heat, cutting_speed=50.0)
    assert allowed_share(records.state, ENV, records.p) == pytest.approx(share)


@pytest.mark.parametrize("turns", [3.0, 0.5, 0.0])
def test_the_motor_heats_up_by_the_square_of_its_load(turns):
    records = records_of(
        rated_power=10.0,
        idle_power_per_speed=0.02,
        capacity_per_speed=0.01,
        thermal_time_constant=4.0,
    )
    # (5 + 0.02 * 50) kW of 10 kW * 0.5.
    put(records.state, cutting_speed=50.0, power=5.0, spindle_heat=0.3)
    put(records.work, sub_step=2.0, turns=turns)
    heat_up(records.state, records.work, ENV, records.p)
    share = 1.0 - math.exp(-0.5) if turns else 0.0
    assert records.state.spindle_heat[ENV] == pytest.approx(0.3 + (1.44 - 0.3) * share)


def test_the_motor_cools_without_load():
    records = records_of(thermal_time_constant=4.0)
    put(records.state, spindle_heat=0.8)
    cool_down(records.state, ENV, records.p, 2.0)
    assert records.state.spindle_heat[ENV] == pytest.approx(0.8 * math.exp(-0.5))
