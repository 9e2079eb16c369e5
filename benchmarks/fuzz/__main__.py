"""Fuzz all that reads files from elsewhere.

    python -m benchmarks.fuzz
    python -m benchmarks.fuzz --reader scenario program --minutes 1 --json
    python -m benchmarks.fuzz --reader program --again runs/fuzz/program/found-0123456789ab.mpf

Readers of scenarios (TOML), measurements (CSV), results and trajectories (JSON), agents (ONNX) and NC programs are given damaged
files. Each must give what the file may hold, or its own error, which names the file. Where atheris is installed (the dependency
group "fuzz"), the code that is reached guides the search, and what it has learnt is kept for the next; else the damage is random.

Each content that breaks a promise is kept, one for each place in the code, and the exit status is then 1.
"""

import argparse
import importlib.util
import json
import random
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tqdm import tqdm

from benchmarks.fuzz.readers import READERS, ROOT, TRIED
from benchmarks.fuzz.search import keep
from turning_env.console import DONE, FAILED, described, exits, print_json

_PROGRAM = "from benchmarks.fuzz.worker import main; main()"
_REACHED = re.compile(r"#\d+\s.*\bcov: (\d+) ft: (\d+)")
_LAST_LINES = 12
_COLUMNS = {"reader": 12, "minutes": 7, "inputs": 10, "branches": 8, "features": 8, "unhandled": 9}


@dataclass
class Outcome:
    """What came of a reader's search."""

    reader: str
    minutes: float
    """Processor time that it was given: on a busy machine, as far as on an idle one."""
    inputs: int = 0
    branches: int | None = None
    """That were reached, of those instrumented; None without atheris."""
    features: int | None = None
    """libFuzzer's: branches with how often they were passed, and what was compared."""
    unhandled: dict[str, str] = field(default_factory=dict)
    """Of each file that was kept, the error."""


def fuzz(name: str, minutes: float, inputs: int | None, out: Path, guided: bool, seed: int) -> Outcome:
    """Try one reader, in a process of its own."""
    outcome = Outcome(name, minutes)
    with tempfile.TemporaryDirectory() as scratch, tqdm(total=round(60 * minutes), desc=name, unit="s", disable=None) as bar:
        asked = {"reader": name, "guided": guided, "scratch": scratch, "out": str((out / name).absolute())}
        asked |= {"seconds": 60.0 * minutes, "inputs": inputs, "seed": seed}
        said: list[str] = []
        with subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, json.dumps(asked)],
            cwd=ROOT,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            encoding="utf-8",
            errors="replace",
        ) as process:
            assert process.stdout is not None
            try:
                for line in process.stdout:
                    if line.startswith('{"tried"'):
                        told = json.loads(line)
                        outcome.inputs, outcome.unhandled = told["tried"], told["found"]
                        bar.set_postfix(inputs=outcome.inputs, unhandled=len(outcome.unhandled), refresh=False)
                        bar.update(min(round(told["seconds"]), bar.total) - bar.n)
                    elif match := _REACHED.match(line):
                        outcome.branches, outcome.features = int(match[1]), int(match[2])
                    else:
                        said = [*said, line][-_LAST_LINES:]
                status = process.wait()
            finally:
                process.kill()
        if status:
            _keep_last(outcome, Path(scratch), out / name, f"its process ended (status {status}):\n{''.join(said)}")
    return outcome


def _keep_last(outcome: Outcome, scratch: Path, kept: Path, error: str) -> None:
    """Keep the content at which a process has ended.

    Raises:
        RuntimeError: it had tried none.
    """
    last = max(scratch.glob(f"{TRIED}.*"), key=lambda path: path.stat().st_mtime_ns, default=None)
    if last is None:
        raise RuntimeError(f"{outcome.reader}: {error}")
    path = keep(kept, last.read_bytes(), READERS[outcome.reader].suffix)
    outcome.unhandled[str(path)] = error


def again(name: str, path: Path) -> int:
    """Try one content, in this process; the exit status. An error is not caught, so that it shows where it was raised."""
    with tempfile.TemporaryDirectory() as scratch:
        given = READERS[name].check(Path(scratch), path.read_bytes())
    print("is refused, as it should be" if given is None else "is read, and as it should be")
    return DONE


@exits(RuntimeError, interrupted="interrupted: what was found is kept, and the next search goes on from there", checks=True)
def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz, print and return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", **described(__doc__))
    parser.add_argument("--reader", nargs="+", choices=READERS, default=list(READERS), help="which (default: all)")
    parser.add_argument("--minutes", type=float, default=10.0, help="processor time for each reader (default: %(default)g)")
    parser.add_argument("--inputs", type=int, help="most that each reader is given (default: as many as there is time for)")
    parser.add_argument("--seed", type=int, help="of what is drawn (default: another every time)")
    parser.add_argument("--out", type=Path, default=Path("runs/fuzz"), help="folder for what is kept (default: %(default)s)")
    parser.add_argument("--random", action="store_true", help="damage files at random also where atheris is installed")
    parser.add_argument("--again", type=Path, metavar="FILE", help="give one reader this file, and show its error if it has one")
    parser.add_argument("--json", action="store_true", help="print the table as JSON")
    options = parser.parse_args(arguments)
    if not 0 < options.minutes < float("inf") or (options.inputs is not None and options.inputs < 1):
        parser.error("--minutes must be above 0, and --inputs at least 1")
    if options.again is not None:
        if len(options.reader) != 1:
            parser.error("--again needs the one --reader that the file is for")
        return again(options.reader[0], options.again)
    guided = not options.random and importlib.util.find_spec("atheris") is not None
    if not guided and not options.random:
        print("atheris is not installed (pip install atheris): files are damaged at random", file=sys.stderr)
    seed = random.randrange(2**31) if options.seed is None else options.seed
    outcomes = []
    if not options.json:
        print("  ".join(f"{heading:>{width}}" for heading, width in _COLUMNS.items()), flush=True)
    for name in dict.fromkeys(options.reader):
        outcomes.append(fuzz(name, options.minutes, options.inputs, options.out, guided, seed))
        if not options.json:
            _print(outcomes[-1])
    if options.json:
        print_json(outcomes)
    for outcome in outcomes:
        for path, error in outcome.unhandled.items():
            print(
                f"{outcome.reader}: {error}\n  python -m benchmarks.fuzz --reader {outcome.reader} --again {path}",
                file=sys.stderr,
            )
    return FAILED if any(outcome.unhandled for outcome in outcomes) else DONE


def _print(outcome: Outcome) -> None:
    branches, features = ("-" if count is None else f"{count:,}" for count in (outcome.branches, outcome.features))
    cells = outcome.reader, f"{outcome.minutes:g}", f"{outcome.inputs:,}", branches, features, f"{len(outcome.unhandled)}"
    print("  ".join(f"{cell:>{width}}" for cell, width in zip(cells, _COLUMNS.values(), strict=True)), flush=True)


if __name__ == "__main__":
    sys.exit(main())
