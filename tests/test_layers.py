"""Imports run downwards only, and the environment stays light."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LEANS_ON = {
    "turning_env": set(),
    "turning_render": {"turning_env"},
    "turning_shop": {"turning_env", "turning_render"},
    "turning_nc": {"turning_env", "turning_render"},
    "turning_control": {"turning_env", "turning_render"},
    "baselines": {"turning_env"},
    "train": {"turning_env", "baselines", "turning_nc", "turning_render"},
    "papers": {"turning_env", "baselines", "train", "turning_render", "turning_shop"},
    "leaderboard": {"turning_env", "baselines", "train", "turning_render"},
    "studies": {"turning_env", "baselines", "train", "leaderboard", "turning_render", "turning_nc"},
    "examples": {"turning_env", "baselines", "train", "turning_nc"},
}
"""Packages that a package may import, wherever in its code."""

FLOORS = (
    {"numerics"},
    {"scenario"},
    {"physics"},
    {"observation", "info"},
    {"batch"},
    {"env", "vector_env", "family_env", "tasks", "wrappers", "action"},
    {"scoring", "adapters"},
    {"__main__"},
)
"""Rooms of ``turning_env`` from the ground up: a room may import its own floor and all below."""
UPWARDS = {("action", "scoring")}
"""Exceptions: actions have the type of a policy's."""
LEAVES = {"files", "locks", "console", "extras"}
"""Modules that all rooms may import, and that import none."""


def imports(path: Path) -> Iterator[str]:
    """Yield the full names of modules that a file imports, wherever in it."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("package", LEANS_ON)
def test_a_package_imports_only_packages_below_it(package: str) -> None:
    others = (LEANS_ON.keys() | {"tests"}) - LEANS_ON[package] - {package}
    for path in (ROOT / package).rglob("*.py"):
        assert not {name.split(".")[0] for name in imports(path)} & others, path


@pytest.mark.parametrize("package", LEANS_ON)
def test_a_package_loads_only_packages_below_it(package: str) -> None:
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in (ROOT / package).rglob("*.py")
        if path.name not in ("__main__.py", "sandbox_child.py", "hal_bridge.py", "panel.py")
    ]
    code = (
        "import sys, importlib, contextlib\n"
        f"for name in {modules}:\n"
        "    with contextlib.suppress(ModuleNotFoundError): importlib.import_module(name)\n"
        "print(*{name.split('.')[0] for name in sys.modules})"
    )
    finished = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, text=True)
    assert not set(finished.stdout.split()) & (LEANS_ON.keys() - LEANS_ON[package] - {package})


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


def test_importing_the_package_loads_no_compiler() -> None:
    """Numba and Pydantic take half a second; they are loaded with the first environment."""
    code = "import sys, turning_env; print(*{'numba', 'pydantic'} & sys.modules.keys())"
    finished = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, text=True)
    assert finished.stdout.strip() == ""


LINES = {
    **{"turning_env": 6000, "turning_render": 1200, "turning_shop": 2600, "turning_nc": 3900, "turning_control": 1500},
    **{"baselines": 3900, "train": 3800, "leaderboard": 3300, "papers": 2500, "studies": 2000, "tests": 12000},
}
"""Most lines of Python of each package. Who needs more deletes something."""
WITHIN = ("turning_nc",)
"""Packages whose lines are checked."""


@pytest.mark.parametrize("package", WITHIN)
def test_a_package_keeps_its_budget_of_lines(package: str) -> None:
    lines = sum(len(path.read_text("utf-8").splitlines()) for path in (ROOT / package).rglob("*.py"))
    assert lines <= LINES[package]
