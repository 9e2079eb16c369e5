"""Lines, words and sub-programs of a part program.

Every word keeps its place in the text, so that a program can be written back with only some words changed.
"""

import os
import re
import string
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from turning_nc.dialects import NUMBER, Dialect, dialect_of, foreign_sign, with_line_feeds
from turning_nc.expression import MAX_SHOWN, parse
from turning_shop import regular_file

from turning_env.console import UserError

MAX_BYTES, MAX_LINES = 10_000_000, 200_000
MAX_CHARACTERS = 1000  # of a line; the longest block of a control has some hundred
MAX_NUMBER, MAX_DIGITS = 1e9, 40
"""Bound of the numbers of words, and of the digits and signs with which they are written; controls take eight or nine digits."""
MAX_LISTED = 5  # largest number of lines that a note lists
_MARK = re.compile("^(?:\u00ef\u00bb\u00bf|\ufeff)")  # of the byte order, as Latin 1 and as it is
_SKIP = re.compile(
    r"\s*(?:/(?:[1-9](?=\s*\D))?\s*)*"
)  # / or /1 to /9 before a block that a switch of the control skips
_NUMBER_GOES_ON = ",.=#[*+-"  # signs that belong to the word before them if no blank parts them
_IN_BRACKETS = r"\"[^\"]*\"?|\([^)]*\)?|\[[^\]]*\]?|<[^>]*>?"
_PIECE = re.compile(rf"(?:{_IN_BRACKETS}|[^\sA-Z])+|[A-Z](?:{_IN_BRACKETS}|\S)*")
"""Text that is no word. It ends at a blank, and at a letter too if it does not begin with one."""
_VARIABLE = re.compile(r"#\s*(?:\d+|<[\w\s]+>)|R\d+")
_UPPER = {ord(letter): letter.upper() for letter in string.ascii_lowercase}
"""Translation of ASCII letters to capitals. Other letters may become two, which would shift places."""

Span = tuple[int, int]  # a place in the program's text: its begin and its end


class NcError(UserError):
    """A program that cannot be read, played or written. The message names the line or block, and the reason."""


@contextmanager
def naming(path: str | os.PathLike[str]) -> Iterator[None]:
    """Name a file in the errors of its program."""
    try:
        yield
    except NcError as error:
        raise NcError(f"{path}: {error}") from error


class Problem(ValueError):
    """A block that is not understood: the present one, or that of another line. All that reads or expands blocks may raise it."""

    def __init__(self, text: str, line: int | None = None) -> None:
        super().__init__(text)
        self.line = line


def at_lines(numbers: Iterable[int]) -> str:
    """Return numbers of lines as text, the first ones of many."""
    listed = sorted(set(numbers))
    shown = ", ".join(map(str, listed[:MAX_LISTED])) + f", ... ({len(listed)} lines)" * (
        len(listed) > MAX_LISTED
    )
    return f"line{'s' * (len(listed) > 1)} {shown}"


def evaluated(expression: str, variables: Mapping[str, float]) -> float:
    """Return the value of an expression while the program runs."""
    try:
        return parse(expression).value(variables)
    except KeyError as error:
        raise Problem(f"the variable {error.args[0]} has no value") from None
    except (ValueError, ZeroDivisionError) as error:
        raise Problem(f"{expression[:MAX_SHOWN]!r} is not understood: {error}") from None


