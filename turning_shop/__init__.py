"""Tools for a process engineer: calibrate a scenario from measured cuts, predict cuts with its laws, map them, and advise.

``command`` adds its commands to ``python -m turning_env``. Playing and scoring of policies belong in ``turning_env.scoring``.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from turning_env.console import Mistake

Values = NDArray[np.float64]
"""An array of numbers."""


class WorkshopError(Mistake):
    """Invalid input of a workshop tool. The message names the fault and the allowed values."""


def aligned(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    """Yield rows of cells as lines with aligned columns: the first to the left, the others to the right."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for first, *others in rows:
        cells = [first.ljust(widths[0]), *(cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))]
        yield "  ".join(cells).rstrip()


def refuse_existing(overwrite: bool, *paths: Path | None) -> None:
    """Raise an error if one of the files exists that a command is about to write, unless it may be replaced."""
    for path in paths:
        if path and path.exists() and not overwrite:
            raise WorkshopError(f"{path} exists; --overwrite replaces it")
