"""Lines, words and sub-programs of a part program.

Every word keeps its place in the text, so that a program can be written back with only some words
changed. What the words mean is left to ``modal``, ``blocks`` and the cycles.
"""

import os
import re
import string
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from turning_nc.dialects import (
    NUMBER,
    Dialect,
    dialect_of,
    foreign_sign,
    with_line_feeds,
    without_null_indices,
)
from turning_nc.expression import MAX_SHOWN, parse

from turning_env.console import UserError
from turning_env.files import read_regular

MAX_BYTES = 10_000_000
MAX_LINES = 200_000
MAX_CHARACTERS = 1000  # of a line; the longest block of a control has some hundred

# Bounds of the numbers of words, and of the digits and signs with which they are written.
# Controls take eight or nine digits.
MAX_NUMBER = 1e9
MAX_DIGITS = 40
MAX_LISTED = 5  # largest number of lines that a note lists

# The mark of the byte order, as Latin 1 and as it is.
_MARK = re.compile("^(?:\u00ef\u00bb\u00bf|\ufeff)")

# The sign / or /1 to /9 before a block that a switch of the control skips (ISO 6983).
_SKIP = re.compile(r"\s*(?:/(?:[1-9](?=\s*\D))?\s*)*")
_BLOCK_NUMBER_OF_PROC = re.compile(r"^/?\s*N\d+\s+(?=PROC\b)")

# A block and a sign ; and another: on a Fanuc it ends a block, in LinuxCNC a comment follows.
_BLOCK_BEHIND = re.compile(r"[^\s;(][^;(]*;\s*(?:N\s*\d+\s*)?[GXZUW]\s*[-+]?\.?\d")

# Signs that belong to the word before them if no blank parts them.
_NUMBER_GOES_ON = ",.=#[*+-"

# Text that is no word. It ends at a blank, and at a letter too if it does not begin with one.
_IN_BRACKETS = r"\"[^\"]*\"?|\([^)]*\)?|\[[^\]]*\]?|<[^>]*>?"
_PIECE = re.compile(rf"(?:{_IN_BRACKETS}|[^\sA-Z])+|[A-Z](?:{_IN_BRACKETS}|\S)*")
_VARIABLE = re.compile(r"#\s*(?:\d+|<[\w\s]+>)|R\d+")

# ASCII letters become capitals. Other letters may become two, which would shift places.
_UPPER = {ord(letter): letter.upper() for letter in string.ascii_lowercase}


class Span(NamedTuple):
    """A place in the program's text."""

    begin: int
    end: int


class NcError(UserError):
    """A program that cannot be read, played or written.

    The message names the line or block, and the reason.
    """


@contextmanager
def naming(path: str | os.PathLike[str]) -> Iterator[None]:
    """Name a file in the errors of its program."""
    try:
        yield
    except NcError as error:
        raise NcError(f"{path}: {error}") from error


class BlockError(ValueError):
    """A block that is not understood: the present one, or that of another line.

    All code that reads or expands blocks may raise it.
    """

    def __init__(self, text: str, line: int | None = None) -> None:
        super().__init__(text)
        self.line = line


def at_lines(numbers: Iterable[int]) -> str:
    """Return numbers of lines as text, the first ones of many."""
    listed = sorted(set(numbers))
    word = "lines" if len(listed) > 1 else "line"
    shown = ", ".join(str(number) for number in listed[:MAX_LISTED])
    if len(listed) > MAX_LISTED:
        shown += f", ... ({len(listed)} lines)"
    return f"{word} {shown}"


def evaluated(expression: str, variables: Mapping[str, float]) -> float:
    """Return the value of an expression while the program runs.

    Raises:
        BlockError: a variable or the expression has no value.
    """
    try:
        return parse(expression).value(variables)
    except KeyError as error:
        raise BlockError(f"the variable {error.args[0]} has no value") from None
    except (ValueError, ZeroDivisionError) as error:
        shown = expression[:MAX_SHOWN]
        raise BlockError(f"{shown!r} is not understood: {error}") from None


class Argument(NamedTuple):
    """An argument of a call."""

    text: str
    span: Span