@dataclass(frozen=True)
class Word:
    """A word of a block: an address with a value, a call with arguments, or a name."""

    address: str  # letter or name; a variable that the word assigns, such as ``R1`` or ``#100``; with a comma, ``,C`` or ``,R``
    value: float | None = None
    text: str = ""  # the value as it is written; the text of a string
    span: Span | None = None  # place of the number; None if it is computed
    expression: str = ""  # the expression that gives the value while the program runs
    mode: str = ""  # ``AC`` or ``IC``: absolute or incremental, whatever G90 or G91 says
    arguments: tuple[tuple[str, Span], ...] | None = None  # texts and places of a call's arguments

    @property
    def is_variable(self) -> bool:
        """Whether the word assigns a value to a variable."""
        return bool(_VARIABLE.fullmatch(self.address))

    @property
    def fault(self) -> str:
        """Why its number cannot be used; empty if it can."""
        if self.value is None or (len(self.text) <= MAX_DIGITS and abs(self.value) <= MAX_NUMBER):
            return ""
        shown = self.text if len(self.text) <= MAX_DIGITS else f"{self.text[:MAX_DIGITS]}..."
        if len(self.text) > MAX_DIGITS and not self.expression:
            return f"{self.address}{shown} has {len(self.text)} digits, but {MAX_DIGITS} at most are read"
        return f"{self.address}{shown} is beyond {MAX_NUMBER:,.0f}, the largest number that is read"

    def with_value(self, variables: Mapping[str, float]) -> "Word":
        """Return the word with the value of its expression; see ``evaluated``.

        Raises:
            Problem: its number, or the value of its expression, is too large.
        """
        word = self
        if self.expression:
            value = evaluated(self.expression, variables)
            word = replace(self, value=value, text=f"{value:.6f}")
        if word.fault:
            raise Problem(word.fault)
        return word


@dataclass(frozen=True)
class Line:
    """A line of a program that holds words."""

    number: int  # number in the file, from 1
    text: str  # its code, without comments
    words: tuple[Word, ...]
    end: int  # place in the program's text after the last word
    unknown: tuple[str, ...] = ()  # pieces that are no words
    flow: Mapping[str, str | None] | None = (
        None  # jump, loop or condition: groups of the dialect's ``flow``
    )

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


@dataclass(frozen=True)
class PartProgram:
    """The text of a part program, divided into lines; the first of its parts is the main program."""

    text: str
    dialect: Dialect
    parts: dict[
        str, tuple[Line, ...]
    ]  # lines of the main program, and of the sub-programs by their names

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
    data = regular_file(path, MAX_BYTES).read_bytes()
    with naming(path):
        if data.startswith((b"\xff\xfe", b"\xfe\xff")):
            raise NcError("is UTF-16 text, which controls do not read: save it as ASCII or UTF-8")
        if b"\0" in data:
            raise NcError("is not text: it holds zero bytes")
        return divide(
            data.decode("latin-1"), dialect
        )  # every byte is a character, and is written unchanged


def divide(text: str, dialect: Dialect | None = None) -> PartProgram:
    """Return the lines, words and sub-programs of a text, by default in the dialect that its own words show.

    Raises:
        NcError: the text holds no words, is too long, defines a sub-program twice, or is of a control that is not read.
    """
    raw = _lines_within_bounds(text)
    if dialect is None and (sign := foreign_sign(text)) and not sign.control.read:
        raise NcError(
            f"{sign.found}, which is not read; --dialect {sign.control.tried} tries to read it"
        )
    dialect = dialect or dialect_of(text)
    fanuc = dialect.system != ""
    parts: dict[str, list[Line]] = {"": []}
    name, offset, defined_at = "", 0, {"": 0}
    for number, whole in enumerate(raw, 1):
        code = _without_comments(whole.translate(_UPPER), dialect)
        stripped = re.sub(r"^/?\s*N\d+\s+(?=PROC\b)", "", code.strip())
        header = dialect.sub_program.match(stripped)
        if header and (fanuc or header.end() == len(stripped)):
            found = next(group for group in header.groups() if group)
            found = str(int(found)) if fanuc else found
            if not (
                header.lastindex == 2 and found == name
            ):  # PROC may repeat the name of its part
                if found in parts:
                    raise NcError(
                        f"line {number}: {stripped!r} is defined twice, first in line {defined_at[found]}"
                    )
                name, parts[found], defined_at[found] = found, [], number
            code = code.replace(header[0], " " * len(header[0]), 1) if fanuc else ""
        if code.strip():
            parts[name].append(_line(number, code, offset, dialect))
        offset += len(whole) + 1
    filled = {key: tuple(lines) for key, lines in parts.items() if lines}
    if not filled:
        raise NcError("holds no blocks: it is empty, or all of it is comment")
    return PartProgram(text, dialect, filled)


