"""Numbers of measured sets: known laws come back from tables made of them."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from research.studies.measured_sets import h13, main, residual_spreads, vicomtech


def write_table(path: Path, rows: Sequence[dict[str, Any]]) -> Path:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    return path


def run_of(run: int, wear: float) -> dict[str, Any]:
    """Return a run whose forces follow known laws."""
    speed = (310.0, 350.0, 390.0)[run % 3]
    feed = (0.07, 0.1, 0.13, 0.11)[run % 4]
    depth = (0.25, 0.5, 0.8, 0.5, 0.25)[run % 5]
    main_force = 1800.0 * speed**-0.05 * feed**0.7 * depth * (1.0 + 2.0 * wear)
    thrust = 900.0 * feed**0.5 * depth**0.9 * (1.0 + 6.0 * wear)
    return {
        "Run_ID": f"{wear}-{run}",
        "Tool_ID": f"{wear}-{run % 2}",
        "TCond": wear,
        "vc": speed,
        "f": feed,
        "ap": depth,
        "Fx": main_force,
        "Fy": 0.8 * thrust,
        "Fz": 0.6 * thrust,
    }


def test_laws_of_h13_come_back(tmp_path: Path) -> None:
    exp1 = write_table(tmp_path / "Exp1.csv", [run_of(run, wear=0.0) for run in range(30)])
    worn = [run_of(run, wear=wear) for wear in (0.1, 0.3) for run in range(30)]
    # Rows of one run differ in roughness alone.
    exp2 = write_table(tmp_path / "Exp2.csv", [*worn, *worn])
    readings = []
    for edge, factor in (("13", 0.01), ("23", 0.02)):
        for time in (2.0, 10.0, 30.0):
            reading = {
                "Tool_ID": edge,
                "CTime": time,
                "TCond": factor * time**0.8,
                "ap": 0.5,
            }
            readings.append(reading)
    prep = write_table(tmp_path / "Prep.csv", readings)
    numbers = h13(exp1, exp2, prep)

    main_force = numbers["main force"]
    assert main_force["b [1/mm]"] == pytest.approx(2.0)
    assert main_force["exponent of feed"] == pytest.approx(0.7)

    thrust = numbers["thrust force"]
    assert thrust["b [1/mm]"] == pytest.approx(6.0)
    assert thrust["exponent of depth"] == pytest.approx(0.9)
    assert thrust["residuals"] == pytest.approx(0.0, abs=1e-9)

    wear = numbers["wear"]
    # The geometric mean of both edges, and their sample standard deviation.
    mean_factor = (0.01 * 0.02) ** 0.5
    spread = np.log(0.02 / 0.01) / 2.0**0.5
    assert wear["exponent of time"] == pytest.approx(0.8)
    assert wear["K at 0.5 mm [mm]"] == pytest.approx(mean_factor)
    assert wear["log spread of edges, within depths"] == pytest.approx(spread)


def test_lines_of_vicomtech_come_back(tmp_path: Path) -> None:
    def segment(tool: str, wear: float, growth: float) -> dict[str, Any]:
        """Return a row at a wear [mm] of an edge whose thrust grows by a share of it [1/mm]."""
        return {
            "tool": tool,
            "Vb": 1000.0 * wear,
            "F_c_MEAN": 500.0 * (1.0 + wear),
            "F_f_MEAN": 240.0 * (1.0 + growth * wear),
            "F_p_MEAN": 180.0 * (1.0 + growth * wear),
        }

    rows = []
    for tool, growth in (("3", 2.0), ("4", 4.0)):
        rows.append(segment(tool, wear=0.0, growth=growth))
        for second in range(2, 121):
            wear = 0.15 * (second / 60.0) ** 0.9
            rows.append(segment(tool, wear, growth))
    numbers = vicomtech(write_table(tmp_path / "segments.csv", rows))
    assert numbers["main force"]["b [1/mm]"] == pytest.approx(1.0)

    thrust = numbers["thrust force"]
    spread = np.log(4.0 / 2.0) / 2.0**0.5
    assert thrust["F0 [N]"] == pytest.approx(np.hypot(240.0, 180.0))
    assert thrust["b [1/mm]"] == pytest.approx((2.0 + 4.0) / 2)
    assert thrust["log spread of b"] == pytest.approx(spread)

    assert numbers["wear"]["exponent of time"] == pytest.approx(0.9)
    assert numbers["wear"]["K [mm]"] == pytest.approx(0.15)


def test_spreads_within_and_between_edges_are_told_apart() -> None:
    random = np.random.default_rng(1)
    edges = np.repeat(np.arange(200), 20)
    of_edges = 0.1 * random.standard_normal(200)
    of_readings = 0.03 * random.standard_normal(4000)
    spreads = residual_spreads(of_edges[edges] + of_readings, edges)
    assert spreads.within == pytest.approx(0.03, rel=0.1)
    assert spreads.between == pytest.approx(0.1, rel=0.15)


def test_a_missing_table_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["vicomtech", str(tmp_path / "none.csv")]) == 2
    assert "none.csv" in capsys.readouterr().err
