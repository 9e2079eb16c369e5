"""Everything in docs/your_own_machine.md but tuning: its files, commands, program and quotations, in the order given."""

import re
import shlex
import shutil
from pathlib import Path

import pytest

from turning_env.__main__ import main
from turning_env.workshop.measurements import COLUMNS, EDGE

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "your_own_machine.md").read_text("utf-8")
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", PAGE, re.DOTALL)
PROMPT = ["python", "-m", "turning_env"]


@pytest.mark.slow
def test_the_tutorial_works_from_first_to_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ROOT / "docs" / "examples", tmp_path / "docs" / "examples")
    monkeypatch.chdir(tmp_path)
    for language, text in BLOCKS:
        if language == "toml":
            Path("machine.toml").write_text(text)
        elif language == "python":
            exec(compile(text, "your_own_machine.md", "exec"), {})
        else:
            for line in text.splitlines():
                words = shlex.split(line)
                assert words[:3] != PROMPT or main(words[3:]) == 0, line
    printed = capsys.readouterr().out
    quoted = [line[4:] for line in PAGE.splitlines() if line.startswith("    ")]
    table = (ROOT / "docs" / "examples" / "cuts.csv").read_text("utf-8")
    assert all(line in printed or line in table for line in quoted)
    for made in ("my_tool.toml", "residuals.png", "report.json", "map.png", "sheet.pdf"):
        assert Path(made).stat().st_size > 0
    assert "power = 5.5" in Path("my_tool.toml").read_text()


def test_the_columns_are_those_that_are_read() -> None:
    assert re.findall(r"^\| `(\w+)` \| (\S+) \|", PAGE, re.MULTILINE) == [
        *((name, column.unit) for name, column in COLUMNS.items()),
        (EDGE, "name"),
    ]
