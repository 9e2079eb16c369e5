"""Make small changes to the physics, the statistics and the models' gradients, and list those that the fast tests miss.

A mutant changes one place in one file of a copy of the repository. It replaces an operator, a comparison or a constant, drops a
term, negates a condition, writes min for max, or swaps two arguments. Two mutants are tested at a time. A mutant of the physics
is tested with the golden trajectories first, interpreted, which takes ten seconds. ``--out`` keeps the outcomes, so the same
command continues where it stopped. The exit status is 1 if the tests find a smaller share of the mutants than ``--at-least``.

    python -m studies.mutants
    python -m studies.mutants --count 20 --seed 1
"""

import argparse
import ast
import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from copy import deepcopy
from hashlib import sha256
from itertools import accumulate
from pathlib import Path
from queue import Queue
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from tqdm import tqdm

from turning_env.console import described, exits

ROOT = Path(__file__).parents[1]
TARGETS = ("turning_env/physics/*.py", "turning_env/scoring/statistics.py", "train/model_gain.py")
OWN = {
    "turning_env/scoring/statistics.py": "tests/turning_env/scoring/test_statistics.py",
    "train/model_gain.py": "tests/train/test_model_gain.py",
}
"""Tests of each file, which run first."""
GOLDEN = "tests/turning_env/test_golden.py"
"""Tests of the physics, run interpreted: compiling would take longer."""
TESTS = ("tests/turning_env/physics", "tests/turning_env/test_observation.py", "tests/turning_env/test_tasks.py")
"""Tests to run compiled if a mutant of the physics passes the golden trajectories."""
LEFT_OUT = shutil.ignore_patterns(".*", "__pycache__", "runs", "results", "agents", "docs", "site")
OPERATORS: dict[type[ast.AST], tuple[type[ast.AST], ...]] = {
    **{ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,), ast.And: (ast.Or,)},
    **{ast.Or: (ast.And,), ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Lt: (ast.LtE, ast.Gt)},
    **{ast.LtE: (ast.Lt, ast.Gt), ast.Gt: (ast.GtE, ast.Lt), ast.GtE: (ast.Gt, ast.Lt)},
}
SWAPPED = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum"}


def changes(node: ast.AST) -> Iterator[ast.AST]:
    """Yield every changed form of an expression."""
    match node:
        case ast.BinOp() | ast.BoolOp():
            yield from (_with(node, op=other()) for other in OPERATORS.get(type(node.op), ()))
            if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add | ast.Sub):
                yield node.left  # a term is dropped
        case ast.Compare(ops=[op]):
            yield from (_with(node, ops=[other()]) for other in OPERATORS.get(type(op), ()))
        case ast.Constant(value=int() | float() as value) if not isinstance(value, bool):
            yield _with(node, value=value + 1 if isinstance(value, int) or value == 0.0 else 1.1 * value)
        case ast.Call(func=ast.Name(id=name)) if name in SWAPPED:
            yield _with(node, func=ast.Name(SWAPPED[name]))
        case ast.Call(func=ast.Attribute(attr=name)) if name in SWAPPED:
            yield _with(node, func=_with(node.func, attr=SWAPPED[name]))
        case ast.Call(args=[ast.Name() | ast.Attribute() as first, ast.Name() | ast.Attribute() as second, *others]):
            yield _with(node, args=[second, first, *others])
        case ast.IfExp(test=test):
            yield _with(node, test=ast.UnaryOp(ast.Not(), test))


def _with(node: ast.AST, **fields: object) -> ast.AST:
    other = deepcopy(node)
    vars(other).update(fields)
    return other


def places(node: ast.AST) -> Iterator[tuple[ast.AST, ast.AST]]:
    """Yield expressions below a node with their changed forms; texts, types, decorators and raised errors stay."""
    if isinstance(node, ast.If | ast.While):
        yield node.test, ast.UnaryOp(ast.Not(), node.test)
    yield from ((node, changed) for changed in changes(node))
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns", "decorator_list", "type_params"):
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST) and not isinstance(child, ast.Raise | ast.Assert | ast.JoinedStr | ast.ImportFrom):
                    yield from places(child)


class Mutant(NamedTuple):
    """A file with one change."""

    path: str
    line: int
    text: str

    @property
    def key(self) -> str:
        """Name of the outcome; it changes with the file."""
        return f"{self.path}:{self.line} {sha256(self.text.encode()).hexdigest()[:16]}"


