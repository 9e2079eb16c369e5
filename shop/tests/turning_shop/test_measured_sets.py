"""The program for public sets finds the laws and the growth that made-up tables have."""

import runpy
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from turning_shop.measurements import read_measurements

PROGRAM = Path(__file__).parents[2] / "examples" / "measured_sets.py"
Main = Callable[[str, str, Path], None]
WEAR = np.linspace(0.0, 0.4, 41)
FIRST_SEEN_WORN = 0.2  # wear of the first reading of the last tool [mm]


@pytest.fixture(scope="module")
def main() -> Main:
    return runpy.run_path(str(PROGRAM))["main"]


@pytest.fixture
def vicomtech(tmp_path: Path) -> Path:
    """Return a table of six edges, whose forces grow in proportion to 1 + b VB."""
    random = np.random.default_rng(1)
    lines = ["tool,Vb,F_c_MEAN,F_f_MEAN,F_p_MEAN"]
    for tool in range(6):
        scale = np.exp(0.1 * random.standard_normal())
        for wear in WEAR:
            if tool == 5 and wear < FIRST_SEEN_WORN:
                continue
            scatter = np.exp(0.005 * random.standard_normal(2))
            main_force = 500.0 * scale * (1.0 + 2.0 * wear) * scatter[0]
            feed_force = 400.0 * scale * (1.0 + 4.0 * wear) * scatter[1]
            lines.append(f"{tool},{1000.0 * wear:.1f},{main_force:.2f},{feed_force:.2f},1")
    path = tmp_path / "vicomtech.csv"
    path.write_text("\n".join(lines), "utf-8")
    return path


@pytest.fixture
def h13(tmp_path: Path) -> Path:
    """Return a folder with tables of forces of fresh and worn edges, and of wear over time.

    Thrust forces are 50, 100 and 300 N at 0, 0.1 and 0.3 mm.
    """
    forces = ["Run_ID,Tool_ID,TCond,ap,vc,f,Fx,Fy,Fz"]
    for edge, (wear, thrust) in enumerate(((0.0, 50.0), (0.1, 100.0), (0.3, 300.0)) * 2):
        for run in range(3):
            passive = thrust * (1.0 + 0.01 * run)
            row = f"run{edge}{run},{edge},{wear},0.25,350,0.1,{80 + edge + run},{passive},0.1"
            # Readings of roughness repeat the forces of their run.
            forces += [row, row]
    wears = ["Tool_ID,CTime,TCond,ap,vc,f"]
    for edge in range(4):
        for time in (2.0, 4.0, 8.0, 16.0):
            wear = 0.02 * time**0.8 * (1.0 + 0.1 * edge)
            wears += [f"{edge},{time},{wear:.4f},0.5,350,0.1"] * 2
    folder = tmp_path / "h13"
    folder.mkdir()
    for name, lines in (("Exp1", forces), ("Exp2", forces), ("Prep", wears)):
        (folder / f"{name}.csv").write_text("\n".join(lines), "utf-8")
    return folder


@pytest.mark.slow
def test_it_finds_the_growth_of_vicomtech(
    main: Main, vicomtech: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main("vicomtech", str(vicomtech), tmp_path)
    printed = capsys.readouterr().out
    assert "form: 1 + b VB, as 5 rows are of fresh edges" in printed
    assert "thrust_force: 1 + b VB better on 6 of 6 edges" in printed
    assert "from 0.1 to 0.3 mm x1.57 (mean of 5)" in printed
    assert "| Vicomtech | thrust force | 226 |" in printed
    # The time of the tool that was worn at first is not known.
    sheet = read_measurements(tmp_path / "vicomtech_1.csv")
    assert np.isnan(sheet.columns["time"]).sum() == 21
    assert sheet.columns["wear"].max() == pytest.approx(0.4)


@pytest.mark.slow
def test_it_finds_the_share_of_a_fresh_edge_and_the_wear_of_h13(
    main: Main, h13: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main("h13", str(h13), tmp_path)
    printed = capsys.readouterr().out
    assert "thrust_force: exponent 1.00; from 0.1 to 0.3 mm x3.00 (mean of 1)" in printed
    assert "thrust_force: a fresh edge has 50 % of the force at 0.1 mm" in printed
    assert "| H13, Exp2 | thrust force | 18 |" in printed
    assert "| H13, Prep | wear | 16 |" in printed


def test_it_predicts_each_pair_of_aist_by_itself(
    main: Main, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    random = np.random.default_rng(2)
    names = "organization,work_material,tool_material,nose_radius_mm"
    lines = [f"{names},cutting_speed_m_min,feed_mm_rev,depth_of_cut_mm,time_min,flank_wear_mm"]
    for material, scale in (("S45C", 1.0), ("FC250", 3.0)):
        for speed in (100, 150, 200, 250, 300):
            for time in (1, 2, 4, 8):
                wear = 0.03 * scale * (speed / 200) ** 2 * time**0.6
                wear *= np.exp(0.02 * random.standard_normal())
                lines.append(f"A,{material},P20,0.8,{speed},0.3,1.5,{time},{wear:.4f}")
    path = tmp_path / "aist.csv"
    path.write_text("\n".join(lines), "utf-8")
    main("aist", str(path), tmp_path)
    row = capsys.readouterr().out.splitlines()[-1]
    assert row.startswith("| AIST, 2 pairs of materials | wear | 40 |")
    errors = float(row.split("|")[5].removesuffix(" % "))
    assert errors < 5.0
