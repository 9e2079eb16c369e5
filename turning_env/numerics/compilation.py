"""Compilation with Numba, and its machine code on disk. With ``NUMBA_DISABLE_JIT=1`` the same functions run interpreted."""

import logging
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import event
from numba.core.caching import FunctionCache

from turning_env.files import digest_of_files, exclusive_lock

_LOG = logging.getLogger("turning_env")


class _Announcer(event.Listener):
    """Says in the log when an entry is being compiled, which could be taken for a hang, and how long it took."""

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


_ANNOUNCER = _Announcer()
event.register("numba:compile", _ANNOUNCER)  # type: ignore[no-untyped-call]


class _SharedCache(FunctionCache):
    """Numba's cache on disk, for several processes at a time, for damaged files and for a full disk."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code kept for a signature, None if there is none or it cannot be read."""
        if not Path(self.cache_path).is_dir():
            return None
        try:
            with exclusive_lock(Path(self.cache_path), wait=True):
                return super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
        except Exception as error:  # whatever comes of reading damaged pickles
            _LOG.warning("compiled code kept in %s cannot be read (%s): it is made anew", self.cache_path, type(error).__name__)
            with suppress(OSError):
                self.flush()  # type: ignore[no-untyped-call]
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code of a signature, if the disk has room for it."""
        try:
            with exclusive_lock(Path(self.cache_path), wait=True):
                super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except OSError as error:
            _LOG.warning("compiled code cannot be kept in %s (%s)", self.cache_path, error.strerror)

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Add the sources: Numba watches the file of the entry alone, not those of the functions that it calls."""
        return *super()._index_key(sig, codegen), _compiled_sources()  # type: ignore[no-untyped-call]


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function into the compiled functions that call it."""
    return numba.njit(error_model="numpy", forceinline=True)(function)


def compiled_separately(function: Callable[..., Any]) -> Any:
    """Compile a large function that other compiled functions call."""
    return numba.njit(error_model="numpy")(function)


def compiled_entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, and keep the machine code on disk.

    Numba numbers record types in the order in which a process meets them, and names machine code by these numbers. Processes load
    one another's code, so an argument of an entry, and of what it calls, must always be of the same record type.
    """
    entry = numba.njit(error_model="numpy", nogil=True)(function)
    if hasattr(entry, "_cache"):  # not where nothing is compiled
        try:
            entry._cache = _SharedCache(entry.py_func)  # type: ignore[no-untyped-call]
        except RuntimeError:  # neither the package's folder nor the user's can be written, as in some containers
            _warn_without_cache()
    _ANNOUNCER.entries.add(entry)
    return entry


@cache
def _warn_without_cache() -> None:
    """Warn once: there is more than one entry."""
    _LOG.warning("no folder for machine code can be written: every process compiles anew; NUMBA_CACHE_DIR names one")


@cache
def _compiled_sources() -> str:
    """Return the digest of the files in which compiled functions of this package stand."""
    package = Path(__file__).parents[1]
    files = [package / "observation.py", package / "scenario" / "power_law.py"]
    return digest_of_files(
        package, [*files, *(path for name in ("numerics", "physics", "batch") for path in (package / name).glob("*.py"))]
    )
