"""Everything in docs/your_own_machine.md but tuning: its files, commands, program and quotations, in the order given."""

import csv
import json
import re
import shlex
import shutil
from pathlib import Path

import pytest

from tests.walking import ROOT, blocks, commands
from turning_env import Scenario
from turning_env.__main__ import main
from turning_shop.headers import EDGE
from turning_shop.measurements import COLUMNS

PAGE = "\n".join((ROOT / "docs" / page).read_text("utf-8") for page in ("your_own_machine.md", "advice.md"))
PROMPT = ["python", "-m", "turning_env"]
NUMBER = r"-?\d+(?:\.\d+)?"


def same(quoted: str, printed: str) -> bool:
    """Return whether two lines have the same words, and the same numbers but for the processor."""
    one, two = (re.sub(NUMBER, "#", line).split() for line in (quoted, printed))
    numbers = [[float(number) for number in re.findall(NUMBER, line)] for line in (quoted, printed)]
    return one == two and numbers[0] == pytest.approx(numbers[1], rel=0.01)


@pytest.mark.slow
def test_the_tutorial_works_from_first_to_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ROOT / "docs" / "examples", tmp_path / "docs" / "examples")
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
    table = (ROOT / "docs" / "examples" / "cuts.csv").read_text("utf-8").splitlines()
    assert [line for line in quoted if line not in table and not any(same(line, other) for other in printed)] == []
    for made in ("my_tool.toml", "residuals.png", "report.json", "map.png", "sheet.pdf", "page.html"):
        assert Path(made).stat().st_size > 0
    assert "power = 5.5" in Path("my_tool.toml").read_text()


@pytest.mark.slow
def test_from_a_messy_sheet_to_an_adapted_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """German headers, decimal commas, W and s, and one slipped decimal point: refused, then corrected, used and applied."""
    monkeypatch.chdir(tmp_path)
    cuts, part = ROOT / "docs/examples/cuts.csv", ROOT / "examples/programs/welle.mpf"
    rows = list(csv.DictReader(cuts.read_text("utf-8").splitlines()))
    heads = ("vc [m/min]", "fn", "ap", "Zeit (s)", "VB [µm]", "Ff [N]", "P [W]")

    def write(slip: float) -> None:
        lines = [";".join(heads)]
        for number, row in enumerate(rows):
            scaled = [
                float(row[name]) * by if row[name] else "" for name, by in zip(row, (1, 1, 1, 60, 1e3, 1, 1e3), strict=True)
            ]
            if number == 3:
                scaled[5] = float(row["thrust_force"]) * slip
            lines.append(";".join(str(value).replace(".", ",") for value in scaled))
        (tmp_path / "messy.csv").write_text("\n".join(lines), "utf-8")

    def command(line: str, status: int = 0) -> str:
        assert main(shlex.split(line)) == status, line
        printed = capsys.readouterr()
        return printed.err if status else printed.out

    write(slip=0.1)
    assert "line 5" in command("calibrate messy.csv --out tool.toml", status=1)
    assert not (tmp_path / "tool.toml").exists()
    write(slip=1.0)
    command("calibrate messy.csv --out tool.toml")
    command(f"calibrate {cuts} --out clean.toml")
    messy, clean = (Scenario.load(tmp_path / name).material for name in ("tool.toml", "clean.toml"))
    for law in ("wear", "thrust_force", "power"):
        assert getattr(messy, law).model_dump() == pytest.approx(getattr(clean, law).model_dump(), rel=1e-5)
    command("whatif tool.toml --cutting-speed 120 --feed 0.3 --wear 0.2")
    command("map tool.toml --wear 0.2 --out map.png")
    found = json.loads(command("advise tool.toml --seeds 2 --sheet sheet.pdf --page page.html --json"))
    assert [year["name"] for year in found["played"]["years"]][:3] == ["fixed parameters", "schedule by time", "rule predictive"]
    assert (tmp_path / "sheet.pdf").read_bytes().count(b"/Type /Page ") == 1
    played = f"program {part} --scenario tool.toml --stock bar:98x150"
    adapted = json.loads(command(f"{played} --adapt words --out welle.simulated.mpf --json"))
    assert adapted["adapted"]["totals"]["time"] < 0.9 * adapted["totals"]["time"]
    assert adapted["adapted"]["totals"]["max_load"] <= 1.001
    again = json.loads(command(f"{played} --json".replace(str(part), "welle.simulated.mpf")))
    assert again["totals"] == adapted["adapted"]["totals"]
    old, new = (path.read_bytes().split() for path in (part, tmp_path / "welle.simulated.mpf"))
    changed = [(before, after) for before, after in zip(old, new, strict=True) if before != after]
    assert changed
    assert all(before[:1] == after[:1] and before[:1] in b"FS" for before, after in changed)
    for made in ("map.png", "sheet.pdf", "page.html"):
        assert (tmp_path / made).stat().st_size > 0


def test_the_columns_are_those_that_are_read() -> None:
    assert re.findall(r"^\| `(\w+)` \| (\S+) \|", PAGE, re.MULTILINE) == [
        *((name, column.unit) for name, column in COLUMNS.items()),
        (EDGE, "name"),
    ]
