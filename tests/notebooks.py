"""Shared part of the tests of notebooks: their cells as a script, and its run."""

import json
import os
import re
from pathlib import Path
from typing import Any

from tests import preloaded
from tests.walking import MAX_SECONDS, ROOT


def code_cells(path: Path) -> list[dict[str, Any]]:
    cells = json.loads(path.read_text("utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def assert_holds_no_outputs(path: Path) -> None:
    cells = code_cells(path)
    assert cells
    assert [cell for cell in cells if cell["outputs"]] == []


def script(cells: list[dict[str, Any]]) -> str:
    """Return the cells as a script.

    Magics are left out, shell commands are processes, agents learn for a few steps only, and advice
    plays few edges.
    """
    code = "\n".join("".join(cell["source"]) for cell in cells)
    code = re.sub(r"^%.*", "", code, flags=re.MULTILINE)
    code = re.sub(
        r"^STEPS = .*",
        "STEPS = 4096",
        code,
        flags=re.MULTILINE,
    )
    code = re.sub(r"(python -m turning_shop advise \S+)", r"\1 --seeds 2", code)
    command = r"import subprocess; subprocess.run('''\1''', shell=True, check=True)"
    # A backslash at a line's end continues the command.
    return re.sub(
        r"^!((?:.*\\\n)*.*)",
        command,
        code,
        flags=re.MULTILINE,
    )


def run(path: Path, folder: Path) -> None:
    """Run a notebook in a folder, from the cell after the installation to the last."""
    programs = folder / "programs"
    programs.mkdir()
    preloaded.write_stand_in(programs / "python", MAX_SECONDS)
    variables = {
        "PATH": os.pathsep.join((str(programs), os.environ["PATH"])),
        "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "shop"))),
        "MPLBACKEND": "agg",
    }
    program = [*preloaded.PROGRAM, script(code_cells(path))]
    process = preloaded.process_of(program)
    assert process is not None
    finished = preloaded.run(process, program, folder, MAX_SECONDS, variables)
    assert finished.returncode == 0, finished.stderr
