"""Dialects of part programs as data: Fanuc (ISO, G code systems A, B and C, LinuxCNC) and SINUMERIK; signs of others."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

INCH = 25.4
NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)"
_DIGITS = r"\d(?:\s*\d)*"
_SPACED_NUMBER = rf"[+-]?\s*(?:{_DIGITS}(?:\s*\.(?:\s*{_DIGITS})?)?|\.\s*{_DIGITS})"  # ISO controls skip blanks
_TERM = rf"(?:R\d+|{NUMBER}|(?:[A-Z]+\s*)?\((?:[^()]|\([^()]*\))*\))"  # a function, or a term in parentheses
_CODES_OF_BOTH = {0, 1, 2, 3, 4, 33, 41, 42, 53, 90, 91, 94, 95, 96, 97}

CornerKind = Literal["legs", "chord", "radius"]
"""Meaning of a broken corner's size: the chamfer's legs, the chamfer itself, or a radius."""


@dataclass(frozen=True)
class Dialect:
    """The syntax of a control's programs, and the words that it understands."""

    name: Literal["fanuc", "sinumerik"]
    word: re.Pattern[str]  # matches a word; its groups are those of ``words.Word``
    comment: re.Pattern[str]
    sub_program: re.Pattern[str]  # matches the line that begins a part of the file; a group holds its name
    flow: re.Pattern[str]  # matches a block that jumps, loops or depends; its groups: word, condition, jump, target, then
    addresses: frozenset[str]  # addresses that take a value
    names: frozenset[str]  # words and calls without a value
    codes: frozenset[float]  # G functions that are understood, also those without effect on path and times
    units: Mapping[float, tuple[float, bool]]  # G functions of units: length [mm], and whether feeds and speeds change too
    spindle_limits: frozenset[float]  # G functions that make S a limit of the spindle
    references: frozenset[float]  # G functions that move to a reference point
    cycles: frozenset[float]  # G functions of cycles
    corners: Mapping[str, CornerKind]  # words that break the corner at the end of a move
    arc_radius: str
    thread_lead: tuple[str, ...]


FANUC = Dialect(
    name="fanuc",
    word=re.compile(
        rf"""(?P<name>\#\s*(?:\d+|<[\w\s]+>))\s*=\s*(?P<value>[^=]+) |
        (?P<letter>[A-Z]|,\s*[A-Z])\s*(?P<number>{_SPACED_NUMBER}|[+-]?\s*(?:\#\s*(?:\d+|<[\w\s]+>)|\[(?:[^\[\]]|\[[^\[\]]*\])*\]))""",
        re.VERBOSE,
    ),
    # A comment may lack its end; [ begins a directive of a simulator, O and a name or <NAME> a program.
    comment=re.compile(r"\((?:[^()]|\([^()]*\))*(?:\)|$)|;.*|^\s*(?:\[.*|O[A-Z]\w*(?=\s*(?:\(|$))|<\w+>)|[%\x1a]\s*$"),
    sub_program=re.compile(r"[O:]\s*(\d{1,8})"),
    flow=re.compile(
        r"(?:(?P<word>IF|WHILE)\s*(?P<condition>\[.*\]))?\s*(?:(?P<jump>GOTO|DO|END)\s*(?P<target>\d+)|THEN\s*(?P<then>.+))"
    ),
    addresses=frozenset({*"NGMTSFXZUWIKRPQDLAH", ",A", ",C", ",R"}),
    names=frozenset(),
    codes=frozenset(
        _CODES_OF_BOTH
        | {7, 8, 20, 21, 28, 30, 32, 50, *range(70, 77), 80, 81, 82, 83, 84, 92, 98, 99}
        | {18, 22, 23, 25, 26, 40, 43, 49, *range(54, 60), 61, 64, 67, 69, 103, 187}
    ),
    units={20: (INCH, True), 21: (1.0, True)},
    spindle_limits=frozenset({50, 92}),
    references=frozenset({28, 30}),
    cycles=frozenset({*range(70, 77), 81, 82, 83, 84}),
    corners={",C": "legs", ",R": "radius"},
    arc_radius="R",
    thread_lead=("F", "K"),
)
SINUMERIK = Dialect(
    name="sinumerik",
    word=re.compile(
        rf"""(?P<law>ID=.*) |
        (?P<letter>[A-Z])\s*(?P<number>[+-]?\s*(?:\d+\.?\d*|\.\d+))(?!\s*=|[_(\d.]) |
        (?P<name>[A-Z_][A-Z_0-9]*|\$[A-Z_]+(?:\[\w+\])?)(?:
            \s*=\s*(?:(?P<mode>AC|IC)\(\s*)?
                (?:(?P<value>[+-]?\s*{_TERM}(?:\s*[-+*/]\s*{_TERM})*)|"(?P<string>[^"]*)")(?(mode)\s*\)) |
            \s*\((?P<arguments>(?:[^()"]|"[^"]*")*)\) |
            (?P<label>:(?!=)) |
            (?![=(\w])
        )""",
        re.VERBOSE,
    ),
    comment=re.compile(r'("[^"]*")|;.*|^\s*%\s*$|\x1a'),
    sub_program=re.compile(r"%_N_(\w+?)_(?:MPF|SPF)|PROC\s+(\w+)(?:\s*\(\s*\))?(?:\s+(?:SAVE|DISPLOF|SBLOF))*"),
    flow=re.compile(
        r"(?:(?P<word>IF|WHILE)\b(?P<condition>.+?))?\s*(?:\b(?P<jump>GOTO[BF]?|ENDWHILE)\b\s*(?P<target>\w*))?(?P<then>(?!))?"
    ),
    addresses=frozenset({*"NGMTSFXZIKDLP", "CR", "LIMS", "S1", "M1", "T1", "CHR", "CHF", "RND", "RNDM", "SF", "ANG", "SPOS"}),
    names=frozenset(
        {"DIAMON", "DIAMOF", "DIAM90", "CYCLE95", "CYCLE97", "RET", "SUPA"}
        | {"SOFT", "BRISK", "DRIVE", "FFWON", "FFWOF", "CFC", "CFTCP", "CFIN", "COMPOF", "STOPRE", "NORM", "KONT", "G"}
        | {"MSG", "SETMS", "WORKPIECE", "GROUP_BEGIN", "GROUP_END", "TRANS", "ATRANS"}
    ),
    codes=frozenset(
        _CODES_OF_BOTH
        | {25, 26, 70, 71, 74, 75, 700, 710}
        | {9, 18, 40, 60, 64, 290, 450, 451, 500, *range(54, 58), *range(505, 600), *range(601, 604), *range(641, 646)}
    ),
    units={70: (INCH, False), 71: (1.0, False), 700: (INCH, True), 710: (1.0, True)},
    spindle_limits=frozenset({25, 26}),
    references=frozenset({74, 75}),
    cycles=frozenset(),
    corners={"CHR": "legs", "CHF": "chord", "RND": "radius"},
    arc_radius="CR",
    thread_lead=("K", "I"),
)
DIALECTS: dict[str, Dialect] = {dialect.name: dialect for dialect in (FANUC, SINUMERIK)}
_SIGNS_OF_SINUMERIK = re.compile(
    r"""^[ \t]*(?:%_N_|;\$PATH) |
    \b(?:CYCLE\d+|MSG)\s*\( | \b(?:LIMS|CR|CHF|CHR|RNDM?|R\d+)\s*= | \bT\s*=\s*" | \bT\d+[ ]+D\d+\b |
    \b(?:DIAMON|DIAMOF|DIAM90|PROC|RET|M17|G500|G700|G710)\b""",
    re.MULTILINE | re.VERBOSE,
)


