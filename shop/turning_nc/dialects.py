"""Dialects of part programs as data: Fanuc (ISO) with its G code systems, and SINUMERIK.

A dialect states the syntax of a control's programs and the words that it understands. Other
modules give these words their meaning. Programs of further controls are known by their signs.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

INCH = 25.4  # [mm]

# There is one way to match each text, so that a failure takes no second look.
NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)"
_DIGITS = r"\d(?:\s*\d)*"

# ISO controls skip blanks, also within a number.
_SPACED_NUMBER = rf"(?:[+-]\s*)?(?:{_DIGITS}(?:\s*\.(?:\s*{_DIGITS})?)?|\.\s*{_DIGITS})"
_FANUC_VARIABLE = r"\#\s*(?:\d+|<[\w\s]+>)"

# An expression of SINUMERIK is made of parameters, numbers, and functions or terms in parentheses.
_TERM = rf"(?:R\d+|{NUMBER}|(?:[A-Z]+\s*)?\((?:[^()]|\([^()]*\))*\))"

_CODES_OF_BOTH = {0, 1, 2, 3, 4, 33, 41, 42, 53, 90, 91, 94, 95, 96, 97}

ZERO_OFFSETS = frozenset({*range(54, 60), 54.1, 154, *range(505, 600)})
"""G functions that set a zero offset, of Fanuc and of SINUMERIK."""
NUMBERED_OFFSETS = frozenset({54.1, 154})
"""G functions of a Fanuc and of a Haas that set the zero offset whose number P states."""

CornerKind = Literal["legs", "chord", "radius"]
"""Meaning of a broken corner's size: the chamfer's legs, the chamfer itself, or a radius."""


@dataclass(frozen=True)
class UnitCode:
    """A G function that sets the unit of a program."""

    length: float  # of the unit [mm]
    with_feeds: bool  # whether feeds and cutting speeds change too


@dataclass(frozen=True)
class Dialect:
    """The syntax of a control's programs, and the words that it understands."""

    name: Literal["fanuc", "fanuc-b", "fanuc-c", "sinumerik"]

    # Fanuc's G code system. Programs of system B without cycles are read as A, too.
    system: Literal["A", "B", "C", ""]

    # Matches a word; ``words`` knows its groups.
    word: re.Pattern[str]
    comment: re.Pattern[str]

    # Matches the line that begins a part of the file; a group holds the part's name.
    sub_program: re.Pattern[str]

    # Matches a block that jumps, loops or depends; its groups are the fields of ``words.Flow``.
    flow: re.Pattern[str]

    addresses: frozenset[str]  # addresses that take a value
    names: frozenset[str]  # words and calls without a value

    # G functions that are understood, also those without effect on path and times.
    codes: frozenset[float]
    units: Mapping[float, UnitCode]
    spindle_limits: frozenset[float]  # G functions that make S a limit of the spindle
    references: frozenset[float]  # G functions that move to a reference point
    cycles: Mapping[float, int]  # G functions of cycles, and their numbers in Fanuc's system A

    # G functions that turn, thread or face a box, and their numbers in system A.
    boxes: Mapping[float, int]
    feed_modes: Mapping[float, bool]  # G functions of feeds, and whether these are per revolution

    # G functions that are not understood, whose blocks' coordinates are their own.
    takes_coordinates: frozenset[float]
    corners: Mapping[str, CornerKind]  # words that break the corner at the end of a move
    arc_radius: str


def _codes(*groups: Iterable[float]) -> frozenset[float]:
    """Return the union of groups of G functions."""
    codes: set[float] = set()
    for group in groups:
        codes.update(group)
    return frozenset(codes)


_FANUC_CYCLES: dict[float, int] = {code: code for code in (*range(70, 77), *range(81, 85))}

