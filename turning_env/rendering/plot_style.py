"""Style and write all figures.

One column is 89 mm wide, two are 183 mm, and no letter is smaller than 8 pt. The colours are Okabe and Ito's, which colour-blind
readers can distinguish. Line styles and markers distinguish the same lines in grey.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zlib import crc32

from turning_env.files import replace_file

if TYPE_CHECKING:  # imported where a figure is drawn: who needs only a colour need not wait for it
    from matplotlib.figure import Figure

SINGLE, DOUBLE = 89.0 / 25.4, 183.0 / 25.4  # widths of one column and of two [inch]
MIN_FONT = 8.0  # smallest font size [pt]

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
"""Colours and dashes of lines of equal rank."""
POLICIES: dict[str, tuple[str, Any]] = {
    "analytic_gradient": LINES[0],
    "grid_search": (ORANGE, LINES[1][1]),
    "ppo_belief": LINES[2],
    "ppo": LINES[3],
    "predictive": LINES[6],
    "sac": LINES[5],
    "rescaled_grid_search": ("#8B5A2B", LINES[4][1]),
    "tqc": ("#999933", LINES[4][1]),
    "lagrangian_ppo": ("#882255", LINES[1][1]),
    "fixed_tuned": ("#999999", LINES[1][1]),
    "causal": (GREY, "-"),
}
"""Colour and dashes of policies that several figures show: the same in each. Vermillion is left to limits."""
_COLOURS = ("#332288", "#44AA99", "#AA4466", "#117733", "#AA4499", "#6699CC", "#663333")
OTHERS = tuple((colour, dashes) for colour, (_, dashes) in zip(_COLOURS, LINES, strict=True))
"""Colours and dashes of all other policies."""

LIMIT: dict[str, Any] = {
    "color": VERMILLION,
    "linewidth": 1.0,
    "linestyle": (0, (5, 1.5)),
}  # style of a limit
OURS: dict[str, Any] = {"color": BLUE, "linewidth": 1.0, "marker": "o", "markersize": 2.6}
"""Style of data computed by the project."""
_POINTS: dict[str, Any] = {"linestyle": "none", "markersize": 6.0}
PRINTED = _POINTS | {
    "color": BLACK,
    "marker": "o",
    "markerfacecolor": "none",
    "markeredgewidth": 0.7,
}
"""Style of data printed in a paper."""
CHOSEN = _POINTS | {
    "color": ORANGE,
    "marker": "D",
    "markeredgecolor": BLACK,
}  # style of operating points that a policy chooses

FORMATS = ("png", "svg", "pdf")
DPI = 250
_OPTIONS: dict[str, dict[str, Any]] = {
    "png": {"dpi": DPI},
    "svg": {"metadata": {"Date": None}},  # no dates: the same figure gives the same bytes
    "pdf": {"metadata": {"CreationDate": None}},
}
_PRINT: dict[str, Any] = {
    "font.size": MIN_FONT,
    **dict.fromkeys(
        ("axes.labelsize", "axes.titlesize", "xtick.labelsize", "ytick.labelsize"), MIN_FONT
    ),
    **dict.fromkeys(("legend.fontsize", "legend.title_fontsize"), MIN_FONT),
    **dict.fromkeys(("axes.spines.top", "axes.spines.right"), False),
    **dict.fromkeys(("axes.linewidth", "xtick.major.width", "ytick.major.width"), 0.6),
    **dict.fromkeys(("grid.linewidth", "hatch.linewidth"), 0.4),
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "savefig.dpi": DPI,
    "pdf.fonttype": 42,
}


@contextmanager
def for_print() -> Iterator[None]:
    """Apply the style within a ``with`` block, whatever the user's own settings; draw and save figures inside it."""
    from matplotlib import style

    with style.context(["default", _PRINT]):
        yield


def policy_look(name: str) -> tuple[str, Any]:
    """Return colour and dashes of a policy, its training seed aside; if it is not known, its name picks one of ``OTHERS``."""
    name = name.partition("-seed")[0]
    return POLICIES.get(name) or OTHERS[crc32(name.encode()) % len(OTHERS)]


def policy_looks(names: Iterable[str]) -> list[tuple[str, Any]]:
    """Return colour and dashes of policies in one picture: each its own, or a free one of ``OTHERS`` if another has it."""
    looks: list[tuple[str, Any]] = []
    for name in names:
        free = [policy_look(name), *OTHERS]
        looks.append(next(look for look in free if look not in looks))
    return looks


def readable(figure: "Figure") -> "Figure":
    """Enlarge every text of a figure to at least ``MIN_FONT``, and return the figure."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_fontsize(max(text.get_fontsize(), MIN_FONT))
    return figure


def save(figure: "Figure", path: Path) -> None:
    """Write a figure, whole or not at all, in the format of ``FORMATS`` that the suffix names; it always gives the same bytes."""
    from matplotlib import rc_context

    kind = path.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise ValueError(f"{path}: its suffix must be .{' or .'.join(FORMATS)}")
    drawn = BytesIO()
    with rc_context({"svg.hashsalt": "rough-turning"}):
        figure.savefig(drawn, format=kind, **_OPTIONS[kind])
    content = _with_palette(drawn) if kind == "png" else drawn.getvalue()
    replace_file(path, lambda partial: partial.write_bytes(content))


def _with_palette(drawn: BytesIO) -> bytes:
    """Return a PNG with a palette of 256 colours: a third of the bytes without a visible difference."""
    from PIL import Image

    written = BytesIO()
    with Image.open(drawn) as image:
        few = image.convert("RGB").quantize(
            256, method=Image.Quantize.MAXCOVERAGE, kmeans=1, dither=Image.Dither.NONE
        )
    few.save(written, format="png", optimize=True, dpi=(DPI, DPI))
    return written.getvalue()
