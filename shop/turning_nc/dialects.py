"""Dialects of part programs as data: Fanuc (ISO, G code systems A, B and C, LinuxCNC) and SINUMERIK; signs of others."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

INCH = 25.4
NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)"  # one way to match each text, so that a failure takes no second look
_DIGITS = r"\d(?:\s*\d)*"
_SPACED_NUMBER = rf"(?:[+-]\s*)?(?:{_DIGITS}(?:\s*\.(?:\s*{_DIGITS})?)?|\.\s*{_DIGITS})"  # ISO controls skip blanks
_TERM = rf"(?:R\d+|{NUMBER}|(?:[A-Z]+\s*)?\((?:[^()]|\([^()]*\))*\))"  # a function, or a term in parentheses
_CODES_OF_BOTH = {0, 1, 2, 3, 4, 33, 41, 42, 53, 90, 91, 94, 95, 96, 97}

CornerKind = Literal["legs", "chord", "radius"]
"""Meaning of a broken corner's size: the chamfer's legs, the chamfer itself, or a radius."""


@dataclass(frozen=True)
class Dialect:
    """The syntax of a control's programs, and the words that it understands."""

    name: Literal["fanuc", "fanuc-b", "fanuc-c", "sinumerik"]
    system: Literal[
        "A", "B", "C", ""
    ]  # Fanuc's G code system; programs of system B without cycles are read as A, too
    word: re.Pattern[str]  # matches a word; its groups are those of ``words.Word``
    comment: re.Pattern[str]
    sub_program: re.Pattern[
        str
    ]  # matches the line that begins a part of the file; a group holds its name
    flow: re.Pattern[
        str
    ]  # matches a block that jumps, loops or depends; its groups: word, condition, jump, target, then
    addresses: frozenset[str]  # addresses that take a value
    names: frozenset[str]  # words and calls without a value
    codes: frozenset[
        float
    ]  # G functions that are understood, also those without effect on path and times
    units: Mapping[
        float, tuple[float, bool]
    ]  # G functions of units: length [mm], and whether feeds and speeds change too
    spindle_limits: frozenset[float]  # G functions that make S a limit of the spindle
    references: frozenset[float]  # G functions that move to a reference point
    cycles: Mapping[float, int]  # G functions of cycles, and their numbers in Fanuc's system A
    boxes: Mapping[
        float, int
    ]  # G functions that turn, thread or face a box, and their numbers in system A
    feed_modes: Mapping[float, bool]  # G functions of feeds, and whether these are per revolution
    takes_coordinates: frozenset[
        float
    ]  # G functions that are not understood, whose blocks' coordinates are their own
    corners: Mapping[str, CornerKind]  # words that break the corner at the end of a move
    arc_radius: str
    thread_lead: tuple[str, ...]


