"""A feed motor's current: what its quantities tell of the load, and the records that are refused."""

import numpy as np
import pytest

from turning_shop import Values, WorkshopError
from turning_shop.current import analyse

RATE, SAMPLES, FREQUENCY = 50.0, 100, 4.0
IDLE, PER_TORQUE = 1.5, 1.6
"""Amplitude without load [A], and its growth with torque [A/(N m)]."""
UP_AND_DOWN = (0.0, 1.0, 2.0, 3.0, 2.0, 1.0, 0.0)


def record(levels: tuple[float, ...], kept: float = 0.0, alternating: bool = True) -> tuple[Values, Values, Values]:
    """Return (time, current, torque): while the set torque falls, the true one is higher by ``kept`` [N m]."""
    set_torque = np.array(levels)
    falling = np.arange(len(levels)) > set_torque.argmax()
    amplitude = np.repeat(IDLE + PER_TORQUE * (set_torque + kept * falling), SAMPLES)
    time = np.arange(len(amplitude)) / RATE
    return time, amplitude * (np.cos(2.0 * np.pi * FREQUENCY * time) if alternating else 1.0), np.repeat(set_torque, SAMPLES)


@pytest.mark.parametrize(("alternating", "share"), [(True, np.sqrt(0.5)), (False, 1.0)])
def test_every_quantity_gives_the_torque_back(alternating: bool, share: float) -> None:
    found = analyse(*record(UP_AND_DOWN, alternating=alternating))
    assert found.frequency == (FREQUENCY if alternating else 0.0)
    assert found.load == list(UP_AND_DOWN)
    for name, line in found.lines.items():
        assert line.slope == pytest.approx(1.0 / (share * PER_TORQUE), rel=0.01), name
        assert line.intercept == pytest.approx(-IDLE / PER_TORQUE, rel=0.02), name


def test_records_that_do_not_serve_are_refused() -> None:
    time, current, torque = record(UP_AND_DOWN)
    noisy = torque + 1e-3 * np.sin(np.arange(len(time)))
    for few in (np.minimum(torque, 1.0), noisy):
        with pytest.raises(WorkshopError, match="needed are 3 loads"):
            analyse(time, current, few)
