"""The programs in the documentation are those that its commands write."""

import re
import shlex
from pathlib import Path

from train import export

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "to_the_control.md").read_text("utf-8")
COMMANDS = re.findall(r"^python -m train.export (--nc .*--out (\S+))$", TEXT, re.MULTILINE)
EXCERPTS = re.findall(r"```nc\n(.*?)```", TEXT, re.DOTALL)


def test_excerpts_are_what_the_commands_write(tmp_path: Path) -> None:
    written = []
    for command, name in [*COMMANDS, ("--nc law --rule one_line_law --out one_line.mpf", "one_line.mpf")]:
        arguments = shlex.split(command.replace(f"--out {name}", "").replace("agents/", f"{ROOT}/agents/"))
        assert export.main([*arguments, "--out", str(tmp_path / name)]) == 0
        written.append((tmp_path / name).read_text("ascii").splitlines())
    assert len(written) == len(EXCERPTS) == 4
    for excerpt in EXCERPTS:
        lines = [line for line in excerpt.splitlines() if line != "..."]
        assert any(set(lines) <= set(program) for program in written), excerpt
