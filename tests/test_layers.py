"""Imports run downwards only, and the environment stays light."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BELOW = {
    "turning_env": set(),
    "baselines": {"turning_env"},
    "train": {"turning_env", "baselines"},
    "leaderboard": {"turning_env", "baselines", "train"},
}


def imported(path: Path) -> set[str]:
    """The packages that a file imports, wherever in it."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
    return names


@pytest.mark.parametrize("package", BELOW)
def test_a_package_imports_only_what_lies_below_it(package: str) -> None:
    others = (BELOW.keys() | {"benchmarks", "examples", "tests"}) - BELOW[package] - {package}
    for path in (ROOT / package).rglob("*.py"):
        assert not imported(path) & others, path


@pytest.mark.parametrize("package", BELOW)
def test_what_decides_results_does_not_depend_on_the_packages_within(package: str) -> None:
    """The digest of a package's sources, by which results are told from stale ones, leaves out the folders in it."""
    within = {path.parent.name for path in (ROOT / package).glob("*/__init__.py")}
    for path in (ROOT / package).glob("*.py"):
        for node in ast.parse(path.read_text("utf-8")).body:  # in a function, for what only looks on, it may
            if isinstance(node, ast.ImportFrom) and node.module:
                assert not set(node.module.split(".")[1:]) & within, path


def test_the_environment_needs_no_learning_or_plotting_library() -> None:
    code = "import sys, turning_env; "
    code += "print(*{'torch', 'stable_baselines3', 'matplotlib', 'jinja2', 'PIL', 'pygame'} & sys.modules.keys())"
    finished = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, text=True)
    assert finished.stdout.strip() == ""
