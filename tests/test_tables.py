"""Tables and figures of results in the docs are what the commands beside them make of the results that ship."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from leaderboard.__main__ import main as leaderboard
from leaderboard.ranking import read_leaderboard
from leaderboard.result import RESULTS
from research.studies import paired
from train import curves

ROOT = Path(__file__).parents[1]
PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text("utf-8")
    for path in (ROOT / "README.md", *ROOT.glob("docs/**/*.md"))
}
COMMAND = r"(?:```bash\n|<!-- )python -m ({}[^\n]*?)(?:\n```| -->)\n\n"
TABLE = r"((?:\|.*\n)*)"
SHOW = re.compile(COMMAND.format(r"leaderboard show [^\n]*--markdown") + TABLE)
PAIRED = re.compile(COMMAND.format("research.studies.paired ") + TABLE)
DRAW = re.compile(COMMAND.format(r"(?:leaderboard figure|train.curves)") + r"!\[[^]]*\]\((\S+?)\)")
TABLES = [
    pytest.param(*found.groups(), id=page)
    for page, text in PAGES.items()
    for found in SHOW.finditer(text)
]
PAIRS = [
    pytest.param(*found.groups(), id=page)
    for page, text in PAGES.items()
    for found in PAIRED.finditer(text)
]
FIGURES = [
    pytest.param(*found.groups(), ROOT / page, id=page)
    for page, text in PAGES.items()
    for found in DRAW.finditer(text)
]


@pytest.mark.parametrize(("command", "table"), TABLES)
def test_a_table_is_what_its_command_prints(
    command: str, table: str, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    monkeypatch.chdir(ROOT)
    assert leaderboard(shlex.split(command)[1:]) == 0
    assert capsys.readouterr().out == table


@pytest.mark.parametrize(("command", "table"), PAIRS)
def test_differences_are_what_their_command_prints(
    command: str, table: str, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(ROOT)
    assert paired.main(shlex.split(command)[1:]) == 0
    assert capsys.readouterr().out == table


def test_the_leads_of_the_ladder_are_those_of_its_command(monkeypatch, capsys) -> None:
    monkeypatch.chdir(ROOT)
    (command,) = re.findall(r"<!-- Leads: python -m leaderboard (.*) -->", PAGES["README.md"])
    assert leaderboard(shlex.split(command)) == 0
    printed = {tuple(line.split(" | ")[1::2]) for line in capsys.readouterr().out.splitlines()}
    ladder = {
        tuple(line.split(" | ")[3:])
        for line in PAGES["README.md"].splitlines()
        if line.startswith("| `RoughTurning-")
    }
    assert len(ladder) == 7
    assert ladder <= printed


@pytest.mark.parametrize(("command", "picture", "page"), FIGURES)
def test_a_figure_is_what_its_command_draws(
    command: str, picture: str, page: Path, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(ROOT)
    program, *words = shlex.split(command)
    main = {"leaderboard": leaderboard, "train.curves": curves.main}[program]
    assert main([*words, "--out", str(tmp_path / "drawn.png")]) == 0
    drawn, shipped = (
        np.asarray(Image.open(path).convert("RGB"))
        for path in (tmp_path / "drawn.png", page.parent / picture)
    )
    np.testing.assert_array_equal(drawn, shipped)


def test_a_level_in_a_figure_is_the_return_of_its_policy() -> None:
    ((name, level),) = re.findall(r"--level (\w+)=(\S+)", PAGES["docs/agents.md"])
    standings = read_leaderboard(RESULTS / "RoughTurning-v0" / "rough_turning").standings
    assert next(each.mean_return.value for each in standings if each.name == name) == pytest.approx(
        float(level), abs=0.05
    )
    assert len(FIGURES) == 2
