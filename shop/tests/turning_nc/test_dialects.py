"""Spellings and dialects of programs: each is read as a control reads it, or named."""

import itertools
import re
from collections.abc import Callable
from typing import NamedTuple, Self

import pytest

pytest.importorskip("shapely")

from turning_nc.adapt import adapt
from turning_nc.cutting import AssumedMachine, Situation
from turning_nc.dialects import DIALECTS
from turning_nc.moves import Move, ReadingChoices, run
from turning_nc.paths import Point
from turning_nc.removal import remove
from turning_nc.stock import read_stock
from turning_nc.words import NcError, divide

from shop.tests.turning_nc.programs import BAR, ISO, SIEMENS, moves
from turning_env import Scenario

CUT = "G1 X56. F0.25\nZ-40.\nG0 X80.\nM30\n"


def cuts(text: str) -> list[tuple[float, float]]:
    """Return Z and diameter at the end of every move at feed."""
    ends = [move.path.end for move in moves(text).moves if move.kind == "feed"]
    return [(round(z, 4), round(2.0 * x, 4)) for z, x in ends]


class Effect(NamedTuple):
    """The effect of a move, without places in the program's text."""

    kind: str
    end: Point
    line: int
    tool: str
    feed: float
    speed: float
    constant_cutting_speed: bool
    max_spindle_speed: float
    spindle_on: bool
    time: float

    @classmethod
    def of(cls, move: Move) -> Self:
        """Return what a move does."""
        return cls(
            kind=move.kind,
            end=move.path.end,
            line=move.line,
            tool=move.tool,
            feed=move.feed.value,
            speed=move.speed.value,
            constant_cutting_speed=move.constant_cutting_speed,
            max_spindle_speed=move.max_spindle_speed,
            spindle_on=move.spindle_on,
            time=move.time,
        )


def effects(text: str, go_on: bool = False) -> list[Effect]:
    """Return what the moves of a program do."""
    return [Effect.of(move) for move in run(divide(text), ReadingChoices(go_on=go_on)).moves]


# Spelling.


def with_mixed_ends(text: str) -> str:
    """Return the text with LF, CR and CRLF in turn at the ends of its lines."""
    ends = itertools.cycle(("\n", "\r", "\r\n"))
    return "".join(line + next(ends) for line in text.splitlines())


