"""Rows that a law cannot hold: fresh edges, forms that do not fit, and copies.

True rows are never called wrong.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from turning_shop import WorkshopError
from turning_shop.calibrate import calibrate
from turning_shop.measurements import read_measurements
from turning_shop.prediction import predict
from turning_shop.provenance import load
from turning_shop.whatif import what_if

from shop.tests.turning_shop.sheets import forces
from turning_env import Scenario
from turning_env.__main__ import main

BASE = Scenario()
NEAR_ZERO = (0.002, 0.01, 0.03, 0.06, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35)


def written(folder: Path, text: str) -> Path:
    path = folder / "cuts.csv"
    path.write_text(text, "utf-8")
    return path


def test_forces_near_a_fresh_edge_are_a_misfit_of_the_form(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sheet = written(tmp_path, forces(0.4, NEAR_ZERO))
    assert main(["calibrate", str(sheet), "--out", str(tmp_path / "made.toml")]) == 0
    assert "implausible" not in capsys.readouterr().err
    scenario, evidence = load(tmp_path / "made.toml")
    (warning,) = [text for text in evidence.warnings if "form" in text]
    assert "thrust_force" in warning
    low, high = evidence.laws["thrust_force"].measured["wear"]
    assert 0.01 < low < 0.2
    assert high == 0.35
    # Where the law holds, it agrees with the formula, and it says where it does not hold.
    for wear in (0.2, 0.3):
        cut = what_if(scenario, 190, 0.25, 1.5, wear=wear)
        assert cut.thrust_force == pytest.approx(900 * 0.25**0.6 * 1.5 * (1 + 5 * wear), rel=0.06)
    near = what_if(scenario, 190, 0.25, 1.5, wear=0.01)
    assert predict(scenario, evidence, near, of_wear=True).extrapolated


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


def test_fresh_edges_tell_the_exponents(tmp_path: Path) -> None:
    sheet = written(tmp_path, forces(0.5, (0.0, 0.1, 0.2, 0.3)))
    with_fresh = calibrate(read_measurements(sheet), BASE)
    for name, feed in (("thrust_force", 0.6), ("power", 0.74)):
        found = with_fresh.fits[name]
        assert found.fresh.sum() == 8
        assert found.law.feed == pytest.approx(feed, abs=0.05)
        assert found.law.depth_of_cut == pytest.approx(1.0, abs=0.05)
    sheet = written(tmp_path, forces(0.5, (0.1, 0.2, 0.3)))
    without = calibrate(read_measurements(sheet), BASE)
    assert with_fresh.material.power.wear == pytest.approx(without.material.power.wear, abs=0.02)
    # Eight rows more, and one parameter more: the level of fresh edges.
    assert with_fresh.fits["power"].degrees == without.fits["power"].degrees + 7


def test_a_sheet_of_fresh_edges_gives_laws_that_hold_for_them_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sheet = written(tmp_path, forces(0.5, (0.0,)))
    assert main(["calibrate", str(sheet), "--out", str(tmp_path / "made.toml")]) == 0
    printed = re.search(r"kc1.1 (\d+) N/mm2, mc (\S+) at", capsys.readouterr().out)
    assert printed is not None
    assert float(printed[1]) == pytest.approx(1800, rel=0.12)
    assert float(printed[2]) == pytest.approx(0.26, rel=0.12)
    scenario, evidence = load(tmp_path / "made.toml")
    assert any("fresh edges" in warning for warning in evidence.warnings)
    worn = what_if(scenario, 190, 0.3, 2.0, wear=0.2)
    assert worn.power == pytest.approx(1800 * 0.3**0.74 * 2 * 190 / 60e3, rel=0.03)
    assert predict(scenario, evidence, worn, of_wear=True).extrapolated


def test_a_start_at_time_0_and_wear_0_is_a_measurement(tmp_path: Path) -> None:
    rows = ["edge,vc,f,ap,time,VB"]
    for speed, edge_factor in ((150, 1.0), (200, 1.05), (250, 0.97)):
        for time in (0, 2, 5, 9):
            wear = 0.05 * (speed / 150) ** 2 * time**0.5 * edge_factor
            rows.append(f"{speed},{speed},0.3,2,{time},{wear}")
    measured = read_measurements(written(tmp_path, "\n".join(rows)))
    found = calibrate(measured, BASE)
    assert len(found.fits["wear"].lines) == 9
    assert found.material.wear.time == pytest.approx(0.5, abs=0.01)
    assert not any("empty cells" in warning for warning in found.warnings)


COPY = "1;210;0.32;2;12;0.22;1700\n"


@pytest.mark.parametrize(
    "rows",
    [
        [COPY] * 9,
        [f"{edge};210;0.32;2;12;0.22;1700\n" for edge in range(9)],
        [f"1;210;0.32;2;12;{0.22 + 0.0001 * (k % 3)};{1700 + k % 2}\n" for k in range(9)],
    ],
    ids=["copies", "copies under other names", "to rounding"],
)
def test_copies_are_one_reading(tmp_path: Path, rows: list[str]) -> None:
    measured = read_measurements(written(tmp_path, "edge;vc;f;ap;time;VB;Fc\n" + "".join(rows)))
    with pytest.raises(WorkshopError, match=r"1 row .*8 rows repeat others.* lines 3 to 10"):
        calibrate(measured, BASE)


def test_copies_do_not_narrow_intervals(tmp_path: Path) -> None:
    text = forces(0.5, (0.1, 0.2, 0.3))
    header, *rows = text.splitlines(keepends=True)
    once = calibrate(read_measurements(written(tmp_path, text)), BASE)
    copied = written(tmp_path, header + "".join(3 * rows))
    thrice = calibrate(read_measurements(copied), BASE)
    assert np.allclose(thrice.fits["power"].covariance, once.fits["power"].covariance)
    assert any("48 rows repeat others" in warning for warning in thrice.warnings)


def test_one_edge_does_not_tell_how_edges_differ(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [f"1;200;0.3;2;{time};{0.06 * time**0.5:.4f}" for time in (2, 4, 8, 12, 16)]
    sheet = written(tmp_path, "\n".join(["edge;vc;f;ap;time;VB", *rows]))
    assert main(["calibrate", str(sheet), "--out", str(tmp_path / "made.toml")]) == 0
    scenario, evidence = load(tmp_path / "made.toml")
    cut = what_if(scenario, 200, 0.3, 2, time=8)
    found = predict(scenario, evidence, cut, of_wear=False)
    # At least as wide as 95 % of edges that differ as the base's do.
    min_ratio = np.exp(2 * 1.96 * scenario.tool.wear_factor_spread)
    assert found.high["wear"] / found.low["wear"] > min_ratio
    assert any("too few edges" in warning for warning in evidence.warnings)
