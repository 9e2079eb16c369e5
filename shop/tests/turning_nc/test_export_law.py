"""Programs of override laws act as their controllers do, and the command writes them or nothing."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from turning_nc import export_law, law_programs
from turning_nc.law import LOAD, Law
from turning_nc.program import WARNING, Program, read, write
from turning_nc.simulate import compare, simulate
from turning_nc.words import NcError

from baselines import catalogue
from turning_env import Scenario

OVERRIDES = Scenario.load("override")
PROGRAMMED_FEED = 0.4  # [mm/rev]


@cache
def law_program(rule: str) -> Program:
    """Return the program of a rule as it reads back."""
    return read(write(law_programs.law_program(rule, OVERRIDES)))


@pytest.mark.parametrize("rule", law_programs.LAWS)
def test_a_law_program_reads_back_equal(rule: str) -> None:
    assert law_program(rule) == law_programs.law_program(rule, OVERRIDES)
    assert law_program(rule).feed == PROGRAMMED_FEED


@pytest.mark.slow
@pytest.mark.parametrize("rule", law_programs.LAWS)
def test_a_law_does_what_the_controller_does(rule: str) -> None:
    program = law_program(rule)
    make_policy = catalogue.spec(rule, OVERRIDES).make
    differences, original = compare(
        program,
        make_policy,
        scenario=OVERRIDES,
        seed=11,
    )
    assert len(differences) > 1000
    assert max(differences) < 0.5
    assert sum(differences) < 0.05 * len(differences)
    assert simulate(program, OVERRIDES, 11).difference(original) < 0.005


@given(
    rule=st.sampled_from(tuple(law_programs.LAWS)),
    loads=st.lists(st.floats(0, 1000), min_size=1, max_size=20),
)
def test_no_law_leaves_the_machines_range(rule: str, loads: list[float]) -> None:
    law = law_program(rule).law
    machine = OVERRIDES.machine
    variables = law.variables()
    for load in loads:
        variables[LOAD] = load
        feed = PROGRAMMED_FEED * 0.01 * law.cycle(variables)
        assert machine.feed_min - 1e-12 <= feed <= machine.feed_max + 1e-12


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({"diameter": 90.0}, "diameter is 90.0 mm"),
        ({"end": -200.0}, "last position is -200.0 mm"),
        ({"max_spindle_speed": 9000.0}, "LIMS is 9000.0, but the machine's range is 0 to"),
        ({"cutting_speed": 900.1}, "cutting speed is 900.1"),
        ({"feed": 3.001}, "feed is 3.001"),
        ({"law": Law()}, "no override law"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_a_program_of_another_machine_or_bar_is_refused(
    changes: dict[str, Any], complaint: str
) -> None:
    with pytest.raises(NcError, match=complaint):
        simulate(replace(law_program("one_line_law"), **changes), OVERRIDES, 1)


@pytest.mark.parametrize(
    ("effect", "complaint"),
    [
        ("$AC_OVR=0.5", "sets a feed of 0.002000"),
        ("$AC_OVR=1.0/$AC_PARAM[0]", "divides by 0"),
    ],
)
def test_a_law_that_leaves_the_range_or_divides_by_zero_is_refused_in_play(
    effect: str, complaint: str
) -> None:
    text = write(law_program("one_line_law"))
    changed = text.replace("SYNFCT(1,$AC_OVR,$AA_LOAD[S1])", effect)
    with pytest.raises(NcError, match=complaint):
        simulate(read(changed), OVERRIDES, 11)


@pytest.mark.slow
def test_the_command_writes_a_law_with_a_summary(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "folder" / "program.mpf"
    assert export_law.main(["law", "--rule", "iadapts", "--out", str(path), "--json"]) == 0
    captured = capsys.readouterr()
    summary = json.loads(captured.out)
    assert captured.err == ""
    assert summary["path"] == str(path)
    assert summary["polynomials"] == 1
    assert summary["actions"] == 5
    assert summary["largest_difference"] < 0.01
    text = path.read_text("ascii")
    assert text.startswith(f"; {WARNING}\n")
    assert "python -m turning_nc.export_law law" in text
    assert export_law.main(["check", str(path)]) == 0
    assert "read back and played: " in capsys.readouterr().out
