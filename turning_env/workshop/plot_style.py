"""How every figure looks in print, and how it is written.

One column is 89 mm wide, two are 183 mm, and no letter is smaller than 8 pt. Colours are those of Okabe and Ito, told apart by
colour-blind readers too; line styles and markers tell the same apart in grey.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

from matplotlib import style
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from turning_env.workshop.inquiry.output import write

SINGLE, DOUBLE = 89.0 / 25.4, 183.0 / 25.4
"""Widths of one column and of two [inch]."""
MIN_FONT = 8.0
"""[pt]"""

BLUE, VERMILLION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY, BLACK = "#E69F00", "#56B4E9", "#000000"
GREY, LIGHT = "#666666", "#DDDDDD"
LINES: tuple[tuple[str, Any], ...] = (
    (BLUE, "-"),
    (VERMILLION, (0, (5, 1))),
    (GREEN, (0, (3, 1, 1, 1))),
    (PURPLE, (0, (1, 1))),
    (ORANGE, (0, (5, 1, 1, 1, 1, 1))),
    (SKY, (0, (8, 2))),
    (BLACK, (0, (2, 2))),
)
"""Colour and dashes of lines that stand for equals."""

LIMIT: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.0, "linestyle": (0, (5, 1.5))}
"""How a limit looks."""
OURS: dict[str, Any] = {"color": BLUE, "linewidth": 1.0, "marker": "o", "markersize": 2.6}
"""How the project's figures look."""
PRINTED: dict[str, Any] = {
    "color": BLACK,
    "linestyle": "none",
    "marker": "o",
    "markersize": 6.0,
    "markerfacecolor": "none",
    "markeredgewidth": 0.7,
}
"""How a paper's printed figures look."""
CHOSEN: dict[str, Any] = {
    "color": ORANGE,
    "linestyle": "none",
    "marker": "D",
    "markersize": 6.0,
    "markeredgecolor": BLACK,
}
"""How what a control chooses looks."""

FORMATS = ("png", "svg", "pdf")
DPI = 250
# Nothing that differs from one run to the next.
_METADATA: dict[str, dict[str, Any]] = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
_PRINT: dict[str, Any] = {
    "font.size": MIN_FONT,
    **dict.fromkeys(("axes.labelsize", "axes.titlesize", "xtick.labelsize", "ytick.labelsize"), MIN_FONT),
    **dict.fromkeys(("legend.fontsize", "legend.title_fontsize"), MIN_FONT),
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    **dict.fromkeys(("xtick.major.width", "ytick.major.width"), 0.6),
    "grid.linewidth": 0.4,
    "hatch.linewidth": 0.4,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "savefig.dpi": DPI,
    "svg.hashsalt": "rough-turning",
    "pdf.fonttype": 42,
}


@contextmanager
def for_print() -> Iterator[None]:
    """Within it figures look so, whatever the reader's own settings; drawing and saving both belong there."""
    with style.context(["default", _PRINT]):
        yield


def letter(axes: Axes, name: str) -> None:
    """Name a panel above its left corner."""
    axes.set_title(name, loc="left", fontweight="bold")


def readable(figure: Figure) -> Figure:
    """The figure with no letter too small for print."""
    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_fontsize(max(text.get_fontsize(), MIN_FONT))
    return figure


def save(figure: Figure, path: Path) -> None:
    """Write a figure, whole or not at all, in the format of its suffix: the same bytes whenever it is drawn.

    Raises:
        ValueError: the suffix is none of ``FORMATS``, or it cannot be written.
    """
    kind = path.suffix.removeprefix(".")
    if kind not in FORMATS:
        raise ValueError(f"{path} is to be written, but its suffix must be .{' or .'.join(FORMATS)}")
    if kind == "png":
        write(path, lambda partial: _save_png(figure, partial))
    else:
        write(path, lambda partial: figure.savefig(partial, format=kind, metadata=_METADATA[kind]))


def _save_png(figure: Figure, path: Path) -> None:
    """With a palette of the picture's own 256 colours: a third of the bytes, and no difference to see."""
    drawn = BytesIO()
    figure.savefig(drawn, format="png", dpi=DPI)
    with Image.open(drawn) as image:
        few = image.convert("RGB").quantize(256, method=Image.Quantize.MAXCOVERAGE, kmeans=1, dither=Image.Dither.NONE)
    few.save(path, format="png", optimize=True, dpi=(DPI, DPI))