FANUC = Dialect(
    name="fanuc",
    system="A",
    word=re.compile(
        rf"""(?P<name>\#\s*(?:\d+|<[\w\s]+>))\s*=\s*(?P<value>[^=]+) |
        (?P<letter>[A-Z]|,\s*[A-Z])\s*(?P<number>{_SPACED_NUMBER}|(?:[+-]\s*)?(?:\#\s*(?:\d+|<[\w\s]+>)|\[(?:[^\[\]]|\[[^\[\]]*\])*\]))""",
        re.VERBOSE,
    ),
    # A comment may lack its end; [ begins a directive of a simulator, O and a name or <NAME> a program.
    comment=re.compile(
        r"\((?:[^()]|\([^()]*\))*(?:\)|$)|;.*|^\s*(?:\[.*|O[A-Z]\w*(?=\s*(?:\(|$))|<\w+>)|[%\x1a]\s*$"
    ),
    sub_program=re.compile(r"[O:]\s*(\d{1,8})"),
    flow=re.compile(
        r"(?:(?P<word>IF|WHILE)\s*(?P<condition>\[.*\]))?\s*(?:(?P<jump>GOTO|DO|END)\s*(?P<target>\d+)|THEN\s*(?P<then>.+))"
    ),
    addresses=frozenset({*"NGMTSFXZUWIKRPQDLAH", ",A", ",C", ",R"}),
    names=frozenset(),
    codes=frozenset(
        _CODES_OF_BOTH
        | {7, 8, 20, 21, 28, 30, 32, 50, *range(70, 77), 80, 81, 82, 83, 84, 92, 98, 99}
        | {9, 18, 22, 23, 25, 26, 40, 43, 49, *range(54, 60), 61, 64, 67, 69, 103, 187}
    ),
    units={20: (INCH, True), 21: (1.0, True)},
    spindle_limits=frozenset({50, 92}),
    references=frozenset({28, 30}),
    cycles={code: code for code in (*range(70, 77), 81, 82, 83, 84)},
    boxes={90: 90, 92: 92, 94: 94},
    feed_modes={94: False, 95: True, 98: False, 99: True},
    # Macros, data, polar and cylindrical coordinates, splines, skips, drilling and threads that are not read.
    takes_coordinates=frozenset(
        {5, 7.1, 10, 12.1, 13.1, 31, 34, *range(35, 40), 50.2, 51, 51.2, 52, 65, 66, 66.1, 68, 68.1}
    )
    | frozenset(
        {77, 78, 79, *range(85, 90), 107, *range(110, 120), *range(183, 190), *range(270, 290)}
    ),
    corners={",C": "legs", ",R": "radius"},
    arc_radius="R",
    thread_lead=("F", "K"),
)
FANUC_B = replace(
    FANUC,
    name="fanuc-b",
    system="B",
    codes=FANUC.codes - {50} | {77, 78, 79},
    spindle_limits=frozenset({92}),
    boxes={77: 90, 78: 92, 79: 94},
    feed_modes={94: False, 95: True},  # G98 and G99 are return levels of drilling cycles
    takes_coordinates=FANUC.takes_coordinates | {50},
)
FANUC_C = replace(
    FANUC_B,
    name="fanuc-c",
    system="C",
    codes=FANUC_B.codes - {79} | {24},
    units={70: (INCH, True), 71: (1.0, True)},
    cycles={72: 70, 73: 71, 74: 72, 75: 73, 76: 74, 77: 75, 78: 76, 81: 81, 82: 82, 83: 83, 84: 84},
    boxes={20: 90, 21: 92, 24: 94},
)
SINUMERIK = Dialect(
    name="sinumerik",
    system="",
    word=re.compile(
        rf"""(?P<law>ID=.*) |
        (?P<letter>[A-Z])\s*(?P<number>(?:[+-]\s*)?(?:\d+(?:\.\d*)?|\.\d+))(?!\s*=|[_(\d.]) |
        (?P<name>[A-Z_][A-Z_0-9]*|\$[A-Z_]+(?:\[\w+\])?)(?:
            \s*=\s*(?:(?P<mode>AC|IC)\(\s*)?
                (?:(?P<value>(?:[+-]\s*)?{_TERM}(?:\s*[-+*/]\s*{_TERM})*)|"(?P<string>[^"]*)")(?(mode)\s*\)) |
            \s*\((?P<arguments>(?:[^()"]|"[^"]*")*)\) |
            (?P<label>:(?!=)) |
            (?![=(\w])
        )""",
        re.VERBOSE,
    ),
    comment=re.compile(r'("[^"]*")|;.*|^\s*%\s*$|\x1a'),
    sub_program=re.compile(
        r"%_N_(\w+?)_(?:MPF|SPF)|PROC\s+(\w+)(?:\s*\(\s*\))?(?:\s+(?:SAVE|DISPLOF|SBLOF))*"
    ),
    flow=re.compile(
        r"(?:(?P<word>IF|WHILE)\b(?P<condition>.+?))?\s*(?:\b(?P<jump>GOTO[BF]?|ENDWHILE)\b\s*(?P<target>\w*))?(?P<then>(?!))?"
    ),
    addresses=frozenset(
        {
            *"NGMTSFXZIKDLP",
            "CR",
            "LIMS",
            "S1",
            "M1",
            "T1",
            "CHR",
            "CHF",
            "RND",
            "RNDM",
            "SF",
            "ANG",
            "SPOS",
        }
    ),
    names=frozenset(
        {"DIAMON", "DIAMOF", "DIAM90", "CYCLE95", "CYCLE97", "RET", "SUPA"}
        | {
            "SOFT",
            "BRISK",
            "DRIVE",
            "FFWON",
            "FFWOF",
            "CFC",
            "CFTCP",
            "CFIN",
            "COMPOF",
            "STOPRE",
            "NORM",
            "KONT",
            "G",
        }
        | {"MSG", "SETMS", "WORKPIECE", "GROUP_BEGIN", "GROUP_END", "TRANS", "ATRANS"}
    ),
    codes=frozenset(
        _CODES_OF_BOTH
        | {25, 26, 70, 71, 74, 75, 700, 710}
        | {
            9,
            18,
            40,
            60,
            64,
            290,
            450,
            451,
            500,
            *range(54, 58),
            *range(505, 600),
            *range(601, 604),
            *range(641, 646),
        }
    ),
    units={70: (INCH, False), 71: (1.0, False), 700: (INCH, True), 710: (1.0, True)},
    spindle_limits=frozenset({25, 26}),
    references=frozenset({74, 75}),
    cycles={},
    boxes={},
    feed_modes={94: False, 95: True},
    # Zero offsets, poles, splines, tapping and threads that are not read.
    takes_coordinates=frozenset(
        {5, 34, 35, 58, 59, 63, 92, 110, 111, 112, 147, 148, 247, 248, 331, 332, 347, 348}
    ),
    corners={"CHR": "legs", "CHF": "chord", "RND": "radius"},
    arc_radius="CR",
    thread_lead=("K", "I"),
)
DIALECTS: dict[str, Dialect] = {
    dialect.name: dialect for dialect in (FANUC, FANUC_B, FANUC_C, SINUMERIK)
}
DIAMETERS = "DIAMON", "DIAMOF", "DIAM90"
NOT_READ = {
    "CYCLE951": ", stock removal by SINUMERIK Operate: write it as CYCLE95 with a contour, or as moves",
    "CYCLE952": ", a contour's stock removal by SINUMERIK Operate: write it as CYCLE95",
    "CYCLE930": ", a groove by SINUMERIK Operate: write its moves",
    "CYCLE940": ", an undercut by SINUMERIK Operate: write its moves",
    "CYCLE99": ", a thread by SINUMERIK Operate: write it as CYCLE97",
    "CYCLE62": ", which names the contour of CYCLE952 in SINUMERIK Operate",
    "CYCLE92": ", parting off by SINUMERIK Operate: write its moves",
    "CYCLE93": ", a groove: write its moves",
    "CYCLE94": ", an undercut: write its moves",
    "CYCLE96": ", an undercut of a thread: write its moves",
    "CYCLE98": ", a chain of threads: write each as CYCLE97",
    "CYCLE81": ", drilling: write its moves",
    "CYCLE82": ", drilling: write its moves",
    "CYCLE83": ", deep drilling: write its moves",
    "CYCLE84": ", tapping: write it as G33",
    "CYCLE840": ", tapping: write it as G33",
}
"""Cycles of SINUMERIK that are not read: what they do, and what to write in their place."""
_SIGNS_OF_SINUMERIK = re.compile(
    r"""^[ \t]*(?:%_N_|;\$PATH) |
    \b(?:CYCLE\d+|MSG)\s*\( | \b(?:LIMS|CR|CHF|CHR|RNDM?|R\d+)\s*= | \bT\s*=\s*" | \bT\d+[ ]+D\d+\b |
    \b(?:DIAMON|DIAMOF|DIAM90|PROC|RET|M17|G500|G700|G710)\b""",
    re.MULTILINE | re.VERBOSE,
)


