"""Tools for a process engineer: calibrate a scenario from measured cuts, predict cuts with its laws, map them, and advise.

``command`` adds its commands to ``python -m turning_env``. Playing and scoring of policies belong in ``turning_env.scoring``.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turning_env.console import UserError

Values = NDArray[np.float64]
"""An array of numbers."""


class WorkshopError(UserError):
    """Invalid input of a workshop tool. The message names the fault and the allowed values."""


def aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield rows of cells as lines with aligned columns: the first to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for first, *others in rows:
        cells = [
            first.ljust(widths[0]),
            *(cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True)),
        ]
        yield "  ".join(cells).rstrip()


def refuse_existing(overwrite: bool, *paths: Path | None) -> None:
    """Raise an error if one of the files that a command is about to write exists, unless it may be replaced, or occurs twice."""
    for path in filter(None, paths):
        if path.exists() and not path.is_file():
            raise WorkshopError(f"{path} is a device, a pipe or a folder, which is not replaced")
        if path.exists() and not overwrite:
            raise WorkshopError(f"{path} exists; --overwrite replaces it")
        if paths.count(path) > 1:
            raise WorkshopError(f"{path} is given for two files")


def regular_file(path: Path, max_bytes: int) -> Path:
    """Return the path of a file to read whole, which has an end and is not too large.

    Raises:
        OSError: There is none.
        WorkshopError: It is a device, a pipe or a folder, or has more than ``max_bytes``.
    """
    size = path.stat().st_size
    if not path.is_file():
        raise WorkshopError(f"{path} is a device, a pipe or a folder, but must be a file")
    if size > max_bytes:
        raise WorkshopError(
            f"{path} has {size / 1e6:.3g} MB, but {max_bytes / 1e6:g} MB at most are read"
        )
    return path
