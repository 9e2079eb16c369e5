"""How the transition is compiled: with Numba, once, and kept on disk.

With ``NUMBA_DISABLE_JIT=1`` in the environment the same functions run in the Python interpreter.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a scalar function that other compiled functions call."""
    return numba.njit(error_model="numpy", forceinline=True)(function)


def compiled_entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, and keep the machine code on disk.

    The function must read ``source_digest()`` from its closure: Numba's cache watches only the file in which a
    function stands, so a change in a file that it calls would otherwise run stale machine code.
    """
    return numba.njit(error_model="numpy", cache=True, nogil=True)(function)


def source_digest(package: Path = Path(__file__).parent) -> str:
    """SHA-256 over every Python file, names and contents, in the folder of a package: of this one, if none is given."""
    digest = hashlib.sha256()
    for path in sorted(package.rglob("*.py")):
        digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
