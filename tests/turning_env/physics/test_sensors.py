"""Sensors, the link from the process to the controller."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from tests.turning_env.physics.one_env import AFTER, ENV, put, records_of
from tests.turning_env.playing import UNDISTURBED, changed, infos
from turning_env.numerics.keyed_random import SENSOR_CHANNEL, standard_normals
from turning_env.physics.sensors import follow_process, read_sensors, warmth

BRISK = changed(UNDISTURBED, control={"interval": 1}, tool={"wear_criterion": 5})
HOLD = [(0.0, 0.0)]


class Ratios(NamedTuple):
    """Measured over true power and force; arrays over steps."""

    power: np.ndarray
    force: np.ndarray


def ratios(steps):
    """Return measured over true power and force by the infos of steps."""
    power = []
    force = []
    for info in steps:
        power.append(info["measured_power"] / info["power"])
        force.append(info["measured_thrust_force"] / info["thrust_force"])
    return Ratios(np.array(power), np.array(force))


@pytest.mark.compiled
def test_noise_is_relative_unbiased_and_independent():
    """Over 2000 steps the standard error of a standard deviation is 1.6 %."""
    noisy = changed(BRISK, sensors={"power_noise": 0.02, "force_noise": 0.05})
    power, force = ratios(infos(noisy, HOLD * 2000))
    assert power.std() == pytest.approx(0.02, rel=0.06)
    assert force.std() == pytest.approx(0.05, rel=0.06)
    assert power.mean() == pytest.approx(1, abs=0.0015)
    assert force.mean() == pytest.approx(1, abs=0.004)
    between_sensors = np.corrcoef(power, force)[0, 1]
    between_steps = np.corrcoef(power[1:], power[:-1])[0, 1]
    assert abs(between_sensors) < 0.05
    assert abs(between_steps) < 0.05


def test_measurements_lag_behind_the_process():
    lags = {"power_time_constant": 2.0, "force_time_constant": 4.0}
    power, force = ratios(infos(changed(BRISK, sensors=lags), HOLD * 3))
    seconds = np.array([1, 2, 3])
    # The process itself drifts slowly with wear, hence the wide tolerance.
    assert power == pytest.approx(1 - np.exp(-seconds / 2.0), rel=0.1)
    assert (force < power).all()


@pytest.mark.compiled
def test_readings_drift_and_the_depth_grows_until_the_machine_is_warm():
    drift = {
        "power_drift": 0.05,
        "force_drift": -0.1,
        "thermal_growth": 0.2,
        "warm_up_time": 2.0,
    }
    steps = infos(changed(BRISK, mismatch=drift), HOLD * 300)
    power, force = ratios(steps)
    depth = [info["depth_of_cut"] for info in steps]
    seconds = np.arange(1, 301)
    warmth = 1 - np.exp(-seconds / 120.0)
    assert power == pytest.approx(1 + 0.05 * warmth, rel=1e-6)
    assert force == pytest.approx(1 - 0.1 * warmth, rel=1e-6)
    # The depth is that of the last sub-step, within a step's warm-up.
    assert depth == pytest.approx(2.5 + 0.2 * warmth, abs=2e-3)


@pytest.mark.parametrize(("clock", "expected"), [(0.0, 0.0), (60.0, 1.0 - math.exp(-2.0))])
def test_the_machine_warms_up_with_its_time_constant(clock, expected):
    records = records_of(warm_up_time=30.0)
    put(records.state, clock=clock)
    assert warmth(records.state, ENV, records.p) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("turns", "power", "force"),
    [
        # The process has 3 + 0.01 * 100 = 4 kW and 900 N.
        pytest.param(5.0, 2.0 + 0.5 * (4.0 - 2.0), 100.0 + 0.25 * (900.0 - 100.0), id="runs"),
        pytest.param(1e-9, 3.0, 300.0, id="hardly turns"),
        pytest.param(0.0, 2.0, 100.0, id="stands"),
    ],
)
def test_sensors_cover_their_share_of_the_way_to_the_process(turns, power, force):
    records = records_of(power_sensor_share=0.5, force_sensor_share=0.25, idle_power_per_speed=0.01)
    put(records.work, turns=turns)
    put(records.state, power=3.0, thrust_force=900.0, cutting_speed=100.0)
    put(records.state, lagged_power=2.0, lagged_thrust_force=100.0)
    follow_process(records.state, records.work, ENV, records.p)
    assert records.state.lagged_power[ENV] == pytest.approx(power)
    assert records.state.lagged_thrust_force[ENV] == pytest.approx(force)


def sensed(**parameters):
    """Return records with 2 kW and 800 N behind the lags, biases and noise; and its normals."""
    records = records_of(
        power_bias=0.5, force_bias=-0.25, power_noise=0.02, force_noise=0.05, **parameters
    )
    put(records.state, seed=11, episode=1, step_count=4, clock=60.0, path=2.5)
    put(records.state, lagged_power=2.0, lagged_thrust_force=800.0, cutting_speed=100.0, feed=0.2)
    normals = standard_normals(records.state, ENV, channel=SENSOR_CHANNEL, bar=0, index=4)
    read_sensors(records.state, records.work, ENV, AFTER, records.p)
    return records.state, normals


def test_readings_have_bias_and_relative_noise():
    state, (power, force) = sensed()
    assert state.measured_power[ENV] == pytest.approx(3.0 * (1.0 + 0.02 * power))
    assert state.measured_thrust_force[ENV] == pytest.approx(600.0 * (1.0 + 0.05 * force))
    assert state.measured_servo_current[ENV] == 0.0


def test_readings_drift_as_the_machine_warms_up():
    state, (power, force) = sensed(
        warms_up=True, warm_up_time=60.0, power_drift=0.1, force_drift=-0.2
    )
    warm = 1.0 - math.exp(-1.0)
    expected_power = 3.0 * (1.0 + 0.02 * power) * (1.0 + 0.1 * warm)
    expected_force = 600.0 * (1.0 + 0.05 * force) * (1.0 - 0.2 * warm)
    assert state.measured_power[ENV] == pytest.approx(expected_power)
    assert state.measured_thrust_force[ENV] == pytest.approx(expected_force)


def test_the_servo_current_is_that_of_force_and_feed_velocity_with_its_ripple():
    state, (_, force) = sensed(
        senses_current=True,
        revolutions_per_metre=5.0,
        no_load_current=1.0,
        no_load_current_rate=0.01,
        current_per_newton=0.002,
        current_ripple=0.1,
        ripples_per_path=0.1,
    )
    # Feed velocity 100 * 5 * 0.2 = 100 mm/min; 2.5 mm are a quarter of a ripple.
    current = 0.75 * (1.0 + 0.01 * 100.0 + 0.002 * 800.0) * 1.1
    assert state.measured_servo_current[ENV] == pytest.approx(current * (1.0 + 0.05 * force))
    assert state.measured_thrust_force[ENV] == 0.0


@pytest.mark.parametrize("senses_current", [False, True])
def test_readings_are_never_below_0(senses_current):
    state, _ = sensed(
        senses_current=senses_current, warms_up=True, power_drift=0.0, force_drift=-9.0
    )
    assert state.measured_thrust_force[ENV] == 0.0
    assert state.measured_servo_current[ENV] == 0.0


def test_a_power_below_0_reads_as_0():
    records = records_of(power_bias=-2.0)
    put(records.state, lagged_power=2.0)
    read_sensors(records.state, records.work, ENV, AFTER, records.p)
    assert records.state.measured_power[ENV] == 0.0
