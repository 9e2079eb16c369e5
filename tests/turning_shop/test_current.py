"""A feed motor's current: what its quantities tell of the load, and the records that are refused."""

from pathlib import Path

import numpy as np
import pytest

from turning_env.__main__ import main
from turning_shop import Values, WorkshopError
from turning_shop.current import QUANTITIES, analyse

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
    for name in QUANTITIES:
        line = found.lines[name]
        assert line.slope.value == pytest.approx(1.0 / (share * PER_TORQUE), rel=0.01), name
        assert line.intercept.value == pytest.approx(-IDLE / PER_TORQUE, rel=0.02), name
        assert line.hysteresis == pytest.approx(0.0, abs=1e-3), name
        assert line.slope.low <= line.slope.value <= line.slope.high


def test_hysteresis_is_the_gap_over_the_range_and_widens_the_intervals() -> None:
    smooth, gaping = (analyse(*record(UP_AND_DOWN, kept)).lines["rms"] for kept in (0.0, 0.3))
    assert gaping.hysteresis == pytest.approx(0.1, rel=0.01)
    assert np.ptp(gaping.slope[1:]) > np.ptp(smooth.slope[1:])
    assert analyse(*record((0.0, 1.0, 2.0, 3.0))).lines["rms"].hysteresis is None


def test_noise_adds_to_the_root_mean_square_but_hardly_to_peak_and_filtered_value() -> None:
    time, current, torque = record(UP_AND_DOWN)
    noise = np.random.default_rng(1).standard_normal(len(time))
    clean, noisy = analyse(time, current, torque).quantities, analyse(time, current + noise, torque).quantities
    added = {name: noisy[name][0] - clean[name][0] for name in QUANTITIES}
    assert added["rms"] > 2.0 * added["filtered"]
    assert added["rms"] > 3.0 * abs(added["peak"])


def test_records_that_do_not_serve_are_refused() -> None:
    time, current, torque = record(UP_AND_DOWN)
    noisy = torque + 1e-3 * np.sin(np.arange(len(time)))
    for given, options, words in (
        ((time**1.1, current, torque), {}, "constant rate"),
        ((time, current, np.minimum(torque, 1.0)), {}, "2 loads"),
        ((time, current, noisy), {}, "noisy reading"),
        ((time, current, torque), {"cutoff": 30.0}, "25 Hz"),
    ):
        with pytest.raises(WorkshopError, match=words):
            analyse(*given, **options)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time,current\n0,1\n", "torque or thrust_force"),
        ("time,current,torque,thrust_force\n0,1,1,1\n", "needs one column"),
        ("time,current,torque\n0,1,1\n0.02,,1\n", "line 3, column current"),
        ("time,ampere,torque\n0,1,1\n", "no column current"),
    ],
)
def test_sheets_that_do_not_serve_end_in_one_line(
    text: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sheet = tmp_path / "sheet.csv"
    sheet.write_text(text)
    assert main(["current", str(sheet)]) == 2
    assert words in capsys.readouterr().err