FANUC = Dialect(
    name="fanuc",
    system="A",
    word=re.compile(
        rf"""
        (?P<name>{_FANUC_VARIABLE})\s*=\s*(?P<value>[^=]+) |
        (?P<letter>[A-Z]|,\s*[A-Z])\s*
        (?P<number>
            {_SPACED_NUMBER} |
            (?:[+-]\s*)?(?:{_FANUC_VARIABLE}|\[(?:[^\[\]]|\[[^\[\]]*\])*\])
        )
        """,
        re.VERBOSE,
    ),
    # A comment may lack its end; [ begins a directive of a simulator, O and a name or <NAME> a
    # program.
    comment=re.compile(
        r"\((?:[^()]|\([^()]*\))*(?:\)|$)|;.*|"
        r"^\s*(?:\[.*|O[A-Z]\w*(?=\s*(?:\(|$))|<\w+>)|[%\x1a]\s*$"
    ),
    # ISO 6983 begins a program with a colon, Fanuc with O.
    sub_program=re.compile(r"[O:]\s*(\d{1,8})"),
    flow=re.compile(
        r"(?:(?P<word>IF|WHILE)\s*(?P<condition>\[.*\]))?\s*"
        r"(?:(?P<jump>GOTO|DO|END)\s*(?P<target>\d+)|THEN\s*(?P<then>.+))"
    ),
    addresses=frozenset({*"NGMTSFXZUWIJKRPQDELAH", ",A", ",C", ",R"}),
    names=frozenset(),
    codes=_codes(
        _CODES_OF_BOTH,
        # In LinuxCNC, centres of arcs count from the start (G91.1), as they do here.
        {7, 8, 20, 21, 28, 30, 32, 50, 80, 91.1, 92, 98, 99},
        _FANUC_CYCLES,
        # Exact stop, plane, zero offsets and other functions without effect on the path.
        {9, 18, 22, 23, 25, 26, 40, 43, 49, 54.1, 61, 64, 67, 69, 103, 154, 187},
        range(54, 60),
    ),
    units={20: UnitCode(INCH, with_feeds=True), 21: UnitCode(1.0, with_feeds=True)},
    spindle_limits=frozenset({50, 92}),
    references=frozenset({28, 30}),
    cycles=_FANUC_CYCLES,
    boxes={90: 90, 92: 92, 94: 94},
    feed_modes={94: False, 95: True, 98: False, 99: True},
    # Macros, data, polar and cylindrical coordinates, splines, skips, drilling and threads that
    # are not read.
    takes_coordinates=_codes(
        {5, 7.1, 10, 12.1, 13.1, 31, 34, 50.2, 50.3, 51, 51.2, 52, 65, 66, 66.1, 68, 68.1},
        {77, 78, 79, 90.1, 92.1, 92.2, 92.3, 107},
        range(35, 40),
        range(85, 90),
        range(110, 120),
        range(183, 190),
        range(270, 290),
    ),
    corners={",C": "legs", ",R": "radius"},
    arc_radius="R",
)

# Fanuc's systems B and C have the cycles of system A under other numbers. G98 and G99 are return
# levels of drilling cycles in both.
FANUC_B = replace(
    FANUC,
    name="fanuc-b",
    system="B",
    codes=FANUC.codes - {50} | {77, 78, 79},
    spindle_limits=frozenset({92}),
    boxes={77: 90, 78: 92, 79: 94},
    feed_modes={94: False, 95: True},
    takes_coordinates=FANUC.takes_coordinates | {50},
)
FANUC_C = replace(
    FANUC_B,
    name="fanuc-c",
    system="C",
    codes=FANUC_B.codes - {79} | {24},
    units={70: UnitCode(INCH, with_feeds=True), 71: UnitCode(1.0, with_feeds=True)},
    cycles={72: 70, 73: 71, 74: 72, 75: 73, 76: 74, 77: 75, 78: 76, 81: 81, 82: 82, 83: 83, 84: 84},
    boxes={20: 90, 21: 92, 24: 94},
)

