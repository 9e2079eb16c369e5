"""Read programs in the subset that ``write.py`` writes; refuse others with the block's number and the reason."""

import re
from collections.abc import Iterator
from pathlib import Path

from turning_nc.expression import NUMBER
from turning_nc.program import (
    FEED_DECIMALS,
    LENGTH_DECIMALS,
    LIMIT_DECIMALS,
    RETRACTION,
    SPEED_DECIMALS,
    Block,
    NcError,
    Program,
)
from turning_nc.read_law import LawReader
from turning_nc.write import SAFE_START, TOOL

MAX_BYTES, MAX_LINE = 10_000_000, 500
_BLOCK = re.compile(r"N(\d{1,7}) +(.*)", re.ASCII)
_WORD = re.compile(rf"(LIMS=|[GMSFXZ])(-?(?:{NUMBER}))", re.ASCII)

_DECIMALS = {
    **dict.fromkeys("GM", 0),
    "S": SPEED_DECIMALS,
    "F": FEED_DECIMALS,
    **dict.fromkeys("XZ", LENGTH_DECIMALS),
    "LIMS=": LIMIT_DECIMALS,
}


def read(text: str) -> Program:
    """Return the program of a text.

    Raises:
        NcError: the text is not in the subset; names the block (without a number, the line) and the reason.
    """
    if len(text) > MAX_BYTES:
        raise NcError(f"the program has {len(text)} characters, but {MAX_BYTES} at most are read")
    reader = _Reader()
    last = 0
    for count, line in _lines(text):
        match = _BLOCK.fullmatch(line)
        if match is None:
            raise NcError(f"line {count}: {line[:60]!r} is no block: it must begin with N and its number")
        number, body = int(match[1]), match[2].strip()
        if number <= last:
            raise NcError(f"N{number}: block numbers must rise, but it follows N{last}")
        last = number
        try:
            reader.take(body)
        except ValueError as error:
            raise NcError(f"N{number}: {error}") from error
    try:
        return reader.program()
    except ValueError as error:
        raise NcError(f"at the end: {error}") from error