def mutants() -> list[Mutant]:
    """Return all mutants in the order of files and lines."""
    found = {}
    for path in sorted(path for target in TARGETS for path in ROOT.glob(target)):
        source = path.read_bytes()
        starts = list(accumulate(map(len, source.splitlines(keepends=True)), initial=0))
        for node, changed in places(ast.parse(source)):
            place: Any = node
            at, to = starts[place.lineno - 1] + place.col_offset, starts[place.end_lineno - 1] + place.end_col_offset
            text = source[:at] + f"({ast.unparse(changed)})".encode() + source[to:]
            found[text] = Mutant(str(path.relative_to(ROOT)), place.lineno, text.decode())
    return list(found.values())


def passes(copy: Path, path: str, limit: float | None = None) -> bool:
    """Return whether the fast tests of a file pass in a copy of the repository, each call within a limit [s]."""
    for interpreted, tests in [(False, (OWN[path],))] if path in OWN else [(True, (GOLDEN,)), (False, TESTS)]:
        command = [sys.executable, "-m", "pytest", "-x", "-q", "--timeout", "0", "-m", "not slow", *tests]
        variables = os.environ | {"PYTHONPATH": str(copy), "OMP_NUM_THREADS": "1", "NUMBA_DISABLE_JIT": str(int(interpreted))}
        try:
            subprocess.run(command, cwd=copy, env=variables, capture_output=True, timeout=limit, check=True)
        except (subprocess.TimeoutExpired, subprocess.CalledProcessError):
            return False
    return True


def survives(mutant: Mutant, copies: "Queue[Path]", limit: float) -> bool:
    """Test a mutant in one of the copies, and restore the copy."""
    copy = copies.get()
    try:
        (copy / mutant.path).write_text(mutant.text, "utf-8")
        return passes(copy, mutant.path, limit)
    finally:
        shutil.copy2(ROOT / mutant.path, copy / mutant.path)
        copies.put(copy)


@exits(RuntimeError, interrupted="interrupted: the same command goes on", checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Test mutants and print those that survive; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m studies.mutants", **described(__doc__))
    parser.add_argument("--count", type=int, default=200, help="number of mutants, drawn at random (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the draw (default: %(default)s)")
    parser.add_argument("--at-least", type=float, default=0.9, help="share that the tests must find (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=Path("runs/mutants.jsonl"), help="file of outcomes (default: %(default)s)")
    options = parser.parse_args(arguments)
    every = mutants()
    drawn = Random(options.seed).sample(every, min(options.count, len(every)))
    options.out.parent.mkdir(parents=True, exist_ok=True)
    survived = dict(map(json.loads, options.out.read_text("utf-8").splitlines())) if options.out.exists() else {}
    left = [mutant for mutant in drawn if mutant.key not in survived]
    with TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool, options.out.open("a", encoding="utf-8") as outcomes:
        copies: Queue[Path] = Queue()
        for name in ("first", "second"):
            copies.put(shutil.copytree(ROOT, Path(folder) / name, ignore=LEFT_OUT))
        start = time.monotonic()
        tests = {mutant.path if mutant.path in OWN else "physics" for mutant in left}
        if not all(passes(Path(folder) / "first", path) for path in sorted(tests)):
            raise RuntimeError("the tests fail without a mutant")
        limit = 60.0 + 2.0 * (time.monotonic() - start)
        work = {pool.submit(survives, mutant, copies, limit): mutant for mutant in left}
        try:
            for done in tqdm(as_completed(work), total=len(work), unit="mutant", disable=None):
                survived[work[done].key] = done.result()
                print(json.dumps([work[done].key, done.result()]), file=outcomes, flush=True)
        finally:
            pool.shutdown(cancel_futures=True)
    alive = [mutant for mutant in drawn if survived[mutant.key]]
    for mutant in sorted(alive):
        lines = (text.splitlines()[mutant.line - 1].strip() for text in ((ROOT / mutant.path).read_text("utf-8"), mutant.text))
        print(f"{mutant.path}:{mutant.line}", *lines, sep="\n  ")
    print(f"{len(drawn) - len(alive)} of {len(drawn)} mutants found ({1 - len(alive) / len(drawn):.1%}), drawn of {len(every)}")
    return 0 if len(alive) <= (1 - options.at_least) * len(drawn) else 1


if __name__ == "__main__":
    sys.exit(main())
