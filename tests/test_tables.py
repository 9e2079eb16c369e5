"""Tables and figures of results in the docs are those of the commands beside them.

The commands read the results that ship.
"""

import re
import shlex
from pathlib import Path
from typing import Any, NamedTuple

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

PAGES: dict[str, str] = {}
"""Texts by the path of their page."""
for page_path in (ROOT / "README.md", *ROOT.glob("docs/**/*.md")):
    PAGES[page_path.relative_to(ROOT).as_posix()] = page_path.read_text("utf-8")

# A command stands above what it prints or draws, as a block or as a comment.
COMMAND = r"(?:```bash\n|<!-- )python -m ({}[^\n]*?)(?:\n```| -->)\n\n"
TABLE = r"((?:\|.*\n)*)"
PICTURE = r"!\[[^]]*\]\((\S+?)\)"
SHOW = re.compile(COMMAND.format(r"leaderboard show [^\n]*--markdown") + TABLE)
PAIRED = re.compile(COMMAND.format("research.studies.paired ") + TABLE)
SOURCES = re.compile(COMMAND.format("research.studies.family_sources") + TABLE)
DRAW = re.compile(COMMAND.format(r"(?:leaderboard figure|train.curves)") + PICTURE)


class Case(NamedTuple):
    """A command in a page, and what the page shows below it."""

    command: str
    shown: str  # a table, or the path of a picture
    page: Path


def cases(pattern: re.Pattern[str]) -> list[Any]:
    """Return every match of a pattern in a page as a test case."""
    matches = []
    for page, text in PAGES.items():
        for match in pattern.finditer(text):
            command, shown = match.groups()
            matches.append(pytest.param(Case(command, shown, ROOT / page), id=page))
    assert matches, pattern
    return matches


@pytest.mark.parametrize("case", cases(SHOW))
def test_a_table_is_what_its_command_prints(case: Case, monkeypatch, capsys) -> None:
    monkeypatch.chdir(ROOT)
    _, *words = shlex.split(case.command)
    assert leaderboard(words) == 0
    assert capsys.readouterr().out == case.shown


@pytest.mark.parametrize("case", cases(PAIRED))
def test_differences_are_what_their_command_prints(case: Case, monkeypatch, capsys) -> None:
    monkeypatch.chdir(ROOT)
    _, *words = shlex.split(case.command)
    assert paired.main(words) == 0
    assert capsys.readouterr().out == case.shown


@pytest.mark.parametrize("case", cases(SOURCES))
def test_counts_of_sources_are_what_their_command_prints(case: Case, monkeypatch, capsys) -> None:
    monkeypatch.chdir(ROOT)
    _, *words = shlex.split(case.command)
    assert family_sources.main(words) == 0
    assert capsys.readouterr().out == case.shown


def test_the_table_of_the_readme_is_what_its_command_prints(monkeypatch, capsys) -> None:
    monkeypatch.chdir(ROOT)
    readme = PAGES["README.md"]
    (command,) = re.findall(r"`python -m leaderboard (show [^`]*--aggregate[^`]*)`", readme)
    assert leaderboard(shlex.split(command)) == 0
    assert f"\n\n{capsys.readouterr().out}\n" in readme


def pixels(path: Path) -> NDArray[np.uint8]:
    return np.asarray(Image.open(path).convert("RGB"))


@pytest.mark.parametrize("case", cases(DRAW))
def test_a_figure_is_what_its_command_draws(case: Case, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.chdir(ROOT)
    program, *words = shlex.split(case.command)
    main = leaderboard if program == "leaderboard" else curves.main
    drawn = tmp_path / "drawn.png"
    assert main([*words, "--out", str(drawn)]) == 0
    shipped = case.page.parent / case.shown
    np.testing.assert_array_equal(pixels(drawn), pixels(shipped))


def test_a_level_in_a_figure_is_the_return_of_its_policy() -> None:
    ((name, level),) = re.findall(r"--level (\w+)=(\S+)", PAGES["docs/results.md"])
    board = read_leaderboard(RESULTS / "RoughTurning-v0" / "rough_turning")
    mean_returns = {standing.name: standing.mean_return.value for standing in board.standings}
    assert mean_returns[name] == pytest.approx(float(level), abs=0.05)
