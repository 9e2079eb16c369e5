"""The sheet of cuts that follows from a record."""

import math
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from turning_control.__main__ import main
from turning_control.machine_log.cuts import CutSettings, find_cuts, read_record
from turning_control.machine_log.record import Recorder, Sample
from turning_shop.calibrate import calibrate
from turning_shop.measurements import read_measurements

from turning_env import Scenario
from turning_env.console import UserError

START = datetime(2026, 3, 2, 8, 0, tzinfo=UTC)
STEP = 0.1  # [s]
DIAMETER = 60.0  # [mm]


class Turner:
    """Turns bars, and notes samples of the machine."""

    def __init__(self, **missing: float) -> None:
        self.samples: list[Sample] = []
        self._missing = missing

    def stay(self, seconds: float, **values: Any) -> None:
        """Hold a state for a time."""
        for _ in range(round(seconds / STEP)):
            time = START + timedelta(seconds=STEP * len(self.samples))
            sample = Sample(
                time,
                x=0.5 * DIAMETER,
                tool="3",
                running=1.0,
                **values,
            )
            self.samples.append(replace(sample, **self._missing))

    def idle(self, seconds: float, spindle_speed: float = 900.0, power: float = 0.4) -> None:
        """Turn the spindle without feed."""
        self.stay(
            seconds,
            spindle_speed=spindle_speed,
            feed_rate=0.0,
            spindle_power=power,
        )

    def cut(
        self, seconds: float, power: float, spindle_speed: float = 900.0, feed: float = 0.25
    ) -> None:
        """Enter the bar, cut, and leave it: the power rises and falls."""
        for share in (0.5, 1.0, 0.5):
            self.stay(
                seconds if share == 1.0 else 0.2,
                spindle_speed=spindle_speed,
                feed_rate=feed * spindle_speed,
                spindle_power=0.4 + share * power,
            )

    def write(self, path: Path) -> Path:
        with Recorder(path) as recorder:
            for sample in self.samples:
                recorder.write(sample)
        return path


@pytest.fixture
def turner() -> Turner:
    return Turner()


KNOWN = CutSettings(x="radius")


def test_a_cut_has_the_mean_of_its_middle_less_the_idle_power(
    turner: Turner, tmp_path: Path
) -> None:
    turner.idle(3.0)
    turner.cut(5.0, power=4.0)
    turner.idle(3.0)
    (cut,) = find_cuts(read_record(turner.write(tmp_path / "log.csv"), KNOWN), KNOWN).cuts
    assert cut.power == pytest.approx(4.0)
    assert cut.idle_power == pytest.approx(0.4)
    assert cut.cutting_speed == pytest.approx(np.pi * DIAMETER * 900 / 1000)
    assert cut.feed == pytest.approx(0.25)
    assert cut.seconds == pytest.approx(5.4, abs=0.15)


def test_other_settings_or_a_gap_begin_another_cut(turner: Turner, tmp_path: Path) -> None:
    turner.idle(3.0)
    turner.cut(5.0, power=4.0)
    turner.cut(5.0, power=4.5, feed=0.3)
    gap = len(turner.samples)
    turner.cut(5.0, power=4.5, feed=0.3)
    turner.samples[gap + 20] = replace(turner.samples[gap + 20], gap="1 s lost")
    known = replace(KNOWN, is_fresh=True)
    record = read_record(turner.write(tmp_path / "log.csv"), known)
    first, other_setting, after_gap = find_cuts(record, known).cuts
    assert first.feed == pytest.approx(0.25, abs=5e-4)
    assert other_setting.feed == pytest.approx(0.3, abs=5e-4)
    assert after_gap.feed == pytest.approx(0.3, abs=5e-4)
    # The edge's time is known as long as nothing has changed and nothing is lost.
    assert first.edge_time == pytest.approx(5.4 / 60, abs=0.1 / 60)
    assert math.isnan(other_setting.edge_time)
    assert math.isnan(after_gap.edge_time)


