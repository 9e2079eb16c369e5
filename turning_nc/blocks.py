"""Part programs of the user's own: lines, words and sub-programs in the dialects of Fanuc (ISO, LinuxCNC) and SINUMERIK.

Every word keeps its place in the text, so that a program can be written back with only some words changed.
"""

import re
import string
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from turning_nc.expression import parse
from turning_nc.program import NcError

Dialect = Literal["fanuc", "sinumerik"]
MAX_BYTES, MAX_LINES = 2_000_000, 50_000

NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_FANUC_VALUE = rf"{NUMBER}|[+-]?(?:\#\d+|\[(?:[^\[\]]|\[[^\[\]]*\])*\])"
_FANUC_WORD = re.compile(
    rf"(?P<name>\#\d+)\s*=\s*(?P<value>[^=]+) | (?P<letter>[A-Z]|,\s*[A-Z])\s*(?P<number>{_FANUC_VALUE})", re.VERBOSE
)
_TERM = rf"(?:R\d+|{NUMBER}|\((?:[^()]|\([^()]*\))*\))"
_SINUMERIK_VALUE = rf"[+-]?\s*{_TERM}(?:\s*[-+*/]\s*{_TERM})*"
_SINUMERIK_WORD = re.compile(
    rf"""(?P<letter>[A-Z])(?P<number>{NUMBER})(?!\s*=|[_(\d.]) |
    (?P<name>[A-Z_][A-Z_0-9]*)(?:
        \s*=\s*(?:(?P<mode>AC|IC)\(\s*)?(?:(?P<value>{_SINUMERIK_VALUE})|"(?P<string>[^"]*)")(?(mode)\s*\)) |
        \s*\((?P<arguments>(?:[^()"]|"[^"]*")*)\) |
        (?P<label>:(?!=)) |
        (?![=(\w])
    )""",
    re.VERBOSE,
)
_UPPER = {ord(letter): letter.upper() for letter in string.ascii_lowercase}
"""Only letters of words: others may become two, which would shift places."""
_SIGNS_OF_SINUMERIK = re.compile(
    r"""^\s*%_N_ | ^\s*;\$PATH | \b(?:CYCLE\d+|MSG)\s*\( | \b(?:LIMS|CR|CHF|CHR|RNDM?|R\d+)\s*= | \bT\s*=\s*" | \bT\d+[ ]+D\d+\b |
    \b(?:DIAMON|DIAMOF|DIAM90|PROC|RET|M17|G500|G700|G710)\b""",
    re.MULTILINE | re.VERBOSE,
)
_SUB_PROGRAM = {
    "fanuc": re.compile(r"[O:]\s*(\d{1,8})"),
    "sinumerik": re.compile(r"%_N_(\w+?)_(?:MPF|SPF)|PROC\s+(\w+)(?:\s*\(\s*\))?(?:\s+(?:SAVE|DISPLOF|SBLOF))*"),
}


class Problem(ValueError):
    """A block that is not understood."""


@dataclass(frozen=True)
class Word:
    """A word of a block: an address with a value, a call with arguments, or a name."""

    address: str
    """Letter or name; a variable that the word assigns, such as ``R1`` or ``#100``; with a comma, ``,C`` or ``,R``."""
    value: float | None = None
    text: str = ""
    """The value as it is written; the text of a string."""
    span: tuple[int, int] | None = None
    """Place of the number in the program's text; None if it is computed."""
    expression: str = ""
    """What the value is computed from while the program runs."""
    mode: str = ""
    """``AC`` or ``IC``: absolute or incremental, whatever G90 or G91 says."""
    arguments: tuple[tuple[str, tuple[int, int]], ...] | None = None
    """Texts and places of a call's arguments."""


@dataclass(frozen=True)
class Line:
    """A line of a program that holds words."""

    number: int
    """Number in the file, from 1."""
    text: str
    """Its code, without comments."""
    words: tuple[Word, ...]
    end: int
    """Place in the program's text after the last word."""
    unknown: str = ""
    """What could not be divided into words."""

    def first(self, *addresses: str) -> Word | None:
        """Return the first word with one of the addresses."""
        return next((word for word in self.words if word.address in addresses), None)

    def number_of(self, address: str) -> float | None:
        """Return the value of the first word with the address."""
        word = self.first(address)
        return None if word is None else word.value

    def with_values(self, variables: Mapping[str, float]) -> "Line":
        """Return the line with the values of its expressions.

        Raises:
            Problem: a variable has no value, or an expression is not understood.
        """
        if not any(word.expression for word in self.words):
            return self
        return replace(self, words=tuple(_evaluated(word, variables) for word in self.words))


def _evaluated(word: Word, variables: Mapping[str, float]) -> Word:
    if not word.expression:
        return word
    for name in re.findall(r"#\d+|R\d+", word.expression):
        if name not in variables:
            raise Problem(f"the variable {name} has no value")
    text = re.sub(r"(?:#|R)(\d+)", r"$R[\1]", word.expression.translate(str.maketrans("[]", "()")))
    text = re.sub(r"(^|\()\s*([+-])", r"\g<1>0\2", text)
    readable = {f"$R[{name.lstrip('#R')}]": value for name, value in variables.items()}
    try:
        value = parse(text, readable).value(readable)
    except (ValueError, ZeroDivisionError) as error:
        raise Problem(f"{word.expression!r} is not understood: {error}") from None
    return replace(word, value=value, text=f"{value:.6f}")


