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
    "turning_env.rendering": {"turning_env"},
    "turning_shop": {"turning_env", "turning_env.rendering"},
    "turning_nc": {"turning_env", "turning_env.rendering", "turning_shop"},
    "turning_control": {"turning_env", "turning_env.rendering"},
    "baselines": {"turning_env"},
    "train": {"turning_env", "baselines", "turning_nc", "turning_env.rendering"},
    "papers": {"turning_env", "baselines", "train", "turning_env.rendering", "turning_shop"},
    "leaderboard": {"turning_env", "baselines", "train", "turning_env.rendering"},
    "studies": {
        "turning_env",
        "baselines",
        "train",
        "leaderboard",
        "turning_env.rendering",
        "turning_nc",
    },
    "examples": {"turning_env", "baselines", "train", "turning_nc"},
}
"""Packages that a package may import, wherever in its code."""

FLOORS = (
    {"numerics"},
    {"scenario"},
    {"physics"},
    {"observation", "info"},
    {"batch"},
    {"env", "vector_env", "family_env", "tasks", "action"},
    {"scoring", "adapters"},
    {"__main__"},
)
"""Rooms of ``turning_env`` from the ground up: a room may import its own floor and all below."""
UPWARDS = {("action", "scoring")}
"""Exceptions: actions have the type of a policy's."""
LEAVES = {"files", "locks", "console", "extras"}
"""Modules that all rooms may import, and that import none."""


def imports(path: Path) -> Iterator[str]:
    """Yield the full names of modules that a file imports, wherever in it, also by ``import_module``."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call) and "import_module" in (
            getattr(node.func, "attr", ""),
            getattr(node.func, "id", ""),
        ):
            yield ast.unparse(node.args[0]).lstrip("f'\"")


@pytest.mark.parametrize("package", LEANS_ON)
def test_a_package_imports_only_packages_below_it(package: str) -> None:
    others = (LEANS_ON.keys() | {"tests"}) - LEANS_ON[package] - {package}
    for path in (ROOT / package).rglob("*.py"):
        assert not {name.split(".")[0] for name in imports(path)} & others, path


def loaded(code: str) -> set[str]:
    """Return the modules that a fresh interpreter has loaded after some code."""
    command = [sys.executable, "-c", f"import sys\n{code}\nprint(*sys.modules)"]
    return set(
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    )


@pytest.mark.parametrize(
    "package", [package for package in LEANS_ON if package.startswith("turning_")]
)
def test_a_package_of_the_wheel_loads_only_packages_below_it(package: str) -> None:
    modules = [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for path in (ROOT / package).rglob("*.py")
        if path.name not in ("__main__.py", "hal_bridge.py", "panel.py", "stable_baselines3.py")
    ]
    code = f"import importlib, contextlib\nfor name in {modules}:\n"
    code += "    with contextlib.suppress(ModuleNotFoundError): importlib.import_module(name)\n"
    assert not {name.split(".")[0] for name in loaded(code)} & (
        LEANS_ON.keys() - LEANS_ON[package] - {package}
    )


def test_a_room_imports_only_rooms_below_it() -> None:
    floor = {room: number for number, rooms in enumerate(FLOORS) for room in rooms} | dict.fromkeys(
        LEAVES, -1
    )
    package = ROOT / "turning_env"
    unknown = {
        path.relative_to(package).parts[0].removesuffix(".py") for path in package.rglob("*.py")
    } - floor.keys()
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


HEAVY = {
    "torch",
    "stable_baselines3",
    "scipy.optimize",
    "scipy.stats",
    "matplotlib",
    "jinja2",
    "PIL",
    "pygame",
}


def test_importing_the_environment_loads_neither_learning_nor_plotting_libraries_nor_a_compiler() -> (
    None
):
    """Numba and Pydantic take half a second; they are loaded with the first environment."""
    assert not loaded("import turning_env") & (HEAVY | {"numba", "pydantic"})
    assert not loaded("import turning_env; turning_env.RoughTurningEnv") & HEAVY
