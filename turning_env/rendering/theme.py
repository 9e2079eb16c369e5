"""The look of a frame: sizes [pixels], colours, letters, scales and ticks."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]
Pixels = NDArray[np.uint8]
Point = tuple[float, float]  # x and y
Anchor = Literal["left", "middle", "right"]


class Box(NamedTuple):
    """A rectangle. Right and bottom are the first pixels outside."""

    left: int
    top: int
    right: int
    bottom: int


WIDTH = 960
HEIGHT = 640
SCALE = 2
"""Factor by which moving parts are drawn larger and then reduced, as Pillow's lines are not
smooth."""

# Sizes of letters.
SMALL = 11
TITLE = 15

PAPER: Colour = (246, 245, 241)
CARD: Colour = (255, 255, 255)
RULE: Colour = (224, 221, 213)
INK: Colour = (38, 40, 44)
QUIET: Colour = (108, 110, 114)
FAINT: Colour = (176, 176, 172)

# Colours with one meaning in every frame: Okabe and Ito's, which the colour-blind tell apart.
POWER: Colour = (0, 114, 178)
FORCE: Colour = (230, 159, 0)
ALLOWED: Colour = (0, 158, 115)
OVER: Colour = (213, 94, 0)  # beyond a limit
SURFACE: Colour = (204, 121, 167)

# Colours of the insert, its wear land and the bar; the last two tint soft and hard metal.
INSERT: Colour = (232, 190, 66)
LAND: Colour = (104, 88, 70)
ALLOWANCE: Colour = (222, 219, 211)
SOFT_TINT: Colour = (236, 240, 244)
HARD_TINT: Colour = (96, 122, 150)

_PIECES = re.compile("([0-9 ])")
_SPACE = 0.28
"""Space between words over the font size: the font's own is too narrow for small letters."""
_LINE_HEIGHT = 1.4  # over the font size
# An entry of a legend: a sample of its colour, its text, and the next entry [pixels].
_SAMPLE_WIDTH = 16
_TEXT_INDENT = 20
_ENTRY_GAP = 14
_ANCHORS: dict[Anchor, float] = {"left": 0.0, "middle": 0.5, "right": 1.0}
_face = lru_cache(ImageFont.load_default)


@lru_cache(maxsize=4096)
def mixed(colour: Colour, share: float, ground: Colour = CARD) -> Colour:
    """Mix a share of a colour, 0 to 1, with a ground."""
    red, green, blue = (
        round(share * part + (1.0 - share) * part_of_ground)
        for part, part_of_ground in zip(colour, ground, strict=True)
    )
    return red, green, blue


class _Piece(NamedTuple):
    """A piece of text."""

    mask: Image.Image  # share of each pixel that letters cover, from the line's top on
    advance: float  # to the start of the next piece


@lru_cache(maxsize=4096)
def _piece(text: str, size: int) -> _Piece:
    advance = _SPACE * size if text == " " else _face(size).getlength(text)
    mask = Image.new("L", (math.ceil(advance) + 2, round(_LINE_HEIGHT * size)))
    ImageDraw.Draw(mask).text((0, 0), text, fill=255, font=_face(size))
    return _Piece(mask, advance)


def _pieces(text: str, size: int) -> list[_Piece]:
    """Return the words, spaces and single digits of a text.

    Numbers are new in every frame, but digits come from the cache.
    """
    return [_piece(part, size) for part in _PIECES.split(text) if part]


def write(
    image: Image.Image,
    place: Point,
    text: str,
    size: int = 13,
    colour: Colour = INK,
    anchor: Anchor = "left",
) -> None:
    """Write a line of text.

    ``place`` is the line's top, and its left end, right end or middle, as ``anchor`` says.
    """
    left, top = place
    x = left - _ANCHORS[anchor] * length(text, size)
    for piece in _pieces(text, size):
        image.paste(colour, (round(x), round(top)), piece.mask)
        x += piece.advance


def write_note(image: Image.Image, place: Point, text: str, anchor: Anchor = "left") -> None:
    """Write a line of small, quiet text, such as the number at a tick."""
    write(image, place, text, size=SMALL, colour=QUIET, anchor=anchor)