# The words that begin with a letter and =, names, calls and labels of SINUMERIK 810D to 840D.
SINUMERIK = Dialect(
    name="sinumerik",
    system="",
    word=re.compile(
        rf"""
        (?P<synchronized>ID=.*) |
        (?P<letter>[A-Z])\s*(?P<number>(?:[+-]\s*)?(?:\d+(?:\.\d*)?|\.\d+))
            (?!\s*=|[_(\d.]|:(?!=)) |
        (?P<name>[A-Z_][A-Z_0-9]*|\$[A-Z_]+(?:\[\w+\])?)
        (?:
            \s*=\s*
            (?:(?P<mode>AC|IC)\(\s*)?
            (?:
                (?P<value>(?:[+-]\s*)?{_TERM}(?:\s*[-+*/]\s*{_TERM})*) |
                "(?P<string>[^"]*)"
            )
            (?(mode)\s*\)) |
            \s*\((?P<arguments>(?:[^()"]|"[^"]*")*)\) |
            (?P<label>:(?!=)) |
            (?![=(\w])
        )
        """,
        re.VERBOSE,
    ),
    comment=re.compile(r'("[^"]*")|;.*|^\s*%\s*$|\x1a'),
    sub_program=re.compile(
        r"%_N_(\w+?)_(?:MPF|SPF)|"
        r"PROC\s+(\w+)(?:\s*\(\s*\))?(?:\s+(?:SAVE|DISPLOF|SBLOF))*"
    ),
    # The last group never matches: SINUMERIK has no THEN.
    flow=re.compile(
        r"(?P<loop>FOR)\s+(?P<counter>R\d+)\s*=(?P<start>.+?)\bTO\b(?P<last>.+)|"
        r"(?:(?P<word>IF|WHILE)\b(?P<condition>.+?))?\s*"
        r"(?:\b(?P<jump>GOTO[BF]?|ENDWHILE|ENDFOR|ELSE|ENDIF)\b\s*(?P<target>\w*))?(?P<then>(?!))?"
    ),
    addresses=frozenset("NGMTSFXZIKDLP")
    | {"CR", "LIMS", "S1", "M1", "T1", "CHR", "CHF", "RND", "RNDM", "SF", "ANG", "SPOS"},
    names=frozenset({"DIAMON", "DIAMOF", "DIAM90", "RET", "SUPA"})
    | {"CYCLE95", "CYCLE97"}
    | {"TRANS", "ATRANS"}
    # Without effect on the path: acceleration, feed at radii, approach, displays.
    | {"SOFT", "BRISK", "DRIVE", "FFWON", "FFWOF", "CFC", "CFTCP", "CFIN", "COMPOF", "STOPRE"}
    | {"NORM", "KONT", "G", "MSG", "SETMS", "WORKPIECE", "GROUP_BEGIN", "GROUP_END"}
    # SCC[X] says that the cutting speed counts at X, as it does without it.
    | {"SCC"},
    codes=_codes(
        _CODES_OF_BOTH,
        {25, 26, 70, 71, 74, 75, 700, 710},
        # Exact stop, plane, zero offsets and continuous path, without effect on the path.
        {9, 18, 40, 60, 64, 153, 290, 450, 451, 500},
        range(54, 58),
        range(505, 600),
        range(601, 604),
        range(641, 646),
    ),
    # G70 and G71 change lengths alone, G700 and G710 feeds too.
    units={
        70: UnitCode(INCH, with_feeds=False),
        71: UnitCode(1.0, with_feeds=False),
        700: UnitCode(INCH, with_feeds=True),
        710: UnitCode(1.0, with_feeds=True),
    },
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
)
DIALECTS: dict[str, Dialect] = {
    dialect.name: dialect for dialect in (FANUC, FANUC_B, FANUC_C, SINUMERIK)
}

# Words of SINUMERIK that state how X is read.
DIAMETERS = "DIAMON", "DIAMOF", "DIAM90"
NOT_READ = {
    "CYCLE62": ", the contour of a cycle by SINUMERIK Operate: name it in CYCLE95",
    "CYCLE951": ", the stock of a corner by SINUMERIK Operate: write it as CYCLE95",
    "CYCLE952": ", the stock of a contour by SINUMERIK Operate: write it as CYCLE95",
    "CYCLE930": ", a groove by SINUMERIK Operate: write its moves",
    "CYCLE940": ", an undercut by SINUMERIK Operate: write its moves",
    "CYCLE99": ", a thread by SINUMERIK Operate: write it as CYCLE97",
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
    "CIP": ", an arc through a point: write it as G2 or G3 with CR=",
    "CT": ", an arc at a tangent: write it as G2 or G3 with CR=",
    "ROT": ", turned coordinates: write the coordinates of the part",
    "AROT": ", turned coordinates: write the coordinates of the part",
    "MIRROR": ", mirrored coordinates: write the coordinates of the part",
    "AMIRROR": ", mirrored coordinates: write the coordinates of the part",
    "SCALE": ", scaled coordinates: write the coordinates of the part",
    "ASCALE": ", scaled coordinates: write the coordinates of the part",
    "SETAL": ", an alarm: leave it out",
    "AR": ", the angle of an arc: write its radius, CR=",
    "RP": ", polar coordinates: write X and Z",
    "AP": ", polar coordinates: write X and Z",
    "OFFN": ", a distance from the contour: write the contour",
}
"""Cycles and words of SINUMERIK that are not read: what they do, and what to write instead."""

