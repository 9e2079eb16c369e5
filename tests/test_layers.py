"""Imports run downwards only, and the environment stays light."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SHOP = ROOT / "shop"
BENCHMARK: dict[str, set[str]] = {
    "turning_env": set(),
    "baselines": {"turning_env"},
    "train": {"turning_env", "baselines"},
    "leaderboard": {"turning_env", "baselines", "train"},
    "research": {"turning_env", "baselines", "train", "leaderboard"},
    "examples": {"turning_env", "baselines", "train"},
}
"""Packages of the benchmark, and those that each may import, wherever in its code."""
WORKSHOP = {
    "turning_shop": {"turning_env", "baselines"},
    "turning_nc": {"turning_env", "baselines", "train", "turning_shop"},
    "turning_control": {"turning_env", "baselines"},
}
"""Packages of the shop, and those that each may import."""
MAY_IMPORT = BENCHMARK | WORKSHOP
FOLDERS = {name: ROOT / name for name in BENCHMARK} | {name: SHOP / name for name in WORKSHOP}

LAYERS = (
    {"numerics"},
    {"scenario"},
    {"physics"},
    {"observation", "info"},
    {"batch"},
    {"env", "vector_env", "family_env", "tasks", "action"},
    {"rendering", "scoring", "adapters"},
    {"__main__"},
)
"""Modules of ``turning_env`` from the bottom up: a module may import its own layer and all below."""
UPWARDS = {("action", "scoring"), ("env", "rendering")}
"""Exceptions: actions have the type of a policy's, and an environment makes its viewer when it is asked to render."""
LEAVES = {"files", "locks", "console", "extras"}
"""Modules that all layers may import, and that import none."""


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


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_a_package_imports_only_packages_below_it(package: str) -> None:
    others = (MAY_IMPORT.keys() | {"tests", "shop", "tools"}) - MAY_IMPORT[package] - {package}
    paths = list(FOLDERS[package].rglob("*.py"))
    assert paths
    for path in paths:
        assert not {name.split(".")[0] for name in imports(path)} & others, path


def loaded(code: str) -> set[str]:
    """Return the modules that a fresh interpreter has loaded after some code."""
    command = [sys.executable, "-c", f"import sys\n{code}\nprint(*sys.modules)"]
    return set(
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    )


@pytest.mark.parametrize("package", ["turning_env", "baselines", *WORKSHOP])
def test_an_installed_package_loads_only_packages_below_it(package: str) -> None:
    # These need a program or a library that is not always there.
    left_out = ("__main__.py", "hal_bridge.py", "panel.py", "stable_baselines3.py", "export_law.py")
    modules = []
    for path in FOLDERS[package].rglob("*.py"):
        if path.name not in left_out:
            relative = path.relative_to(FOLDERS[package].parent).with_suffix("")
            modules.append(".".join(relative.parts).removesuffix(".__init__"))
    assert modules
    code = f"import importlib, contextlib\nfor name in {modules}:\n"
    code += "    with contextlib.suppress(ModuleNotFoundError): importlib.import_module(name)\n"
    above = MAY_IMPORT.keys() - MAY_IMPORT[package] - {package}
    assert not {name.split(".")[0] for name in loaded(code)} & above


def test_a_module_of_the_environment_imports_only_layers_below_it() -> None:
    layer = {
        module: number for number, modules in enumerate(LAYERS) for module in modules
    } | dict.fromkeys(LEAVES, -1)
    package = ROOT / "turning_env"
    unknown = {
        path.relative_to(package).parts[0].removesuffix(".py") for path in package.rglob("*.py")
    } - layer.keys()
    assert unknown == {"__init__"}
    upwards = [
        f"{path.relative_to(ROOT)} imports {name}"
        for path in package.rglob("*.py")
        if (module := path.relative_to(package).parts[0].removesuffix(".py")) != "__init__"
        for name in imports(path)
        if name.startswith("turning_env.")
        and layer.get(other := name.split(".")[1], 0) > layer[module]
        and (module, other) not in UPWARDS
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
