"""Calibration refuses implausible sheets, and names what is wrong in them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from turning_shop.calibrate import ImplausibleError, calibrate
from turning_shop.measurements import Measurements

from turning_env import Scenario
from turning_env.__main__ import main

MATERIAL = Scenario().material
FIRST_LINE = 2
ROWS = 27


def sheet() -> dict[str, np.ndarray]:
    """Return columns of a sheet that the default material scatters about."""
    index = np.arange(ROWS)
    scatter = np.random.default_rng(5).normal(scale=0.03, size=(ROWS, 3)).T
    settings = {
        "cutting_speed": np.array([60.0, 110.0, 180.0])[index % 3],
        "feed": np.array([0.15, 0.25, 0.4])[index // 3 % 3],
        "depth_of_cut": np.array([1.5, 2.0, 3.0])[index // 9 % 3],
    }
    time = 2.0 + index % 5 * 3
    wear = MATERIAL.wear(**settings, time=time) * np.exp(scatter[0])
    force = MATERIAL.thrust_force(**settings, wear=wear) * np.exp(scatter[1])
    power = MATERIAL.power(**settings, wear=wear) * np.exp(scatter[2])
    return settings | {"time": time, "wear": wear, "thrust_force": force, "power": power}


def text(columns: dict[str, np.ndarray], header: str = "", separator: str = ",") -> str:
    rows = [
        separator.join(f"{value:.6g}" for value in row)
        for row in np.column_stack(list(columns.values()))
    ]
    return "\n".join([header or separator.join(columns), *rows]) + "\n"


def times(factor: float, *names: str, lines: tuple[int, ...] = ()) -> str:
    """Return the sheet with columns times a factor, in all rows or in some lines of the file."""
    columns = sheet()
    rows = np.arange(ROWS)
    if lines:
        rows = np.array(lines) - FIRST_LINE
    for name in names:
        columns[name][rows] *= factor
    return text(columns)


def by_law(name: str, law: Callable[..., np.ndarray]) -> str:
    """Return the sheet with one response by a law of speed [100 m/min], feed, depth and time.

    Force and power are left out unless they are this response.
    """
    columns = sheet()
    del columns["thrust_force"]
    del columns["power"]
    columns[name] = law(
        columns["cutting_speed"] / 100,
        columns["feed"],
        columns["depth_of_cut"],
        columns["time"],
    )
    return text(columns)


WRONG = [
    # All rows in a wrong unit.
    (times(1000, "power"), ("power looks like W", "lines 2 to 28")),
    (times(60, "time"), ("tool life", "time looks like seconds")),
    (times(1 / 25.4, "feed", "depth_of_cut"), ("feed and depth_of_cut look like inches",)),
    (times(1 / 60, "cutting_speed"), ("cutting_speed looks like m/s",)),
    (times(0.001, "thrust_force"), ("thrust_force looks like kN",)),
    (times(1 / 25.4, "wear"), ("tool life", "wear looks like inches")),
    # A typing error or two.
    (times(10, "power", lines=(7,)), ("line 7: power is",)),
    (times(0.1, "power", lines=(7, 19)), ("line 7", "line 19")),
    (times(10, "thrust_force", lines=(4,)), ("line 4: thrust_force is",)),
    (times(0.1, "wear", lines=(9, 10)), ("line 9", "line 10")),
    (times(10, "cutting_speed", lines=(12,)), ("line 12",)),
    (times(0.1, "depth_of_cut", lines=(2, 3)), ("line 2:", "line 3:")),
    (times(60, "time", lines=(20,)), ("line 20: wear is",)),
    # Laws that cannot be.
    (by_law("wear", lambda v, f, d, t: 0.1 * t**0.2 / v), ("wear: falls with cutting_speed",)),
    (by_law("wear", lambda v, f, d, t: 0.012 * t**0.9 * v**0.8), ("Taylor exponent",)),
    (by_law("power", lambda v, f, d, t: 1.2 * v * d * f**-0.2), ("power: falls with feed",)),
    (
        by_law("thrust_force", lambda v, f, d, t: 900 / d),
        ("thrust_force: falls with depth_of_cut",),
    ),
]


@pytest.mark.parametrize(("content", "words"), WRONG, ids=range(len(WRONG)))
def test_wrong_sheets_are_refused(
    tmp_path: Path, capsys: Any, content: str, words: tuple[str, ...]
) -> None:
    (tmp_path / "cuts.csv").write_text(content)
    command = ["calibrate", str(tmp_path / "cuts.csv"), "--out", str(tmp_path / "made.toml")]
    assert main(command) == 1
    printed = capsys.readouterr()
    assert not printed.out
    for word in words:
        assert word in printed.err
    assert not (tmp_path / "made.toml").exists()


def test_a_good_sheet_is_plausible_however_it_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    columns = sheet()
    columns["time"] *= 60.0
    columns["wear"] *= 1000.0
    columns["power"] *= 1000.0
    header = "vc [m/min];fn [mm/U];ap;t [s];VB [µm];thrust force;P [W]"
    command = ["calibrate", str(tmp_path / "cuts.csv"), "--out", str(tmp_path / "made.toml")]
    for content in (text(sheet()), text(columns, header, ";").replace(".", ",")):
        (tmp_path / "cuts.csv").write_text(content, "cp1252")
        assert main([*command, "--overwrite"]) == 0
        assert "implausible" not in capsys.readouterr().err


def measured(**columns: np.ndarray) -> Measurements:
    return Measurements(sheet() | columns, np.arange(FIRST_LINE, FIRST_LINE + ROWS))


def test_the_robust_law_is_that_of_the_other_rows() -> None:
    wrong = measured()
    # So far out that a law of least squares is drawn to this row.
    wrong.columns["cutting_speed"][3] *= 10.0
    wrong.columns["power"][8] *= 0.01
    with pytest.raises(ImplausibleError) as error:
        calibrate(wrong, Scenario())
    problems = "\n".join(error.value.problems)
    assert "line 5" in problems
    assert "line 10" in problems
    forced = calibrate(wrong, Scenario(), force=True)
    assert abs(forced.material.power.cutting_speed - MATERIAL.power.cutting_speed) > 0.2
    assert forced.problems


def test_an_unusual_edge_is_no_typing_error() -> None:
    columns = sheet()
    del columns["thrust_force"]
    del columns["power"]
    del columns["wear"]
    wear = sheet()["wear"]
    for name in ("cutting_speed", "feed", "depth_of_cut"):
        columns[name][:4] = columns[name][0]
    columns["time"][:4] = (2.0, 4.0, 8.0, 14.0)
    first_edge = {name: values[:4] for name, values in columns.items()}
    wear[:4] = 2.5 * MATERIAL.wear(**first_edge)
    columns["wear"] = wear
    found = calibrate(replace(measured(), columns=columns), Scenario())
    assert any("lines 2 to 5" in warning for warning in found.warnings)


def test_warnings_travel_with_the_file_and_are_no_part_of_its_identity(
    tmp_path: Path, capsys: Any
) -> None:
    (tmp_path / "cuts.csv").write_text(times(1000, "power"))
    made = tmp_path / "made.toml"
    child = tmp_path / "child.toml"
    assert main(["calibrate", str(tmp_path / "cuts.csv"), "--out", str(made), "--force"]) == 0
    child.write_text('base = "made.toml"\n[limits]\npower = 9.0\n')
    settings = ["--cutting-speed", "100", "--feed", "0.25", "--wear", "0.15"]
    for source in (made, child):
        capsys.readouterr()
        assert main(["whatif", str(source), *settings]) == 0
        assert "power looks like W" in capsys.readouterr().err
    scenario = Scenario.load(made)
    made.write_text(made.read_text().partition("[calibration]")[0])
    plain = Scenario.load(made)
    assert plain.calibration is None
    assert plain == scenario
    assert plain.digest() == scenario.digest()
