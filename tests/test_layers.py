"""Imports run downwards only, the environment stays light, and no library rounds its numbers."""

import ast
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from tests.walking import ROOT

SHOP = ROOT / "shop"
BENCHMARK: dict[str, set[str]] = {
    "turning_env": set(),
    "baselines": {"turning_env"},
    "leaderboard": {"turning_env", "baselines"},
    "train": {"turning_env", "baselines", "leaderboard"},
    "research": {"turning_env", "baselines", "leaderboard", "train"},
    "examples": {"turning_env", "baselines", "leaderboard", "train"},
}
"""Packages of the benchmark, and those that each may import, wherever in its code."""
WORKSHOP = {
    "turning_shop": {"turning_env", "baselines", "leaderboard"},
    "turning_nc": {"turning_env", "baselines", "leaderboard", "turning_shop"},
    # Records of a machine become sheets of cuts.
    "turning_control": {"turning_env", "baselines", "leaderboard", "turning_shop"},
}
"""Packages of the shop, and those that each may import."""
COMMAND_LINES = {SHOP / "turning_shop" / "__main__.py"}
"""Files that stand above the packages of the shop: they gather the commands of all."""
MAY_IMPORT = BENCHMARK | WORKSHOP
FOLDERS = {name: ROOT / name for name in BENCHMARK} | {name: SHOP / name for name in WORKSHOP}

LAYERS = (
    {"numerics"},
    {"scenario"},
    {"physics"},
    {"observation", "info", "named_observation"},
    {"batch"},
    {"policy", "env", "vector_env", "family_env", "tasks", "action"},
    {"rendering", "adapters"},
    {"__main__"},
)
"""Modules of ``turning_env`` from the bottom up.

A module may import its own layer and all below.
"""
UPWARDS = {("env", "rendering")}
"""The exception: an environment creates its viewer."""
LEAVES = {"files", "locks", "console", "extras", "progress"}
"""Modules that all layers may import, and that import none."""


def imports(path: Path) -> Iterator[str]:
    """Yield the full names of modules that a file imports.

    Imports in functions count, and so do those by ``import_module``.
    """
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Call):
            function = ast.unparse(node.func)
            if function.rpartition(".")[2] == "import_module":
                yield ast.unparse(node.args[0]).lstrip("f'\"")


def top_level(modules: Iterable[str]) -> set[str]:
    """Return the packages of modules."""
    return {name.split(".")[0] for name in modules}


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_a_package_imports_only_packages_below_it(package: str) -> None:
    others = (MAY_IMPORT.keys() | {"tests", "shop", "tools"}) - MAY_IMPORT[package] - {package}
    paths = list(FOLDERS[package].rglob("*.py"))
    assert paths
    for path in paths:
        if path not in COMMAND_LINES:
            assert not top_level(imports(path)) & others, path


def loaded(code: str) -> set[str]:
    """Return the modules that a fresh interpreter has loaded after some code."""
    command = [sys.executable, "-c", f"import sys\n{code}\nprint(*sys.modules)"]
    finished = subprocess.run(
        command,
        cwd=ROOT,
        check=True,
        capture_output=True,
        text=True,
    )
    return set(finished.stdout.split())


@pytest.mark.slow
@pytest.mark.parametrize("package", ["turning_env", "baselines", *WORKSHOP])
def test_an_installed_package_loads_only_packages_below_it(package: str) -> None:
    # These need a program or a library that is not always there.
    left_out = ("__main__.py", "hal_bridge.py", "panel.py", "stable_baselines3.py")
    modules = []
    for path in FOLDERS[package].rglob("*.py"):
        if path.name not in left_out:
            relative = path.relative_to(FOLDERS[package].parent).with_suffix("")
            modules.append(".".join(relative.parts).removesuffix(".__init__"))
    assert modules
    code = f"import importlib, contextlib\nfor name in {modules}:\n"
    code += "    with contextlib.suppress(ModuleNotFoundError): importlib.import_module(name)\n"
    above = MAY_IMPORT.keys() - MAY_IMPORT[package] - {package}
    assert not top_level(loaded(code)) & above