MAX_SIGN = 40  # longest part of a word that a message shows


@dataclass(frozen=True)
class Pair:
    """Words that show a control if the second stands anywhere after the first.

    They are two patterns, as one would search all lines that follow each match of the first word.
    """

    first: re.Pattern[str]
    second: re.Pattern[str]

    def search(self, text: str) -> re.Match[str] | None:
        """Return the first word of the pair; None if a text does not hold both in their order."""
        match = self.first.search(text)
        if match is None or self.second.search(text, match.end()) is None:
            return None
        return match


@dataclass(frozen=True)
class Foreign:
    """A control whose programs are not read, or are read as Fanuc's with a note."""

    name: str
    signs: re.Pattern[str]  # words of its own
    pair: Pair | None = None  # words that are its own only together
    tried: str = "fanuc"  # the dialect that comes nearest
    read: bool = False  # whether that dialect is taken without asking

    def first_sign(self, text: str) -> re.Match[str] | None:
        """Return the first of its words in a text of capitals, if there is one."""
        sign = self.signs.search(text)
        paired = self.pair.search(text) if self.pair else None
        if sign is None or paired is None:
            return sign or paired
        return min(sign, paired, key=re.Match.start)


@dataclass(frozen=True)
class Sign:
    """A word that shows another control."""

    control: Foreign
    found: str  # the word and its line, for messages


def _signs(*patterns: str) -> re.Pattern[str]:
    return re.compile("|".join(patterns), re.MULTILINE)


