"""Spellings and dialects of programs: each is read as a control reads it, or named."""

import itertools
import re
from collections.abc import Callable

import pytest

pytest.importorskip("shapely")

from tests.turning_nc.test_moves import ISO, SIEMENS, moves
from turning_env import Scenario
from turning_nc.adapt import adapt
from turning_nc.cutting import Machine, Situation
from turning_nc.moves import Move
from turning_nc.stock import read_stock, remove
from turning_nc.words import NcError, divide

BAR = "G21 G99 T0101\nG97 S800 M3\nG0 X62. Z2.\n"
CUT = "G1 X56. F0.25\nZ-40.\nG0 X80.\nM30\n"


def cuts(text: str) -> list[tuple[float, float]]:
    """Return Z and diameter at the end of every move at feed."""
    ends = [move.path.end for move in moves(text).moves if move.kind == "feed"]
    return [(round(z, 4), round(2.0 * x, 4)) for z, x in ends]


def without_places(text: str) -> list[tuple[object, ...]]:
    """Return what the moves of a program do, without places in its text."""

    def of(move: Move) -> tuple[object, ...]:
        return move.kind, move.path.end, move.line, move.tool, move.feed.value, move.speed.value, move.spindle_on

    return [of(move) for move in moves(text).moves]


# Spelling.


def with_mixed_ends(text: str) -> str:
    """Return the text with LF, CR and CRLF in turn at the ends of its lines."""
    ends = itertools.cycle(("\n", "\r", "\r\n"))
    return "".join(line + next(ends) for line in text.splitlines())


SPELLINGS: dict[str, Callable[[str], str]] = {
    "CR": lambda text: text.replace("\n", "\r"),
    "CRLF": lambda text: text.replace("\n", "\r\n"),
    "mixed ends": with_mixed_ends,
    "a blank after addresses": lambda text: re.sub(r"(?m)\b([XZFGT])(?=-?\d)(?!.*[\"=])", r"\1 ", text),
    "a blank after the sign": lambda text: text.replace("-", "- "),
    "a blank before the sign": lambda text: text.replace("Z-", "Z\t- "),
    "small letters": str.lower,
}


@pytest.mark.parametrize("spelling", SPELLINGS)
@pytest.mark.parametrize("text", [ISO, SIEMENS.replace("M4\n", "M4 ; remark\n")])
def test_blanks_and_ends_of_lines_change_nothing(text: str, spelling: str) -> None:
    respelled = SPELLINGS[spelling](text)
    assert respelled != text
    assert divide(respelled).dialect == divide(text).dialect
    assert without_places(respelled) == without_places(text)


def test_blanks_inside_numbers_are_skipped() -> None:
    assert cuts(BAR + "G 0 1 X 5 6. F 0. 2 5\nZ - 4 0 .\n# 1 = - 5.\nX [ # 1 + 6 5. ]") == [
        (2.0, 56.0),
        (-40.0, 56.0),
        (-40.0, 60.0),
    ]


def test_adapted_words_keep_their_places_with_any_end_of_line() -> None:
    adapted = {}
    for end in ("\n", "\r", "\r\n"):
        text = (BAR + CUT).replace("F0.25", "F 0.2 5").replace("\n", end)
        made = moves(text)
        situation = Situation(Scenario.load("rough_turning"), Machine(), made, remove(made, read_stock("bar:60x60")))
        adapted[end] = adapt(situation).text
        assert adapted[end] != text
    assert adapted["\r"].replace("\r", "\n") == adapted["\r\n"].replace("\r\n", "\n") == adapted["\n"]


# Dialects.


def test_named_parameters_of_linuxcnc_are_read() -> None:
    text = "G18 G7 G21 G90 G95\n#<_depth> = 2.0\n#<Start> = 56.0\nT1 M6\nG97 S800 M3 F0.25\nG0 X62 Z2\n"
    text += "G1 X#<start>\nZ-40\nX[#<start> + 3*#<_depth>]"
    assert cuts(text) == [(2.0, 56.0), (-40.0, 56.0), (-40.0, 62.0)]
    with pytest.raises(NcError, match=r"line 7: .*#<START>"):
        moves(text.replace("#<Start> =", "#<stop> ="))