STATEMENTS = {
    "DEF": "declares a variable of the user: write an R parameter in its place, such as R1",
    "EXTERN": "declares a program elsewhere: put it beside this file and call it by name alone",
    "EXTCALL": "runs a program elsewhere: put it beside this file and call it by name alone",
    "CALL": "calls a program by a string: write the name alone",
    "PCALL": "calls a program by its path: put it beside this file and call it by name alone",
    "MCALL": "repeats a cycle at each move: write the cycle's moves",
    "FOR": "is read with an R parameter alone: FOR R1=1 TO 5",
    "LOOP": "has no end: write WHILE or a jump",
    "ENDLOOP": "has no end: write WHILE or a jump",
    "REPEAT": "repeats blocks: write WHILE or a jump",
    "REPEATB": "repeats a block: write WHILE or a jump",
    "UNTIL": "repeats blocks: write WHILE or a jump",
    "CASE": "chooses a jump: write IF ... GOTOF",
}
"""Statements of SINUMERIK that are not read, by the words with which they begin.

They take the rest of their block.
"""

NOT_READ_CODES: dict[float, str] = {
    5: ", a spline or a fast mode: write its moves",
    10: ", data for the control: set them there, and leave the block out",
    31: ", a move until a signal: leave it out, or write it as G1",
    50.3: ", the end of a shift of the zero point: leave it out if nothing shifts it",
    52: ", a shift of the zero point: write the coordinates from one zero point",
    65: ", a macro call: write the macro's moves, or call it by M98",
    66: ", a modal macro call: write the macro's moves",
    87: ", a cycle across the axis: write its moves",
    90.1: ", centres of arcs in absolute coordinates: write I and K from the arc's start",
    92.1: ", the end of a shift of the zero point: leave it out if nothing shifts it",
    92.2: ", the end of a shift of the zero point: leave it out if nothing shifts it",
    92.3: ", a shift of the zero point: write the coordinates from one zero point",
    112: ", polar coordinates for milling: leave out what mills",
}
"""G functions of Fanuc that are not read: what they do, and what to write instead."""

# An index in brackets that says what its word says without it: R[1], and the first spindle's LIMS.
_NULL_INDEX = re.compile(r"\b(?:(R)\[\s*(\d+)\s*\]|(LIMS)\[\s*1\s*\]|(SCC)\[\s*X\s*\])")


def without_null_indices(code: str) -> str:
    """Return a line of SINUMERIK with R1 for R[1], LIMS for LIMS[1] and SCC for SCC[X].

    All other characters keep their places.
    """

    def plain(match: re.Match[str]) -> str:
        word = "".join(group for group in match.groups() if group)
        return word.ljust(len(match[0]))

    return _NULL_INDEX.sub(plain, code)


_SIGNS_OF_SINUMERIK = re.compile(
    r"""
    ^[ \t]*(?:%_N_|;\$PATH) |
    \b(?:CYCLE\d+|MSG)\s*\( |
    \b(?:LIMS|CR|CHF|CHR|RNDM?|R\d+|R\[\s*\d+\s*\]|LIMS\[\s*\d+\s*\])\s*= |
    \bSCC\[ |
    \bT\s*=\s*" |
    \bT\d+[ ]+D\d+\b |
    \b(?:DIAMON|DIAMOF|DIAM90|PROC|RET|M17|G500|G700|G710)\b
    """,
    re.MULTILINE | re.VERBOSE,
)
_COMMENT = re.compile(r"\([^()\n]*\)|;.*")

# A comment, which may hold signs; or, in the group, a call or a function of SINUMERIK.
_REMARK = re.compile(r"(\b[A-Z_]{2,}\d*[ \t]*\([^()\n]*\))|\([^()\n]*\)|;(?!\$PATH).*")


MAX_SIGN = 40  # longest part of a word that a message shows


@dataclass(frozen=True)
class Pair:
    """Words that show a control if the second stands anywhere after the first.

    One pattern for both would search all lines that follow each match of the first word.
    """

    first: re.Pattern[str]
    second: re.Pattern[str]

    def search(self, text: str) -> re.Match[str] | None:
        """Return the first word; None if a text does not hold both in their order."""
        match = self.first.search(text)
        if match is None or self.second.search(text, match.end()) is None:
            return None
        return match