@dataclass(frozen=True)
class Word:
    """A word of a block: an address with a value, a call with arguments, or a name."""

    # A letter or a name; a variable that the word assigns, such as ``R1`` or ``#100``; with a
    # comma, Fanuc's ``,C`` or ``,R``.
    address: str
    value: float | None = None
    text: str = ""  # the value as it is written; the text of a string
    span: Span | None = None  # place of the number; None if it is computed
    expression: str = ""  # the expression that gives the value while the program runs

    # ``AC`` or ``IC`` of SINUMERIK: absolute or incremental, whatever G90 or G91 says.
    mode: str = ""
    arguments: tuple[Argument, ...] | None = None

    @property
    def is_variable(self) -> bool:
        """Whether the word assigns a value to a variable."""
        return bool(_VARIABLE.fullmatch(self.address))

    @property
    def is_whole(self) -> bool:
        """Whether its number has no decimal point."""
        return "." not in self.text

    @property
    def is_call(self) -> bool:
        """Whether the word is a call or a name, without a value."""
        return self.value is None and not self.text

    @property
    def fault(self) -> str:
        """Why its number cannot be used; empty if it can."""
        if self.value is None:
            return ""
        too_long = len(self.text) > MAX_DIGITS
        if too_long and not self.expression:
            return (
                f"{self.address}{self.text[:MAX_DIGITS]}... has {len(self.text)} digits, "
                f"but {MAX_DIGITS} at most are read"
            )
        if too_long or not abs(self.value) <= MAX_NUMBER:
            shown = f"{self.text[:MAX_DIGITS]}..." if too_long else self.text
            return (
                f"{self.address}{shown} is beyond {MAX_NUMBER:,.0f}, "
                "the largest number that is read"
            )
        return ""

    def with_value(self, variables: Mapping[str, float]) -> "Word":
        """Return the word with the value of its expression; see ``evaluated``.

        Raises:
            BlockError: its number, or the value of its expression, is too large.
        """
        word = self
        if self.expression:
            value = evaluated(self.expression, variables)
            word = replace(self, value=value, text=f"{value:.6f}")
        if word.fault:
            raise BlockError(word.fault)
        return word


class Flow(NamedTuple):
    """A jump, a loop or a condition; what a block lacks of it is empty.

    ``IF [#1 GT 0] GOTO 10`` has a word, a condition, a jump and a target; ``END 1`` has a jump and
    a target alone.
    """

    word: str  # IF, WHILE or FOR
    condition: str
    jump: str  # GOTO, GOTOF, GOTOB, DO, END or ENDWHILE
    target: str  # label or number of the block or the loop
    then: str  # words after THEN
    counter: str = ""  # parameter that FOR counts up
    start: str = ""  # its first value
    before: tuple["Word", ...] = ()  # words of the block before it


@dataclass(frozen=True)
class Line:
    """A line of a program that holds words."""

    number: int  # number in the file, from 1
    text: str  # its code, without comments
    words: tuple[Word, ...]
    end: int  # place in the program's text after the last word
    unknown: tuple[str, ...] = ()  # pieces that are no words
    flow: Flow | None = None

    @cached_property
    def codes(self) -> set[float]:
        """G functions of the line as they are written."""
        return {word.value for word in self.words if word.address == "G" and word.value is not None}

    def first(self, *addresses: str) -> Word | None:
        """Return the first word with one of the addresses."""
        return next((word for word in self.words if word.address in addresses), None)

    def number_of(self, *addresses: str) -> float | None:
        """Return the value of the first word with one of the addresses."""
        word = self.first(*addresses)
        return None if word is None else word.value

    def has(self, address: str, value: float) -> bool:
        """Return whether the line has a word, such as M98."""
        return any(word.address == address and word.value == value for word in self.words)

    def with_words(self, words: Iterable[Word]) -> "Line":
        """Return the line with some or all of its words."""
        return replace(self, words=tuple(words))


@dataclass(frozen=True)
class PartProgram:
    """The text of a part program, divided into lines.

    The first of its parts is the main program; the others are sub-programs, by their names.
    """

    text: str
    dialect: Dialect
    parts: dict[str, tuple[Line, ...]]
    notes: tuple[str, ...] = ()  # on its files and comments

    @property
    def main(self) -> str:
        """Name of the main program."""
        return next(iter(self.parts))

    @property
    def sub_programs(self) -> str:
        """Names of the sub-programs, for messages."""
        return ", ".join(list(self.parts)[1:]) or "none"


def read_program_file(path: Path, dialect: Dialect | None = None) -> PartProgram:
    """Return the program in a file; see ``divide``."""
    data = read_regular(path, MAX_BYTES)
    with naming(path):
        if data.startswith((b"\xff\xfe", b"\xfe\xff")):
            raise NcError("is UTF-16 text, which controls do not read: save it as ASCII or UTF-8")
        if b"\0" in data:
            raise NcError("is not text: it holds zero bytes")
        # In Latin 1 every byte is a character, and is written unchanged.
        return divide(data.decode("latin-1"), dialect)


