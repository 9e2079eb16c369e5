"""What pictures have in common: colours that colour-blind readers tell apart, and how a file is written."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from turning_env.workshop.inquiry.output import OutputError, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# Okabe and Ito's colours.
BLUE, VERMILLION, GREEN, GREY, LIGHT = "#0072B2", "#D55E00", "#009E73", "#666666", "#E4E4E4"

FORMATS = (".png", ".svg", ".pdf")


def picture_path(text: str) -> Path:
    """The path of a picture, for argparse: its ending names its format."""
    path = Path(text)
    if path.suffix.lower() not in FORMATS:
        raise argparse.ArgumentTypeError(f"{text!r} must end in {', '.join(FORMATS)}")
    return path


def require_matplotlib() -> None:
    """Raises OutputError, which names what to install, if Matplotlib is missing."""
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise OutputError("pictures need Matplotlib, which is not installed: pip install matplotlib") from error


def save(figure: "Figure", path: Path) -> None:
    """Write a picture, whole or not at all; OutputError says why not."""
    write(path, lambda partial: figure.savefig(partial, dpi=150))