def _lines_within_bounds(text: str) -> list[str]:
    """Return the lines of a text, which keep their places in it; none is so long that a search through it takes long.

    Raises:
        NcError: there are too many lines, or one is too long.
    """
    lines = _MARK.sub(lambda mark: " " * len(mark[0]), with_line_feeds(text)).split("\n")
    if len(lines) > MAX_LINES:
        raise NcError(f"has {len(lines)} lines, but {MAX_LINES} at most are read")
    for number, line in enumerate(lines, 1):
        if len(line) > MAX_CHARACTERS:
            raise NcError(
                f"line {number}: has {len(line):,} characters, but {MAX_CHARACTERS:,} at most are read"
            )
    return lines


def _without_comments(line: str, dialect: Dialect) -> str:
    """Replace a line's comments by blanks, so that places stay."""
    line = dialect.comment.sub(
        lambda found: found[1] if found.re.groups and found[1] else " " * len(found[0]), line
    )
    return line.replace("\t", " ")


def _line(number: int, code: str, offset: int, dialect: Dialect) -> Line:
    """Return the words of a line. Text that is no word is kept apart; reading goes on after it."""
    words: list[Word] = []
    unknown: list[tuple[int, int]] = []  # places of pieces that are no words
    flow = None
    end = len(code.rstrip())
    skip = _SKIP.match(code)
    place = skip.end() if skip else 0
    word_place = last_end = place  # of the last word
    while place < end:
        if flow is None and (found := dialect.flow.fullmatch(code, place, end)):
            flow = found.groupdict()
            flow["condition"] = _without_blanks(flow["condition"]) if flow["condition"] else None
            place = found.start("then") if found["then"] else end
        elif match := dialect.word.match(code, place):
            words.append(_word(match, offset))
            word_place, place = place, match.end()
            last_end = place
        else:
            begin = place
            if words and last_end == place and code[place] in _NUMBER_GOES_ON:
                begin = word_place  # the word before is damaged, too, such as X56,5
                words.pop()
            place = _end_of_piece(code, place)
            if unknown and not code[unknown[-1][1] : begin].strip():
                begin = unknown.pop()[0]
            unknown.append((begin, place))
        place += len(code) - place - len(code[place:].lstrip())
    pieces = tuple(code[begin:piece_end] for begin, piece_end in unknown)
    return Line(number, code.strip(), tuple(words), offset + end, pieces, flow)


def _end_of_piece(code: str, place: int) -> int:
    """Return where text that is no word ends."""
    match = _PIECE.match(code, place)
    return match.end() if match else place + 1


def _word(match: re.Match[str], offset: int) -> Word:
    """Return the word of a match; ``offset`` is the place of its line in the text."""
    groups = match.groupdict()

    def span(group: str) -> Span:
        return match.start(group) + offset, match.end(group) + offset

    if groups.get("law"):
        return Word("ID", text=groups["law"].strip())
    for address, group in ((groups["letter"], "number"), (groups["name"], "value")):
        if not address or groups[group] is None:
            continue
        address = "".join(address.split())
        text = groups[group].strip()
        mode = groups.get("mode") or ""
        number = "".join(text.split())
        if re.fullmatch(NUMBER, number):
            return Word(address, float(number), number, span(group), mode=mode)
        return Word(address, expression=_without_blanks(text), mode=mode)
    name = groups["name"]
    if groups["string"] is not None:
        return Word(name, None, groups["string"], span("string"))
    if groups["arguments"] is not None:
        return Word(name, arguments=tuple(_arguments(groups["arguments"], span("arguments")[0])))
    return Word(f"{name}:" if groups["label"] else name)


def _without_blanks(expression: str) -> str:
    """Return an expression without the blanks inside of its variables and numbers, which controls skip."""
    expression = _VARIABLE.sub(lambda name: "".join(name[0].split()), expression)
    return re.sub(r"(?<=[\d.])\s+(?=[\d.])", "", expression)


def _arguments(text: str, place: int) -> list[tuple[str, Span]]:
    """Return the texts and places of arguments, which commas outside of strings separate."""
    arguments = []
    for found in re.finditer(r'((?:"[^"]*"|[^,"])*),', text + ","):
        begin = place + found.start() + len(found[1]) - len(found[1].lstrip())
        arguments.append((found[1].strip(), (begin, begin + len(found[1].strip()))))
    return arguments