def divide(text: str, dialect: Dialect | None = None) -> PartProgram:
    """Return the lines, words and sub-programs of a text.

    By default they are read in the dialect that its words show.

    Raises:
        NcError: the text holds no words, is too long, defines a sub-program twice, or is of a
            control that is not read.
    """
    raw = _lines_within_bounds(text)
    if dialect is None:
        _check_control(text)
        dialect = dialect_of(text)
    parts: dict[str, list[Line]] = {"": []}
    defined_at: dict[str, int] = {}
    part = ""
    offset = 0
    for number, whole in enumerate(raw, 1):
        code = _without_comments(whole.translate(_UPPER), dialect)
        header = _header(code, dialect)
        if header is not None:
            # PROC of SINUMERIK may repeat the name of its part, which %_N_NAME_SPF has begun.
            if not (header.is_proc and header.name == part):
                if header.name in parts:
                    raise NcError(
                        f"line {number}: {header.text!r} is defined twice, "
                        f"first in line {defined_at[header.name]}"
                    )
                part = header.name
                parts[part] = []
                defined_at[part] = number
            code = header.rest
        if code.strip():
            parts[part].append(_line(number, code, offset=offset, dialect=dialect))
        offset += len(whole) + 1
    # Numbers of blocks alone before the program's own begin are no program.
    if len(parts) > 1 and not any(_says_something(line) for line in parts[""]):
        parts[""] = []
    filled = {name: tuple(lines) for name, lines in parts.items() if lines}
    if not filled:
        raise NcError("holds no blocks: it is empty, or all of it is comment")
    return PartProgram(text, dialect, parts=filled, notes=_notes_on_comments(raw, dialect))


def _says_something(line: Line) -> bool:
    """Return whether a line holds more than the number of its block."""
    has_words = any(word.address != "N" for word in line.words)
    return has_words or bool(line.unknown) or line.flow is not None


def _notes_on_comments(raw: Iterable[str], dialect: Dialect) -> tuple[str, ...]:
    """Return a note on blocks behind the sign ; in a line, which are left out."""
    if not dialect.system:
        return ()
    numbers = []
    for number, whole in enumerate(raw, 1):
        if ";" in whole and _BLOCK_BEHIND.match(whole.strip().translate(_UPPER)):
            numbers.append(number)
    if not numbers:
        return ()
    return (
        f"{at_lines(numbers)}: what follows ; is left out as a comment, but looks like a block: "
        "write each block on a line of its own",
    )


def _check_control(text: str) -> None:
    """Refuse a program that shows a control whose programs are not read."""
    sign = foreign_sign(text)
    if sign is not None and not sign.control.read:
        raise NcError(
            f"{sign.found}, which is not read; --dialect {sign.control.tried} tries to read it"
        )


def _lines_within_bounds(text: str) -> list[str]:
    """Return the lines of a text, which keep their places in it.

    None is so long that a search through it takes long.

    Raises:
        NcError: there are too many lines, or one is too long.
    """
    unmarked = _MARK.sub(lambda mark: " " * len(mark[0]), with_line_feeds(text))
    lines = unmarked.split("\n")
    if len(lines) > MAX_LINES:
        raise NcError(f"has {len(lines)} lines, but {MAX_LINES} at most are read")
    for number, line in enumerate(lines, 1):
        if len(line) > MAX_CHARACTERS:
            raise NcError(
                f"line {number}: has {len(line):,} characters, "
                f"but {MAX_CHARACTERS:,} at most are read"
            )
    return lines


def _without_comments(line: str, dialect: Dialect) -> str:
    """Replace a line's comments by blanks, so that places stay."""

    def replaced(match: re.Match[str]) -> str:
        # SINUMERIK's pattern has a group for strings, which may hold a semicolon and stay.
        string_ = match[1] if match.re.groups else None
        return string_ or " " * len(match[0])

    code = dialect.comment.sub(replaced, line).replace("\t", " ")
    return code if dialect.system else without_null_indices(code)


class _Header(NamedTuple):
    """The begin of a sub-program."""

    name: str
    text: str  # its line
    rest: str  # code of the line without it
    is_proc: bool  # whether it is PROC of SINUMERIK


def _header(code: str, dialect: Dialect) -> _Header | None:
    """Return the begin of a sub-program in a line; None if the line holds none."""
    text = _BLOCK_NUMBER_OF_PROC.sub("", code.strip())
    match = dialect.sub_program.match(text)
    if match is None:
        return None
    name = next(group for group in match.groups() if group)
    if dialect.system:
        # Words may follow Fanuc's O and number, whose leading zeros do not count.
        number = str(int(name))
        blank = " " * len(match[0])
        rest = code.replace(match[0], blank, 1)
        return _Header(number, text, rest=rest, is_proc=False)
    if match.end() < len(text):
        return None
    is_proc = match.lastindex == 2
    return _Header(name, text, rest="", is_proc=is_proc)