SPELLINGS: dict[str, Callable[[str], str]] = {
    "CR": lambda text: text.replace("\n", "\r"),
    "CRLF": lambda text: text.replace("\n", "\r\n"),
    "mixed ends": with_mixed_ends,
    "a blank after addresses": lambda text: re.sub(
        r"(?m)\b([XZFGT])(?=-?\d)(?!.*[\"=])", r"\1 ", text
    ),
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
    assert effects(respelled) == effects(text)


def test_blanks_inside_numbers_are_skipped() -> None:
    assert cuts(BAR + "G 0 1 X 5 6. F 0. 2 5\nZ - 4 0 .\n# 1 = - 5.\nX [ # 1 + 6 5. ]") == [
        (2.0, 56.0),
        (-40.0, 56.0),
        (-40.0, 60.0),
    ]


def test_blanks_in_conditions_are_skipped() -> None:
    text = BAR + "# 1 = 2\nIF [# 1 EQ 2 . 0] GOTO 10\nG1 Z-1. F0.2\nN 10 G1 Z-5. F0.2\n"
    assert cuts(text) == [(-5.0, 62.0)]


def test_adapted_words_keep_their_places_with_any_end_of_line() -> None:
    adapted = {}
    for end in ("\n", "\r", "\r\n"):
        last = "G0 Z2.\nG1 X54. F0.1\nZ-40.\nM30"
        text = (BAR + CUT).replace("F0.25", "F 0.2 5").replace("M30", last).replace("\n", end)
        made = moves(text)
        removal = remove(made, read_stock("bar:60x60"))
        situation = Situation(Scenario.load("rough_turning"), AssumedMachine(), made, removal)
        adapted[end] = adapt(situation).text
        assert adapted[end] != text
    assert adapted["\r"].replace("\r", "\n") == adapted["\n"]
    assert adapted["\r\n"].replace("\r\n", "\n") == adapted["\n"]


# Dialects.


def test_named_parameters_of_linuxcnc_are_read() -> None:
    text = (
        "G18 G7 G21 G90 G95\n#<_depth> = 2.0\n#<Start> = 56.0\nT1 M6\nG97 S800 M3 F0.25\n"
        "G0 X62 Z2\nG1 X#<start>\nZ-40\nX[#<start> + 3*#<_depth>]"
    )
    assert cuts(text) == [(2.0, 56.0), (-40.0, 56.0), (-40.0, 62.0)]
    with pytest.raises(NcError, match=r"line 7: .*#<START>"):
        moves(text.replace("#<Start> =", "#<stop> ="))


# Words that are not understood beside others that are.

INCHES = "G20 G40 G99\nT0101\nG96 S500 M3\nG0 X2.1 Z.1\nG1 X1.8 F.012\nZ-2.5"
TWO_TOOLS = f"{BAR}{CUT}".replace("M30", "T0505\nG0 X40. Z2.\nG1 Z-9. F0.1\nM30")
DREHEN = "G90 G95 G71 DIAMON T1 D1\nG97 S800 M4 F0.2\nG0 X62 Z2\nG1 X56\nZ-40\nG0 X80\nM30"


class Change(NamedTuple):
    """A program, and words that another program has in place of one of its words."""

    clean: str
    word: str
    words: str

    @property
    def text(self) -> str:
        """The other program."""
        assert self.word in self.clean
        return self.clean.replace(self.word, self.words, 1)

    @property
    def more_lines(self) -> int:
        """Number of lines by which the other program is longer."""
        return self.words.count("\n") - self.word.count("\n")


# Units, feeds, speeds, tools and axes stay beside words of every kind that are not understood.
CUT_AT_56 = "G1 X56. F0.25"
SPEED = "G97 S800 M3"
LEFT_OUT = {
    "D beside a kind of feed": Change(INCHES, "G99\n", "G99 D200\n"),
    "G beside a unit": Change(INCHES, "G20 G40", "G20 G777 G40"),
    "signs before a unit": Change(INCHES, "G20 G40", "?! G20 G40"),
    "call between functions": Change(INCHES, "G20 G40", "G20 MODE(A B) G40"),
    "axis beside a tool": Change(TWO_TOOLS, "T0505", "T0505 C30."),
    "E before a tool": Change(TWO_TOOLS, "T0505", "E7 T0505"),
    "macro before a tool": Change(TWO_TOOLS, "T0505", "G65 P9001 X50. Z-30. R2. T0505"),
    "Y in a move": Change(TWO_TOOLS, CUT_AT_56, "G1 X56. Y12.5 F0.25"),
    "G and R in a move": Change(TWO_TOOLS, CUT_AT_56, "G1 G777 X56. F0.25 R3."),
    "negative speed in a move": Change(TWO_TOOLS, CUT_AT_56, "G1 X56. F0.25 S-100 C2."),
    "variable in a move": Change(TWO_TOOLS, CUT_AT_56, "G1 X56. W#7 F0.25"),
    "negative feed beside a speed": Change(TWO_TOOLS, SPEED, "G97 S800 M3 F-1"),
    "B beside a speed": Change(TWO_TOOLS, SPEED, "G97 S800 B45. M3"),
    "macro beside the end": Change(TWO_TOOLS, "M30", "G65 P2 M30\nG1 X10. Z-30."),
    "K and a corner": Change(TWO_TOOLS, "Z-40.", "Z-40. K2. ,Q5"),
    "name beside a tool": Change(DREHEN, "T1 D1", "T1 D1 TRAORI"),
    "plane and a name": Change(DREHEN, "G90 G95", "G17 G90 G95 WALIMON"),
    "cycle beside a speed": Change(DREHEN, "S800 M4 F0.2", "S800 M4 F0.2 CYCLE951(80,0,60)"),
    "Q and C in a move": Change(DREHEN, "X56", "X56 Q=12 C=30"),
    "variable as a feed": Change(DREHEN, "G1 X56", "G1 X56 F=R77"),
    "position of a spindle": Change(DREHEN, "Z-40", "Z-40 SPOS[2]=90"),
    "B in a rapid move": Change(DREHEN, "G0 X62 Z2", "G0 X62 Z2 B30"),
    "zero offset, which does not move": Change(DREHEN, "T1 D1", "T1 D1\nG58 X0 Z45"),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_only_words_that_are_not_understood_are_left_out(name: str) -> None:
    change = LEFT_OUT[name]
    with pytest.raises(NcError, match=r"not understood.*\n  line \d"):
        moves(change.text)
    notes = run(divide(change.text), ReadingChoices(go_on=True)).notes
    assert any(note.partition(": ")[2].startswith("left out") for note in notes)
    done = effects(change.text, go_on=True)
    # Lines behind the end are not run, so they shift no others.
    if "M30" not in change.words:
        done = [effect._replace(line=effect.line - change.more_lines) for effect in done]
    assert done == effects(change.clean)


def test_coordinates_of_a_cycle_that_is_not_read_do_not_move_the_tool() -> None:
    text = f"{BAR}G87 X20. Z-30. Q5. F0.3\n{CUT.replace(' F0.25', '')}"
    made = run(divide(text), ReadingChoices(go_on=True)).moves
    assert [move.path.end for move in made if move.kind == "feed"] == [(2.0, 28.0), (-40.0, 28.0)]
    assert made[-2].feed.value == 0.3


def test_the_contour_of_a_cycle_that_is_left_out_is_not_cut() -> None:
    # The contour turns back.
    contour = "N1 G0 X30.\nG1 Z-20. F0.2\nX40. Z-10.\nN2 Z-30.\n"
    text = f"{BAR}G71 U2. R0.5\nG71 P1 Q2 U0.4 W0.\n{contour}G1 X58. Z-5. F0.1"
    ends = [effect.end for effect in effects(text, go_on=True)]
    assert ends == [(2.0, 31.0), (-5.0, 29.0)]


def test_every_word_of_a_line_that_is_not_understood_is_named_at_once() -> None:
    with pytest.raises(NcError) as refused:
        moves(f"{BAR}G1 X56. Y5. F0.25 G777 K2. TO303")
    assert str(refused.value).count("line ") == 1
    for word in ("Y", "G777", "K2.", "TO303"):
        assert word in str(refused.value)


# Axes that turning does not use.

TURNED = BAR + CUT
NULL = {
    "Y in a move": Change(TURNED, "G1 X56.", "G1 X56. Y0."),
    "V, C and B in a move": Change(TURNED, "Z-40.", "Z-40. V0 C0. B-0.0"),
    "A and Y before a function": Change(TURNED, "G97", "A0 Y0 G97"),
    "A with two coordinates": Change(TURNED, "Z-40.", "Z-40. X56. A0."),
    "reference point beside U": Change(f"{BAR}G28 U0\n{CUT}", "G28 U0", "G28 U0 V0 C0"),
    "reference point alone": Change(TURNED, "M3\n", "M3\nG28 V0\nG28 H0 C0.\n"),
    "box": Change(f"{BAR}G90 X56. Z-40. F0.2\nX52.", "X52.", "X52. Y0"),
    "axes of a SINUMERIK": Change(DREHEN, "X56", "X56 Y0 C=0 V0 B0.0 A0"),
    "reference point of a SINUMERIK": Change(DREHEN, "M4", "M4\nG74 Y0"),
}


@pytest.mark.parametrize("name", NULL)
def test_other_axes_at_0_have_no_effect(name: str) -> None:
    change = NULL[name]
    done = [(effect.kind, effect.end) for effect in effects(change.text)]
    assert done == [(effect.kind, effect.end) for effect in effects(change.clean)]
    with pytest.raises(NcError, match="not understood"):
        moves(change.clean.replace(change.word, f"{change.word} B30.", 1))


# Dwells.

DWELLS = [("G4 P500", 0.5), ("G4 X1.5", 1.5), ("U2. G4", 2.0), ("G4 P1.25", 1.25)]


@pytest.mark.parametrize(("dwell", "seconds"), DWELLS)
def test_words_beside_a_dwell_act(dwell: str, seconds: float) -> None:
    made = moves(f"G21 G99\nM3 S800 T0303 {dwell} F0.3\nG0 X62. Z2.\nG1 X56.\nZ-9.").moves
    assert [move.time for move in made if move.kind == "dwell"] == [pytest.approx(seconds)]
    assert made[0].kind == "dwell"
    last = Effect.of(made[-1])
    assert last.tool == "T0303"
    assert last.speed == 800.0
    assert last.feed == 0.3
    assert last.spindle_on


@pytest.mark.parametrize(("dwell", "seconds"), DWELLS)
def test_the_end_beside_a_dwell_acts(dwell: str, seconds: float) -> None:
    last = effects(f"{BAR}G1 X56. F0.2\n{dwell} M30\nZ-5.")[-1]
    assert last.kind == "dwell"
    assert last.time == pytest.approx(seconds)


def test_a_dwell_of_linuxcnc_is_in_seconds_and_stands_before_a_move() -> None:
    done = effects("G7 G21 G95 G97\nM3 S800 G4 P1 F0.2\nG0 X62. Z2. G4 P0.5\nG1 Z-5.")
    assert [effect.kind for effect in done] == ["dwell", "dwell", "rapid", "feed"]
    assert [effect.time for effect in done] == [1.0, 0.5, 0.0, 0.0]
    assert done[-1].speed == 800.0


def test_a_dwell_and_a_modal_move_share_no_block() -> None:
    with pytest.raises(NcError, match="beside G4"):
        moves(f"{BAR}G1 X56. F0.2\nG4 P500 Z-40.")


@pytest.mark.parametrize(
    ("block", "seconds", "speed", "feed"),
    [
        pytest.param("S800 M3 G4 F2", 2.0, 800.0, 0.2, id="seconds, after a speed"),
        pytest.param("G4 F2 S800 M3", 2.0, 800.0, 0.2, id="seconds, before a speed"),
        pytest.param("M3 S800 G4 S40", 3.0, 800.0, 0.2, id="40 revolutions"),
        pytest.param("F0.3 G4 F1.5 S800 M3", 1.5, 800.0, 0.3, id="seconds, after a feed"),
    ],
)
def test_sinumerik_dwells_for_the_word_after_g4(
    block: str, seconds: float, speed: float, feed: float
) -> None:
    made = moves(f"DIAMON G71 G90 G95 G97 F0.2\n{block}\nG0 X62 Z2\nG1 Z-9").moves
    (dwell,) = [move for move in made if move.kind == "dwell"]
    assert dwell.time == pytest.approx(seconds)
    last = made[-1]
    assert last.speed.value == speed
    assert last.feed.value == feed


def test_a_zero_point_and_a_limit_of_the_spindle_may_share_a_block() -> None:
    made = moves("G50 X200. Z100. S1500\nG21 G99 G96 S150 M3\nG0 X62. Z2.\nG1 Z-5. F0.2").moves
    assert made[-1].max_spindle_speed == 1500.0
    assert made[0].path.start == (100.0, 100.0)


# Controls that are named.

OTHERS = {
    "Okuma": [
        "$FLANSCH.MIN%",
        "$AB-12.SUB%",
        "T030303",
        "T010112 M42",
        "N10 T000505",
        "G71 X38.2 Z-20 B60 D0.7 U0.1 H2.45 L2 F1.5 M32 M73",
        "G85 NLAP1 D6 F0.3",
        "NKONT G81",
        "G87 NAUS1",
        "CALL O123 Q2",
        "NOEX V1=3",
        "V12=50",
        "RTS",
    ],
    "LinuxCNC": [
        "O<bore> CALL [5]",
        "o100 endsub",
        "O100 WHILE [#1 LT 3]",
        "o<a b> sub",
        "O#5 repeat [3]",
        "o7 elseif [#1]",
    ],
    "SINUMERIK": [
        "%MPF1005",
        "%SPF 12",
        "N40 G2 X60 Z-25 B5",
        "G03X20Z-5B+2.5",
        "N5 @714",
        "N10 G58 X0 Z45\nN15 G92 S3000",
    ],
    "Heidenhain": ["0 BEGIN PGM WELLE MM"],
    "Mazatrol": ["PNO. 3"],
    "Fagor": [
        "%SHAFT,MX--,",
        "%SHAFT 12 ,MX--",
        "%L BORE",
        "#RET",
        "N20 (RPT N10,N20)",
        "(PCALL 5, P1=3)",
        "(IF P1 GT 3 GOTO N10)",
        "$IF P1 > 3",
    ],
    "Emco": ["G84 X50. Z-30. D3=1000", "N10 G86 X40 Z-12 D5=3 F0.1"],
    "ShopTurn": ['N5 E_HEAD(0,100,0,"A")', "E_STOCK_R(1)"],
}


CONTROLS_AND_LINES = [
    pytest.param(control, line, id=f"{control}: {line}")
    for control, lines in OTHERS.items()
    for line in lines
]


@pytest.mark.parametrize("end", ["\n", "\r"], ids=["LF", "CR"])
@pytest.mark.parametrize(("control", "line"), CONTROLS_AND_LINES)
def test_programs_of_other_controls_are_named_with_their_line(
    control: str, line: str, end: str
) -> None:
    text = f"(TITLE)\nG0 X60. Z2.\n{line}\nG1 Z-40. F0.2\n"
    with pytest.raises(NcError, match=f"line 3: .*{control}"):
        divide(text.replace("\n", end))


@pytest.mark.parametrize("text", ["N10 G58 X0 Z45\n", "N15 G92 S3000\nN20 G58 X0 Z45\n"])
def test_a_zero_offset_shows_an_old_sinumerik_only_before_a_limit_of_the_spindle(text: str) -> None:
    lines = divide(f"{text}G0 X60. Z2.\nG1 Z-40. F0.2\n").parts[""]
    assert lines[-1].number_of("Z") == -40.0


@pytest.mark.parametrize("sign", ["G53.5", "G123.1", "G276 X20. P3", "M998<BORE>"])
def test_programs_of_mazak_are_read_as_fanucs_with_a_note(sign: str) -> None:
    text = BAR + CUT.replace("M30", f"{sign}\nM30")
    made = run(divide(text), ReadingChoices(go_on=True))
    assert any("Mazak" in note for note in made.notes)
    assert [move.path.end for move in made.moves] == [
        move.path.end for move in moves(BAR + CUT).moves
    ]


@pytest.mark.parametrize(
    "line",
    [
        "T0303 M8",
        "T03",
        "T10203",
        "G2 X60. Z-25. R5. B0.",
        "G3 X60. Z-5. I0. K-2. B0",
        "G58",
        "N5 G71 U2. R1.",
        "(CALL THE SETTER)",
        "(IF THE BAR IS LONG GOTO THE NEXT)",
    ],
)
def test_words_of_fanuc_show_no_other_control(line: str) -> None:
    assert divide(f"G21\n{line}\n").dialect.name == "fanuc"


@pytest.mark.parametrize(
    "cycle", ["CYCLE62", "CYCLE951", "CYCLE952", "CYCLE930", "CYCLE940", "CYCLE99", "CYCLE92"]
)
def test_cycles_of_operate_that_are_not_read_are_named(cycle: str) -> None:
    text = DREHEN.replace("G1 X56", f"{cycle}(80,0,60,-50)\nG1 X56")
    with pytest.raises(NcError, match=rf"line 4: {cycle}.*Operate"):
        moves(text)
    assert cuts(DREHEN) == [(2.0, 56.0), (-40.0, 56.0)]


@pytest.mark.parametrize(("word", "hint"), [("R3.", ",R"), ("C2.", ",C")])
def test_corners_without_a_comma_have_a_hint(word: str, hint: str) -> None:
    with pytest.raises(NcError, match=f"line 4: .*write {hint} for a"):
        moves(f"{BAR}G1 X56. {word} F0.25\nZ-40.")


# G code systems of Fanuc.

IN_A = {
    "cylinder": "G90 X56. Z-40. F0.25\nX52.\n",
    "cone": "G90 X50. Z-40. R-2. F0.25\n",
    "thread": "G92 X56. Z-25. F2.\nX55.\n",
    "face": "G94 X0. Z1. F0.2\nZ0.\n",
    "roughing": "G71 U2. R1.\nG71 P10 Q20 U0.4 W0.1 F0.25\nN10 G0 X20.\nG1 Z-20.\nN20 X60.\n"
    "G70 P10 Q20\n",
    "facing": "G72 W2. R1.\nG72 P10 Q20 U0.4 W0.1 F0.25\nN10 G0 Z-20.\nG1 X40.\nN20 Z0.\n",
    "pattern": "G73 U4. W1. R3\nG73 P10 Q20 U0.4 W0.1 F0.25\nN10 G0 X50.\nG1 Z-20.\nN20 X60.\n",
    "threads": "G76 P010060 Q50 R0.1\nG76 X58. Z-34. P1000 Q400 F2.\n",
    "groove": "G0 Z-10.\nG75 R1.\nG75 X56. Z-14. P2000 Q4000 F0.1\n",
    "peck": "G0 X0.\nG74 R1.\nG74 Z-9. Q4000 F0.1\n",
    "pitch": "G32 Z-25. F2.\n",
}
TO_B = {
    "G90": "G77",
    "G92": "G78",
    "G94": "G79",
    "G32": "G33",
    "G98": "G94",
    "G99": "G95",
    "G50": "G92",
}
TO_C = {
    "G90": "G20",
    "G92": "G21",
    "G94": "G24",
    "G32": "G33",
    "G98": "G94",
    "G99": "G95",
    "G50": "G92",
    "G20": "G70",
    "G21": "G71",
}
TO_C |= {f"G{70 + k}": f"G{72 + k}" for k in range(7)}


def in_system(text: str, codes: dict[str, str]) -> str:
    """Return a program of system A with the G functions of another system."""
    return re.sub(r"G\d+", lambda found: codes.get(found[0], found[0]), text)


def in_a(name: str) -> str:
    """Return a program of system A."""
    head = "G21 G40 G99 T0101\nG50 S2000\nG96 S150 M3\nG0 X62. Z2. F0.2\n"
    return f"{head}{IN_A[name]}G1 X64.\nM30\n"


@pytest.mark.parametrize("name", IN_A)
@pytest.mark.parametrize(
    ("dialect", "codes"),
    [pytest.param("fanuc-b", TO_B, id="B"), pytest.param("fanuc-c", TO_C, id="C")],
)
def test_systems_b_and_c_make_the_cuts_of_system_a(
    name: str, dialect: str, codes: dict[str, str]
) -> None:
    text = in_system(in_a(name), codes)
    done = run(divide(text, DIALECTS[dialect])).moves
    expected = moves(in_a(name)).moves
    assert [move.kind for move in done] == [move.kind for move in expected]
    assert [move.path for move in done] == [move.path for move in expected]
    assert [move.feed.value for move in done] == [move.feed.value for move in expected]
    assert {move.max_spindle_speed for move in done} == {2000.0}


BOXES = ("cylinder", "cone", "thread", "face")
CONTOURS_AND_THREADS = ("roughing", "facing", "pattern", "threads", "groove")


@pytest.mark.parametrize("name", BOXES)
def test_system_b_is_told_from_its_boxes(name: str) -> None:
    assert divide(in_a(name)).dialect.name == "fanuc"
    assert divide(in_system(in_a(name), TO_B)).dialect.name == "fanuc-b"


@pytest.mark.parametrize("name", [*BOXES, *CONTOURS_AND_THREADS])
def test_system_c_is_told_from_its_units_and_cycles(name: str) -> None:
    assert divide(in_a(name)).dialect.name == "fanuc"
    assert divide(in_system(in_a(name), TO_C)).dialect.name == "fanuc-c"


def test_system_b_has_absolute_and_incremental_coordinates() -> None:
    text = (
        "G21 G90 G95\nG92 S2000\nG97 S800 M3\nG0 X62. Z2.\nG77 X56. Z-40. F0.25\nG0 X54.\n"
        "G91 G1 Z-12. G99\nG90 X60."
    )
    assert cuts(text)[-2:] == [(-10.0, 54.0), (-10.0, 60.0)]
    last = moves(text).moves[-1]
    assert last.per_revolution
    assert last.max_spindle_speed == 2000.0


# What only looks like something else.


@pytest.mark.parametrize("comment", ["(T1 D1 CR=0.8 - TAPER=0.)", "; LIMS=2000", "(NOSE R1=0.8)"])
def test_signs_of_a_control_do_not_count_in_comments(comment: str) -> None:
    assert moves(f"{comment}\n{BAR}{CUT}").program.dialect.name == "fanuc"


def test_calls_and_strings_of_a_sinumerik_are_no_comments() -> None:
    text = 'MSG("A; B (C)")\nG90 G95 G71 T1\nG97 S500 F0.2 M3\nG0 X20 Z0\nG1 Z-5\nM30'
    assert moves(text).program.dialect.name == "sinumerik"


@pytest.mark.parametrize(
    ("number", "nearest"), [("2.5", 3.0), ("3.5", 4.0), ("-2.5", -3.0), ("2.4", 2.0)]
)
def test_halves_are_rounded_away_from_zero(number: str, nearest: float) -> None:
    assert cuts(f"{BAR}#1=ROUND[{number}]\nG1 X50. Z#1 F0.2") == [(nearest, 50.0)]


@pytest.mark.parametrize(
    ("mode", "feed"), [("G98", "F500."), ("G99", "F1."), ("G98 G20", "F19.68504")]
)
def test_a_tap_is_fed_as_its_mode_says(mode: str, feed: str) -> None:
    depth = "Z-0.7874" if "G20" in mode else "Z-20."
    text = f"G21 T0303 {mode}\n" if "G20" not in mode else f"T0303 {mode}\n"
    (tap,) = [
        move
        for move in moves(f"{text}G97 S500 M3\nG0 X0. Z0.\nG84 {depth} {feed}\nG80").moves
        if move.kind == "thread"
    ]
    per_minute = tap.feed.value * (tap.speed.value if tap.per_revolution else 1.0)
    assert per_minute == pytest.approx(500.0, rel=1e-4)


def test_a_sinumerik_jumps_to_the_number_of_a_block() -> None:
    text = (
        "G90 G95 G71 DIAMON\nG97 S500 F0.2 M3\nG0 X60 Z0\nR1=50\nN100 G1 X=R1\nR1=R1-5\n"
        "IF R1>=40 GOTOB N100\nM30"
    )
    assert [diameter for _, diameter in cuts(text)] == [50.0, 45.0, 40.0]


@pytest.mark.parametrize("place", ["Z-35.", "X10.", "W-5."])
def test_a_drilling_cycle_that_holds_is_no_rapid_move(place: str) -> None:
    drill = f"{BAR}G0 X0.\nG83 Z-25. Q5000 F0.1\n"
    with pytest.raises(NcError, match="line 6: the drilling cycle before it holds"):
        moves(f"{drill}{place}\nG80")
    assert moves(f"{drill}G80\nG0 X100.").moves[-1].path.end.x == 50.0


@pytest.mark.parametrize("block", ["G1 X50. X40. F0.2", "G1 Z-5. F0.2 F0.1", "T0101 T0202"])
def test_a_word_that_stands_twice_is_named(block: str) -> None:
    with pytest.raises(NcError, match=r"line 4: .* is the second"):
        moves(f"{BAR}{block}\n{CUT}")


@pytest.mark.parametrize(
    ("text", "note"),
    [
        pytest.param(f"{BAR}{CUT}O5\n{BAR}{CUT}", "O5 begins here, but is not called", id="part"),
        pytest.param(f"{BAR}G1 X56. F0.2; Z-9.\n{CUT}", "looks like a block", id="semicolon"),
        pytest.param(
            f"G54\n{BAR}G1 X56. F0.2\nG55\nG0 Z5.\n", "G55 after G54: zero offsets", id="offset"
        ),
        pytest.param(
            f"{BAR}G71 U2. R1.\nG71 P1 Q2 U0.4 W0.1 F0.2\nG0 X90.\nN1 G0 X30.\nG1 Z-20.\nN2 X60.",
            "the blocks between G71 and its contour are not run",
            id="contour",
        ),
    ],
)
def test_what_is_not_run_is_noted(text: str, note: str) -> None:
    assert any(note in said for said in moves(text).notes)


def test_a_word_that_keeps_a_loop_from_its_end_is_named() -> None:
    loop = f"{BAR}#1=3\nN5 G1 U-1. F0.2\n#1=#1-1 E1\nIF [#1 GT 0] GOTO 5\nG1 Y5.\n"
    with pytest.raises(NcError, match=r"(?s)line 6: .*line 8: the address Y"):
        moves(loop)


def test_one_offset_and_comments_behind_blocks_need_no_note() -> None:
    made = moves(f"G55\n{BAR}G1 X56. F0.2 ; FINISH X\n; G1 Z-90.\n{CUT}")
    assert not any("offset" in note or "block" in note for note in made.notes)


def test_a_thread_of_several_starts_states_their_angle() -> None:
    (thread,) = [
        move for move in moves(f"{BAR}G92 X58. Z-25. F3. Q180000").moves if move.kind == "thread"
    ]
    assert thread.feed.value == 3.0


def test_machine_axes_go_to_their_reference_points() -> None:
    text = "G90 G95 G71 DIAMON\nG97 S500 F0.2 M3\nG0 X60 Z0\nG1 X50\nG75 X1=0 Z1=0\nM30"
    assert moves(text).moves[-1].kind == "rapid"
    with pytest.raises(NcError, match="X1= is not understood"):
        moves(text.replace("G75", "G1"))


@pytest.mark.parametrize("line", ["N5", "N5 (FIRST OP)"])
def test_numbers_before_the_begin_of_a_program_are_no_program(line: str) -> None:
    assert cuts(f"%\n{line}\nO0001\n{BAR}{CUT}%\n") == [(2.0, 56.0), (-40.0, 56.0)]


@pytest.mark.parametrize(
    ("text", "modes"),
    [
        (f"{BAR}G90 G91 G1 X56. F0.2", "G90 and G91"),
        (f"{BAR}G98 G99\n{CUT}", "G98 and G99"),
        (f"{BAR}G96 G97 S100\n{CUT}", "G96 and G97"),
        (f"{BAR}G20 G21\n{CUT}", "G20 and G21"),
        (f"{BAR}G41 G40 {CUT}", "G40 and G41"),
        (DREHEN.replace("G71", "G70 G71"), "G70 and G71"),
    ],
)
def test_modes_that_contradict_each_other_are_named(text: str, modes: str) -> None:
    with pytest.raises(NcError, match=f"{modes} exclude each other"):
        moves(text)


def test_coordinates_beside_the_modes_of_linuxcnc_are_moves() -> None:
    head = "G7 G21 G95 G97\nM3 S800 F0.2\nG0 X62 Z2\nG1 X56\n"
    assert cuts(f"{head}G91 Z-5\nG94 Z-5 F160\nG90 X60")[1:] == [
        (-3.0, 56.0),
        (-8.0, 56.0),
        (-8.0, 60.0),
    ]


def test_increments_beside_coordinates_are_no_box() -> None:
    text = f"G95\n{BAR.replace(' G99', '')}G1 X56. F0.2\nG91 Z-5.\nG90\nG1 X60.\n"
    assert cuts(text) == [(2.0, 56.0), (-3.0, 56.0), (-3.0, 60.0)]


CONTOUR = "N1 G0 X40.\nG1 Z-30.\nN2 X62.\n"
ROUGH = f"{BAR}G71 U2. R1.\nG71 P1 Q2 U0.4 W0.1 F0.2{{word}}\n{CONTOUR}"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (ROUGH.format(word=" P9"), "P9 is the second P"),
        (ROUGH.format(word=" G72"), "G71 and G72 exclude each other"),
        (ROUGH.format(word=" ,C1."), r",C1\. has no meaning"),
        (ROUGH.format(word="").replace("R1.\n", "R1. A10.\n", 1), r"A10\. has no meaning"),
        (f"{BAR}G1 X56. U1. F0.2", "X and U of one axis exclude each other"),
        (f"{BAR}G1 X56. F0.2\nG2 X60. Z0. R2. ,A10.", r",A10\. has no meaning"),
        (f"{BAR}G90 G92 X56. Z-9. F0.2", "G90 and G92 exclude each other"),
        (f"{BAR}G76 P010060 Q50 R0.05\nG76 X58. Z-9. P1000 Q300 I2. F1.5", r"I2\. has no meaning"),
        (f"{DREHEN}\nCYCLE97(1.5,,0,-20,50,50) X50".replace("\nM30", ""), "X50 beside CYCLE97"),
        (DREHEN.replace("Z-40", "Z-40\nG2 X60 Z-42 CR=2 I2"), "CR= and a centre"),
    ],
)
def test_words_that_act_on_nothing_are_named(text: str, reason: str) -> None:
    with pytest.raises(NcError, match=reason):
        moves(text)


def test_a_rapid_move_holds_behind_a_reference_point() -> None:
    made = moves(f"{BAR}G1 X56. F0.2\nG0 G28 U0 W0\nX62. Z2.\nG1 Z-5.").moves
    assert [move.kind for move in made[-2:]] == ["rapid", "feed"]


def test_m17_ends_a_part_of_a_sinumerik_alone() -> None:
    made = run(divide(f"{BAR}G1 X56. F0.2\nM17\nZ-40.", DIALECTS["fanuc"]))
    assert made.moves[-1].path.end == (-40.0, 28.0)
    assert any("M17 is not understood" in note for note in made.notes)
    assert cuts(DREHEN.replace("Z-40", "M17\nZ-40")) == [(2.0, 56.0)]
