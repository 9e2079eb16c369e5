"""Compile with Numba and keep the machine code on disk. With ``NUMBA_DISABLE_JIT=1``, the same functions run interpreted.

Numba compiles a function anew if its own file has changed, but not if a file of the functions that it calls has. So the folder
of machine code is named after the contents of all sources that could be compiled into it. Folders of older sources are removed.
"""

import atexit
import functools
import hashlib
import inspect
import logging
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba.extending import register_jitable

from turning_env.files import digest_of_files, file_lock

_LOG = logging.getLogger("turning_env")
_PACKAGE = Path(__file__).parents[1]
_COMPILED = ("numerics", "physics", "batch")
"""Folders with functions that are compiled into entries, beside ``observation.py`` and an entry's own folder."""
_NAME = "machine_code-"
INLINED: Any = {
    "forceinline": True,
    "no_cfunc_wrapper": True,
}  # options of overloads that are compiled into their callers


def compiled(function: Callable[..., Any]) -> Any:
    """Let compiled functions call a function, which is compiled into them; called from Python it runs interpreted."""
    return register_jitable(error_model="numpy", **INLINED)(function)


def compiled_separately(function: Callable[..., Any]) -> Any:
    """Let compiled functions call a large function; called from Python it runs interpreted."""
    return register_jitable(error_model="numpy", no_cfunc_wrapper=True)(function)


@compiled
def env_range(first, last):  # type: ignore[no-untyped-def]
    """Return the numbers of environments ``first`` to ``last - 1``.

    They have no sign: Numba tests an index with a sign for being negative, which prevents vector instructions.
    """
    return range(np.uint64(first), np.uint64(last))


def compiled_entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls at its first call, and keep the machine code on disk.

    Numba numbers record types in the order in which a process meets them, and names machine code by these numbers. Processes load
    one another's code, so an argument of an entry, and of what it calls, must always be of the same record type.
    """
    config: Any = numba.config
    name, module = function.__name__, function.__globals__
    ready: Any = None

    @functools.wraps(function)
    def entry(*arguments: Any) -> Any:
        nonlocal ready
        if ready is not None:
            return ready(*arguments)
        folder = machine_code_folder(Path(inspect.getfile(function)).parent)
        if folder is None or not any(folder.rglob(f"*.{name}-*.nbi")):
            _LOG.warning("compiling %s, or waiting for another process that does ...", name)
        with file_lock(folder / f".{name}.lock", wait=True) if folder else nullcontext():
            before = config.CACHE_DIR
            try:
                config.CACHE_DIR = str(folder or before)
                ready = numba.njit(error_model="numpy", nogil=True, cache=folder is not None)(
                    function
                )
            finally:
                config.CACHE_DIR = before
            result = ready(*arguments)
        if module.get(name) is entry:
            module[name] = ready  # callers in the function's module need no wrapper
        return result

    return function if config.DISABLE_JIT else entry


@functools.cache
def machine_code_folder(sources: Path) -> Path | None:
    """Return the folder for machine code of entries in a folder of sources; None if there is none to write in.

    It is in the sources' ``__pycache__`` or, if that is read-only, in the user's cache; ``NUMBA_CACHE_DIR`` names another place.
    Machine code in a read-only ``__pycache__``, as of a container image, is copied.
    """
    compiled = [
        _PACKAGE / "observation.py",
        *(path for name in _COMPILED for path in (_PACKAGE / name).glob("*.py")),
    ]
    digests = (
        digest_of_files(_PACKAGE, compiled)[:12]
        + digest_of_files(sources, sources.glob("*.py"))[:12]
    )
    own = f"{sources.name}_{hashlib.sha256(str(sources).encode()).hexdigest()[:12]}"
    named: str = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    places = (
        [Path(named, own)] if named else [sources / "__pycache__", cache / "rough-turning" / own]
    )
    prepared = places[0] / f"{_NAME}{digests}"
    if prepared.is_dir():
        places.append(Path(tempfile.gettempdir(), f"rough-turning-{os.getpid()}"))
        atexit.register(shutil.rmtree, places[-1], ignore_errors=True)
    for place in places:
        folder = place / prepared.name
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
            if prepared.is_dir() and folder != prepared:
                shutil.copytree(prepared, folder, dirs_exist_ok=True)
            for other in place.glob(f"{_NAME}*"):
                if other != folder:
                    shutil.rmtree(other, ignore_errors=True)
            return folder
    _LOG.warning(
        "compiled code cannot be kept in %s; NUMBA_CACHE_DIR names another folder",
        " or ".join(map(str, places)),
    )
    return None
