"""Tools with scenarios of their own: which laws hold, what adapts, and mistakes of the option."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely")

from turning_nc.adapt import adapt
from turning_nc.cutting import AssumedMachine, Laws, Situation, play
from turning_nc.edges import parts_per_edge
from turning_nc.removal import remove
from turning_nc.report import rows, summary
from turning_nc.stock import read_stock
from turning_nc.words import NcError
from turning_shop.__main__ import main

from shop.tests.turning_nc.programs import moves
from turning_env import Scenario

SCENARIO = Scenario.load("rough_turning")
TWO_TOOLS = (
    "G21 G99\nG50 S3000\nT0101\nG96 S150 M3\nG0 X62. Z2.\nG1 X56. F0.25\nZ-60.\nG0 X64.\nZ2.\n"
    "T0202\nG96 S160\nG0 X52.\nG1 Z-40. F0.2\nG0 X64.\nZ2.\nG1 X48. F0.1\nZ-60.\nX64.\n"
)
"""T0101 roughs at 150 m/min, T0202 roughs at 160 m/min and leaves the surface."""


def stronger(factor: float) -> Scenario:
    """Return the preset with laws of force and power times a factor."""
    values = SCENARIO.model_dump()
    for name in ("thrust_force", "power"):
        values["material"][name]["coefficient"] *= factor
    return Scenario.load(values)


def situated(own_laws: dict[str, Laws] | None = None, text: str = TWO_TOOLS) -> Situation:
    """Return both tools on a bar."""
    made = moves(text)
    removal = remove(made, read_stock("bar:60x80"))
    return Situation(SCENARIO, AssumedMachine(), made, removal, own_laws=own_laws or {})


def test_laws_of_a_tool_hold_for_its_passes_alone() -> None:
    without = play(situated(), 0.2)
    situation = situated({"T0202": Laws(stronger(2.0))})
    played = play(situation, 0.2)
    is_second = situation.by_tool["T0202"]
    # The force has no share that does not follow the law: twice the coefficient, twice the load.
    np.testing.assert_allclose(
        played.force_share[is_second], 2.0 * without.force_share[is_second], rtol=1e-12
    )
    assert without.force_share[is_second].max() > 0.1
    np.testing.assert_array_equal(played.force_share[~is_second], without.force_share[~is_second])


def test_the_command_s_laws_given_for_each_tool_change_nothing() -> None:
    shared = situated()
    own = situated({"T0101": Laws(SCENARIO), "T0202": Laws(SCENARIO)})
    np.testing.assert_array_equal(play(own, 0.2).load, play(shared, 0.2).load)
    assert parts_per_edge(own, play(own, 0.2)) == parts_per_edge(shared, play(shared, 0.2))
    cost = summary(own, play(own, 0.2)).cost
    assert cost == pytest.approx(summary(shared, play(shared, 0.2)).cost, rel=1e-12)


def test_an_edge_has_the_price_of_its_tool_s_scenario() -> None:
    values = SCENARIO.model_dump()
    values["economics"]["edge_cost"] = SCENARIO.economics.edge_cost + 4.0  # [min]
    dear = situated({"T0202": Laws(Scenario.load(values))})
    played = play(dear, 0.2)
    parts = parts_per_edge(dear, played)["T0202"]
    usual = situated()
    extra = summary(dear, played).cost - summary(usual, play(usual, 0.2)).cost
    assert extra == pytest.approx(4.0 / parts, rel=1e-9)


def test_every_tool_with_laws_is_adapted_by_them() -> None:
    usual = adapt(situated())
    assert "S150" in usual.text
    assert "S160" not in usual.text
    own = adapt(situated({"T0101": Laws(stronger(0.5))}), life=1.5)
    first, second = re.findall(r"S(\d+)", own.text)[1:]
    assert first != "150"
    assert second != "160"
    assert own.played.load.max() <= 1.001


def test_thrust_and_life_of_a_drill_are_unknown_rather_than_0() -> None:
    made = moves("G21 G99\nT0101\nG97 S800 M3\nG0 X0. Z2.\nG1 Z-20. F0.1\nG0 Z2.\n")
    removal = remove(made, read_stock("bar:60x80"), {"T0101": "drill:20"})
    situation = Situation(SCENARIO, AssumedMachine(), made, removal)
    (row,) = rows(situation, play(situation, 0.2))
    assert row.removed > 1.0
    assert row.force_share is None
    assert row.used_life is None
    assert row.power_share is not None
    assert row.power_share > 0.1


def test_a_tool_with_laws_is_not_described_by_the_command_s() -> None:
    made = moves(TWO_TOOLS)
    removal = remove(made, read_stock("bar:60x80"))
    laws = {"T0101": Laws(SCENARIO)}
    with pytest.raises(NcError, match="T0101 has a scenario of its own"):
        Situation(SCENARIO, AssumedMachine(), made, removal, described=["T0101"], own_laws=laws)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with a program and scenarios, of which one has a fault."""
    (tmp_path / "part.nc").write_text(TWO_TOOLS)
    (tmp_path / "bore.toml").write_text('base = "rough_turning"\nlimits.power = 9.0\n')
    (tmp_path / "bad.toml").write_text('base = "rough_turning"\ntool.strength = 3.0\n')
    return tmp_path