def read_file(path: Path) -> Program:
    """Return the program in a file.

    Raises:
        NcError: see ``read``; names the file.
        OSError: the file cannot be read.
    """
    try:
        with path.open(encoding="ascii") as stream:
            return read(stream.read(MAX_BYTES + 1))
    except UnicodeDecodeError as error:
        raise NcError(f"{path}: is not ASCII text") from error
    except NcError as error:
        raise NcError(f"{path}: {error}") from error


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield the numbers and texts of lines, without comments and empty lines."""
    for count, line in enumerate(text.split("\n"), 1):
        if len(line) > MAX_LINE:
            raise NcError(f"line {count}: has {len(line)} characters, but {MAX_LINE} at most are read")
        if block := line.partition(";")[0].strip():
            yield count, block


class _Reader:
    """A state machine that takes blocks in the order of the subset; ``take`` is the method for the next block."""

    def __init__(self) -> None:
        self._law = LawReader()
        self.take = self._safe_start
        self._limit = self._speed = self._feed = self._position = self._across = 0.0
        self._diameter: float | None = None
        self._start: float | None = None
        self._bars: list[tuple[Block, ...]] = []
        self._blocks: list[Block] = []

    def program(self) -> Program:
        """Return the program that has been read.

        Raises:
            ValueError: the program does not end with M30.
        """
        if self.take != self._nothing:
            raise ValueError("the program does not end with M30")
        assert self._diameter is not None
        assert self._start is not None
        return Program(self._diameter, self._start, self._limit, tuple(self._bars), self._law.law())

    def _safe_start(self, body: str) -> None:
        if sorted(body.split()) != sorted(SAFE_START.split()):
            raise ValueError(f"a program must begin with {SAFE_START}, in any order and whole, not with {body!r}")
        self.take = self._tool

    def _tool(self, body: str) -> None:
        _exactly(body, TOOL)
        self.take = self._law_or_spindle

    def _law_or_spindle(self, body: str) -> None:
        if not self._law.take(body):
            self._law.check()
            self._spindle(body)

    def _spindle(self, body: str) -> None:
        first = not self._bars
        words = _words(body, "G S F LIMS= M" if first else "G S F M")
        if (words["G"], words["M"]) != (96.0, 3.0):
            raise ValueError(f"a bar must begin with G96 and M03, not with {body!r}")
        self._limit = _above_zero(words["LIMS="], "LIMS") if first else self._limit
        self._speed, self._feed = _above_zero(words["S"], "S"), _above_zero(words["F"], "F")
        self.take = self._approach

    def _approach(self, body: str) -> None:
        words = _words(body, "G X Z")
        _is(words["G"], 0.0, "the bar must be approached with G00")
        z = words["Z"]
        if z < 0.0:
            raise ValueError(f"Z{z} lies in the bar: it must be approached from 0 or above")
        if self._start not in (None, z):
            raise ValueError(f"every bar must be approached at Z{self._start}, as the first, not at Z{z}")
        self._across, self._start, self._position = _above_zero(words["X"], "X"), z, z
        self.take = self._engage

    def _engage(self, body: str) -> None:
        words = _words(body, "G X")
        _is(words["G"], 0.0, "the diameter of the cut must be approached with G00")
        x = _above_zero(words["X"], "X")
        if self._diameter not in (None, x):
            raise ValueError(f"every bar must be cut at X{self._diameter}, as the first, not at X{x}")
        self._diameter = x
        self._check_clear(self._across)
        self.take = self._first_feed

    def _check_clear(self, x: float) -> None:
        assert self._diameter is not None
        least = self._diameter + 2.0 * RETRACTION
        if x < least - 1e-9:
            raise ValueError(
                f"X{x} is too near the bar, which is cut at X{self._diameter}: the tool must keep to X{least} or beyond"
            )

    def _first_feed(self, body: str) -> None:
        words = _words(body, "G Z", "S F")
        _is(words["G"], 1.0, "the approach must be followed by a feed block, G01")
        self._cut(words)
        self.take = self._feed_or_retract

    def _feed_or_retract(self, body: str) -> None:
        if body.split()[0] in ("G0", "G00"):
            self._retract(body)
        else:
            words = _words(body, "G Z", "S F")
            _is(words["G"], 1.0, "only G01 to Z, or G00 to X, may follow")
            self._cut(words)

    def _cut(self, words: dict[str, float]) -> None:
        self._speed = _above_zero(words.get("S", self._speed), "S")
        self._feed = _above_zero(words.get("F", self._feed), "F")
        if not words["Z"] < self._position:
            raise ValueError(f"Z{words['Z']} must lie below Z{self._position}: feed goes towards the chuck")
        self._position = words["Z"]
        self._blocks.append(Block(self._position, self._speed, self._feed))

    def _retract(self, body: str) -> None:
        words = _words(body, "G X")
        self._check_clear(words["X"])
        self.take = self._return

    def _return(self, body: str) -> None:
        words = _words(body, "G Z")
        if (words["G"], words["Z"]) != (0.0, self._start):
            raise ValueError(f"the tool must return with G00 to Z{self._start}, not {body!r}")
        self.take = self._stop

    def _stop(self, body: str) -> None:
        _is(_words(body, "M")["M"], 5.0, "the spindle must be stopped with M05")
        self._bars.append(tuple(self._blocks))
        self._blocks = []
        self.take = self._next_bar_or_end

    def _next_bar_or_end(self, body: str) -> None:
        code = _words(body, "M")["M"]
        if code not in (0.0, 30.0):
            raise ValueError(f"after the spindle's stop M00 or M30 must follow, not {body!r}")
        self.take = self._spindle if code == 0.0 else self._nothing

    def _nothing(self, body: str) -> None:
        raise ValueError(f"nothing may follow M30, but {body!r} does")


def _words(body: str, needed: str, allowed: str = "") -> dict[str, float]:
    """Return the words of a block by address. Each of ``needed`` must occur once, each of ``allowed`` at most once."""
    words: dict[str, float] = {}
    for text in body.split():
        match = _WORD.fullmatch(text)
        if match is None:
            raise ValueError(f"{text!r} is not a word of the subset")
        if match[1] in words:
            raise ValueError(f"{match[1]} stands twice in {body!r}")
        decimals = _DECIMALS[match[1]]
        if len(match[2].partition(".")[2]) > decimals:
            raise ValueError(f"{text!r} is finer than the control's resolution, which is {decimals} decimals")
        words[match[1]] = float(match[2])
    if extra := words.keys() - set(needed.split()) - set(allowed.split()):
        raise ValueError(f"{', '.join(sorted(extra))} may not stand in {body!r} here")
    if missing := set(needed.split()) - words.keys():
        raise ValueError(f"{', '.join(sorted(missing))} is missing in {body!r}")
    return words


def _exactly(body: str, text: str) -> None:
    if body.split() != text.split():
        raise ValueError(f"{text} must stand here, not {body!r}")


def _is(value: float, expected: float, otherwise: str) -> None:
    if value != expected:
        raise ValueError(otherwise)


def _above_zero(value: float, name: str) -> float:
    if value <= 0.0:
        raise ValueError(f"{name} is {value}, but must be above 0")
    return value
