"""Rows that a law cannot hold: fresh edges, forms that do not fit, and copies.

True rows are never called wrong.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from turning_shop import WorkshopError
from turning_shop.__main__ import main
from turning_shop.calibrate import calibrate
from turning_shop.fit import TYPICAL_GROWTH
from turning_shop.measurements import Measurements, read_measurements
from turning_shop.prediction import Evidence, predict
from turning_shop.provenance import load
from turning_shop.whatif import what_if

from shop.tests.turning_shop.sheets import forces
from turning_env import Scenario

BASE = Scenario()
NEAR_ZERO = (0.002, 0.01, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35)


def written(folder: Path, text: str) -> Path:
    """Write a sheet; return its path."""
    path = folder / "cuts.csv"
    path.write_text(text, "utf-8")
    return path


def measured(folder: Path, text: str) -> Measurements:
    """Return the measurements of a sheet."""
    return read_measurements(written(folder, text))


def calibrated(folder: Path, text: str) -> tuple[Scenario, Evidence]:
    """Return the scenario that ``calibrate`` writes for a sheet, and its evidence."""
    sheet = written(folder, text)
    out = folder / "made.toml"
    assert main(["calibrate", str(sheet), "--out", str(out)]) == 0
    return load(out)


def test_forces_near_a_fresh_edge_follow_their_formula(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario, evidence = calibrated(tmp_path, forces(0.4, NEAR_ZERO))
    assert "implausible" not in capsys.readouterr().err
    assert evidence.laws["thrust_force"].measured["wear"] == (0.002, 0.35)
    for wear in (0.01, 0.2, 0.3):
        cuts = what_if(scenario, 190, 0.25, depth_of_cut=1.5, wear=wear)
        thrust = 900 * 0.25**0.6 * 1.5 * (1 + 5 * wear)
        assert cuts.thrust_force == pytest.approx(thrust, rel=0.06)


def test_typing_errors_are_still_typing_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = forces(0.4, (0.1, 0.15, 0.2, 0.25, 0.3, 0.35)).splitlines()
    cells = lines[9].split(";")
    # Feed force and back force make the thrust force.
    cells[-2] = str(10 * float(cells[-2]))
    cells[-1] = str(10 * float(cells[-1]))
    lines[9] = ";".join(cells)
    sheet = written(tmp_path, "\n".join(lines))
    assert main(["calibrate", str(sheet), "--out", str(tmp_path / "made.toml")]) == 1
    assert "line 10: thrust_force" in capsys.readouterr().err


@pytest.mark.parametrize(("response", "feed_exponent"), [("thrust_force", 0.6), ("power", 0.74)])
def test_fresh_edges_tell_the_exponents(
    tmp_path: Path, response: str, feed_exponent: float
) -> None:
    measurements = measured(tmp_path, forces(0.5, (0.0, 0.1, 0.2, 0.3)))
    fitted = calibrate(measurements, BASE).fits[response]
    assert fitted.fresh.sum() == 8
    assert fitted.law.feed == pytest.approx(feed_exponent, abs=0.05)
    assert fitted.law.depth_of_cut == pytest.approx(1.0, abs=0.05)


@pytest.mark.slow
def test_fresh_edges_are_rows_of_the_law(tmp_path: Path) -> None:
    with_fresh = calibrate(measured(tmp_path, forces(0.5, (0.0, 0.1, 0.2, 0.3))), BASE)
    without = calibrate(measured(tmp_path, forces(0.5, (0.1, 0.2, 0.3))), BASE)
    assert with_fresh.fits["power"].degrees == without.fits["power"].degrees + 8
    fresh = with_fresh.material.power(150, 0.2, 2, wear=0.0)
    assert fresh == pytest.approx(1800 * 0.2**0.74 * 2 * 150 / 60e3, rel=0.03)


def test_a_sheet_of_fresh_edges_gets_a_typical_growth_with_wear(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario, evidence = calibrated(tmp_path, forces(0.5, (0.0,)))
    printed = re.search(r"kc1.1 (\d+) N/mm2, mc (\S+) at", capsys.readouterr().out)
    assert printed is not None
    assert float(printed[1]) == pytest.approx(1800, rel=0.12)
    assert float(printed[2]) == pytest.approx(0.26, rel=0.12)
    assert "fresh edges" in "\n".join(evidence.warnings)
    fresh_power = 1800 * 0.3**0.74 * 2 * 190 / 60e3
    assert scenario.material.power(
        190,
        0.3,
        2.0,
        wear=0.0,
    ) == pytest.approx(fresh_power, rel=0.03)
    worn = what_if(scenario, 190, 0.3, depth_of_cut=2.0, wear=0.2)
    growth = 1 + 0.2 * TYPICAL_GROWTH["power"]
    assert worn.power == pytest.approx(growth * fresh_power, rel=0.03)
    assert predict(scenario, evidence, worn, of_wear=True).extrapolated


def test_a_start_at_time_0_and_wear_0_is_a_measurement(tmp_path: Path) -> None:
    rows = ["edge,vc,f,ap,time,VB"]
    for speed, edge_factor in ((150, 1.0), (200, 1.05), (250, 0.97)):
        for time in (0, 2, 5, 9):
            wear = 0.05 * (speed / 150) ** 2 * time**0.5 * edge_factor
            rows.append(f"{speed},{speed},0.3,2,{time},{wear}")
    calibration = calibrate(measured(tmp_path, "\n".join(rows)), BASE)
    assert len(calibration.fits["wear"].lines) == 9
    assert calibration.material.wear.time == pytest.approx(0.5, abs=0.01)
    assert "empty cells" not in "\n".join(calibration.warnings)


HEADER = "edge;vc;f;ap;time;VB;Fc"
SAME = ["1;210;0.32;2;12;0.22;1700"] * 9
OTHER_NAMES = [f"{edge};210;0.32;2;12;0.22;1700" for edge in range(9)]
ROUNDED = ["1;210;0.32;2;12;0.2200;1700", "1;210;0.32;2;12;0.2201;1701"] * 4
ROUNDED.append("1;210;0.32;2;12;0.2202;1700")


@pytest.mark.parametrize(
    "rows",
    [
        pytest.param(SAME, id="copies"),
        pytest.param(OTHER_NAMES, id="copies under other names"),
        pytest.param(ROUNDED, id="to rounding"),
    ],
)
def test_copies_are_one_reading(tmp_path: Path, rows: list[str]) -> None:
    measurements = measured(tmp_path, "\n".join([HEADER, *rows]))
    with pytest.raises(WorkshopError, match=r"1 row .*8 rows repeat others.* lines 3 to 10"):
        calibrate(measurements, BASE)


@pytest.mark.slow
def test_copies_do_not_narrow_intervals(tmp_path: Path) -> None:
    text = forces(0.5, (0.1, 0.2, 0.3))
    header, *rows = text.splitlines(keepends=True)
    once = calibrate(measured(tmp_path, text), BASE)
    thrice = calibrate(measured(tmp_path, header + "".join(3 * rows)), BASE)
    covariance = once.fits["power"].covariance
    assert thrice.fits["power"].covariance == pytest.approx(covariance, rel=1e-5, abs=1e-8)
    assert "48 rows repeat others" in "\n".join(thrice.warnings)


def test_one_edge_does_not_tell_how_edges_differ(tmp_path: Path) -> None:
    rows = ["edge;vc;f;ap;time;VB"]
    for time in (2, 4, 8, 12, 16):
        rows.append(f"1;200;0.3;2;{time};{0.06 * time**0.5:.4f}")
    scenario, evidence = calibrated(tmp_path, "\n".join(rows))
    cuts = what_if(scenario, 200, 0.3, depth_of_cut=2, time=8)
    prediction = predict(scenario, evidence, cuts, of_wear=False)
    # At least as wide as 95 % of edges that differ as the base's do.
    min_ratio = np.exp(2 * 1.96 * scenario.tool.wear_factor_spread)
    assert prediction.high["wear"] / prediction.low["wear"] > min_ratio
    assert "too few edges" in "\n".join(evidence.warnings)