FOREIGN = {
    name: re.compile(pattern, re.MULTILINE)
    for name, pattern in (
        ("Okuma (OSP)", r"\bNAT\d+|\bG8[5-8]\s*NLAP|^[ \t]*NLAP\d*|\bNOEX\b|\bV[ZX]OF\b|\bG14[01]\b"),
        ("Mazatrol", r"^[ \t]*(?:UNO\.|PNO\.)"),
        ("LinuxCNC with O words", r"^[ \t]*O(?:<\w+>|\d+)\s*(?:SUB|CALL|IF|ELSE|ENDIF|WHILE|ENDWHILE|REPEAT)\b"),
        ("Heidenhain", r"^[ \t]*(?:\d+\s+)?(?:BEGIN PGM|CYCL DEF|TOOL CALL)\b"),
        ("Fagor or Huazhong (HNC)", r"^%(?:\d+[ \t\r]*$|[^\s,]+,\s*M\w*,)"),
        ("Mazak (EIA)", r"\bG53\.5\b|\bG10\.9\b|\bG109\b|\bG27[0-9]\b"),
    )
}
"""Signs of controls that are not read; but those of Mazak (EIA) are close to Fanuc's."""


def with_line_feeds(text: str) -> str:
    """Return the text with LF at the end of each line, where it has LF, CR or CRLF. All other places stay."""
    return text.replace("\r\n", " \n").replace("\r", "\n")


def foreign_sign(text: str) -> tuple[str, str] | None:
    """Return the name of another control whose words a program has, and the first of these with its line; or None."""
    plain = re.sub(r"\([^()\n]*\)|;.*", "", with_line_feeds(text).upper())
    for name, pattern in FOREIGN.items():
        if found := pattern.search(plain):
            line = plain.count("\n", 0, found.start()) + 1
            return name, f"line {line}: {found[0].strip()!r} is a word of {name}"
    return None


def dialect_of(text: str) -> Dialect:
    """Return the dialect that a program's own words show; Fanuc if none does."""
    return SINUMERIK if _SIGNS_OF_SINUMERIK.search(with_line_feeds(text).upper()) else FANUC
