"""How the transition is compiled: with Numba, once, and kept on disk.

With ``NUMBA_DISABLE_JIT=1`` in the environment the same functions run in the Python interpreter.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np

from turning_env.files import digest_of_files


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a scalar function that other compiled functions call."""
    return numba.njit(error_model="numpy", forceinline=True)(function)


def compiled_entry(function: Callable[..., Any]) -> Any:
    """Compile a function that Python calls, and keep the machine code on disk.

    The function must read ``source_digest()`` from its closure: Numba's cache watches only the file in which a
    function stands, so a change in a file that it calls would otherwise run stale machine code.
    """
    return numba.njit(error_model="numpy", cache=True, nogil=True)(function)


def handed_over(records: Any) -> Any:
    """Records as an entry takes them: plain arrays, which cost a compiled call far less than record arrays; these if interpreted."""
    return records if numba.config.DISABLE_JIT else records.view(np.ndarray)


def source_digest(package: Path = Path(__file__).parent) -> str:
    """SHA-256 over every Python file, names and contents, in the folder of a package: of this one, if none is given."""
    return digest_of_files(package, "*.py")
