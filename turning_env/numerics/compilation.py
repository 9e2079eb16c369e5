"""Compile with Numba and keep the machine code on disk. With ``NUMBA_DISABLE_JIT=1``, the same functions run interpreted."""

import inspect
import logging
import time
from collections.abc import Callable
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import config
from numba.core.caching import (
    CompileResultCacheImpl,
    FunctionCache,
    IndexDataCacheFile,
    InTreeCacheLocator,
    UserProvidedCacheLocator,
)
from numba.core.registry import CPUDispatcher
from numba.extending import register_jitable

from turning_env.files import FolderTaken, digest_of_files, exclusive_lock, file_lock

_LOG = logging.getLogger("turning_env")
INLINED: Any = {"forceinline": True, "no_cfunc_wrapper": True}
"""Options of overloads that are compiled into their callers."""


class _LastLocator(InTreeCacheLocator):
    """Locator of the package's own folder if no folder can be written: it may hold machine code compiled in advance."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> "_LastLocator":
        """Return a locator, even if the folder cannot be written."""
        return cls(py_func, py_file)


class _Files(CompileResultCacheImpl):
    _locator_classes = [*CompileResultCacheImpl._locator_classes, _LastLocator]  # noqa: RUF012 - as in the base


class _SharedCache(FunctionCache):
    """Numba's cache on disk, made safe for several processes, damaged files, a full disk and read-only folders.

    A process that compiles holds a lock, which ends with the process. Others that need the same code wait and load it.
    Compiling can look like a hang, so the log says when it starts and how long it took.
    """

    _impl_class = _Files

    def __init__(self, py_func: Any) -> None:
        super().__init__(py_func)  # type: ignore[no-untyped-call]
        named = config.CACHE_DIR  # type: ignore[attr-defined]
        place: Any = (UserProvidedCacheLocator if named else InTreeCacheLocator)(py_func, inspect.getfile(py_func))
        self.preferred: str = place.get_cache_path()
        """Preferred folder of machine code; ``cache_path`` is another folder if this one cannot be written."""
        self._lock, self._started = ExitStack(), 0.0

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the machine code kept for a signature, or None if there is none that can be read; the caller then compiles."""
        found = self._load(sig, target_context)
        if found is None:
            lock, name = Path(self.cache_path) / f".{self._impl.filename_base}.lock", self._py_func.__name__
            with suppress(OSError):  # where the folder cannot be written
                try:
                    self._lock.enter_context(file_lock(lock))
                except FolderTaken:
                    _LOG.warning("another process is compiling %s: waiting for it ...", name)
                    self._lock.enter_context(file_lock(lock, wait=True))
                found = self._load(sig, target_context)  # which may have been saved before the lock was taken
        if found is None:
            _LOG.warning("compiling %s; the machine code is kept on disk for the next time ...", name)
            self._started = time.perf_counter()
        return found

    def _load(self, sig: Any, target_context: Any) -> Any:
        target_context.refresh()
        try:
            if Path(self.cache_path).is_dir():
                with exclusive_lock(Path(self.cache_path), wait=True):
                    found = super().load_overload(sig, target_context)  # type: ignore[no-untyped-call]
                if found is not None:
                    return found
        except Exception as error:  # damaged pickles can raise anything
            _LOG.warning("compiled code kept in %s cannot be read (%s): it is made anew", self.cache_path, type(error).__name__)
            with suppress(OSError):
                self.flush()  # type: ignore[no-untyped-call]
        return self._load_prepared(sig, target_context)

    def _load_prepared(self, sig: Any, target_context: Any) -> Any:
        """Return machine code that was compiled in advance to a read-only folder, as in a container image."""
        stamp = self._impl.locator.get_source_stamp()
        file = IndexDataCacheFile(self.preferred, self._impl.filename_base, stamp)  # type: ignore[no-untyped-call]
        if self.preferred != self.cache_path:
            with suppress(Exception):
                kept = file.load(self._index_key(sig, target_context.codegen()))  # type: ignore[no-untyped-call]
                return None if kept is None else self._impl.rebuild(target_context, kept)
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the machine code of a signature, if the disk has room for it."""
        try:
            with exclusive_lock(Path(self.cache_path), wait=True):
                super().save_overload(sig, data)  # type: ignore[no-untyped-call]
        except OSError as error:
            _warn_without_cache(self.cache_path, error.strerror)

    def finish(self) -> None:
        """Let other processes compile, or load what has been compiled."""
        self._lock.close()
        if self._started:
            _LOG.warning("... which took %.0f s", time.perf_counter() - self._started)
            self._started = 0.0

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        """Return Numba's key with the sources: Numba watches the entry's file, but not those of the functions that it calls."""
        folder = Path(inspect.getfile(self._py_func)).parent
        return *super()._index_key(sig, codegen), _compiled_sources(folder)  # type: ignore[no-untyped-call]


class _Entry(CPUDispatcher):
    """A compiled function that Python calls."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._cache = _SharedCache(self.py_func)

    def compile(self, sig: Any) -> Any:
        """Compile the function for a signature, or load it."""
        try:
            return super().compile(sig)
        finally:
            self._cache.finish()

    def kept_files(self) -> list[Path]:
        """Return the files on disk with its machine code."""
        folders = {Path(self._cache.cache_path), Path(self._cache.preferred)}
        return [path for folder in folders for path in folder.glob(f"{self._cache._impl.filename_base}.*nb[ci]")]


def compiled(function: Callable[..., Any]) -> Any:
    """Let compiled functions call a function, which is compiled into them; called from Python it runs interpreted."""
    return register_jitable(error_model="numpy", forceinline=True, no_cfunc_wrapper=True)(function)


def compiled_separately(function: Callable[..., Any]) -> Any:
    """Let compiled functions call a large function; called from Python it runs interpreted."""
    return register_jitable(error_model="numpy", no_cfunc_wrapper=True)(function)


def compiled_entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, and keep the machine code on disk.

    Numba numbers record types in the order in which a process meets them, and names machine code by these numbers. Processes load
    one another's code, so an argument of an entry, and of what it calls, must always be of the same record type.
    """
    if config.DISABLE_JIT:  # type: ignore[attr-defined]
        return function
    return _Entry(function, targetoptions={"nopython": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True})


@cache
def _warn_without_cache(folder: str, reason: str) -> None:
    """Warn once for a folder: there is more than one entry."""
    _LOG.warning("compiled code cannot be kept in %s (%s); NUMBA_CACHE_DIR names another folder", folder, reason)


@cache
def _compiled_sources(folder: Path) -> tuple[str, str]:
    """Return digests of the files with compiled functions: of this package, and of an entry's own folder."""
    package = Path(__file__).parents[1]
    files = [package / "observation.py", package / "scenario" / "power_law.py"]
    for name in ("numerics", "physics", "batch"):
        files += (package / name).glob("*.py")
    return digest_of_files(package, files), digest_of_files(folder, folder.glob("*.py"))
