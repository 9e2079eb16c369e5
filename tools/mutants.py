"""Make small wrong edits of the core, one at a time, and list those that its tests let pass.

    python -m tools.mutants
    python -m tools.mutants turning_env/physics/edge.py --sample 40

A mutant is a source with one wrong edit: another operator, a dropped clamp or sign, a number that
is twice as large or one higher, a condition turned round, a statement left out. It is killed if the
test file of the same name fails, such as tests/turning_env/physics/test_edge.py. Code runs
interpreted (``NUMBA_DISABLE_JIT``), so a mutant takes a tenth of a second; tests marked
``compiled`` play too long for that, and are left out.

mutmut skips decorated functions, which all kernels are; cosmic-ray starts an interpreter for each
mutant, and has no operator that drops a clamp. So a process imports a file and its tests once, and
forks for each mutant, in which the functions get the code of the mutant.
"""

import ast
import copy
import gc
import importlib.abc
import importlib.machinery
import importlib.util
import json
import multiprocessing
import os
import random
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any, NamedTuple

import gymnasium

from turning_env.console import DONE, FAILED, Parser, described, exits

ROOT = Path(__file__).parents[1]
PACKAGES = ("turning_env/physics", "turning_env/numerics", "baselines/models")
FILES = (
    "leaderboard/statistics.py",
    "leaderboard/standings.py",
    "leaderboard/ranking.py",
    "leaderboard/aggregate.py",
)
LEFT_OUT = {
    "turning_env/numerics/compilation.py": "does nothing in interpreted code",
    "turning_env/numerics/linked_code.py": "does nothing in interpreted code",
}
EQUIVALENT = Path(__file__).with_suffix(".json")
"""Mutants that change no result, by file, each with the reason."""
PROJECT = ("turning_env", "baselines", "leaderboard", "train", "research", "examples", "tests")
MAX_SECONDS = 60  # of the tests of a mutant; one that takes longer is killed
KEY = 709  # of the sample

