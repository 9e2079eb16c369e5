"""``python -m turning_shop predict`` tests laws on edges or rows that were left out."""

import csv
from pathlib import Path

import numpy as np
import pytest
from turning_shop import WorkshopError
from turning_shop.__main__ import main
from turning_shop.hold_out import hold_out
from turning_shop.measurements import read_measurements

from shop.tests.turning_shop.sheets import forces, wear_curves
from turning_env import Scenario

BASE = Scenario()
WEARS = (0.0, 0.05, 0.1, 0.2, 0.3)


@pytest.fixture
def sheet(tmp_path: Path) -> Path:
    """Return a sheet of forces of eight edges, fresh and worn."""
    path = tmp_path / "cuts.csv"
    path.write_text(forces(0.5, WEARS))
    return path


def test_edges_that_were_left_out_are_predicted(
    sheet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "predictions.csv"
    assert main(["predict", str(sheet), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "thrust_force: 1 + b VB was chosen for 8 of 8 parts" in printed
    rows = list(csv.DictReader(out.read_text().splitlines()))
    assert len(rows) == 2 * 8 * len(WEARS)
    for row in rows:
        within = float(row["low"]) <= float(row["measured"]) <= float(row["high"])
        assert row["holds"] == str(int(within))
    errors = [abs(float(row["predicted"]) / float(row["measured"]) - 1) for row in rows]
    # Readings scatter by 1 %.
    assert np.median(errors) < 0.02
    assert np.mean([row["holds"] == "1" for row in rows]) > 0.9


def test_a_part_of_the_sheet_is_not_known_to_the_law_that_predicts_it(sheet: Path) -> None:
    measurements = read_measurements(sheet)
    before = hold_out(measurements, BASE, by="edge")
    edge = measurements.edges == 0
    measurements.columns["thrust_force"][edge] *= 1.5
    after = hold_out(measurements, BASE, by="edge")
    first = before[0].parts == 1
    assert before[0].response == "thrust_force"
    assert after[0].predicted[first].tolist() == before[0].predicted[first].tolist()
    assert not after[0].holds[first].any()


@pytest.mark.parametrize(("by", "parts"), [("edge", 8), ("row", 8 * len(WEARS)), (3, 3), (None, 8)])
def test_the_sheet_is_divided_as_asked(sheet: Path, by: str | int | None, parts: int) -> None:
    results = hold_out(read_measurements(sheet), BASE, by=by)
    assert results
    for result in results:
        assert len(result.lines) == 8 * len(WEARS)
        assert len(np.unique(result.parts)) == parts


@pytest.mark.slow
def test_wear_over_time_is_predicted(tmp_path: Path) -> None:
    path = tmp_path / "cuts.csv"
    path.write_text(wear_curves())
    results = hold_out(read_measurements(path), BASE, by=None)
    assert [result.response for result in results] == ["wear", "thrust_force", "power"]
    for result in results:
        assert result.holds.mean() > 0.9
        assert np.median(result.errors) < 0.1
        assert 1.0 < result.width < 1.5


@pytest.mark.slow
def test_edges_without_names_cannot_be_left_out(tmp_path: Path) -> None:
    lines = forces(0.5, WEARS).splitlines()
    path = tmp_path / "cuts.csv"
    path.write_text("\n".join(line.partition(";")[2] for line in lines))
    measurements = read_measurements(path)
    with pytest.raises(WorkshopError, match="no column names edges"):
        hold_out(measurements, BASE, by="edge")
    assert len(np.unique(hold_out(measurements, BASE, by=None)[0].parts)) == 8 * len(WEARS)


def test_a_sheet_of_one_edge_cannot_be_predicted(tmp_path: Path) -> None:
    path = tmp_path / "cuts.csv"
    path.write_text("edge,vc,f,ap,VB,Fc\n1,200,0.2,2,0.1,900\n1,200,0.2,2,0.2,950\n")
    assert main(["predict", str(path)]) == 2


RAW = """tool,Vb,Fx,Fy,Fz,F
1,0,500,300,200,620
1,100,540,420,270,740
1,200,570,540,360,860
2,0,510,290,190,610
2,100,555,400,265,735
2,200,590,560,340,880
"""
CONSTANTS = "vc=300,f=0.2,ap=1.5"
FORCES = ["--forces", "Fc=Fx,Ff=Fy,Fp=Fz"]


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ([], "--set cutting_speed=X"),
        (["--set", CONSTANTS], "--forces Fc=Fx,Ff=Fy,Fp=Fz"),
        (["--set", CONSTANTS, *FORCES], "--unit wear=um"),
        (["--set", CONSTANTS, "--unit", "time=s"], "there is no column time"),
        (["--set", CONSTANTS + ",VB=0.1"], "column 'Vb' is wear already"),
    ],
)
def test_what_a_raw_sheet_lacks_is_asked_for_with_the_option_that_tells_it(
    options: list[str], fault: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "raw.csv"
    path.write_text(RAW)
    assert main(["predict", str(path), *options]) == 2
    assert fault in capsys.readouterr().err


def test_a_raw_sheet_is_read_as_it_comes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "raw.csv"
    path.write_text(RAW)
    out = tmp_path / "made.toml"
    told = ["--set", CONSTANTS, "--unit", "wear=um", *FORCES]
    assert main(["calibrate", str(path), "--out", str(out), *told]) == 0
    printed = capsys.readouterr().out
    assert "wear [mm] from 'Vb' times 0.001" in printed
    assert "cutting_speed 300 m/min in all rows" in printed
    material = Scenario.load(out).material
    fresh_force = np.hypot(295, 195)
    assert material.thrust_force(
        300,
        0.2,
        1.5,
        wear=0.0,
    ) == pytest.approx(fresh_force, rel=0.05)
    assert material.power(
        300,
        0.2,
        1.5,
        wear=0.0,
    ) == pytest.approx(505 * 300 / 60e3, rel=0.03)


@pytest.mark.parametrize(
    ("option", "named"),
    [
        (["--unit", "wear=kg"], "wear is not measured in 'kg'"),
        (["--set", "wear=x"], "wear: 'x' is no number"),
        (["--forces", "Fq=Fx"], "'Fq=Fx' is not allowed"),
        (["--set", "vc=0"], "0 is outside"),
    ],
)
def test_malformed_options_are_refused(
    option: list[str], named: str, sheet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["predict", str(sheet), *option])
    assert named in capsys.readouterr().err


def test_readings_beyond_the_others_are_marked(
    sheet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = sheet.read_text().splitlines()
    # The first edge alone is this deep; its speed and feed are those of others, too.
    deep = [line.replace("1;150;0.2;2;", "1;150;0.2;4;") for line in lines]
    sheet.write_text("\n".join(deep))
    result = hold_out(read_measurements(sheet), BASE, by="edge")[0]
    assert result.extrapolated.tolist() == (result.parts == 1).tolist()
    assert main(["predict", str(sheet)]) == 0
    printed = capsys.readouterr().out
    assert f"{len(WEARS)} readings lie outside the settings, time or wear" in printed