LAYER_OF = dict.fromkeys(LEAVES, -1)
"""Numbers of layers by module, from the bottom up."""
for number, modules in enumerate(LAYERS):
    LAYER_OF |= dict.fromkeys(modules, number)


def module_of(path: Path) -> str:
    """Return the module or package of ``turning_env`` that a file belongs to."""
    return path.relative_to(ROOT / "turning_env").parts[0].removesuffix(".py")


def test_every_module_of_the_environment_has_a_layer() -> None:
    modules = {module_of(path) for path in (ROOT / "turning_env").rglob("*.py")}
    assert modules - LAYER_OF.keys() == {"__init__"}


def test_a_module_of_the_environment_imports_only_layers_below_it() -> None:
    upwards = []
    for path in (ROOT / "turning_env").rglob("*.py"):
        module = module_of(path)
        if module == "__init__":
            continue
        for name in imports(path):
            package, _, rest = name.partition(".")
            imported = rest.split(".")[0]
            # Names of the package itself, as ``turning_env.Scenario``, are no module's. Leaves may
            # not import them.
            layer = LAYER_OF.get(imported, 0)
            if package != "turning_env" or (module, imported) in UPWARDS:
                continue
            if layer > LAYER_OF[module]:
                upwards.append(f"{path.relative_to(ROOT)} imports {name}")
    assert upwards == []


LIBRARY_FUNCTIONS = {
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "logaddexp", "geomspace"),
    *("logspace", "pow", "power", "float_power", "hypot", "cbrt", "erf", "erfc", "gamma"),
    *("sin", "cos", "tan", "sinh", "cosh", "tanh", "arcsin", "arccos", "arctan", "arctan2"),
    *("asin", "acos", "atan", "atan2", "dot", "inner", "matmul", "einsum", "linalg"),
}
"""Functions of NumPy and of the C library whose last bits depend on the processor."""
DECIDES_NOTHING = (
    ROOT / "turning_env" / "rendering",  # pictures
    ROOT / "turning_env" / "scenario" / "validation.py",  # bounds, far from any value that ships
)


def depends_on_the_processor(node: ast.AST) -> bool:
    """Return whether an expression takes a library's function, a matrix product or a real power."""
    match node:
        case ast.Attribute(value=ast.Name(id="np" | "math"), attr=name):
            return name in LIBRARY_FUNCTIONS
        case ast.BinOp(op=ast.MatMult()):
            return True
        case ast.BinOp(op=ast.Pow(), right=ast.Constant(value=int())):
            return False
        case ast.BinOp(op=ast.Pow(), right=ast.UnaryOp(operand=ast.Constant(value=int()))):
            return False
        case ast.BinOp(op=ast.Pow()):
            return True
    return False


@pytest.mark.parametrize("package", ["turning_env", "baselines"])
def test_jobs_trajectories_and_rules_are_rounded_alike_on_every_processor(package: str) -> None:
    """Their exponentials and logarithms are those of ``turning_env/numerics/functions.py``."""
    places = []
    for path in FOLDERS[package].rglob("*.py"):
        if any(path.is_relative_to(left_out) for left_out in DECIDES_NOTHING):
            continue
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if depends_on_the_processor(node):
                places.append(f"{path.relative_to(ROOT)}: {ast.unparse(node)}")
    assert places == []


# Learning, plotting and rendering.
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


@pytest.mark.slow
def test_importing_the_environment_loads_no_heavy_library() -> None:
    """Numba and Pydantic take half a second; they are loaded with the first environment."""
    assert not loaded("import turning_env") & (HEAVY | {"numba", "pydantic"})
    assert not loaded("import turning_env; turning_env.RoughTurningEnv") & HEAVY
