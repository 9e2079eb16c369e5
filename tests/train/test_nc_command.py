"""The command line writes programs that were read back and played, or nothing."""

import json
import re
import shlex
from pathlib import Path

import pytest

from train import export
from train.nc import interval_table
from turning_nc import simulate
from turning_nc.read import read_file
from turning_nc.schedule import Totals
from turning_nc.write import WARNING

ROOT = Path(__file__).parents[2]


def run(*arguments: str) -> int:
    return export.main(["--nc", *arguments])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "scenario"),
    [
        (("schedule", "--rule", "fixed_handbook", "--tuning-seed", "1"), "rough_turning"),
        (("schedule", "--rule", "omative", "--scenario", "override", "--seed", "5"), "override"),
        (("table", "--interval", "2"), "rough_turning"),
        (("law", "--rule", "iadapts"), "override"),
    ],
)
def test_programs_are_written_with_a_summary(
    arguments: tuple[str, ...], scenario: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "folder" / "program.mpf"
    assert run(*arguments, "--out", str(path), "--json") == 0
    captured = capsys.readouterr()
    told = json.loads(captured.out)
    assert captured.err == ""
    program = read_file(path)
    assert (told["path"], told["bars"], told["blocks"]) == (str(path), len(program.bars), program.blocks)
    assert told["largest_difference"] < 0.01
    assert told["simulated"].keys() == {"removed", "time", "wear"}
    text = path.read_text("ascii")
    assert text.startswith(f"; {WARNING}\n")
    assert f"python -m train.export --nc {arguments[0]}" in text

    assert run("check", str(path), "--scenario", scenario) == 0
    assert "read back and played: " in capsys.readouterr().out
    assert run(*arguments, "--out", str(path)) == 0
    assert "largest difference: " in capsys.readouterr().out


@pytest.mark.slow
def test_an_agents_file_plays_its_own_scenario_or_another_that_fits(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bar.mpf"
    agent = str(ROOT / "agents" / "RoughTurning-v0" / "rough_turning" / "ppo-seed0.onnx")
    for arguments, scenario in (((), "rough_turning"), (("--scenario", "ck45"), "ck45")):
        assert run("schedule", "--agent", agent, *arguments, "--out", str(path), "--json") == 0
        assert json.loads(capsys.readouterr().out)["largest_difference"] < 0.01
        header = path.read_text("ascii").replace("\n; ", " ")
        assert f"ppo (training seed 0) on scenario {scenario}, " in header
    assert run("schedule", "--agent", agent, "--scenario", "override", "--out", str(path)) == 2
    assert "cannot play 'override'" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("schedule", "--rule", "nobody"), "no controller is called 'nobody'"),
        (("schedule", "--rule", "grid_search", "--scenario", "shift"), "control.edge_changes is 'commanded'"),
        (("schedule", "--rule", "parts_pv", "--scenario", "batch_casting"), 'control.action is "part"'),
        (("schedule", "--rule", "grid_search", "--tuning-seed", "-1"), "--tuning-seed is -1"),
        (("schedule", "--rule", "grid_search", "--bars", "0"), "0 bars asked for, but there must be 1 to 1000"),
        (("table", "--scenario", "override"), "the grid search cannot play scenario 'override'"),
        (("table", "--interval", "1e-9"), "is too short"),
        (("law", "--rule", "tmac"), "tmac cannot be written as synchronized actions; those that can are one_line_law"),
    ],
)
def test_a_users_mistakes_are_named_and_nothing_is_written(
    arguments: tuple[str, ...],
    complaint: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(interval_table, "MAX_INTERVALS", 20)
    assert run(*arguments, "--out", str(tmp_path / "program.mpf")) == 2
    captured = capsys.readouterr()
    assert captured.err.startswith("error: ")
    assert complaint in captured.err
    assert captured.out == ""
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("status", "complaint"), [(2, "nothing was written"), (130, "interrupted")])
def test_a_program_that_does_otherwise_or_is_interrupted_is_not_written(
    status: int, complaint: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def simulated(*arguments: object) -> Totals:
        if status == 130:
            raise KeyboardInterrupt
        return Totals(1.0, 1.0, 0.1)

    monkeypatch.setattr(simulate, "simulate", simulated)
    assert run("schedule", "--rule", "fixed_handbook", "--out", str(tmp_path / "bar.mpf")) == status
    assert complaint in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_no_program_is_refused_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "bar.mpf"
    for content, complaint in ((b"N10 G01", "N10: a program must begin"), (b"\xff", "is not ASCII text")):
        path.write_bytes(content)
        assert run("check", str(path)) == 2
        assert f"error: {path}: {complaint}" in capsys.readouterr().err
    assert run("check", str(tmp_path / "none.mpf")) == 2
    assert "No such file" in capsys.readouterr().err


LONG = re.compile(r"(\d\.\d{5})\d+")
"""The first digits of a fitted coefficient; its last ones depend on the processor's BLAS."""


@pytest.mark.slow
def test_excerpts_in_the_documentation_are_what_its_commands_write(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "to_the_control.md").read_text("utf-8")
    commands = re.findall(r"^python -m train.export (--nc .*--out (\S+))$", text, re.MULTILINE)
    written = []
    for line, name in [*commands, ("--nc law --rule one_line_law --out one_line.mpf", "one_line.mpf")]:
        arguments = shlex.split(line.replace(f"--out {name}", "").replace("agents/", f"{ROOT}/agents/"))
        assert export.main([*arguments, "--out", str(tmp_path / name)]) == 0
        written.append(LONG.sub(r"\1", (tmp_path / name).read_text("ascii")).splitlines())
    excerpts = re.findall(r"```nc\n(.*?)```", text, re.DOTALL)
    assert len(written) == len(excerpts) == 4
    for excerpt in excerpts:
        lines = {LONG.sub(r"\1", line) for line in excerpt.splitlines() if line != "..."}
        assert any(lines <= set(program) for program in written), excerpt
