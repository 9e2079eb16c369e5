"""How what a command makes is written, and what it says where that fails."""

from collections.abc import Callable
from pathlib import Path

from turning_env.files import replace_file


class OutputError(ValueError):
    """A file that cannot be made. The message names it, or what is missing."""


def write(path: Path, fill: Callable[[Path], object]) -> None:
    """Write a file, whole or not at all; OutputError says why not."""
    try:
        replace_file(path, fill)
    except OSError as error:
        raise OutputError(f"{path} cannot be written: {error.strerror}") from error