FOREIGN = (
    Foreign(
        "Okuma (OSP)",
        _signs(
            r"^[ \t]*\$[\w.-]+\.(?:MIN|SUB|SSB|SDF|LIB|MSB)\b",  # names of files
            r"\bNAT\d+",
            r"\bG8[0-8][ \t]*N[A-Z]\w*",  # calls of a contour, and its begin and end
            r"^[ \t]*N[A-Z]\w*[ \t]+G8[0-2]\b",
            r"^[ \t]*NLAP\d*",
            r"\b(?:NOEX|RTS|MODIN|MODOUT|V[ZX]OF[ZX]?|VET[FLN]+|VLMON|VPLI)\b",
            r"\bCALL[ \t]+O\w+",
            r"\bG14[01]\b",
            r"T(?P<nose>\d\d)(?P=nose)\d\d(?!\d)",  # six digits: nose radius, tool and offset
            r"T\d\d(?P<offset>\d\d)(?P=offset)(?!\d)",
            r"G7[12](?!\d)[^\n]*(?:B[ \t]*\d|M3[234](?!\d)|M7[345](?!\d))",  # threads
            r"^[ \t]*(?:N\d+[ \t]+)?V(?:C|D)?\d+[ \t]*=",  # variables
        ),
    ),
    Foreign("Mazatrol", _signs(r"^[ \t]*(?:UNO\.|PNO\.)")),
    Foreign(
        "LinuxCNC with O words",
        _signs(
            r"^[ \t]*O[ \t]*(?:<[\w \t]+>|\d+|#\d+|\[[^\n]*\])[ \t]*"
            r"(?:SUB|ENDSUB|CALL|RETURN|IF|ELSEIF|ELSE|ENDIF|WHILE|ENDWHILE|DO|BREAK|CONTINUE|REPEAT|ENDREPEAT)\b"
        ),
    ),
    Foreign("Heidenhain", _signs(r"^[ \t]*(?:\d+\s+)?(?:BEGIN PGM|CYCL DEF|TOOL CALL)\b")),
    Foreign(
        "an old SINUMERIK (810, 820, 840C or before)",
        _signs(
            r"^[ \t]*%[ \t]*(?:MPF|SPF)[ \t]*\d+",
            r"^[ \t/]*(?:N\d+[ \t]*)?@[ \t]*\d{2,3}\b",  # its jumps and computations
            # B is the radius of an arc; B0 is an axis of mill-turn machines.
            r"G0?[23](?!\d)(?![^\n]*(?:R[ \t=]*\d|[IK][ \t]*[-+.\d]))[^\nB]*B[ \t]*[+-]?0*\.?0*[1-9]",
        ),
        pair=Pair(
            _signs(r"^[^\nG]*G5[89][ \t]+[XZ][^\nG]*$"), _signs(r"G92[ \t]*S")
        ),  # zero offsets, limit of the spindle
        tried="sinumerik",
    ),
    Foreign("Fagor or Huazhong (HNC)", _signs(r"^%(?:\d+[ \t\r]*$|[^\s,]+,\s*M\w*,)")),
    Foreign(
        "Mazak (EIA)",
        _signs(
            r"\bG53\.5\b|\bG10\.9\b|\bG109\b|\bG27[0-9]\b|\bG12[23]\.1\b|\bG6[89]\.5\b",
            r"\bM99[89]\s*<",
        ),
        read=True,
    ),
)
"""Signs of controls that are not read; but those of Mazak (EIA) are close to Fanuc's."""


def with_line_feeds(text: str) -> str:
    """Return the text with LF at the end of each line, where it has LF, CR or CRLF. All other places stay."""
    return text.replace("\r\n", " \n").replace("\r", "\n")


def foreign_sign(text: str) -> Sign | None:
    """Return the first word of a program that shows another control, if it has one."""
    plain = re.sub(r"\([^()\n]*\)|;.*", "", with_line_feeds(text).upper())
    for control in FOREIGN:
        if match := control.first_sign(plain):
            line = plain.count("\n", 0, match.start()) + 1
            word = " ".join(match[0].split())[:MAX_SIGN]
            return Sign(control, f"line {line}: {word!r} is a word of {control.name}")
    return None


def dialect_of(text: str) -> Dialect:
    """Return the dialect that a program's own words show; Fanuc's system A if none does."""
    code = with_line_feeds(text).upper()
    if _SIGNS_OF_SINUMERIK.search(code):
        return SINUMERIK
    return _system_of(re.sub(r"\([^()\n]*\)|;.*", "", code))


def _system_of(code: str) -> Dialect:
    """Return the G code system of Fanuc that the cycles of a program show; A if none does."""
    units_of_c = cycles_of_c = boxes_of_b = boxes_of_c = False
    for line in code.split("\n"):
        functions = {int(number) for number in re.findall(r"G\s*(\d+)(?![\d.])", line)}
        letters = set(re.findall(r"([A-Z])\s*[-+.\d\[#]", line))
        moves = functions & {0, 1, 2, 3, 28, 30, 32, 33, 53}
        contour = {"P", "Q"} <= letters
        if letters & {"X", "Z", "U", "W"} and not (moves or contour):
            boxes_of_b |= bool(functions & {77, 78, 79})
            boxes_of_c |= bool(functions & {20, 21, 24})
            if 24 in functions:
                return FANUC_C
        units_of_c |= bool(functions & {70, 71}) and not letters & {*"PQUWRDIK"}
        cycles_of_c |= contour and bool(functions & {*range(72, 79)})
    if units_of_c and (cycles_of_c or boxes_of_c):
        return FANUC_C
    return FANUC_B if boxes_of_b else FANUC
