"""The notebooks run from the cell after the installation to the last, and git holds no outputs."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.walking import ROOT

NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


def code_cells(path: Path) -> list[dict[str, Any]]:
    cells = json.loads(path.read_text("utf-8"))["cells"]
    return [cell for cell in cells if cell["cell_type"] == "code"]


def script(cells: list[dict[str, Any]]) -> str:
    """Return the cells as a script.

    Magics are left out, shell commands are processes, and agents learn for a few steps only.
    """
    code = "\n".join("".join(cell["source"]) for cell in cells)
    code = re.sub(r"^%.*", "", code, flags=re.MULTILINE)
    code = re.sub(r"^STEPS = .*", "STEPS = 4096", code, flags=re.MULTILINE)
    command = r"import subprocess; subprocess.run('''\1''', shell=True, check=True)"
    return re.sub(r"^!(.*)", command, code, flags=re.MULTILINE)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_holds_no_outputs(path: Path) -> None:
    cells = code_cells(path)
    assert cells
    assert [cell for cell in cells if cell["outputs"]] == []


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path) -> None:
    python_folder = str(Path(sys.executable).parent)
    variables = os.environ | {
        "PATH": os.pathsep.join((python_folder, os.environ["PATH"])),
        "PYTHONPATH": str(ROOT),
        "MPLBACKEND": "agg",
    }
    subprocess.run(
        [sys.executable, "-W", "error", "-c", script(code_cells(path))],
        cwd=tmp_path,
        env=variables,
        check=True,
    )
