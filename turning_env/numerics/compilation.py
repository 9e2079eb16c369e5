"""Compilation with Numba, and machine code kept on disk.

With ``NUMBA_DISABLE_JIT=1``, the same functions run interpreted.

Numba compiles a function again if its own file has changed, but not if a file of the functions that
it calls has. So the folder of machine code is named after the contents of all sources that could be
compiled into it. Folders of older sources are removed.
"""

import atexit
import functools
import gc
import hashlib
import inspect
import logging
import os
import shutil
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.extending import register_jitable

from turning_env.files import digest_of_files, file_lock
from turning_env.numerics.linked_code import EntryCompiler, LinkedCompiler

_LOG = logging.getLogger("turning_env")
_PACKAGE = Path(__file__).parents[1]
_COMPILED = ("numerics", "physics", "batch")
"""Folders with compiled functions. ``observation.py`` and an entry's own folder have some, too."""
_NAME = "machine_code-"
_DIGITS = 12  # of a digest in a folder's name
_NOTICE_AFTER = 2.0  # [s]
FIRST_ENV = np.uint64(0)
ONE_ENV = np.uint64(1)
"""Numbers of environments have no sign. Numba tests a signed index for being negative, which
prevents vector instructions, and it compiles a function again for each type of number."""

_LINKED: Any = {"error_model": "numpy", "no_cfunc_wrapper": True, "pipeline_class": LinkedCompiler}
_ENTRY: Any = {
    "error_model": "numpy",
    "nogil": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": EntryCompiler,
}
COMPILED: Any = {"forceinline": True, **_LINKED}
"""Options of functions that are compiled into their callers."""


def compiled(function: Callable[..., Any]) -> Any:
    """Let compiled functions call a function, which is compiled into them.

    Called from Python, it runs interpreted.
    """
    return register_jitable(**COMPILED)(function)


def compiled_separately(function: Callable[..., Any]) -> Any:
    """Let compiled functions call a large function. Called from Python, it runs interpreted."""
    return register_jitable(**_LINKED)(function)


@compiled
def env_range(first, last):  # type: ignore[no-untyped-def]
    """Return the numbers of environments ``first`` to ``last - 1``, without a sign."""
    return range(np.uint64(first), np.uint64(last))


def compiled_entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, at its first call, and keep the machine code on disk.

    Numba numbers record types in the order in which a process meets them, and names machine code by
    these numbers. Processes load one another's code, so an argument of an entry, and of the
    functions that it calls, must always be of the same record type.
    """
    config: Any = numba.config
    name = function.__name__
    module = function.__globals__
    dispatcher: Any = None

    @functools.wraps(function)
    def entry(*arguments: Any) -> Any:
        nonlocal dispatcher
        if dispatcher is not None:
            return dispatcher(*arguments)
        source = Path(inspect.getfile(function))
        folder = machine_code_folder(source.parent)
        is_compiled = folder is not None and any(folder.rglob(f"*.{name}-*.nbi"))
        notice = nullcontext() if is_compiled else _notice(name)
        # The lock lets one process compile, while the others wait for its code.
        lock = nullcontext() if folder is None else file_lock(folder / f".{name}", wait=True)
        with notice, lock, _no_garbage_collection():
            # Numba reads the folder for machine code from this setting, once per function.
            cache_dir = config.CACHE_DIR
            try:
                config.CACHE_DIR = str(folder or cache_dir)
                options: Any = {**_ENTRY, "cache": folder is not None}
                compile_function = numba.njit(**options)
                dispatcher = compile_function(function)
            finally:
                config.CACHE_DIR = cache_dir
            result = dispatcher(*arguments)
        # From now on, callers in the function's module call the compiled function itself.
        if module.get(name) is entry:
            module[name] = dispatcher
        return result

    return function if config.DISABLE_JIT else entry


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    """Pause the garbage collector, which would search the compiler's many objects for nothing."""
    paused = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if paused:
            gc.enable()


@contextmanager
def _notice(name: str) -> Iterator[None]:
    """Log a notice, which goes to stderr, if a function takes seconds to be compiled."""
    # Measured: docs/scaling.md, "Compile time".
    text = "compiling %s for this machine, once: a first step takes about 17 s in all"
    timer = threading.Timer(_NOTICE_AFTER, _LOG.warning, [text, name])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@functools.cache
def machine_code_folder(sources: Path) -> Path | None:
    """Return the folder for machine code of entries in a folder of sources, or None.

    It is in the sources' ``__pycache__`` or, if that is read-only, in the user's cache;
    ``NUMBA_CACHE_DIR`` names another place. Machine code in a read-only ``__pycache__``, as in a
    container image, is copied. Without any place to write to, there is no folder.
    """
    places = _places(sources)
    name = f"{_NAME}{_digests(sources)}"
    prepared = places[0] / name
    if prepared.is_dir():
        # A copy for this process alone, in case no other place can be written to. A read-only
        # container may have no folder for temporary files: then there is no copy either.
        with suppress(FileNotFoundError):
            own_copy = Path(tempfile.gettempdir(), f"rough-turning-{os.getpid()}")
            atexit.register(shutil.rmtree, own_copy, ignore_errors=True)
            places.append(own_copy)
    for place in places:
        folder = place / name
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            if prepared.is_dir() and folder != prepared:
                shutil.copytree(prepared, folder, dirs_exist_ok=True)
            for older in place.glob(f"{_NAME}*"):
                if older != folder:
                    shutil.rmtree(older, ignore_errors=True)
            return folder
    _LOG.warning(
        "compiled code cannot be kept in %s; NUMBA_CACHE_DIR names another folder",
        " or ".join(map(str, places)),
    )
    return None


def _places(sources: Path) -> list[Path]:
    """Return the folders in which machine code of a folder of sources may be kept, best first."""
    digest = hashlib.sha256(str(sources).encode()).hexdigest()
    name = f"{sources.name}_{digest[:_DIGITS]}"
    chosen: str = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    if chosen:
        return [Path(chosen, name)]
    xdg_cache = os.environ.get("XDG_CACHE_HOME")
    user_cache = Path(xdg_cache) if xdg_cache else Path.home() / ".cache"
    return [sources / "__pycache__", user_cache / "rough-turning" / name]


def _digests(sources: Path) -> str:
    """Return a digest of all sources that can be compiled into the entries of a folder."""
    compiled_files = [_PACKAGE / "observation.py"]
    for name in _COMPILED:
        compiled_files += (_PACKAGE / name).glob("*.py")
    shared_digest = digest_of_files(_PACKAGE, compiled_files)
    entries_digest = digest_of_files(sources, sources.glob("*.py"))
    return shared_digest[:_DIGITS] + entries_digest[:_DIGITS]
