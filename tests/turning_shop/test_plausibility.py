"""Calibration refuses nonsense: forty wrong sheets, each with the exit status and the words that its message must hold."""

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest

from turning_env import Scenario
from turning_env.__main__ import main
from turning_shop.calibrate import Implausible, calibrate
from turning_shop.measurements import Measurements, read_measurements

MATERIAL = Scenario().material
Row = dict[str, float]


def rows(count: int = 27, scatter: float = 0.03) -> list[Row]:
    """Return rows that the default material scatters about."""
    rng = np.random.default_rng(5)
    made = []
    for index in range(count):
        v, f, d, t = (
            (60.0, 110.0, 180.0)[index % 3],
            (0.15, 0.25, 0.4)[index // 3 % 3],
            (1.5, 2.0, 3.0)[index // 9 % 3],
            2.0 + index % 5 * 3,
        )
        wear = float(MATERIAL.wear(v, f, d, time=t) * np.exp(scatter * rng.normal()))
        force, power = (
            float(law(v, f, d, wear=wear) * np.exp(scatter * rng.normal())) for law in (MATERIAL.thrust_force, MATERIAL.power)
        )
        made.append(
            {"cutting_speed": v, "feed": f, "depth_of_cut": d, "time": t, "wear": wear, "thrust_force": force, "power": power}
        )
    return made


def text(table: list[Row], header: str = "", separator: str = ",") -> str:
    lines = [header or separator.join(table[0])]
    return "\n".join(lines + [separator.join(f"{value:.6g}" for value in row.values()) for row in table]) + "\n"


def scaled(column: str, factor: float, lines: Iterable[int] | None = None) -> str:
    """Return the sheet with a column times a factor, in all rows or only in some lines of the file."""
    table = rows()
    for line, row in enumerate(table, 2):
        if lines is None or line in lines:
            row[column] *= factor
    return text(table)


def replaced(column: str, law: Callable[[float, float, float, float], float]) -> str:
    """Return the sheet with a column by a law of speed in 100 m/min, feed, depth and time; without the other responses."""
    names = ["cutting_speed", "feed", "depth_of_cut", "time", "wear", column]
    table = [{name: row[name] for name in names} for row in rows()]
    for row in table:
        row[column] = law(row["cutting_speed"] / 100, row["feed"], row["depth_of_cut"], row["time"])
    return text(table)


def both(*steps: tuple[str, float]) -> str:
    table = rows()
    for column, factor in steps:
        for row in table:
            row[column] *= factor
    return text(table)


GOOD = text(rows())
HEADER = GOOD.partition("\n")[0]


def named(old: str, new: str) -> str:
    return GOOD.replace(old, new, 1)


WRONG: list[tuple[str, int, tuple[str, ...]]] = [
    # All rows in a wrong unit.
    (scaled("power", 1000), 1, ("power looks like W", "lines 2 to 28")),
    (scaled("power", 0.001), 1, ("power looks like MW",)),
    (scaled("time", 60), 1, ("tool life", "time looks like seconds")),
    (scaled("time", 1 / 3600), 1, ("tool life",)),
    (scaled("feed", 1 / 25.4), 1, ("feed looks like inches",)),
    (scaled("depth_of_cut", 1 / 25.4), 1, ("depth_of_cut looks like inches",)),
    (both(("feed", 1 / 25.4), ("depth_of_cut", 1 / 25.4)), 1, ("feed and depth_of_cut look like inches",)),
    (scaled("cutting_speed", 1 / 60), 1, ("cutting_speed looks like m/s",)),
    (scaled("thrust_force", 0.001), 1, ("thrust_force looks like kN",)),
    (scaled("wear", 1 / 25.4), 1, ("tool life", "wear looks like inches")),
    (scaled("wear", 1000), 2, ("wear", "allowed range")),
    (scaled("feed", 1000), 2, ("feed", "allowed range")),
    # A typing error or two.
    (scaled("power", 10, [7]), 1, ("line 7", "is power", "10 times")),
    (scaled("power", 0.1, [7, 19]), 1, ("line 7", "line 19", "is power")),
    (scaled("power", 1000, [28]), 1, ("line 28", "is power")),
    (scaled("thrust_force", 10, [4]), 1, ("line 4", "is thrust_force")),
    (scaled("wear", 10, [9]), 1, ("line 9", "is wear")),
    (scaled("wear", 0.1, [9, 10]), 1, ("line 9", "line 10", "is wear")),
    (scaled("cutting_speed", 10, [12]), 1, ("line 12", "is cutting_speed")),
    (scaled("cutting_speed", 0.1, [12]), 1, ("line 12", "is cutting_speed")),
    (scaled("feed", 10, [15]), 1, ("line 15", "is feed")),
    (scaled("depth_of_cut", 10, [17]), 1, ("line 17", "is depth_of_cut")),
    (scaled("depth_of_cut", 0.1, [2, 3]), 1, ("line 2:", "line 3:", "is depth_of_cut")),
    (scaled("time", 60, [20]), 1, ("line 20", "is time", "60 times")),
    (scaled("power", 25.4, [20]), 1, ("line 20", "is power", "25.4 times")),
    # Laws that cannot be.
    (replaced("wear", lambda v, f, d, t: 0.1 * t**0.2 / v), 1, ("wear: falls with cutting_speed",)),
    (replaced("wear", lambda v, f, d, t: 0.012 * t**0.9 * v**0.8), 1, ("Taylor exponent",)),
    (replaced("power", lambda v, f, d, t: 1.2 * v * d * f**-0.2), 1, ("power: falls with feed",)),
    (replaced("thrust_force", lambda v, f, d, t: 900 / d), 1, ("thrust_force: falls with depth_of_cut",)),
    # Sheets that cannot be read.
    (named("feed", "f [mm/min]"), 2, ("feed", "mm/min")),
    (named("power", "P [Nm]"), 2, ("power", "Nm")),
    (named("feed", "vf"), 2, ("no column feed",)),
    (named("wear", "ap"), 2, ("more than one column depth_of_cut",)),
    (named("power", "vc"), 2, ("more than one column cutting_speed",)),
    (HEADER, 2, ("no rows",)),
    ("", 2, ("is empty",)),
    (GOOD.replace("\n", "\n1,2\n", 1), 2, ("line 2 has 2 cells",)),
    (GOOD + "fast,0.3,2.5,1,0.1,900,3\n", 2, ("line 29", "cutting_speed", "not a number")),
    (GOOD.replace(",", ";").replace(".", ",") + "100;0.3;2,5;1;0,1;900;3\n", 2, ("line 29", "feed", "decimal commas")),
    (GOOD + "-100,0.3,2.5,1,0.1,900,3\n", 2, ("line 29", "cutting_speed", "allowed range")),
    ("\n".join(GOOD.splitlines()[:5]), 2, ("rows", "needed")),
    (GOOD + '"100', 2, ("is not CSV",)),
]  # fmt: skip


@pytest.mark.parametrize(("sheet", "status", "words"), WRONG, ids=range(len(WRONG)))
def test_wrong_sheets_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sheet: str, status: int, words: tuple[str, ...]
) -> None:
    (tmp_path / "cuts.csv").write_text(sheet)
    assert main(["calibrate", str(tmp_path / "cuts.csv"), "--out", str(tmp_path / "made.toml")]) == status
    printed = capsys.readouterr()
    assert not printed.out
    assert [word for word in words if word not in printed.err] == []
    assert not (tmp_path / "made.toml").exists()


def test_there_are_forty() -> None:
    assert len(WRONG) >= 40


def test_a_good_sheet_is_plausible(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cuts.csv").write_text(GOOD)
    assert main(["calibrate", str(tmp_path / "cuts.csv"), "--out", str(tmp_path / "made.toml")]) == 0
    assert "implausible" not in capsys.readouterr().err


def measured(change: Callable[[dict[str, np.ndarray]], None]) -> Measurements:
    columns = {name: np.array([row[name] for row in rows()]) for name in rows()[0]}
    change(columns)
    return Measurements(columns, np.arange(2, 29))


def test_the_robust_law_is_that_of_the_other_rows() -> None:
    def change(columns: dict[str, np.ndarray]) -> None:
        columns["cutting_speed"][3] *= 10.0  # far out, so that it draws a law of least squares to its row
        columns["power"][8] *= 0.01

    with pytest.raises(Implausible) as error:
        calibrate(measured(change), Scenario())
    assert all(any(f"line {line}" in problem for problem in error.value.problems) for line in (5, 10))
    forced = calibrate(measured(change), Scenario(), force=True)
    assert forced.robust["power"].exponents["cutting_speed"] == pytest.approx(MATERIAL.power.cutting_speed, abs=0.1)
    assert abs(forced.material.power.cutting_speed - MATERIAL.power.cutting_speed) > 0.2
    assert np.flatnonzero(forced.robust["power"].outlying).tolist() == [3, 8]
    assert forced.problems


def test_an_unusual_edge_is_no_typing_error() -> None:
    def change(columns: dict[str, np.ndarray]) -> None:
        for name in ("cutting_speed", "feed", "depth_of_cut"):
            columns[name][:4] = columns[name][0]
        columns["time"][:4] = (2.0, 4.0, 8.0, 14.0)
        columns["wear"][:4] = 2.5 * MATERIAL.wear(
            *(columns[name][:4] for name in ("cutting_speed", "feed", "depth_of_cut", "time"))
        )
        del columns["thrust_force"], columns["power"]

    found = calibrate(measured(change), Scenario())
    assert any("lines 2 to 5" in warning for warning in found.warnings)


def test_warnings_travel_with_the_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "cuts.csv").write_text(scaled("power", 1000))
    made = str(tmp_path / "made.toml")
    assert main(["calibrate", str(tmp_path / "cuts.csv"), "--out", made, "--force"]) == 0
    (tmp_path / "child.toml").write_text('base = "made.toml"\n[limits]\npower = 9.0\n')
    for source in (made, str(tmp_path / "child.toml")):
        capsys.readouterr()
        assert main(["whatif", source, "--cutting-speed", "100", "--feed", "0.25", "--wear", "0.15"]) == 0
        assert "power looks like W" in capsys.readouterr().err


def test_the_calibration_is_no_part_of_the_identity(tmp_path: Path) -> None:
    (tmp_path / "cuts.csv").write_text(GOOD)
    made = tmp_path / "made.toml"
    main(["calibrate", str(tmp_path / "cuts.csv"), "--out", str(made)])
    scenario = Scenario.load(made)
    assert scenario.calibration["source"] == "cuts.csv"
    made.write_text(made.read_text().partition("[calibration]")[0])
    plain = Scenario.load(made)
    assert plain.calibration is None
    assert plain == scenario
    assert plain.digest() == scenario.digest()


def test_columns_are_read_however_they_are_written(tmp_path: Path) -> None:
    table = [row | {"time": 60 * row["time"], "wear": 1000 * row["wear"], "power": 1000 * row["power"]} for row in rows()]
    header = "vc [m/min];fn [mm/U];ap;t [s];VB [µm];Vorschubkraft;P [W]"
    (tmp_path / "cuts.csv").write_text(text(table, header, ";").replace(".", ","), "cp1252")
    found = read_measurements(tmp_path / "cuts.csv")
    for name, column in found.columns.items():
        assert column == pytest.approx([row[name] for row in rows()], rel=1e-4)
