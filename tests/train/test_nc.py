"""Programs of controllers and agents repeat their originals, and the command writes them or nothing."""

import json
from functools import cache
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from baselines import catalogue
from train import export, nc_programs
from turning_env import Scenario
from turning_nc.law import LOAD
from turning_nc.program import WARNING, Block, Program, read, read_file, write
from turning_nc.simulate import compare, play_schedule, simulate
from turning_nc.words import NcError

ROOT = Path(__file__).parents[2]
AGENT = str(ROOT / "agents" / "RoughTurning-v0" / "rough_turning" / "ppo-seed0.onnx")
SCENARIO, OVERRIDES = Scenario.load("rough_turning"), Scenario.load("override")


def written_and_read(program: Program) -> Program:
    back = read(write(program))
    assert back == program
    return back


# Schedules.


@pytest.mark.parametrize(
    ("preset", "rule", "bars", "tolerance"),
    [
        ("rough_turning", "rescaled_grid_search", 1, 0.0),
        pytest.param("rough_turning", "fixed_handbook", 30, 0.01, marks=pytest.mark.slow),  # to the end of the edge
        ("paper", "grid_search", 2, 0.01),
        pytest.param("override", "omative", 1, 0.01, marks=pytest.mark.slow),
    ],
)
def test_a_schedule_does_what_the_controller_did(preset: str, rule: str, bars: int, tolerance: float) -> None:
    scenario = Scenario.load(preset)
    program, original = play_schedule(catalogue.spec(rule, scenario).make, scenario, 11, bars, tolerance)
    assert simulate(written_and_read(program), scenario, 11).difference(original) < 0.01
    assert original.removed > 30.0
    assert len(program.bars) <= bars


@pytest.mark.parametrize(
    ("diameter", "start", "limit", "blocks", "complaint"),
    [
        (60.0, 3.0, 636.6, [(-300.0, 150.0, 0.3)], "diameter is 60.0 mm"),
        (100.0, 3.0, 700.0, [(-300.0, 150.0, 0.3)], "LIMS is 700.0 rev/min, but the machine's highest is 636.6"),
        (100.0, 3.0, 636.6, [(-300.0, 200.1, 0.3)], "cutting speed is 200.1, but the machine's range is 50"),
        (100.0, 3.0, 636.6, [(-300.0, 150.0, 0.601)], "feed is 0.601"),
        (100.0, 3.0, 636.6, [(-301.0, 150.0, 0.3)], "Z is -301.0"),
        (100.0, 3.0, 636.6, [(-200.0, 150.0, 0.3), (-300.0, 150.0, 0.3)], "bar 1 ends at Z-200.0"),
        (100.0, 3.0, 636.6, [], "at least one bar"),
    ],
)
def test_a_program_of_another_machine_or_bar_is_refused(
    diameter: float, start: float, limit: float, blocks: list[tuple[float, float, float]], complaint: str
) -> None:
    bars = tuple((Block(*block),) for block in blocks)
    with pytest.raises(NcError, match=complaint):
        simulate(Program(diameter, start, limit, bars), SCENARIO, 1)


# Override laws.


@cache
def law_program(rule: str) -> Program:
    return written_and_read(nc_programs.law_program(rule, OVERRIDES))


@pytest.mark.slow
@pytest.mark.parametrize("rule", nc_programs.LAWS)
def test_a_law_does_what_the_controller_does(rule: str) -> None:
    program = law_program(rule)
    differences, original = compare(program, catalogue.spec(rule, OVERRIDES).make, OVERRIDES, 11)
    assert max(differences) < 0.5
    assert sum(differences) < 0.05 * len(differences)
    assert len(differences) > 1000
    assert simulate(program, OVERRIDES, 11).difference(original) < 0.005


@given(
    st.sampled_from(tuple(nc_programs.LAWS)), st.lists(st.tuples(st.floats(0, 1000), st.floats(0, 500)), min_size=1, max_size=20)
)
def test_no_law_leaves_the_machines_range(rule: str, measured: list[tuple[float, float]]) -> None:
    law, machine = law_program(rule).law, OVERRIDES.machine
    variables = law.variables() | {"$AA_S[1]": 710.0}
    for load, velocity in measured:
        variables |= {LOAD: load, "$AC_VACTB": velocity}
        feed = 0.4 * 0.01 * law.cycle(variables)
        assert machine.feed_min - 1e-12 <= feed <= machine.feed_max + 1e-12


def test_a_law_that_leaves_the_range_or_divides_by_zero_is_refused_in_play() -> None:
    text = write(law_program("one_line_law"))
    for effect, complaint in (("$AC_OVR=0.5", "sets a feed of 0.002000"), ("$AC_OVR=1.0/$AC_PARAM[0]", "divides by 0")):
        with pytest.raises(NcError, match=complaint):
            simulate(read(text.replace("SYNFCT(1,$AC_OVR,$AA_LOAD[S1])", effect)), OVERRIDES, 11)


# The command.


def run(*arguments: str) -> int:
    return export.main(["--nc", *arguments])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "scenario"),
    [
        (("schedule", "--rule", "omative", "--scenario", "override", "--seed", "5"), "override"),
        (("table", "--interval", "2"), "rough_turning"),
        (("law", "--rule", "iadapts"), "override"),
        (("schedule", "--agent", AGENT), "rough_turning"),
        (("schedule", "--agent", AGENT, "--scenario", "ck45"), "ck45"),
    ],
)
def test_programs_are_written_with_a_summary(
    arguments: tuple[str, ...], scenario: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "folder" / "program.mpf"
    assert run(*arguments, "--out", str(path), "--json") == 0
    captured = capsys.readouterr()
    done, text, program = json.loads(captured.out), path.read_text("ascii"), read_file(path)
    assert captured.err == ""
    assert (done["path"], done["bars"], done["blocks"]) == (str(path), len(program.bars), program.blocks)
    assert done["largest_difference"] < 0.01
    assert text.startswith(f"; {WARNING}\n")
    assert f"python -m train.export --nc {arguments[0]}" in text
    assert run("check", str(path), "--scenario", scenario) == 0
    assert "read back and played: " in capsys.readouterr().out
