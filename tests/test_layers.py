"""Imports run downwards only, and the environment stays light."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BELOW = {
    "turning_env": set(),
    "baselines": {"turning_env"},
    "train": {"turning_env", "baselines"},
    "papers": {"turning_env", "baselines", "train"},
    "leaderboard": {"turning_env", "baselines", "train"},
    "benchmarks": {"turning_env", "baselines", "train", "leaderboard"},
    "examples": {"turning_env", "baselines", "train"},
}
"""Packages that a package may import."""

FLOORS = (
    {"numerics"},
    {"scenario"},
    {"physics"},
    {"observation", "info"},
    {"batch"},
    {"env", "vector_env", "family_env", "tasks", "wrappers", "action"},
    {"scoring", "programs", "control", "workshop", "rendering", "adapters"},
    {"__main__"},
)
"""Rooms of ``turning_env`` from the ground up: a room may import its own floor and all below."""
UPWARDS = {("env", "rendering"), ("vector_env", "rendering"), ("action", "scoring")}
"""Exceptions: an environment opens its viewer when it is asked to render, and actions have the type of a policy's."""
LEAVES = {"files", "locks", "console", "extras"}
"""Modules that all rooms may import, and that import none."""


def imports(path: Path) -> Iterator[str]:
    """Yield the full names of modules that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("package", BELOW)
def test_a_package_imports_only_packages_below_it(package: str) -> None:
    others = (BELOW.keys() | {"tests"}) - BELOW[package] - {package}
    for path in (ROOT / package).rglob("*.py"):
        assert not {name.split(".")[0] for name in imports(path)} & others, path


def test_a_room_imports_only_rooms_below_it() -> None:
    floor = {room: number for number, rooms in enumerate(FLOORS) for room in rooms} | dict.fromkeys(LEAVES, -1)
    package = ROOT / "turning_env"
    unknown = {path.relative_to(package).parts[0].removesuffix(".py") for path in package.rglob("*.py")} - floor.keys()
    assert unknown == {"__init__"}
    upwards = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in package.rglob("*.py")
        if (room := path.relative_to(package).parts[0].removesuffix(".py")) != "__init__"
        for name in imports(path)
        if name.startswith("turning_env.")
        and floor.get(other := name.split(".")[1], 0) > floor[room]
        and (room, other) not in UPWARDS
    ]
    assert upwards == []


def test_the_environment_needs_no_learning_or_plotting_library() -> None:
    heavy = {"torch", "stable_baselines3", "scipy.optimize", "scipy.stats", "matplotlib", "jinja2", "PIL", "pygame"}
    code = f"import sys, turning_env; print(*{heavy} & sys.modules.keys())"
    finished = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, text=True)
    assert finished.stdout.strip() == ""
