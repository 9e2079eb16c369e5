"""Tables and figures of results in the docs are those of the commands beside them.

The commands read the results that ship.
"""

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from leaderboard.__main__ import main as leaderboard
from leaderboard.ranking import read_leaderboard
from leaderboard.result import RESULTS
from research.studies import family_sources, paired
from tests.walking import ROOT
from train import curves

pytestmark = pytest.mark.slow

PAGES = {
    path.relative_to(ROOT).as_posix(): path.read_text("utf-8")
    for path in (ROOT / "README.md", *ROOT.glob("docs/**/*.md"))
}
COMMAND = r"(?:```bash\n|<!-- )python -m ({}[^\n]*?)(?:\n```| -->)\n\n"
TABLE = r"((?:\|.*\n)*)"
SHOW = re.compile(COMMAND.format(r"leaderboard show [^\n]*--markdown") + TABLE)
PAIRED = re.compile(COMMAND.format("research.studies.paired ") + TABLE)
SOURCES = re.compile(COMMAND.format("research.studies.family_sources") + TABLE)
DRAW = re.compile(COMMAND.format(r"(?:leaderboard figure|train.curves)") + r"!\[[^]]*\]\((\S+?)\)")


def cases(pattern: re.Pattern[str]) -> list[Any]:
    """Return the groups of every match of a pattern in a page, and the page, as test cases."""
    matches = []
    for page, text in PAGES.items():
        for match in pattern.finditer(text):
            matches.append(pytest.param(*match.groups(), ROOT / page, id=page))
    assert matches, pattern
    return matches


@pytest.mark.parametrize(("command", "table", "page"), cases(SHOW))
def test_a_table_is_what_its_command_prints(
    command: str, table: str, page: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(ROOT)
    assert leaderboard(shlex.split(command)[1:]) == 0
    assert capsys.readouterr().out == table


@pytest.mark.parametrize(("command", "table", "page"), cases(PAIRED))
def test_differences_are_what_their_command_prints(
    command: str, table: str, page: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(ROOT)
    assert paired.main(shlex.split(command)[1:]) == 0
    assert capsys.readouterr().out == table


@pytest.mark.parametrize(("command", "table", "page"), cases(SOURCES))
def test_counts_of_sources_are_what_their_command_prints(
    command: str, table: str, page: Path, monkeypatch, capsys
) -> None:
    monkeypatch.chdir(ROOT)
    assert family_sources.main(shlex.split(command)[1:]) == 0
    assert capsys.readouterr().out == table


def test_the_leads_of_the_ladder_are_those_of_its_command(monkeypatch, capsys) -> None:
    monkeypatch.chdir(ROOT)
    (command,) = re.findall(r"<!-- Leads: python -m leaderboard (.*) -->", PAGES["README.md"])
    assert leaderboard(shlex.split(command)) == 0
    printed = set()
    for line in capsys.readouterr().out.splitlines():
        # The policy and its lead: scenario and feasibility stand elsewhere in the README.
        printed.add(tuple(line.split(" | ")[1::2]))
    ladder = set()
    for line in PAGES["README.md"].splitlines():
        if line.startswith("| `RoughTurning-"):
            ladder.add(tuple(line.split(" | ")[3:]))
    assert len(ladder) == 7
    assert ladder <= printed


def pixels(path: Path) -> NDArray[np.uint8]:
    return np.asarray(Image.open(path).convert("RGB"))


@pytest.mark.parametrize(("command", "picture", "page"), cases(DRAW))
def test_a_figure_is_what_its_command_draws(
    command: str, picture: str, page: Path, tmp_path: Path, monkeypatch
) -> None:
    monkeypatch.chdir(ROOT)
    program, *words = shlex.split(command)
    main = {"leaderboard": leaderboard, "train.curves": curves.main}[program]
    drawn = tmp_path / "drawn.png"
    assert main([*words, "--out", str(drawn)]) == 0
    np.testing.assert_array_equal(pixels(drawn), pixels(page.parent / picture))


def test_a_level_in_a_figure_is_the_return_of_its_policy() -> None:
    ((name, level),) = re.findall(r"--level (\w+)=(\S+)", PAGES["docs/agents.md"])
    board = read_leaderboard(RESULTS / "RoughTurning-v0" / "rough_turning")
    (standing,) = [standing for standing in board.standings if standing.name == name]
    assert standing.mean_return.value == pytest.approx(float(level), abs=0.05)


def test_both_kinds_of_figures_are_drawn_by_commands() -> None:
    assert len(cases(DRAW)) == 2
