"""The notebooks run from the cell after the installation to the last, and git holds no outputs."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.walking import ROOT


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [*(ROOT / "examples" / "notebooks").glob("*.ipynb")], ids=lambda path: path.stem
)
def test_a_notebook_runs(path: Path, tmp_path: Path) -> None:
    cells = [
        each for each in json.loads(path.read_text("utf-8"))["cells"] if each["cell_type"] == "code"
    ]
    assert not any(each["outputs"] for each in cells)
    code = re.sub(
        r"^%.*", "", "\n".join("".join(each["source"]) for each in cells), flags=re.MULTILINE
    )
    code = re.sub(
        r"^!(.*)",
        r"import subprocess; subprocess.run('''\1''', shell=True, check=True)",
        code,
        flags=re.MULTILINE,
    )
    path_of_python = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))
    variables = os.environ | {"PATH": path_of_python, "PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"}
    subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=tmp_path, env=variables, check=True
    )