def _line(number: int, code: str, offset: int, dialect: Dialect) -> Line:
    """Return the words of a line.

    Text that is no word is kept apart; reading goes on after it. ``offset`` is the place of the
    line in the text.
    """
    words: list[Word] = []
    unknown: list[Span] = []  # places in the line
    flow = None
    end = len(code.rstrip())
    skip = _SKIP.match(code)
    place = skip.end() if skip else 0

    # Of the last word.
    word_begin = word_end = place
    while place < end:
        flow_match = None if flow else dialect.flow.fullmatch(code, place, end)
        word_match = None if flow_match else dialect.word.match(code, place)
        if flow_match:
            flow = _flow(flow_match)._replace(before=tuple(words))
            place = flow_match.start("then") if flow.then else end
        elif word_match:
            words.append(_word(word_match, offset))
            word_begin = place
            word_end = place = word_match.end()
        else:
            begin = place
            # The word before is damaged, too, such as X56 in X56,5.
            if words and word_end == place and code[place] in _NUMBER_GOES_ON:
                begin = word_begin
                words.pop()
            place = _end_of_piece(code, place)
            # Pieces with nothing but blanks between them are one.
            if unknown and not code[unknown[-1].end : begin].strip():
                begin = unknown.pop().begin
            unknown.append(Span(begin, place))
        place = len(code) - len(code[place:].lstrip())
    return Line(
        number,
        code.strip(),
        words=tuple(words),
        end=offset + end,
        unknown=tuple(code[span.begin : span.end] for span in unknown),
        flow=flow,
    )


def _flow(match: re.Match[str]) -> Flow:
    """Return the jump, loop or condition of a match."""
    groups = match.groupdict()
    if groups.get("loop"):
        counter = groups["counter"]
        last = _without_blanks(groups["last"])
        return Flow(
            word="FOR",
            condition=f"{counter}<={last}",
            jump="",
            target="",
            then="",
            counter=counter,
            start=_without_blanks(groups["start"]),
        )
    return Flow(
        word=match["word"] or "",
        condition=_without_blanks(match["condition"] or ""),
        jump=match["jump"] or "",
        target=match["target"] or "",
        then=match["then"] or "",
    )


def _end_of_piece(code: str, place: int) -> int:
    """Return where text that is no word ends."""
    match = _PIECE.match(code, place)
    return match.end() if match else place + 1


def _word(match: re.Match[str], offset: int) -> Word:
    """Return the word of a match; ``offset`` is the place of its line in the text."""
    groups = match.groupdict()

    # Synchronized actions of SINUMERIK take the rest of their line.
    if groups.get("synchronized"):
        return Word("ID", text=groups["synchronized"].strip())
    if groups["letter"]:
        return _word_with_value(match, "letter", value="number", offset=offset)
    if groups["value"] is not None:
        return _word_with_value(match, "name", value="value", offset=offset)
    name = groups["name"]
    if groups["string"] is not None:
        return Word(name, text=groups["string"], span=_span(match, "string", offset))
    if groups["arguments"] is not None:
        begin = _span(match, "arguments", offset).begin
        return Word(name, arguments=tuple(_arguments(groups["arguments"], begin)))
    return Word(f"{name}:" if groups["label"] else name)


def _word_with_value(match: re.Match[str], address: str, value: str, offset: int) -> Word:
    """Return a word whose address and value are groups of a match."""
    name = "".join(match[address].split())
    text = match[value].strip()
    mode = match.groupdict().get("mode") or ""
    number = "".join(text.split())
    if re.fullmatch(NUMBER, number):
        span = _span(match, value, offset)
        return Word(name, float(number), text=number, span=span, mode=mode)
    return Word(name, expression=_without_blanks(text), mode=mode)


def _span(match: re.Match[str], group: str, offset: int) -> Span:
    return Span(match.start(group) + offset, match.end(group) + offset)


def _without_blanks(expression: str) -> str:
    """Return an expression without the blanks in its variables and numbers.

    Controls skip these.
    """
    expression = _VARIABLE.sub(lambda name: "".join(name[0].split()), expression)
    return re.sub(r"(?<=[\d.])\s+(?=[\d.])", "", expression)


def _arguments(text: str, place: int) -> Iterator[Argument]:
    """Yield the arguments of a call, which commas outside of strings separate."""
    for match in re.finditer(r'((?:"[^"]*"|[^,"])*),', text + ","):
        argument = match[1].strip()
        indent = len(match[1]) - len(match[1].lstrip())
        begin = place + match.start() + indent
        yield Argument(argument, Span(begin, begin + len(argument)))
