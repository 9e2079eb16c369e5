"""How the transition is compiled: with Numba, once, and kept on disk.

With ``NUMBA_DISABLE_JIT=1`` in the environment the same functions run in the Python interpreter.
"""

import hashlib
import logging
import os
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.core import event, types
from numba.core.caching import FunctionCache

from turning_env.files import digest_of_files

try:
    import fcntl
except ImportError:  # there is none on Windows
    fcntl = None  # type: ignore[assignment]


class _Announcer(event.Listener):
    """Says in the log when an entry is being compiled, which takes long enough to be taken for a hang, and how long it took."""

    def __init__(self) -> None:
        self.entries: set[Any] = set()
        self._started: dict[Any, float] = {}

    def on_start(self, event: Any) -> None:
        entry = event.data["dispatcher"]
        if entry in self.entries:
            self._started[entry] = time.perf_counter()
            _LOG.warning("compiling %s; the machine code is kept on disk for the next time ...", entry.__name__)

    def on_end(self, event: Any) -> None:
        entry = event.data["dispatcher"]
        if entry in self._started:
            _LOG.warning("... which took %.0f s", time.perf_counter() - self._started.pop(entry))


_LOG = logging.getLogger("turning_env")
_ANNOUNCER = _Announcer()
event.register("numba:compile", _ANNOUNCER)  # type: ignore[no-untyped-call]


def _mangled_by_content(record: Any) -> tuple[str, tuple[int]]:
    """What a record type's name in machine code is made of.

    Numba numbers record types in the order in which a process meets them. So code on disk that two processes made has the same
    names for what is done to different records, and where a third loads both, one's code would work on the other's.
    """
    return type(record).__name__, (int.from_bytes(hashlib.sha256(record.name.encode()).digest()[:7], "big"),)


types.Record.mangling_args = property(_mangled_by_content)  # type: ignore[method-assign, assignment]


class _SharedCache(FunctionCache):
    """Numba's cache on disk, for several processes at a time and for files that are damaged.

    Numba's own lets two processes that compile an entry for different types write the same file, and the index then hands out
    one's machine code for the other's records.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The machine code kept for a signature, None if there is none or it cannot be read."""
        try:
            with self._alone():
                return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception as error:  # whatever comes of reading damaged pickles
            _LOG.warning("compiled code kept in %s cannot be read (%s): it is made anew", self.cache_path, type(error).__name__)
            with suppress(OSError), self._alone():
                self.flush()  # type: ignore[no-untyped-call]
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code of a signature, if the disk has room for it."""
        try:
            with self._alone():
                super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except OSError as error:
            _LOG.warning("compiled code cannot be kept in %s (%s)", self.cache_path, error.strerror)

    @contextmanager
    def _alone(self) -> Iterator[None]:
        """Wait until no other process reads or writes here."""
        try:
            lock = open(Path(self.cache_path) / ".lock", "w")  # noqa: SIM115 - closed below
        except OSError:  # the folder cannot be written, so nobody does
            yield
            return
        with lock:
            if fcntl is not None:
                fcntl.flock(lock, fcntl.LOCK_EX)
            yield


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a scalar function that other compiled functions call."""
    return numba.njit(error_model="numpy", forceinline=True)(function)


def compiled_apart(function: Callable[..., Any]) -> Any:
    """Compile a function that other compiled functions call, but not as part of them: for large ones."""
    return numba.njit(error_model="numpy")(function)


def compiled_entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, and keep the machine code on disk.

    The function must read ``source_digest()`` from its closure: Numba's cache watches only the file in which a
    function stands, so a change in a file that it calls would otherwise run stale machine code. Nothing else that is compiled
    may be in the closure: it would make a key of its own in every process.
    """
    entry = numba.njit(error_model="numpy", nogil=True)(function)
    if hasattr(entry, "_cache"):  # not where nothing is compiled
        try:
            entry._cache = _SharedCache(entry.py_func)  # type: ignore[no-untyped-call]
        except RuntimeError:  # neither the package's folder nor the user's can be written, as in some containers
            _tell_of_no_cache()
    _ANNOUNCER.entries.add(entry)
    return entry


@cache
def _tell_of_no_cache() -> None:
    """Once: there is more than one entry."""
    _LOG.warning("no folder for machine code can be written: every process compiles anew; NUMBA_CACHE_DIR names one")


def handed_over(records: Any) -> Any:
    """Records as an entry takes them: plain arrays, which a compiled call takes far faster; record arrays if interpreted.

    A compiled call knows types by identity: of equal ones, all but the first would take microseconds more each.
    """
    return records if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0" else records.view(_first_of(records.dtype), np.ndarray)


@cache
def _first_of(dtype: np.dtype[Any]) -> np.dtype[Any]:
    """The first of equal types."""
    return dtype


def source_digest(package: Path = Path(__file__).parents[1]) -> str:
    """SHA-256 over the Python files, names and contents, of a package: of this one, if none is given.

    What stands in folders below does not count: packages there draw or use what happens, and decide nothing of it.
    """
    return digest_of_files(package, package.rglob("*.py"))
