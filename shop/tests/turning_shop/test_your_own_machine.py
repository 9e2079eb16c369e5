"""Everything in docs/your_own_machine.md but tuning: its files, commands, program and quotations, in the order given."""

import re
import shlex
import shutil
from pathlib import Path

import pytest
from turning_shop.headers import COLUMNS, EDGE

from tests.walking import ROOT, blocks, commands
from turning_env import Scenario
from turning_env.__main__ import main

PAGE = "\n".join(
    (ROOT / "shop" / "docs" / page).read_text("utf-8")
    for page in ("your_own_machine.md", "advice.md")
)
PROMPT = ["python", "-m", "turning_env"]
NUMBER = r"-?\d+(?:\.\d+)?"


def same(quoted: str, printed: str) -> bool:
    """Return whether two lines have the same words, and the same numbers but for the processor."""
    one, two = (re.sub(NUMBER, "#", line).split() for line in (quoted, printed))
    numbers = [[float(number) for number in re.findall(NUMBER, line)] for line in (quoted, printed)]
    return one == two and numbers[0] == pytest.approx(numbers[1], rel=0.01)


@pytest.mark.slow
def test_the_tutorial_works_from_first_to_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    shutil.copytree(ROOT / "shop" / "examples", tmp_path / "shop" / "examples")
    monkeypatch.chdir(tmp_path)
    for block in blocks(PAGE):
        if block.language == "toml":
            Path(str(block.title)).write_text(block.text)
        elif block.language == "python":
            exec(compile(block.text, "your_own_machine.md", "exec"), {})
        else:
            for line in commands(block):
                words = shlex.split(line)
                assert words[:3] != PROMPT or main(words[3:]) == 0, line
    printed = capsys.readouterr().out.splitlines()
    quoted = [line[4:] for line in PAGE.splitlines() if line.startswith("    ")]
    table = (ROOT / "shop" / "examples" / "cuts.csv").read_text("utf-8").splitlines()
    assert [
        line
        for line in quoted
        if line not in table and not any(same(line, other) for other in printed)
    ] == []
    for made in ("my_tool.toml", "map.png", "sheet.pdf", "page.html"):
        assert Path(made).stat().st_size > 0
    assert Scenario.load("my_tool.toml").limits.power == 5.5


def test_the_columns_are_those_that_are_read() -> None:
    assert re.findall(r"^\| `(\w+)` \| (\S+) \|", PAGE, re.MULTILINE) == [
        *((name, column.unit) for name, column in COLUMNS.items()),
        (EDGE, "name"),
    ]