def run(folder: Path, *options: str) -> int:
    """Run the command in a folder on its program."""
    words = [option.replace("@", f"{folder}/") for option in options]
    program = str(folder / "part.nc")
    stock = ["--stock", "bar:60x80"]
    return main(["program", program, "--scenario", "rough_turning", *stock, *words])


def test_the_output_names_the_laws_of_each_tool(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--tool", "T0202=@bore.toml", "--tool", "t0202=outside")
    assert run(folder, *options) == 0
    printed = capsys.readouterr().out
    assert "T0101: laws and limits of rough_turning\n" in printed
    assert f"T0202: laws and limits of {folder / 'bore.toml'}\n" in printed
    assert run(folder, *options, "--json") == 0
    laws = json.loads(capsys.readouterr().out)["laws"]
    assert laws == {"T0101": "rough_turning", "T0202": str(folder / "bore.toml")}


@pytest.mark.parametrize(
    ("limit", "other"),
    [
        pytest.param("", "", id="no limit of the tool"),
        pytest.param("limits.power = 99.0\n", "", id="higher limit of the tool"),
        pytest.param("limits.power = 1.0\n", "limits.power = 1.0\n", id="lower limit of the tool"),
    ],
)
def test_the_machine_s_power_limits_tools_whose_files_do_not(
    limit: str, other: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Below the base speed, less than the rated power is available, also to tools with own laws.
    machine = 'base = "rough_turning"\nlimits.power = 4.0\nspindle.base_speed = 2000.0\n'
    (folder / "machine.toml").write_text(machine)
    (folder / "plain.toml").write_text(f'base = "rough_turning"\n{limit}')
    (folder / "same.toml").write_text(
        machine.replace("limits.power = 4.0\n", other or "limits.power = 4.0\n")
    )

    def blocks(tool: str) -> tuple[list[float], list[str]]:
        options = ["--scenario", "@machine.toml", "--tool", f"T0202=@{tool}", "--json"]
        assert run(folder, *options) == 0
        printed = json.loads(capsys.readouterr().out)
        shares = [block["power_share"] for block in printed["blocks"]]
        return shares, [note for note in printed["notes"] if "T0202" in note]

    shares, notes = blocks("plain.toml")
    assert shares == pytest.approx(blocks("same.toml")[0])
    assert max(shares) > 0.5
    assert not any("limits.power is off" in note for note in notes)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        pytest.param(
            "--tool T2=@bore.toml", "calls T0101, T0202: is it T0202?", id="spoken number"
        ),
        pytest.param("--tool T0102=@bore.toml", "is it T0", id="number beside another"),
        pytest.param("--tool T0202=@bad.toml", "bad.toml: tool: unknown key strength", id="fault"),
        pytest.param("--tool T0202=@missing.toml", "missing.toml", id="no file"),
        pytest.param(
            "--tool T0202=@bore.toml --tool T0202=@bore.toml",
            "two scenarios of T0202",
            id="two scenarios",
        ),
        pytest.param(
            "--tool T0202=outside --tool T0202=inside", "two kinds of T0202", id="two kinds"
        ),
        pytest.param("--tool T0202=bore", "a scenario's name ends in .toml", id="no ending"),
        pytest.param(
            "--tool T0202=@bore.toml --law-of T0202",
            "T0202 has a scenario of its own",
            id="described twice",
        ),
        pytest.param(
            "--tool T0202=@bore.toml --wear 0.31",
            "at most the wear criterion, 0.3 mm",
            id="wear above the criterion",
        ),
    ],
)
def test_mistakes_of_the_option_are_named(
    options: str, message: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, *options.split()) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert message in printed.err
    assert printed.err.count("\n") == 1


def test_a_pair_without_a_name_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        run(folder, "--tool", "bore.toml")
    assert "must be NAME=KIND or NAME=FILE.toml" in capsys.readouterr().err


def test_the_thrust_of_grooving_tools_is_said_to_be_assumed(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, "--tool", "T0202=groove:3") == 0
    assert "the thrust of grooving tools is taken as that of turning" in capsys.readouterr().out
