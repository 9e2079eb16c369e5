"""Sensors, the link from the process to the controller."""

import math

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed, infos

BRISK = changed(UNDISTURBED, control={"interval": 1}, tool={"wear_criterion": 5})
HOLD = [(0.0, 0.0)]


def power_ratio(info):
    return info["measured_power"] / info["power"]


def force_ratio(info):
    return info["measured_thrust_force"] / info["thrust_force"]


def test_noise_is_relative_unbiased_and_independent():
    """Over 2000 steps the standard error of a standard deviation is 1.6 %."""
    noisy = changed(BRISK, sensors={"power_noise": 0.02, "force_noise": 0.05})
    steps = infos(noisy, HOLD * 2000)
    power = np.array([power_ratio(info) - 1 for info in steps])
    force = np.array([force_ratio(info) - 1 for info in steps])
    assert power.std() == pytest.approx(0.02, rel=0.06)
    assert force.std() == pytest.approx(0.05, rel=0.06)
    assert power.mean() == pytest.approx(0, abs=0.0015)
    assert force.mean() == pytest.approx(0, abs=0.004)
    assert abs(np.corrcoef(power, force)[0, 1]) < 0.05
    assert abs(np.corrcoef(power[1:], power[:-1])[0, 1]) < 0.05


def test_measurements_lag_behind_the_process():
    lags = {"power_time_constant": 2.0, "force_time_constant": 4.0}
    for seconds, info in enumerate(infos(changed(BRISK, sensors=lags), HOLD * 3), start=1):
        # The process itself drifts slowly with wear, hence the wide tolerance.
        expected = 1 - math.exp(-seconds / 2.0)
        assert power_ratio(info) == pytest.approx(expected, rel=0.1)
        assert force_ratio(info) < power_ratio(info)


def test_readings_drift_and_the_depth_grows_until_the_machine_is_warm():
    drift = {"power_drift": 0.05, "force_drift": -0.1, "thermal_growth": 0.2, "warm_up_time": 2.0}
    for seconds, info in enumerate(infos(changed(BRISK, mismatch=drift), HOLD * 300), start=1):
        warmth = 1 - math.exp(-seconds / 120.0)
        assert power_ratio(info) == pytest.approx(1 + 0.05 * warmth, rel=1e-6)
        assert force_ratio(info) == pytest.approx(1 - 0.1 * warmth, rel=1e-6)
        # The depth is that of the last sub-step, within a step's warm-up.
        assert info["depth_of_cut"] == pytest.approx(2.5 + 0.2 * warmth, abs=2e-3)
