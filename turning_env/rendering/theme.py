"""The look of a frame: sizes [pixels], colours, letters, scales and ticks."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Colour = tuple[int, int, int]
Pixels = NDArray[np.uint8]
Point = tuple[float, float]
Box = tuple[
    int, int, int, int
]  # a rectangle: left, top, right and bottom; the last two are the first pixels outside

WIDTH, HEIGHT = 960, 640
SCALE = 2  # factor by which moving parts are drawn larger and then reduced, as Pillow's lines are not smooth

PAPER: Colour = (246, 245, 241)
CARD: Colour = (255, 255, 255)
RULE: Colour = (224, 221, 213)
INK: Colour = (38, 40, 44)
QUIET: Colour = (108, 110, 114)
FAINT: Colour = (176, 176, 172)
POWER: Colour = (0, 114, 178)
FORCE: Colour = (230, 159, 0)
ALLOWED: Colour = (0, 158, 115)
OVER: Colour = (213, 94, 0)
SURFACE: Colour = (204, 121, 167)
"""Colours with one meaning in every frame (Okabe and Ito's, which the colour-blind tell apart); ``OVER``: beyond a limit."""
# Colours of the insert, its wear land and the bar; the last two tint soft and hard metal.
INSERT: Colour = (232, 190, 66)
LAND: Colour = (104, 88, 70)
ALLOWANCE: Colour = (222, 219, 211)
SOFT_TINT: Colour = (236, 240, 244)
HARD_TINT: Colour = (96, 122, 150)

_PIECES = re.compile("([0-9 ])")
_SPACE = (
    0.28  # space between words over the font size: the font's own is too narrow for small letters
)
_face = lru_cache(ImageFont.load_default)


@lru_cache(maxsize=4096)
def mixed(colour: Colour, share: float, ground: Colour = CARD) -> Colour:
    """Mix a share of a colour, 0 to 1, with a ground."""
    red, green, blue = (
        round(share * ours + (1.0 - share) * theirs)
        for ours, theirs in zip(colour, ground, strict=True)
    )
    return red, green, blue


@lru_cache(maxsize=4096)
def _letters(piece: str, size: int) -> tuple[Image.Image, float]:
    """Return the share of each pixel that letters cover, from the line's top on, and the start of the next piece."""
    advance = _SPACE * size if piece == " " else _face(size).getlength(piece)
    mask = Image.new("L", (math.ceil(advance) + 2, round(1.4 * size)))
    ImageDraw.Draw(mask).text((0, 0), piece, fill=255, font=_face(size))
    return mask, advance


def _pieces(text: str, size: int) -> list[tuple[Image.Image, float]]:
    """Return the words, the spaces and, as numbers are new in every frame, the single digits of a text."""
    return [_letters(piece, size) for piece in _PIECES.split(text) if piece]


def write(
    image: Image.Image,
    place: Point,
    text: str,
    size: int = 13,
    colour: Colour = INK,
    anchor: str = "left",
) -> None:
    """Write a line of text with its top at a place: beginning there, ending there ("right") or in its middle ("middle")."""
    x = place[0] - {"left": 0.0, "middle": 0.5, "right": 1.0}[anchor] * length(text, size)
    for letters, advance in _pieces(text, size):
        image.paste(colour, (round(x), round(place[1])), letters)
        x += advance


def write_up(
    image: Image.Image, place: Point, text: str, size: int = 11, colour: Colour = QUIET
) -> None:
    """Write a line of text from bottom to top, with its left side and its middle at a place."""
    line = Image.new("RGB", (math.ceil(length(text, size)) + 1, round(1.4 * size)))
    write(line, (0, 0), text, size, (255, 255, 255))
    mask = line.getchannel(0).transpose(Image.Transpose.ROTATE_90)
    image.paste(colour, (round(place[0]), round(place[1] - 0.5 * mask.height)), mask)


def length(text: str, size: int) -> float:
    """Return the length of a line of text [pixels]."""
    return sum(advance for _, advance in _pieces(text, size))


def enlarged(image: Image.Image) -> Image.Image:
    """Return the image enlarged by ``SCALE``, to draw on."""
    return image.resize((image.width * SCALE, image.height * SCALE), Image.Resampling.NEAREST)


def put(frame: Pixels, image: Image.Image, corner: tuple[int, int]) -> None:
    """Put an image into a frame, shape (height, width, 3), with its left top corner there."""
    left, top = corner
    frame[top : top + image.height, left : left + image.width] = np.asarray(image)


def draw_key(
    image: Image.Image, place: tuple[int, int], entries: Sequence[tuple[str, Colour, int]], gap: int
) -> None:
    """Write a legend in one line: texts, each behind a sample of its colour and height [pixels]."""
    x, y = place
    for text, colour, height in entries:
        top = y + 8 - height // 2
        ImageDraw.Draw(image).rectangle((x, top, x + 15, top + height - 1), fill=colour)
        write(image, (x + 20, y), text, 11, QUIET)
        x += 20 + round(length(text, 11)) + gap


@dataclass(frozen=True)
class Ruler:
    """A linear scale from quantities to pixels: ``start`` lies at pixel ``first``, ``end`` at ``last``."""

    start: float
    end: float
    first: float
    last: float

    def __call__(self, value: float) -> float:
        """Return the pixel of a value."""
        return self.first + (value - self.start) / (self.end - self.start) * (
            self.last - self.first
        )

    def within(self, value: float) -> float:
        """Return the pixel of a value, or the end of the scale beyond which it lies."""
        return self(min(max(value, self.start), self.end))


def round_ticks(low: float, high: float, most: int = 6) -> list[float]:
    """Return at most ``most`` evenly spaced round numbers within a range."""
    span = high - low
    for power in range(math.floor(math.log10(span)) - 2, math.ceil(math.log10(span)) + 1):
        for digit in (1, 2, 5):
            step = digit * 10.0**power
            first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
            if last - first < most:
                return [number * step for number in range(first, last + 1)]
    return [low, high]


def log_ticks(low: float, high: float) -> list[float]:
    """Return round numbers within a range, at about even distances on a log scale."""
    digits = (
        (1.0, 1.2, 1.4, 1.6, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0)
        if high < 8.0 * low
        else (1.0, 2.0, 3.0, 6.0)
    )
    powers = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = [digit * 10.0**power for power in powers for digit in digits]
    return [tick for tick in ticks if low * 0.999 <= tick <= high * 1.001]
