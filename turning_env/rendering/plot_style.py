"""Style and write all figures.

One column is 89 mm wide, two are 183 mm, and no letter is smaller than 8 pt. The colours are Okabe
and Ito's, which colour-blind readers can distinguish. Line styles and markers distinguish the same
lines in grey.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from zlib import crc32

from turning_env.files import write_file

if TYPE_CHECKING:
    # Matplotlib is imported where a figure is drawn: who needs only a colour need not wait for it.
    from matplotlib.figure import Figure

SINGLE = 89.0 / 25.4  # width of one column [inch]
DOUBLE = 183.0 / 25.4  # width of two columns [inch]
MIN_FONT = 8.0  # smallest font size [pt]

BLUE = "#0072B2"
VERMILLION = "#D55E00"
GREEN = "#009E73"
PURPLE = "#CC79A7"
ORANGE = "#E69F00"
SKY = "#56B4E9"
BLACK = "#000000"
GREY = "#666666"
LIGHT = "#DDDDDD"


class LineLook(NamedTuple):
    """The look of a line."""

    colour: str
    dashes: Any  # Matplotlib's ``linestyle``


LINES = (
    LineLook(BLUE, "-"),
    LineLook(VERMILLION, (0, (5, 1))),
    LineLook(GREEN, (0, (3, 1, 1, 1))),
    LineLook(PURPLE, (0, (1, 1))),
    LineLook(ORANGE, (0, (5, 1, 1, 1, 1, 1))),
    LineLook(SKY, (0, (8, 2))),
    LineLook(BLACK, (0, (2, 2))),
)
"""Colours and dashes of lines of equal rank."""
POLICIES = {
    "analytic_gradient": LINES[0],
    "grid_search": LineLook(ORANGE, LINES[1].dashes),
    "ppo_belief": LINES[2],
    "ppo": LINES[3],
    "predictive": LINES[6],
    "sac": LINES[5],
    "rescaled_grid_search": LineLook("#8B5A2B", LINES[4].dashes),
    "tqc": LineLook("#999933", LINES[4].dashes),
    "lagrangian_ppo": LineLook("#882255", LINES[1].dashes),
    "fixed_tuned": LineLook("#999999", LINES[1].dashes),
    "causal": LineLook(GREY, "-"),
}
"""Colour and dashes of policies that several figures show: the same in each.

Vermillion is left to limits.
"""
OTHERS = (
    LineLook("#332288", LINES[0].dashes),
    LineLook("#44AA99", LINES[1].dashes),
    LineLook("#AA4466", LINES[2].dashes),
    LineLook("#117733", LINES[3].dashes),
    LineLook("#AA4499", LINES[4].dashes),
    LineLook("#6699CC", LINES[5].dashes),
    LineLook("#663333", LINES[6].dashes),
)
"""Colours and dashes of all other policies."""

LIMIT: dict[str, Any] = {"color": VERMILLION, "linewidth": 1.0, "linestyle": (0, (5, 1.5))}
"""Style of a limit."""
OURS: dict[str, Any] = {"color": BLUE, "linewidth": 1.0, "marker": "o", "markersize": 2.6}
"""Style of data computed by the project."""
PRINTED: dict[str, Any] = {
    "linestyle": "none",
    "markersize": 6.0,
    "color": BLACK,
    "marker": "o",
    "markerfacecolor": "none",
    "markeredgewidth": 0.7,
}
"""Style of data printed in a paper."""
CHOSEN: dict[str, Any] = {
    "linestyle": "none",
    "markersize": 6.0,
    "color": ORANGE,
    "marker": "D",
    "markeredgecolor": BLACK,
}
"""Style of operating points that a policy chooses."""

FORMATS = ("png", "svg", "pdf")
DPI = 250
# Without dates, the same figure gives the same bytes.
_OPTIONS: dict[str, dict[str, Any]] = {
    "png": {"dpi": DPI},
    "svg": {"metadata": {"Date": None}},
    "pdf": {"metadata": {"CreationDate": None}},
}
_PRINT: dict[str, Any] = {
    "font.size": MIN_FONT,
    "axes.labelsize": MIN_FONT,
    "axes.titlesize": MIN_FONT,
    "xtick.labelsize": MIN_FONT,
    "ytick.labelsize": MIN_FONT,
    "legend.fontsize": MIN_FONT,
    "legend.title_fontsize": MIN_FONT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "grid.linewidth": 0.4,
    "hatch.linewidth": 0.4,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "savefig.dpi": DPI,
    "pdf.fonttype": 42,
}


@contextmanager
def for_print() -> Iterator[None]:
    """Apply the style within a ``with`` block, whatever the user's own settings.

    Draw and save figures inside it.
    """
    from matplotlib import style

    with style.context(["default", _PRINT]):
        yield


def policy_look(name: str) -> LineLook:
    """Return colour and dashes of a policy, its training seed aside.

    If it is not known, its name picks one of ``OTHERS``.
    """
    name = name.partition("-seed")[0]
    if name in POLICIES:
        return POLICIES[name]
    return OTHERS[crc32(name.encode()) % len(OTHERS)]


def policy_looks(names: Iterable[str]) -> list[LineLook]:
    """Return colour and dashes of policies in one picture.

    Each has its own, or a free one of ``OTHERS`` if another policy has it.
    """
    looks: list[LineLook] = []
    for name in names:
        candidates = [policy_look(name), *OTHERS]
        looks.append(next(look for look in candidates if look not in looks))
    return looks


def readable(figure: "Figure") -> "Figure":
    """Enlarge every text of a figure to at least ``MIN_FONT``, and return the figure."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        assert isinstance(text, Text)
        text.set_fontsize(max(text.get_fontsize(), MIN_FONT))
    return figure


def save(figure: "Figure", path: Path) -> None:
    """Write a figure, whole or not at all, in the format of ``FORMATS`` that the suffix names.

    The same figure always gives the same bytes. Raise ValueError for another suffix.
    """
    from matplotlib import rc_context

    kind = path.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise ValueError(f"{path}: its suffix must be .{' or .'.join(FORMATS)}")
    drawn = BytesIO()
    with rc_context({"svg.hashsalt": "rough-turning"}):
        figure.savefig(drawn, format=kind, **_OPTIONS[kind])
    content = _with_palette(drawn) if kind == "png" else drawn.getvalue()
    write_file(path, content)


def _with_palette(drawn: BytesIO) -> bytes:
    """Return a PNG with a palette of 256 colours.

    It has a third of the bytes without a visible difference.
    """
    from PIL import Image

    written = BytesIO()
    with Image.open(drawn) as image:
        reduced = image.convert("RGB").quantize(
            256, method=Image.Quantize.MAXCOVERAGE, kmeans=1, dither=Image.Dither.NONE
        )
    reduced.save(written, format="png", optimize=True, dpi=(DPI, DPI))
    return written.getvalue()
