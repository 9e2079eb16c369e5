"""Calibration refuses implausible sheets, and names what is wrong in them."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from turning_shop.__main__ import main
from turning_shop.calibrate import ImplausibleError, calibrate
from turning_shop.measurements import Measurements

from turning_env import Scenario

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
    return settings | {
        "time": time,
        "wear": wear,
        "thrust_force": force,
        "power": power,
    }


def text(columns: dict[str, np.ndarray], header: str = "", separator: str = ",") -> str:
    """Return a sheet as text, with the names of the columns unless a header is given."""
    rows = [header or separator.join(columns)]
    for values in zip(*columns.values(), strict=True):
        rows.append(separator.join(f"{value:.6g}" for value in values))
    return "\n".join(rows) + "\n"


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


WRONG = {
    # All rows in a wrong unit.
    "power in W": (times(1000, "power"), ["power looks like W", "lines 2 to 28"]),
    "time in s": (times(60, "time"), ["tool life", "time looks like seconds"]),
    "lengths in inches": (
        times(1 / 25.4, "feed", "depth_of_cut"),
        ["feed and depth_of_cut look like inches"],
    ),
    "speed in m/s": (times(1 / 60, "cutting_speed"), ["cutting_speed looks like m/s"]),
    "force in kN": (times(0.001, "thrust_force"), ["thrust_force looks like kN"]),
    "wear in inches": (times(1 / 25.4, "wear"), ["tool life", "wear looks like inches"]),
    # A typing error or two.
    "one power": (times(10, "power", lines=(7,)), ["line 7: power is"]),
    "two powers": (times(0.1, "power", lines=(7, 19)), ["line 7", "line 19"]),
    "one force": (times(10, "thrust_force", lines=(4,)), ["line 4: thrust_force is"]),
    "two wears": (times(0.1, "wear", lines=(9, 10)), ["line 9", "line 10"]),
    "one speed": (times(10, "cutting_speed", lines=(12,)), ["line 12"]),
    "two depths": (times(0.1, "depth_of_cut", lines=(2, 3)), ["line 2:", "line 3:"]),
    "one time": (times(60, "time", lines=(20,)), ["line 20: wear is"]),
    # Laws that cannot be.
    "wear that falls with speed": (
        by_law("wear", lambda speed, feed, depth, time: 0.1 * time**0.2 / speed),
        ["wear: falls with cutting_speed"],
    ),
    "wear that hardly grows with speed": (
        by_law("wear", lambda speed, feed, depth, time: 0.012 * time**0.9 * speed**0.8),
        ["Taylor exponent"],
    ),
    "power that falls with feed": (
        by_law("power", lambda speed, feed, depth, time: 1.2 * speed * depth * feed**-0.2),
        ["power: falls with feed"],
    ),
    "force that falls with depth": (
        by_law("thrust_force", lambda speed, feed, depth, time: 900 / depth),
        ["thrust_force: falls with depth_of_cut"],
    ),
}
"""Sheets, and what must be said of them."""


@pytest.mark.slow
@pytest.mark.parametrize("name", WRONG)
def test_wrong_sheets_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    content, words = WRONG[name]
    (tmp_path / "cuts.csv").write_text(content)
    out = tmp_path / "made.toml"
    assert main(["calibrate", str(tmp_path / "cuts.csv"), "--out", str(out)]) == 1
    printed = capsys.readouterr()
    assert not printed.out
    for word in words:
        assert word in printed.err
    assert not out.exists()


def in_german_units() -> str:
    """Return the sheet in other units, with decimal commas."""
    columns = sheet()
    columns["time"] *= 60.0
    columns["wear"] *= 1000.0
    columns["power"] *= 1000.0
    header = "vc [m/min];fn [mm/U];ap;t [s];VB [µm];thrust force;P [W]"
    return text(columns, header, separator=";").replace(".", ",")


@pytest.mark.parametrize(
    "content",
    [pytest.param(text(sheet()), id="plain"), pytest.param(in_german_units(), id="German")],
)
def test_a_good_sheet_is_plausible_however_it_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str
) -> None:
    (tmp_path / "cuts.csv").write_text(content, "cp1252")
    command = ["calibrate", str(tmp_path / "cuts.csv"), "--out", str(tmp_path / "made.toml")]
    assert main(command) == 0
    assert "implausible" not in capsys.readouterr().err


def measured() -> Measurements:
    """Return the measurements of the sheet."""
    return Measurements(sheet(), np.arange(FIRST_LINE, FIRST_LINE + ROWS))


@pytest.mark.slow
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
    calibration = calibrate(replace(measured(), columns=columns), Scenario())
    assert "lines 2 to 5" in "\n".join(calibration.warnings)


def test_warnings_travel_with_the_file_and_are_no_part_of_its_identity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
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
