"""The check against measured wear, on made-up data that follow its model."""

from pathlib import Path

import numpy as np
import pytest

from studies.measured_wear import curves, estimate, main, predict, read

HEADER = "organization,work_material,tool_material,cutting_speed_m_min,feed_mm_rev,depth_of_cut_mm,time_min,flank_wear_mm"


def sheet(folder: Path, edge: float, reading: float) -> Path:
    rng, lines = np.random.default_rng(2), [HEADER]
    for pair in range(12):
        level, power = rng.normal(0, 0.5), 0.4 + rng.normal(0, 0.1)
        for speed in (100, 150, 200):
            own = level + edge * rng.normal()
            for time in (1, 2, 4, 8, 16, 32, 64):
                wear = 0.05 * (speed / 150) ** 1.2 * time**power * np.exp(own + reading * rng.normal())
                lines.append(f"A,steel {pair},carbide,{speed},0.1,0.5,{time},{wear:.6f}")
    (folder / "wear.csv").write_text("\n".join(lines))
    return folder / "wear.csv"


@pytest.mark.slow
def test_variances_and_intervals_are_found(tmp_path: Path) -> None:
    readings = read(sheet(tmp_path, 0.2, 0.1))
    assert len(readings.pairs()) == 12
    found = estimate(readings)
    assert found.edge**0.5 == pytest.approx(0.2, abs=0.06)
    assert found.reading**0.5 == pytest.approx(0.1, abs=0.01)
    out = readings.edge % 3 == 0
    centre, deviation = predict(readings.of(~out), readings.of(out), found)
    assert 0.85 < (np.abs(readings.wear[out] - centre) < 1.96 * deviation).mean() <= 1.0


def test_the_power_law_is_recognised(tmp_path: Path) -> None:
    found = curves(read(sheet(tmp_path, 0.2, 0.03)))
    assert found["edges"] == 36
    assert found["median_exponent"] == pytest.approx(0.4, abs=0.1)
    assert found["line_better"] < 0.1


def test_a_wrong_sheet_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cuts.csv").write_text("speed\n1\n")
    assert main([str(tmp_path / "cuts.csv")]) == 2
    assert "work_material" in capsys.readouterr().err
