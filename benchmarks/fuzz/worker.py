"""The process in which a reader is tried: whatever an input does to it, the command that started it goes on.

It prints a line of JSON about every second: how many inputs have been tried, what was found, and the processor time that this
took. With atheris, libFuzzer prints between these how much of the code has been reached.
"""

import faulthandler
import json
import os
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from pathlib import Path
from random import Random
from types import CodeType, ModuleType
from typing import Any

HANGS = 120.0
"""So much processor time [s] without a line, and the process ends itself."""
_INSTRUMENTED = (
    *("tomllib._parser", "tomllib._re"),
    *(f"turning_env.{name}" for name in ("scenario", "sections", "quantity", "extremes", "power_law")),
    *(f"turning_env.calibration.{name}" for name in ("columns", "reading")),
    *(f"leaderboard.{name}" for name in ("results", "trajectories")),
    *(f"train.nc.{name}" for name in ("read", "read_law", "expression", "program", "numbers", "synchronous", "write")),
    *("train.plain_graph", "train.agent_file"),
)
"""The modules whose branches guide atheris: what reads, and no compiled functions, which Numba could not make of changed code."""
_LONGEST_INPUT = 100_000


class _Instrumenting(PathFinder):
    """Finds these modules so that they are loaded with atheris's instrumentation, which else takes whole packages."""

    @classmethod
    def find_spec(cls, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        spec = super().find_spec(fullname, path, target) if fullname in _INSTRUMENTED else None
        if spec is not None and isinstance(spec.loader, SourceFileLoader):
            spec.loader = _Loader(spec.loader.name, spec.loader.path)
        return spec


class _Loader(SourceFileLoader):
    def get_code(self, fullname: str) -> CodeType | None:
        code = super().get_code(fullname)
        patched: CodeType | None = code and import_module("atheris").patch_code(code, True)
        return patched


def main() -> None:
    """Try one reader, as the one argument says, which is JSON: see ``__main__.py``."""
    asked = json.loads(sys.argv[1])
    if hasattr(signal, "SIGPROF"):
        faulthandler.register(signal.SIGPROF, chain=True)  # says where it is, and then ends the process
    if asked["guided"]:
        sys.meta_path.insert(0, _Instrumenting)
    # Only now, as these import the modules that are instrumented.
    from benchmarks.fuzz.readers import READERS
    from benchmarks.fuzz.search import Search

    search = Search(READERS[asked["reader"]], Path(asked["scratch"]), Path(asked["out"]), _report)
    if asked["guided"]:
        _guided(search, asked)
    else:
        search.damage(asked["seconds"], asked["inputs"], Random(asked["seed"]))
        search.tell()


def _report(tried: int, found: dict[str, str], seconds: float) -> None:
    if hasattr(signal, "SIGPROF"):
        signal.setitimer(signal.ITIMER_PROF, HANGS)
    print(json.dumps({"tried": tried, "found": found, "seconds": seconds}), flush=True)


def _guided(search: Any, asked: dict[str, Any]) -> None:
    """Let libFuzzer search. The process ends within, and what was learnt is on the disk."""
    atheris = import_module("atheris")
    reader, scratch = search.reader, Path(asked["scratch"])
    valid, grown = scratch / "valid", Path(asked["out"]) / "corpus"
    for folder in (valid, grown):
        folder.mkdir(parents=True, exist_ok=True)
    for number, content in enumerate(reader.valid()):
        (valid / f"{number}").write_bytes(content)
    words = scratch / "words"
    words.write_text("".join('"' + "".join(f"\\x{byte:02x}" for byte in token) + '"\n' for token in reader.tokens), "ascii")

    def attempt(content: bytes) -> None:
        search.attempt(content)
        if search.seconds >= asked["seconds"] or search.tried == asked["inputs"]:
            search.tell()
            os._exit(0)  # libFuzzer knows limits by the clock alone

    def mutated(content: bytes, most: int, seed: int) -> bytes:
        random = Random(seed)
        changed: bytes = reader.damaged(content, random) if random.random() < 0.5 else b""
        return changed if 0 < len(changed) <= most else atheris.Mutate(content, most)

    lengths = [f"-max_len={_LONGEST_INPUT}", "-len_control=0", "-rss_limit_mb=4096"]
    told = [f"-artifact_prefix={scratch}/", f"-dict={words}", f"-seed={asked['seed'] % 2**31 + 1}", str(grown), str(valid)]
    atheris.Setup(["fuzz", *lengths, *told], attempt, custom_mutator=mutated)
    atheris.Fuzz()
