"""Speeds of a turned bar, and power and torque of the spindle, by hand."""

import math

import numpy as np
import pytest

from turning_env.numerics.conversions import (
    cutting_speed_at,
    feed_velocity_at,
    power_at,
    spindle_speed_at,
    torque_at,
)

CUTS = (
    # diameter [mm], spindle speed [rev/min], cutting speed [m/min]
    (1000.0 / math.pi, 100.0, 100.0),  # a circumference of 1 m
    (100.0, 1000.0, 314.159265359),  # 0.314 m a turn
    (50.0, 1200.0, 188.495559215),
)


@pytest.mark.parametrize(("diameter", "spindle_speed", "cutting_speed"), CUTS)
def test_spindle_speed_and_cutting_speed_are_inverse(
    diameter: float, spindle_speed: float, cutting_speed: float
) -> None:
    assert cutting_speed_at(spindle_speed, diameter) == pytest.approx(cutting_speed)
    assert spindle_speed_at(cutting_speed, diameter) == pytest.approx(spindle_speed)


def test_the_feed_velocity_is_in_mm_per_second() -> None:
    # 600 turns a minute are 10 a second, each of 0.3 mm.
    cutting_speed = cutting_speed_at(600.0, 80.0)
    assert feed_velocity_at(cutting_speed, 0.3, 80.0) == pytest.approx(3.0)


def test_power_and_torque_are_inverse() -> None:
    # 300 / pi turns a minute are 10 rad a second: 100 N m take 1 kW.
    turns = 300.0 / math.pi
    assert torque_at(1.0, turns) == pytest.approx(100.0)
    assert power_at(100.0, turns) == pytest.approx(1.0)


def test_arrays_are_converted_entry_by_entry() -> None:
    diameters = np.array([100.0, 200.0])
    assert spindle_speed_at(62.831853, diameters) == pytest.approx([200.0, 100.0])
