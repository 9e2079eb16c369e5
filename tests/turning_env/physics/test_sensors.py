"""Sensors, the link from the process to the controller."""

from typing import NamedTuple

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed, infos

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