@dataclass(frozen=True)
class Foreign:
    """A control whose programs are not read, or are read as Fanuc's with a note."""

    name: str
    signs: re.Pattern[str]  # words that only this control has
    statements: re.Pattern[str] | None = None  # its blocks with parentheses, comments elsewhere
    pair: Pair | None = None  # words that only this control has together
    tried: str = "fanuc"  # the dialect that comes nearest
    read: bool = False  # whether that dialect is taken without asking

    def first_sign(self, text: str, plain: str) -> re.Match[str] | None:
        """Return the first of its words in a text of capitals, if there is one.

        ``plain`` is the text without comments; it has the same lines.
        """
        if self.statements is not None:
            statement = self.statements.search(text)
            if statement is not None:
                return statement
        return self._first_word(plain)

    def _first_word(self, text: str) -> re.Match[str] | None:
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


_OKUMA = Foreign(
    "Okuma (OSP)",
    _signs(
        # Names of files.
        r"^[ \t]*\$[\w.-]+\.(?:MIN|SUB|SSB|SDF|LIB|MSB)\b",
        r"\bNAT\d+",
        # Calls of a contour, its begin and its end.
        r"\bG8[0-8][ \t]*N[A-Z]\w*",
        r"^[ \t]*N[A-Z]\w*[ \t]+G8[0-2]\b",
        r"^[ \t]*NLAP\d*",
        r"\b(?:NOEX|RTS|MODIN|MODOUT|V[ZX]OF[ZX]?|VET[FLN]+|VLMON|VPLI)\b",
        r"\bCALL[ \t]+O\w+",
        r"\bG14[01]\b",
        # T of six digits: nose radius, tool and offset.
        r"T(?P<nose>\d\d)(?P=nose)\d\d(?!\d)",
        r"T\d\d(?P<offset>\d\d)(?P=offset)(?!\d)",
        # Threads.
        r"G7[12](?!\d)[^\n]*(?:B[ \t]*\d|M3[234](?!\d)|M7[345](?!\d))",
        # Variables.
        r"^[ \t]*(?:N\d+[ \t]+)?V(?:C|D)?\d+[ \t]*=",
    ),
)
_OLD_SINUMERIK = Foreign(
    "an old SINUMERIK (810, 820, 840C or before)",
    _signs(
        r"^[ \t]*%[ \t]*(?:MPF|SPF)[ \t]*\d+",
        # Jumps and computations.
        r"^[ \t/]*(?:N\d+[ \t]*)?@[ \t]*\d{2,3}\b",
        # B is the radius of an arc; B0 is an axis of mill-turn machines.
        r"G0?[23](?!\d)(?![^\n]*(?:R[ \t=]*\d|[IK][ \t]*[-+.\d]))"
        r"[^\nB]*B[ \t]*[+-]?0*\.?0*[1-9]",
    ),
    # Zero offsets, then a limit of the spindle.
    pair=Pair(_signs(r"^[^\nG]*G5[89][ \t]+[XZ][^\nG]*$"), _signs(r"G92[ \t]*S")),
    tried="sinumerik",
)
_LINUXCNC_O_WORDS = Foreign(
    "LinuxCNC with O words",
    _signs(
        r"^[ \t]*O[ \t]*(?:<[\w \t]+>|\d+|#\d+|\[[^\n]*\])[ \t]*"
        r"(?:SUB|ENDSUB|CALL|RETURN|IF|ELSEIF|ELSE|ENDIF|WHILE|ENDWHILE|DO|BREAK|CONTINUE|"
        r"REPEAT|ENDREPEAT)\b"
    ),
)
_MAZAK_EIA = Foreign(
    "Mazak (EIA)",
    _signs(
        r"\bG53\.5\b|\bG10\.9\b|\bG109\b|\bG27[0-9]\b|\bG12[23]\.1\b|\bG6[89]\.5\b",
        r"\bM99[89]\s*<",
    ),
    read=True,
)