def write_up(image: Image.Image, place: Point, text: str) -> None:
    """Write a small, quiet line from bottom to top; a place is its left side and its middle."""
    left, middle = place
    line = Image.new("RGB", (math.ceil(length(text, SMALL)) + 1, round(_LINE_HEIGHT * SMALL)))
    write(line, (0, 0), text, size=SMALL, colour=(255, 255, 255))
    mask = line.getchannel(0).transpose(Image.Transpose.ROTATE_90)
    image.paste(QUIET, (round(left), round(middle - 0.5 * mask.height)), mask)


def length(text: str, size: int) -> float:
    """Return the length of a line of text [pixels]."""
    return sum(piece.advance for piece in _pieces(text, size))


def enlarged(image: Image.Image) -> Image.Image:
    """Return the image enlarged by ``SCALE``, to draw on."""
    size = (image.width * SCALE, image.height * SCALE)
    return image.resize(size, Image.Resampling.NEAREST)


def enlarged_sheet(width: int, height: int) -> Image.Image:
    """Return an empty image, enlarged by ``SCALE``, to draw on."""
    return Image.new("RGB", (SCALE * width, SCALE * height), CARD)


def put(frame: Pixels, image: Image.Image, corner: tuple[int, int]) -> None:
    """Put an image into a frame, shape (height, width, 3), with its left top corner there."""
    left, top = corner
    frame[top : top + image.height, left : left + image.width] = np.asarray(image)


class KeyEntry(NamedTuple):
    """An entry of a legend."""

    text: str
    colour: Colour
    height: int  # of the sample of the colour


def draw_key(image: Image.Image, place: tuple[int, int], entries: Sequence[KeyEntry]) -> None:
    """Write a legend in one line: texts, each behind a sample of its colour."""
    x, y = place
    for entry in entries:
        top = y + 8 - entry.height // 2
        sample = (x, top, x + _SAMPLE_WIDTH - 1, top + entry.height - 1)
        ImageDraw.Draw(image).rectangle(sample, fill=entry.colour)
        write_note(image, (x + _TEXT_INDENT, y), entry.text)
        x += _TEXT_INDENT + round(length(entry.text, SMALL)) + _ENTRY_GAP


def draw_dot(
    draw: ImageDraw.ImageDraw,
    middle: Point,
    radius: int,
    fill: Colour | None = None,
    outline: Colour | None = None,
    width: int = 1,
) -> None:
    """Draw a disc, or a ring of a width."""
    x, y = middle
    box = (x - radius, y - radius, x + radius, y + radius)
    draw.ellipse(box, fill=fill, outline=outline, width=width)


@dataclass(frozen=True)
class Ruler:
    """A linear scale from quantities to pixels: ``start`` is at ``first``, ``end`` at ``last``."""

    start: float
    end: float
    first: float
    last: float

    def __call__(self, value: float) -> float:
        """Return the pixel of a value."""
        share = (value - self.start) / (self.end - self.start)
        return self.first + share * (self.last - self.first)

    def within(self, value: float) -> float:
        """Return the pixel of a value, or the end of the scale beyond which it lies."""
        return self(min(max(value, self.start), self.end))


def round_ticks(low: float, high: float, max_ticks: int = 6) -> list[float]:
    """Return at most ``max_ticks`` evenly spaced round numbers within a range."""
    span = high - low
    for power in range(math.floor(math.log10(span)) - 2, math.ceil(math.log10(span)) + 1):
        for digit in (1, 2, 5):
            step = digit * 10.0**power
            first = math.ceil(low / step - 1e-9)
            last = math.floor(high / step + 1e-9)
            if last - first < max_ticks:
                return [number * step for number in range(first, last + 1)]
    return [low, high]


def log_ticks(low: float, high: float) -> list[float]:
    """Return round numbers within a range, at about even distances on a log scale."""
    digits: tuple[float, ...] = (1.0, 2.0, 3.0, 6.0)
    if high < 8.0 * low:
        digits = (1.0, 1.2, 1.4, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
    ticks = []
    for power in range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1):
        ticks += [digit * 10.0**power for digit in digits]
    return [tick for tick in ticks if low * 0.999 <= tick <= high * 1.001]