def test_short_touches_are_left_out(turner: Turner, tmp_path: Path) -> None:
    turner.idle(3.0)
    turner.cut(0.5, power=4.0)
    turner.idle(1.0)
    path = turner.write(tmp_path / "log.csv")
    with pytest.raises(UserError, match="no steady cut"):
        find_cuts(read_record(path, KNOWN), KNOWN)


def test_samples_may_come_at_changes_only(turner: Turner, tmp_path: Path) -> None:
    turner.idle(3.0)
    turner.cut(5.0, power=4.0)
    turner.idle(3.0)
    kept = [turner.samples[0]]
    for sample in turner.samples:
        if sample.spindle_power != kept[-1].spindle_power:
            kept.append(sample)
    turner.samples = [*kept, turner.samples[-1]]
    (cut,) = find_cuts(read_record(turner.write(tmp_path / "log.csv"), KNOWN), KNOWN).cuts
    assert cut.power == pytest.approx(4.0)


@pytest.mark.parametrize(
    ("missing", "settings", "named"),
    [
        pytest.param({}, CutSettings(), "--x radius", id="radius or diameter"),
        pytest.param({"x": np.nan}, CutSettings(), "--diameter", id="no position"),
        pytest.param({"feed_rate": np.nan}, KNOWN, "feed_rate", id="no feed"),
        pytest.param({"spindle_power": np.nan}, KNOWN, "power, torque or load", id="no load"),
        pytest.param(
            {"spindle_power": np.nan, "spindle_load": 50.0}, KNOWN, "--rated-power", id="load in %"
        ),
    ],
)
def test_what_a_record_lacks_is_asked_for(
    missing: dict[str, float], settings: CutSettings, named: str, tmp_path: Path
) -> None:
    turner = Turner(**missing)
    turner.idle(3.0)
    turner.cut(5.0, power=4.0)
    with pytest.raises(UserError, match=named):
        read_record(turner.write(tmp_path / "log.csv"), settings)


def test_without_idling_the_idle_power_is_asked_for(turner: Turner, tmp_path: Path) -> None:
    turner.cut(5.0, power=4.0)
    record = read_record(turner.write(tmp_path / "log.csv"), KNOWN)
    with pytest.raises(UserError, match="--idle-power"):
        find_cuts(record, KNOWN)
    (cut,) = find_cuts(record, replace(KNOWN, idle_power=0.4)).cuts
    assert cut.power == pytest.approx(4.0)


def kienzle(cutting_speed: float, feed: float) -> float:
    """Return the power [kW] at 2 mm depth with kc1.1 1700 N/mm2 and mc 0.25."""
    return 1700.0 * 2.0 * feed**0.75 * cutting_speed / 60e3


def test_a_sheet_gives_calibrate_the_law_that_the_machine_had(
    turner: Turner, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    law: Callable[[float, float], float] = kienzle
    for spindle_speed in (700.0, 900.0, 1100.0):
        for feed in (0.15, 0.25, 0.35):
            turner.idle(2.0, spindle_speed=spindle_speed)
            power = law(np.pi * DIAMETER * spindle_speed / 1000, feed)
            turner.cut(4.0, power, spindle_speed=spindle_speed, feed=feed)
    record = turner.write(tmp_path / "log.csv")
    sheet = tmp_path / "cuts.csv"
    words = ["log", str(record), "--x", "radius", "--depth", "2", "--wear", "0"]
    assert main([*words, "--cuts", str(sheet)]) == 0
    assert "9 cuts" in capsys.readouterr().err
    assert main([*words, "--cuts", str(sheet)]) == 2  # it exists

    fitted = calibrate(read_measurements(sheet), Scenario.load("rough_turning")).fits["power"].law
    assert fitted.feed == pytest.approx(0.75, abs=1e-3)
    assert fitted.cutting_speed == pytest.approx(1.0, abs=1e-3)


def test_another_file_is_no_record(tmp_path: Path) -> None:
    path = tmp_path / "sheet.csv"
    path.write_text("cutting_speed,feed\n1,2\n")
    assert main(["log", str(path), "--cuts", str(tmp_path / "cuts.csv")]) == 2
