"""Sensors, the link from the process to the controller."""

import math

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed, infos

BRISK = changed(UNDISTURBED, control={"interval": 1}, tool={"wear_criterion": 5})
STILL = [(0.0, 0.0)]


def test_noise_is_relative_unbiased_and_independent():
    """Over 2000 intervals the standard error of a standard deviation is 1.6 %."""
    noisy = infos(changed(BRISK, sensors={"power_noise": 0.02, "force_noise": 0.05}), STILL * 2000)
    power = np.array([info["measured_power"] / info["power"] - 1 for info in noisy])
    force = np.array([info["measured_thrust_force"] / info["thrust_force"] - 1 for info in noisy])
    assert (power.std(), force.std()) == (
        pytest.approx(0.02, rel=0.06),
        pytest.approx(0.05, rel=0.06),
    )
    assert (power.mean(), force.mean()) == (
        pytest.approx(0, abs=0.0015),
        pytest.approx(0, abs=0.004),
    )
    assert abs(np.corrcoef(power, force)[0, 1]) < 0.05
    assert abs(np.corrcoef(power[1:], power[:-1])[0, 1]) < 0.05


def test_measurements_lag_behind_the_process():
    lagged = infos(
        changed(BRISK, sensors={"power_time_constant": 2.0, "force_time_constant": 4.0}), STILL * 3
    )
    for seconds, info in enumerate(lagged, start=1):
        # The process itself drifts slowly with wear, hence the wide tolerance.
        assert info["measured_power"] / info["power"] == pytest.approx(
            1 - math.exp(-seconds / 2.0), rel=0.1
        )
        assert (
            info["measured_thrust_force"] / info["thrust_force"]
            < info["measured_power"] / info["power"]
        )


def test_readings_drift_and_the_depth_grows_until_the_machine_is_warm():
    drift = {"power_drift": 0.05, "force_drift": -0.1, "thermal_growth": 0.2, "warm_up_time": 2.0}
    for seconds, info in enumerate(infos(changed(BRISK, mismatch=drift), STILL * 300), start=1):
        warm = 1 - math.exp(-seconds / 120.0)
        assert info["measured_power"] / info["power"] == pytest.approx(1 + 0.05 * warm, rel=1e-6)
        assert info["measured_thrust_force"] / info["thrust_force"] == pytest.approx(
            1 - 0.1 * warm, rel=1e-6
        )
        assert info["depth_of_cut"] == pytest.approx(
            2.5 + 0.2 * warm, abs=2e-3
        )  # within a step's warm-up
