"""Tools for a process engineer: calibrate a scenario from measured cuts, predict, map and advise.

``command`` adds their commands to ``python -m turning_shop``. Playing and scoring of policies
belong in ``leaderboard``.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from turning_shop.extras import register

from turning_env.console import UserError

Values = NDArray[np.float64]

register()
"""An array of numbers."""


class WorkshopError(UserError):
    """Invalid input of a workshop tool. The message names the fault and the allowed values."""


def aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield rows of cells as lines: the first column to the left, the others to the right."""
    widths = []
    for column in zip(*rows, strict=True):
        widths.append(max(len(cell) for cell in column))
    for row in rows:
        cells = [row[0].ljust(widths[0])]
        for cell, width in zip(row[1:], widths[1:], strict=True):
            cells.append(cell.rjust(width))
        yield "  ".join(cells).rstrip()


def refuse_existing(overwrite: bool, *paths: Path | None) -> None:
    """Raise an error if a file that a command is about to write exists, or is given twice.

    Regular files may exist if ``overwrite`` is set. A path of None stands for no file.
    """
    for path in paths:
        if path is None:
            continue
        if path.exists() and not path.is_file():
            raise WorkshopError(f"{path} is a device, a pipe or a folder, which is not replaced")
        if path.exists() and not overwrite:
            raise WorkshopError(f"{path} exists; --overwrite replaces it")
        if paths.count(path) > 1:
            raise WorkshopError(f"{path} is given for two files")