BINARY: dict[type, type] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.FloorDiv: ast.Div,
    ast.Mod: ast.Mult,
    ast.BitAnd: ast.BitOr,
    ast.BitOr: ast.BitAnd,
    ast.RShift: ast.LShift,
    ast.LShift: ast.RShift,
}
COMPARISONS: dict[type, tuple[type, ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.Is: (ast.IsNot,),
    ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
BOUNDS = ("min", "max", "minimum", "maximum")


class Mutant(NamedTuple):
    """A wrong edit: the node of this number in ``ast.walk`` becomes its alternative."""

    node: int
    alternative: int
    text: str  # "number of the line: line [before -> after]"

    def tree(self, source: str) -> ast.Module:
        """Return the tree of the source with this edit."""
        tree = ast.parse(source)
        nodes = list(ast.walk(tree))
        chosen = nodes[self.node]
        replacement = list(alternatives(chosen))[self.alternative]
        for parent in nodes:
            for name, value in ast.iter_fields(parent):
                if value is chosen:
                    setattr(parent, name, replacement)
                elif isinstance(value, list) and any(item is chosen for item in value):
                    replaced = [replacement if item is chosen else item for item in value]
                    setattr(parent, name, replaced)
        return ast.fix_missing_locations(tree)


def with_fields(node: Any, **fields: Any) -> Any:
    """Return a copy of a node with other fields."""
    other = copy.copy(node)
    for name, value in fields.items():
        setattr(other, name, value)
    return other


def alternatives(node: Any) -> Iterator[ast.AST]:
    """Yield the wrong alternatives of a node."""
    yield from other_operators(node)
    yield from other_values(node)
    yield from dropped_bounds(node)
    # A statement left out.
    match node:
        case ast.AugAssign() | ast.Expr(value=ast.Call()):
            yield ast.copy_location(ast.Pass(), node)
        case ast.Assign(targets=[ast.Attribute() | ast.Subscript()]):
            yield ast.copy_location(ast.Pass(), node)


def other_operators(node: Any) -> Iterator[ast.AST]:
    """Yield a node with another operator, or a condition turned round."""
    match node:
        case ast.BinOp() | ast.AugAssign():
            if type(node.op) in BINARY:
                yield with_fields(node, op=BINARY[type(node.op)]())
        case ast.Compare(ops=[operator]):
            for other in COMPARISONS[type(operator)]:
                yield with_fields(node, ops=[other()])
        case ast.BoolOp():
            yield with_fields(node, op=ast.Or() if isinstance(node.op, ast.And) else ast.And())
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            yield node.operand
        case ast.IfExp() | ast.If():
            yield with_fields(node, test=ast.UnaryOp(ast.Not(), node.test))


def other_values(node: Any) -> Iterator[ast.AST]:
    """Yield another number or truth value."""
    if not isinstance(node, ast.Constant):
        return
    value: Any = node.value
    if isinstance(value, bool):
        yield with_fields(node, value=not value)
    elif isinstance(value, int):
        yield with_fields(node, value=value + 1)
    elif isinstance(value, float):
        yield with_fields(node, value=2.0 * value or 1.0)


def dropped_bounds(node: Any) -> Iterator[ast.AST]:
    """Yield what a clamp or a magnitude is taken of."""
    match node:
        case ast.Call(args=[_, *_], keywords=[]):
            name = getattr(node.func, "id", "") or getattr(node.func, "attr", "")
            if name in BOUNDS and len(node.args) == 2:
                yield from node.args
            elif name in ("clip", "abs"):
                yield node.args[0]


def nodes_without_code(tree: ast.Module) -> set[ast.AST]:
    """Return the nodes that no test should depend on: types, decorators, messages of errors."""
    left_out: set[ast.AST] = set()
    for node in ast.walk(tree):
        parts: list[Any] = [getattr(node, "annotation", None), getattr(node, "returns", None)]
        parts += getattr(node, "decorator_list", [])
        if isinstance(node, ast.Raise):
            parts.append(node)
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "NamedTuple":
            parts.append(node)
        for part in parts:
            if isinstance(part, ast.AST):
                left_out.update(ast.walk(part))
    return left_out


def mutants_of(source: str) -> list[Mutant]:
    """Return all mutants of a source."""
    tree = ast.parse(source)
    lines = source.splitlines()
    left_out = nodes_without_code(tree)
    mutants = []
    for number, node in enumerate(ast.walk(tree)):
        if node in left_out:
            continue
        for place, other in enumerate(alternatives(node)):
            line = getattr(node, "lineno", 0)
            before = " ".join(ast.unparse(node).split())
            after = " ".join(ast.unparse(ast.fix_missing_locations(other)).split())
            text = f"{line}: {lines[line - 1].strip()} [{before[:60]} -> {after[:60]}]"
            mutants.append(Mutant(number, place, text))
    return mutants


def test_file_of(file: str) -> str:
    """Return the test file of the same name."""
    path = Path(file)
    return str(Path("tests") / path.parent / f"test_{path.name}")


class NeedsImportError(Exception):
    """The mutant changes code that runs when its module is imported."""


def swapped(
    before: CodeType, after: CodeType, functions: dict[CodeType, list[FunctionType]]
) -> Iterator[tuple[FunctionType, CodeType]]:
    """Yield the functions whose code the mutant changes, each with its new code."""
    if before == after:
        return
    if before in functions:
        for function in functions[before]:
            yield function, after
        return
    inner_before = [part for part in before.co_consts if isinstance(part, CodeType)]
    inner_after = [part for part in after.co_consts if isinstance(part, CodeType)]
    constants_before = [part for part in before.co_consts if not isinstance(part, CodeType)]
    constants_after = [part for part in after.co_consts if not isinstance(part, CodeType)]
    same = before.co_code == after.co_code and repr(constants_before) == repr(constants_after)
    if not same or len(inner_before) != len(inner_after) or not inner_before:
        raise NeedsImportError
    for part_before, part_after in zip(inner_before, inner_after, strict=True):
        yield from swapped(part_before, part_after, functions)


class MutantFinder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports the code of a mutant in place of its module."""

    def __init__(self, module: str, path: str, code: CodeType) -> None:
        self._module = module
        self._path = path
        self._code = code

    def find_spec(self, fullname: str, path: Any, target: Any = None) -> Any:
        if fullname != self._module:
            return None
        return importlib.util.spec_from_file_location(fullname, self._path, loader=self)

    def exec_module(self, module: Any) -> None:
        exec(self._code, module.__dict__)


def put_in(file: str, mutant: Mutant, *, import_again: bool) -> None:
    """Let this process run a mutant in place of a file.

    Its functions get new code. With ``import_again``, or if code outside of functions differs, all
    modules are imported again, which takes longer.
    """
    path = str(ROOT / file)
    source = Path(path).read_text("utf-8")
    before = compile(source, path, "exec", dont_inherit=True)
    after = compile(mutant.tree(source), path, "exec", dont_inherit=True)
    functions: dict[CodeType, list[FunctionType]] = {}
    gc.unfreeze()  # the suite's settings freeze what is imported
    for thing in gc.get_objects():
        if isinstance(thing, FunctionType) and thing.__code__.co_filename == path:
            functions.setdefault(thing.__code__, []).append(thing)
    try:
        if import_again:
            raise NeedsImportError
        for function, code in list(swapped(before, after, functions)):
            function.__code__ = code
    except (NeedsImportError, ValueError):
        gymnasium.registry.clear()
        for name in list(sys.modules):
            if name.partition(".")[0] in PROJECT:
                del sys.modules[name]
        module = file.removesuffix(".py").replace("/", ".")
        sys.meta_path.insert(0, MutantFinder(module, path, after))


def run_tests(tests: str, *options: str) -> int:
    """Run a test file; return pytest's status."""
    import pytest

    chosen = "not slow and not compiled"
    arguments = [tests, *options, "-x", "-q", "--no-header", "-m", chosen]
    arguments += ["--assert=plain", "-p", "no:cacheprovider", "-p", "no:xdist"]
    return int(pytest.main(arguments))


def in_a_fork(file: str, mutant: Mutant | None = None, *, import_again: bool = False) -> int:
    """Run the tests of a mutant in a process of its own; return its status, 0 if they pass."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            signal.alarm(MAX_SECONDS)
            silence = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silence, 1)
            os.dup2(silence, 2)
            if mutant is not None:
                put_in(file, mutant, import_again=import_again)
            status = run_tests(test_file_of(file))
        finally:
            os._exit(status)
    _, status = os.waitpid(child, 0)
    return status


def survivors_of(file: str, mutants: list[Mutant]) -> list[Mutant]:
    """Return the mutants of a file that its tests let pass."""
    if not (ROOT / test_file_of(file)).exists():
        return mutants
    # The imports of the tests, once for all mutants.
    run_tests(test_file_of(file), "--collect-only", "-qq")
    if in_a_fork(file) != 0:
        raise RuntimeError(f"the tests of {file} fail without any edit")
    survivors = [mutant for mutant in mutants if in_a_fork(file, mutant) == 0]
    # What modules compute as they are imported is from before the edit, so try those again.
    return [mutant for mutant in survivors if in_a_fork(file, mutant, import_again=True) == 0]


def chosen_files(names: list[str]) -> list[str]:
    """Return the files of some folders or files, by default all of the core."""
    files = []
    for name in names or [*PACKAGES, *FILES]:
        path = ROOT / name
        found = sorted(path.glob("*.py")) if path.is_dir() else [path]
        files += [str(file.relative_to(ROOT)) for file in found if file.name != "__init__.py"]
    return [file for file in files if file not in LEFT_OUT]


@exits()
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = Parser(prog="python -m tools.mutants", **described(__doc__))
    parser.add_argument("files", nargs="*", help="files or folders; default: all of the core")
    parser.add_argument("--sample", type=int, help="number of mutants of each file; default: all")
    options = parser.parse_args(arguments)
    os.chdir(ROOT)
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    equivalent = json.loads(EQUIVALENT.read_text("utf-8")) if EQUIVALENT.exists() else {}
    # Libraries are imported once for all files.
    import scipy.stats  # noqa: F401

    all_made = 0
    all_survived = 0
    for file in chosen_files(options.files):
        reasons = equivalent.get(file, {})
        mutants = mutants_of((ROOT / file).read_text("utf-8"))
        mutants = [mutant for mutant in mutants if mutant.text.partition(": ")[2] not in reasons]
        if options.sample is not None and options.sample < len(mutants):
            mutants = random.Random(KEY).sample(mutants, options.sample)
            mutants.sort()
        with multiprocessing.get_context("fork").Pool(1) as pool:
            survivors = pool.apply(survivors_of, (file, mutants))
        all_made += len(mutants)
        all_survived += len(survivors)
        print(f"{file}: {len(mutants) - len(survivors)} of {len(mutants)} killed", flush=True)
        for mutant in survivors:
            print(f"    {file}:{mutant.text}", flush=True)
    killed = all_made - all_survived
    print(f"{killed} of {all_made} killed: {100.0 * killed / max(all_made, 1):.1f} %")
    return FAILED if all_survived else DONE


if __name__ == "__main__":
    sys.exit(main())
