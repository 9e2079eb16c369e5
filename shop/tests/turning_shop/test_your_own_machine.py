"""The tutorial for a machine of your own works as printed, but for tuning.

Files, commands, program and quotations are taken from the page in the order given.
"""

import re
import shlex
import shutil
from pathlib import Path

import pytest
from turning_shop.__main__ import main
from turning_shop.headers import COLUMNS, EDGE

from tests.walking import ROOT, blocks, commands
from turning_env import Scenario

PAGE = (ROOT / "shop" / "docs" / "your_own_machine.md").read_text("utf-8")
PROMPT = ["python", "-m", "turning_shop"]
NUMBER = r"-?\d+(?:\.\d+)?"


def same(quoted: str, printed: str) -> bool:
    """Return whether two lines have the same words, and the same numbers but for the processor."""
    quoted_words = re.sub(NUMBER, "#", quoted).split()
    printed_words = re.sub(NUMBER, "#", printed).split()
    quoted_numbers = [float(number) for number in re.findall(NUMBER, quoted)]
    printed_numbers = [float(number) for number in re.findall(NUMBER, printed)]
    if quoted_words != printed_words:
        return False
    return bool(quoted_numbers == pytest.approx(printed_numbers, rel=0.01))


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
                if words[:3] == PROMPT:
                    assert main(words[3:]) == 0, line
    printed = capsys.readouterr().out.splitlines()
    quoted = [line[4:] for line in PAGE.splitlines() if line.startswith("    ")]
    table = (ROOT / "shop" / "examples" / "cuts.csv").read_text("utf-8").splitlines()
    for line in quoted:
        assert line in table or any(same(line, output) for output in printed), line
    for made in ("my_tool.toml", "map.png", "sheet.pdf", "page.html"):
        assert Path(made).stat().st_size > 0
    assert Scenario.load("my_tool.toml").limits.power == 5.5


def test_the_columns_are_those_that_are_read() -> None:
    documented = re.findall(r"^\| `(\w+)` \| (\S+) \|", PAGE, re.MULTILINE)
    columns = [(name, column.unit) for name, column in COLUMNS.items()]
    assert documented == [*columns, (EDGE, "name")]
