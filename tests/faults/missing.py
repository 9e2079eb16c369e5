"""Python in which an optional package is missing."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
WITHOUT = """
import importlib.abc, os, sys

class Without(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == os.environ["WITHOUT"]:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Without())
"""


def python(folder: Path, package: str, *arguments: str) -> "subprocess.CompletedProcess[str]":
    """Run Python where a package is missing; ``folder`` gets the file that hides it."""
    (folder / "sitecustomize.py").write_text(WITHOUT)
    variables = os.environ | {
        "WITHOUT": package,
        "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "shop"), str(folder))),
    }
    return subprocess.run(
        [sys.executable, *arguments],
        cwd=ROOT,
        env=variables,
        capture_output=True,
        text=True,
        check=False,
    )


def check_missing(folder: Path, package: str, command: str) -> None:
    """Check that a command says in one line that a package is missing, and how to install it."""
    words = command.replace("FILE", str(folder / "film")).split()
    finished = python(folder, package, "-m", *words)
    assert finished.returncode == 2, finished.stderr
    (line,) = finished.stderr.splitlines()
    assert line.startswith("error: ")
    assert f"{package} is not installed" in line
    assert "pip install" in line