_FAGOR = Foreign(
    "Fagor or Huazhong (HNC)",
    _signs(
        # The name of the program, with its attributes: %SHAFT,MX--,
        r"^%(?:\d+[ \t\r]*$|[^,\n]{1,60},[ \t]*[MOXHEI-]+[ \t]*(?:,|\r?$)|[^\s,]+,\s*M\w*,)",
        # Sub-programs and statements of the 8060, 8065 and 8070.
        r"^%L[ \t]+\w",
        r"^[ \t]*(?:N\d+[ \t]*)?#(?:RET|CALL|PCALL|MCALL|TIME|WAIT|SCALE|ERROR|EXEC)\b",
        r"^[ \t]*(?:N\d+[ \t]*)?\$(?:IF|FOR|WHILE|GOTO|ENDIF|ENDFOR|ENDWHILE)\b",
    ),
    statements=_signs(
        r"^[ \t]*(?:N\d+[ \t]*)?\((?:(?:P|M)?CALL|SUB)[ \t]+\d+[ \t]*[,)]",
        r"^[ \t]*(?:N\d+[ \t]*)?\((?:RET|(?:RPT|GOTO)[ \t]+N\d+[^)\n]*)\)",
        r"^[ \t]*(?:N\d+[ \t]*)?\(IF[ \t][^)\n]*\bGOTO[ \t]+N\d+[ \t]*\)",
    ),
)
_EMCO = Foreign(
    "Emco (EMCOTRONIC)",
    # The parameters of its cycles: G84 X50 Z-30 D3=1000.
    _signs(r"[\d. \t]D[0-8][ \t]*=[ \t]*[-+]?\d"),
)
_SHOPTURN = Foreign(
    "ShopTurn",
    _signs(r"(?!)"),
    # Its steps, such as E_HEAD(...); elsewhere their arguments look like comments.
    statements=_signs(r"^[ \t]*(?:N\d+[ \t]+)?[EF]_[A-Z][A-Z_0-9]*[ \t]*\("),
    tried="sinumerik",
)

# The first control of the list that has a sign in a program is named.
FOREIGN = (
    _OKUMA,
    Foreign("Mazatrol", _signs(r"^[ \t]*(?:UNO\.|PNO\.)")),
    _LINUXCNC_O_WORDS,
    Foreign("Heidenhain", _signs(r"^[ \t]*(?:\d+\s+)?(?:BEGIN PGM|CYCL DEF|TOOL CALL)\b")),
    _OLD_SINUMERIK,
    _FAGOR,
    _EMCO,
    _SHOPTURN,
    _MAZAK_EIA,
)
"""Signs of controls that are not read; but those of Mazak (EIA) are close to Fanuc's."""


def with_line_feeds(text: str) -> str:
    """Return the text with LF at the end of each line, where it has LF, CR or CRLF.

    All other characters keep their places.
    """
    return text.replace("\r\n", " \n").replace("\r", "\n")


def foreign_sign(text: str) -> Sign | None:
    """Return the first word of a program that shows another control, if it has one."""
    capitals = with_line_feeds(text).upper()
    plain = _COMMENT.sub("", capitals)
    for control in FOREIGN:
        match = control.first_sign(capitals, plain)
        if match is None:
            continue
        lines_before = match.string.count("\n", 0, match.start())
        word = " ".join(match[0].split())
        shown = word[:MAX_SIGN]
        reason = f"line {lines_before + 1}: {shown!r} is a word of {control.name}"
        return Sign(control, reason)
    return None


def dialect_of(text: str) -> Dialect:
    """Return the dialect that a program's words show; Fanuc's system A if none does."""
    code = with_line_feeds(text).upper()
    remarks_left_out = _REMARK.sub(lambda remark: remark[1] or "", code)
    if _SIGNS_OF_SINUMERIK.search(remarks_left_out):
        return SINUMERIK
    return _system_of(_COMMENT.sub("", code))


def _system_of(code: str) -> Dialect:
    """Return the G code system of Fanuc that the cycles of a program show; A if none does."""
    units_of_c = cycles_of_c = False
    boxes_of_b = boxes_of_c = False
    for line in code.split("\n"):
        functions = {int(number) for number in re.findall(r"G\s*(\d+)(?![\d.])", line)}
        letters = set(re.findall(r"([A-Z])\s*[-+.\d\[#]", line))
        moves = functions & {0, 1, 2, 3, 28, 30, 32, 33, 53}
        contour = {"P", "Q"} <= letters

        # A box cycle is a block with coordinates, but without a function that moves to them.
        if letters & {"X", "Z", "U", "W"} and not (moves or contour):
            boxes_of_b = boxes_of_b or bool(functions & {77, 78, 79})
            boxes_of_c = boxes_of_c or bool(functions & {20, 21, 24})
            if 24 in functions:
                return FANUC_C

        # G70 and G71 are units in system C, but cycles with words of their own in A and B.
        if functions & {70, 71} and not letters & {*"PQUWRDIK"}:
            units_of_c = True
        if contour and functions & {*range(72, 79)}:
            cycles_of_c = True
    if units_of_c and (cycles_of_c or boxes_of_c):
        return FANUC_C
    return FANUC_B if boxes_of_b else FANUC