@dataclass(frozen=True)
class PartProgram:
    """The text of a part program, divided into lines; the first of its parts is the main program."""

    text: str
    dialect: Dialect
    parts: dict[str, tuple[Line, ...]]
    """Lines of the main program, and of the sub-programs by their names."""

    @property
    def main(self) -> str:
        """Name of the main program."""
        return next(iter(self.parts))

    def line_text(self, number: int) -> str:
        """Return a line of the file without the blanks around it."""
        return self.text.split("\n")[number - 1].strip()


def read_program_file(path: Path, dialect: Dialect | None = None) -> PartProgram:
    """Return the program in a file; see ``divide``.

    Raises:
        NcError: see ``divide``; names the file.
        OSError: the file cannot be read.
    """
    data = path.read_bytes()
    if len(data) > MAX_BYTES:
        raise NcError(f"{path}: has {len(data)} bytes, but {MAX_BYTES} at most are read")
    if b"\0" in data:
        raise NcError(f"{path}: is not text: it holds zero bytes")
    try:
        return divide(data.decode("latin-1"), dialect)  # every byte stands for a character, and comes back as it was
    except NcError as error:
        raise NcError(f"{path}: {error}") from error


def divide(text: str, dialect: Dialect | None = None) -> PartProgram:
    """Return the lines, words and sub-programs of a text.

    Args:
        text: a program, with any ends of lines.
        dialect: ``"fanuc"`` or ``"sinumerik"``; by default what the text's own words tell, else Fanuc.

    Raises:
        NcError: the text holds no words, is too long, or defines a sub-program twice.
    """
    dialect = dialect or ("sinumerik" if _SIGNS_OF_SINUMERIK.search(text.upper()) else "fanuc")
    raw = text.split("\n")
    if len(raw) > MAX_LINES:
        raise NcError(f"has {len(raw)} lines, but {MAX_LINES} at most are read")
    parts: dict[str, list[Line]] = {"": []}
    name, offset, defined_at = "", 0, {"": 0}
    for number, whole in enumerate(raw, 1):
        code = _without_comments(whole.translate(_UPPER), dialect)
        stripped = re.sub(r"^/?\s*N\d+\s+(?=PROC\b)", "", code.strip())
        if (header := _SUB_PROGRAM[dialect].match(stripped)) and (dialect == "fanuc" or header.end() == len(stripped)):
            found = next(group for group in header.groups() if group)
            found = str(int(found)) if dialect == "fanuc" else found
            if not (header.lastindex == 2 and found == name):  # PROC may repeat the name of its part
                if found in parts:
                    raise NcError(f"line {number}: {stripped!r} stands a second time, first in line {defined_at[found]}")
                name, parts[found], defined_at[found] = found, [], number
            if dialect == "fanuc":
                code = " " * (code.index(header[0]) + len(header[0])) + code[code.index(header[0]) + len(header[0]) :]
            else:
                code = ""
        if code.strip() not in ("", "%"):
            parts[name].append(_line(number, code, offset, dialect))
        offset += len(whole) + 1
    filled = {key: tuple(lines) for key, lines in parts.items() if lines}
    if not filled:
        raise NcError("holds no blocks: it is empty, or all of it is comment")
    return PartProgram(text, dialect, filled)


def _without_comments(line: str, dialect: Dialect) -> str:
    """Replace a line's comments by blanks, so that places stay."""
    pattern = r"\([^()]*\)|;.*" if dialect == "fanuc" else r'("[^"]*")|;.*'
    line = re.sub(pattern, lambda found: found[1] if found.re.groups and found[1] else " " * len(found[0]), line)
    return line.replace("\r", " ").replace("\t", " ")


def _line(number: int, code: str, offset: int, dialect: Dialect) -> Line:
    pattern = _FANUC_WORD if dialect == "fanuc" else _SINUMERIK_WORD
    words: list[Word] = []
    place = re.match(r"[\s/]*", code).end()  # type: ignore[union-attr]
    while place < len(code.rstrip()):
        match = pattern.match(code, place)
        if match is None:
            break
        words.append(_word(match, offset))
        place = re.compile(r"\s*").match(code, match.end()).end()  # type: ignore[union-attr]
    unknown = code[place:].strip()
    return Line(number, code.strip(), tuple(words), offset + len(code.rstrip()), unknown)


def _word(match: re.Match[str], offset: int) -> Word:
    def span(group: str) -> tuple[int, int]:
        return match.start(group) + offset, match.end(group) + offset

    groups = match.groupdict()
    for address, group in ((groups["letter"], "number"), (groups["name"], "value")):
        if address and groups[group] is not None:
            address, text, mode = re.sub(r"\s", "", address), groups[group].strip(), groups.get("mode") or ""
            if re.fullmatch(NUMBER, text):
                return Word(address, float(text), text, span(group), mode=mode)
            return Word(address, expression=text, mode=mode)
    name = groups["name"]
    if groups["string"] is not None:
        return Word(name, None, groups["string"], span("string"))
    if groups["arguments"] is not None:
        start = match.start("arguments") + offset
        arguments: list[tuple[str, tuple[int, int]]] = []
        for found in re.finditer(r'(?:"[^"]*"|[^,"])*(?:,|$)', groups["arguments"]):
            if found.start() == len(groups["arguments"]) and arguments and not groups["arguments"].endswith(","):
                break
            piece = found[0].removesuffix(",")
            shift = len(piece) - len(piece.lstrip())
            place = start + found.start() + shift
            arguments.append((piece.strip(), (place, place + len(piece.strip()))))
        return Word(name, arguments=tuple(arguments))
    return Word(f"{name}:" if groups["label"] else name)
