"""Python in which an optional package is missing."""

import os
import subprocess
from pathlib import Path

from tests import preloaded
from tests.walking import MAX_SECONDS, ROOT

WITHOUT = """
import importlib.abc, sys

class Without(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == {package!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)

sys.meta_path.insert(0, Without())
for name in list(sys.modules):
    if name.partition(".")[0] == {package!r}:
        del sys.modules[name]
"""
RUN = """
from tests import preloaded

preloaded.act({arguments!r})
"""


def run_program(package: str, program: str) -> "subprocess.CompletedProcess[str]":
    """Run a program where a package is missing, as if it had never been installed."""
    return preloaded.run(
        "shared",
        [*preloaded.PROGRAM, WITHOUT.format(package=package) + program],
        folder=ROOT,
        max_seconds=MAX_SECONDS,
        variables={"PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "shop")))},
    )


def run_module(package: str, words: list[str]) -> "subprocess.CompletedProcess[str]":
    """Run ``python -m`` with these words where a package is missing."""
    return run_program(package, RUN.format(arguments=[preloaded.MODULE, *words]))


def check_missing(folder: Path, package: str, command: str) -> None:
    """Check that a command says in one line that a package is missing, and how to install it."""
    words = command.replace("FILE", str(folder / "film")).split()
    finished = run_module(package, words)
    assert finished.returncode == 2, finished.stderr
    (line,) = finished.stderr.splitlines()
    assert line.startswith("error: ")
    assert f"{package} is not installed" in line
    assert "pip install" in line
