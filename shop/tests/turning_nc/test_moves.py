"""Users' programs: the moves that they stand for, and what is named with its line because it is not understood."""

import contextlib
import math
import random
from pathlib import Path

import pytest

pytest.importorskip("shapely")

import shapely
from turning_nc.dialects import FANUC, SINUMERIK
from turning_nc.moves import Moves, Reading, run
from turning_nc.removal import remove
from turning_nc.stock import read_stock
from turning_nc.words import NcError, divide

from shop.examples.adapt_programs import COLLECTION, path_of
from shop.tests.turning_nc.linuxcnc import INSTALLED, canonical
from tests.programs import NO_LINUXCNC

ISO = """%
O0001 (TEST)
N10 G21 G99 T0101
N20 G50 S2000
N30 G96 S150 M3
N40 G0 X52. Z2.
N50 G1 Z-20. F0.25
N60 G2 X56. Z-22. R2.
N70 G0 X60. Z2.
N80 M98 P7
N90 M30
O0007
N100 G1 X58. Z1.
M99
%
"""
SIEMENS = """%_N_TEST_MPF
N10 G90 G95 G71 DIAMON T1 D1
N20 G96 S150 LIMS=2000 F0.3 M4
N30 G0 X60 Z2
N40 CYCLE95("KONTUR",2,0.1,0.2,,0.3,,0.15,9)
N50 L5
N60 M30
%_N_KONTUR_SPF
N70 G1 X30 Z0
N80 Z-20
N90 X50 Z-30
N100 M17
%_N_L5_SPF
N110 G1 X62 Z1
N120 RET
"""


def moves(text: str) -> Moves:
    return run(divide(text))


def test_both_dialects_are_told_from_the_text() -> None:
    assert divide(ISO).dialect == FANUC
    assert divide(SIEMENS).dialect == SINUMERIK
    assert list(divide(SIEMENS).parts) == ["TEST", "KONTUR", "L5"]
    assert divide(ISO, SINUMERIK).dialect == SINUMERIK


@pytest.mark.parametrize(
    ("text", "notes"),
    [
        (ISO, ("line 3: X is taken as a diameter, as usual (assumption); --radius sets a radius",)),
        (SIEMENS, ()),
    ],
)
def test_programs_and_their_sub_programs_are_run_with_any_ends_of_lines(
    text: str, notes: tuple[str, ...]
) -> None:
    made = moves(text)
    assert made.notes == notes
    assert made.moves[-1].path.end[0] == 1.0
    assert [move.path for move in moves(text.replace("\n", "\r\n")).moves] == [
        move.path for move in made.moves
    ]


@pytest.mark.parametrize(
    ("text", "old", "new", "line", "named"),
    [
        (ISO, "G2 X56. Z-22. R2.", "G2 X56. Z-22.", 8, "centre or a radius"),
        (ISO, "R2.", "R0.5", 8, "radius 0.5"),
        (ISO, " F0.25", "", 7, "no feed"),
        (ISO, "S150 ", "", 7, "no speed"),
        (ISO, "F0.25", "F-0.25", 7, "negative"),
        (ISO, "G1 Z-20.", "G1 G2 Z-20.", 7, "exclude"),
        (ISO, "G1 Z-20.", "G76 Z-20.", 7, "two blocks"),
        (ISO, "G1 Z-20.", "G87 Z-20.", 7, "G87"),
        (ISO, "G1 Z-20.", "G1 Z-20. R2.", 7, "write ,R"),
        (ISO, "G1 Z-20.", "G1 Z-20. K2.", 7, "K2. has no meaning"),
        (ISO, "G1 Z-20.", "G94\nG90 Z-20.", 8, "cycle on some controls"),
        (ISO, "G1 Z-20.", "G1 Z-20. C45.", 7, "address C"),
        (ISO, "G1 Z-20.", "G1 Z#101", 7, "#101 has no value"),
        (ISO, "G1 Z-20.", "G1 Z[1./0.]", 7, "zero"),
        (ISO, "G1 Z-20.", "IF [#1 EQ 2] GOTO 5", 7, "no word"),
        (ISO, "N80 M98 P7", "N80 G50 X100. Z50.", 10, "G50"),
        (ISO, "M98 P7", "M98 P8", 10, "sub-program 8"),
        (ISO, "M98 P7", "G71 P100 Q200", 10, "N100 to N200"),
        (ISO, "M98 P7", "G71 U2. R1.\nG71 P90 Q100", 11, "contour"),
        (ISO, "M98 P7", "G73 P300 Q301\nN300 G1 X58.\nN301 Z0.", 10, "how often"),
        (ISO, "M98 P7", "G32 Z-5.", 10, "lead"),
        (SIEMENS, '"KONTUR"', '"CONTOUR"', 5, "'CONTOUR' is not in this file"),
        (SIEMENS, '"KONTUR",2,', '"KONTUR",0,', 5, "above 0"),
        (SIEMENS, "0.15,9)", "0.15,13)", 5, "1 to 12"),
        (SIEMENS, "N80 Z-20", "N80 X20 Z2", 10, "turns back"),
        (SIEMENS, "N50 L5", "N50 L6", 6, "L6"),
        (SIEMENS, "N50 L5", "N50 G1 X=R1", 6, "R1 has no value"),
        (SIEMENS, "N50 L5", "N50 IF R1==2 GOTOF END", 6, "IF"),
        (SIEMENS, "N50 L5", "N50 CYCLE97(,20,0,-30)", 6, "pitch"),
        (SIEMENS, "N50 L5", "N50 TRANS Z-10", 6, "TRANS"),
        (SIEMENS, "N50 L5", "N50 G1 X20 RND=2", 6, "must follow"),
        (SIEMENS, "N80 Z-20", "N80 Z-20 CHF=60", 11, "of line 10"),
        (SIEMENS, "N50 L5", "N50 ID=1 DO $AC_OVR=$AC_SECRET", 6, "cannot be read"),
    ],
)
def test_what_is_not_understood_is_named_with_its_line(
    text: str, old: str, new: str, line: int, named: str
) -> None:
    assert old in text
    with pytest.raises(NcError) as refused:
        moves(text.replace(old, new, 1))
    assert f"line {line}: " in str(refused.value)
    assert named in str(refused.value)


def test_all_lines_that_are_not_understood_are_named_at_once_or_left_out() -> None:
    text = ISO.replace("N80 M98 P7", "N80 G76 X5.\nN81 G65 P2\nN82 M77")
    with pytest.raises(NcError, match=r"(?s)^(?!.*no feed).*line 7: .*line 10: .*line 11: "):
        moves(text.replace("N50 G1", "N50 G65 G1"))  # it also sets the feed
    made = run(divide(text), Reading(go_on=True))
    assert [note.split(":")[0] for note in made.notes] == [
        "line 3",
        "line 10",
        "line 11",
        "line 12",
    ]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "no blocks"),
        ("(ONLY A COMMENT)", "no blocks"),
        ("G0 X10. Z5.", "no feed move"),
        ("O1\nG0 X1.\nO2\nM99\nO2\nM99", "line 5"),
        ("O1\nM98 P2\nM30\nO2\nM98 P2\nM99", "more than 8 deep"),
        ("O1\nM98 P2 L9999\nM30\nO2\nM98 P3 L9999\nM99\nO3\nM99", "moves or blocks are run"),
        (SIEMENS.replace("N80 Z-20", 'N80 CYCLE95("KONTUR",2)'), "more than 8 deep"),
        ("\n" * 200_001, "lines"),
    ],
)
def test_programs_that_are_none_are_refused(text: str, named: str) -> None:
    with pytest.raises(NcError, match=named):
        moves(text)


def test_damaged_programs_are_read_or_refused() -> None:
    rng = random.Random(7)
    words = 'G71|P100|M98 P7|Z-1e5|S0|R1e9|I0 K0|G2|(|;|-|0|CYCLE95(|"|U-5.|AC(|PROC A|R1=|#1=|X=R1|Z#1|,R2.|RND=1|ID=1 DO|$A='
    pieces = [*words.split("|"), "CYCLE97(2,", "G76 P1", "G73 P1 Q2", "U0 W0 R3", "ß"]
    for _ in range(150):
        text = path_of(rng.choice(list(COLLECTION))).read_text()
        for _ in range(rng.randint(1, 5)):
            place = rng.randrange(len(text))
            text = text[:place] + rng.choice(pieces) + text[place + rng.randrange(6) :]
        with contextlib.suppress(NcError):
            run(divide(text), Reading(go_on=rng.random() < 0.5))


def test_the_same_word_means_what_its_dialect_says() -> None:
    for units, feed in (
        ("G21 G99\nG20", 0.254),
        ("DIAMON G70 G95", 0.01),
        ("DIAMON G700 G95", 0.254),
    ):  # G70: lengths alone
        last = moves(f"{units}\nG97 S500 M3\nG0 X2. Z0.\nG1 Z-1. F0.01").moves[-1]
        assert (last.path.end, last.feed.value) == ((-25.4, 25.4), pytest.approx(feed))


def test_assumptions_are_named_and_cancelled_offsets_change_no_tool() -> None:
    assert "nose radius" in moves(ISO.replace("G1 Z-20.", "G42 G1 Z-20.")).notes[1]
    with pytest.raises(NcError, match="--dialect sinumerik"):
        moves("G90 G71\nG0 X50. Z2.")
    made = moves(ISO.replace("N90 M30", "N81 G0 X100. T0100\nN82 T0200\nG0 X101.\nN90 M30"))
    assert [move.tool for move in made.moves[-2:]] == ["T0101", "T0200"]


# Cycles, chamfers, radii and variables.

TURN = "G21 G99 T0101\nG96 S150 M3\nG0 X20. Z2.\nG1 Z0. F0.2\n"
DREH = "G90 G95 G71 DIAMON T1 D1\nG96 S150 M4\nG0 X20 Z2\nG1 Z0 F0.2\n"
START = "G7 G90 G18 G21 G95\nT101 M6\n"
SET_UP = "G96 D2500 S150 M3\nF0.28 G0 X102. Z2.\n"
CORNER, BROKEN = (-20.0, 10.0), [(-18.0, 10.0), (-20.0, 12.0), (-20.0, 30.0)]
ROUNDED = [(-19.0, 10.0), (-20.0, 11.0), (-20.0, 29.0), (-21.0, 30.0), (-30.0, 30.0)]


@pytest.mark.parametrize(
    ("text", "ends", "radius"),
    [
        (f"{TURN}Z-20. ,C2.\nX60.", BROKEN, 0.0),
        (f"{TURN}Z-20. ,R2.\nX60.", BROKEN, 2.0),
        (f"{DREH}Z-20 CHR=2\nX60", BROKEN, 0.0),
        (f"{DREH}Z-20 CHF={math.sqrt(8.0):.9f}\nX60", BROKEN, 0.0),
        (f"{DREH}Z-20 RND=2\nX60", BROKEN, 2.0),
        (
            f"{DREH}RNDM=1\nZ-20\nX60\nRNDM=0\nZ-30",
            ROUNDED,
            1.0,
        ),  # the second corner stands before RNDM=0
    ],
)
def test_corners_are_broken(text: str, ends: list[tuple[float, float]], radius: float) -> None:
    made = moves(text).moves[2:]
    assert [move.path.end for move in made] == [pytest.approx(end) for end in ends]
    arcs = [move.path for move in made if move.path.centre is not None]
    assert bool(arcs) == (radius > 0.0)
    for arc in arcs:
        assert arc.length == pytest.approx(0.5 * math.pi * radius)  # the shorter way round


def test_a_chamfer_of_an_obtuse_corner_is_as_long_as_written() -> None:
    made = moves(f"{DREH}Z-20 CHF=3\nX40 Z-40").moves
    assert made[-2].path.length == pytest.approx(3.0)
    first, last = made[-3].path, made[-1].path
    assert math.dist(first.end, CORNER) == pytest.approx(math.dist(last.start, CORNER))


HASH = "G21 G99 T0101\nG97 S500 M3\n#100=-20.\n#2=[#100*2.+4.]\nG0 X#100 Z2.\nG1 X[10.-#2] Z#2 F[1./5.]"
COMPUTED = "G90 G95 G71 DIAMON\nG97 S500 M4\nR1=5\nR2=-R1*2 R3=R1/20\nR2=R2-1\nG0 X60 Z0\nG1 X=R1+20 Z=IC(R2) F=R3"
SET_BELOW = "G90 G95 G71 DIAMON\nG97 S500 M4\nL5 P3\nG1 X20 Z=R9 F0.1\nM30\n%_N_L5_SPF\nR9=-7\nRET"


@pytest.mark.parametrize(
    ("text", "end", "feed"),
    [(HASH, (-36.0, 23.0), 0.2), (COMPUTED, (-11.0, 12.5), 0.25), (SET_BELOW, (-7.0, 10.0), 0.1)],
)
def test_variables_are_computed(text: str, end: tuple[float, float], feed: float) -> None:
    last = moves(text).moves[-1]
    assert (last.path.end, last.feed.value) == (pytest.approx(end), pytest.approx(feed))
    assert (last.feed.span is None) == (text != SET_BELOW)  # only a plain number can be changed


POCKETS = (
    "G1 Z-10.\nX44. Z-20.\nZ-30.\nX70. Z-40.\nZ-45.\nX60. Z-55.\nG2 X80. Z-65. R10.\nG1 Z-80.\n"
)
STEPS = "G1 Z-30.\nG2 X60. Z-35. R5.\nG1 Z-60.\nX80. Z-80.\n"


@pytest.mark.skipif(not INSTALLED, reason=NO_LINUXCNC)
@pytest.mark.parametrize("contour", [STEPS, POCKETS])
def test_passes_of_g71_are_those_of_linuxcnc(contour: str, tmp_path: Path) -> None:
    theirs = canonical(
        f"{START}O100 sub\nG0 X50.\n{contour}X102.\nO100 endsub\n{SET_UP}G71 Q100 I2.5 R0.5 D0\nM30\n",
        tmp_path,
    )
    ours = moves(f"G99\n{SET_UP}G71 U2.5 R0.5\nG71 P1 Q2\nN1 G0 X50.\n{contour}N2 X102.\nM30")
    ends = [move.end for move in theirs if move.kind == "feed"]
    cuts = [
        move.path
        for move in ours.moves
        if move.kind == "feed" and move.cycle_pass and move.path.length > 3.0
    ]
    assert len(cuts) > 10
    assert all(
        min(math.dist(cut.end, end) for end in ends) < 0.02 for cut in cuts
    )  # arcs are chords here
    first_ends = [end for end in ends if end != (-80.0, 51.0)]  # theirs begins with a pass in air
    assert all(
        min(math.dist(move.path.end, end) for move in ours.moves) < 0.02 for end in first_ends
    )


@pytest.mark.parametrize(
    "text",
    [
        f"G99\n{SET_UP}G71 U2.5 R0.5\nG71 P1 Q2 U0.4 W0.1\nN1 G0 X50.\n{POCKETS}N2 X102.\nG70 P1 Q2\nM30",
        f"G99\n{SET_UP}G73 U25. W0. R11\nG73 P1 Q2 U0.4 W0.1\nN1 G0 X50.\n{POCKETS}N2 X102.\nG70 P1 Q2\nM30",
        f"G99\n{SET_UP}G73 P1 Q2 I25. K0. D11 U0.4 W0.1\nN1 G0 X50.\n{POCKETS}N2 X102.\nG70 P1 Q2\nM30",
        'G90 G95 G71 DIAMON T1 D1\nG96 S150 LIMS=2500 F0.3 M4\nG0 X104 Z5\nCYCLE95("C",2.5,0.1,0.2,,0.3,,0.15,9,,,1)\nM30\n'
        f"%_N_C_SPF\nG1 X50 Z0\n{POCKETS.replace('R10.', 'CR=10')}X100\nM17",
    ],
)
def test_pockets_are_cut_to_the_contour(text: str) -> None:
    made = moves(text)
    removal = remove(made, read_stock("bar:100x120"), {made.moves[-1].tool: "copying"})
    for z, radius in {-5.0: 25.0, -25.0: 22.0, -42.0: 35.0, -54.9: 30.05, -75.0: 40.0}.items():
        height = removal.part.intersection(shapely.box(z - 0.01, 0.0, z + 0.01, 100.0)).bounds[3]
        assert height == pytest.approx(radius, abs=0.05)
    rough = [k for k, move in enumerate(made.moves) if move.cycle_pass and move.kind == "feed"]
    cutting = removal.slices.depth[[slice_ in rough for slice_ in removal.slices.move]]
    assert cutting.max() < 4.5  # no pass takes more than its depth and a corner beside it
    assert removal.rapids == {}


@pytest.mark.skipif(not INSTALLED, reason=NO_LINUXCNC)
def test_passes_of_g76_are_those_of_linuxcnc(tmp_path: Path) -> None:
    start = "G8 G90 G18 G21 G95\nT101 M6\nG97 S600 M3\nG0 X16. Z6.\n"
    theirs = canonical(f"{start}G76 P1.5 Z-34. I-1. J0.3 R2 K0.92 Q0 H2 L0 E0\nM30\n", tmp_path)
    ours = moves(
        f"{TURN}G97 S600\nG0 X32. Z6.\nG76 P020000 Q20 R0.\nG76 X28.16 Z-34. P920 Q300 F1.5\nM30"
    )
    threads = [move for move in ours.moves if move.kind == "thread"]
    expected = [move for move in theirs if move.kind == "feed"]
    assert [move.path.end for move in threads] == [
        pytest.approx(move.end, abs=1e-3) for move in expected
    ]
    assert {(move.feed.value, move.speed.value) for move in threads} == {
        (move.feed, move.speed) for move in expected
    }


def test_threads_leave_their_allowance_and_taper_and_their_lead_is_never_adapted() -> None:
    first = f"{TURN}G97 S600\nG0 X32. Z6.\nG76 P010060 Q50 R0.1\n"
    made = moves(f"{first}G76 X28. Z-34. R-2. P1000 Q400 F2.\nG1 X50.\nM30")
    cuts = [move.path for move in made.moves if move.kind == "thread"]
    assert [round(path.end[1], 3) for path in cuts] == [
        14.6,
        14.434,
        14.307,
        14.2,
        14.106,
        14.1,
        14.0,
    ]
    assert all(path.end[1] - path.start[1] == pytest.approx(2.0) for path in cuts)
    assert cuts[-1].start[0] == pytest.approx(6.0 - math.tan(math.radians(30.0)))
    last = moves(f"{first}G76 X28. Z-34. P1000 Q400 F2.\nG32 Z-40. F1.5\nG1 X50. Z-45.\nM30").moves[
        -1
    ]
    assert (last.feed.value, last.feed.span) == (1.5, None)  # as on the control, F stays in force


@pytest.mark.parametrize(
    ("variant", "roots"), [(1, (14.55, 14.1, 14.0, 14.0)), (3, (14.364, 14.1, 14.0, 14.0))]
)
def test_cycle97_cuts_its_passes(variant: int, roots: tuple[float, ...]) -> None:
    made = moves(f"{DREH}CYCLE97(1.5,,0,-32,30,30,6,2,1,0.1,30,0,2,1,{variant},1)\nG1 X50\nM30")
    cuts = [move for move in made.moves if move.kind == "thread"]
    assert [move.path.end for move in cuts] == [
        pytest.approx((-34.0, root), abs=1e-3) for root in roots
    ]
    assert {move.feed.value for move in cuts} == {1.5}
    assert made.moves[-1].feed.value == 0.2


# What real programs hold.

BAR = "G21 G99 T0101\nG97 S800 M3\nG0 X62. Z2.\n"
LOOP = "#1=56.\nWHILE [#1 GE 48.] DO1\nG0 X#1\nG1 Z-40. F0.2\nG0 X62.\nZ2.\n#1=#1-4.\nEND1"
JUMP = "#1=3\nN5 #2=#1*10.\nG0 X[#2+20.]\nG1 Z-#1 F0.2\nIF [#1 LE 1] THEN #3=7\n#1=#1-1\nIF [#1 GT 0] GOTO 5\nGOTO 9\nG1 X0.\nN9 M30"
AGAIN = "R1=2\nANF: G1 Z=-R1\nR1=R1-1\nIF R1>0 GOTOB ANF\nWHILE R1<2\nG1 X=20-R1\nR1=R1+1\nENDWHILE\nM30"
AT_20 = "DIAMON G90 G95 G97 S500 F0.2\nG0 X20 Z0\n"
CUTS: dict[str, list[tuple[float, float]]] = {
    f"{BAR}G90 X56. Z-40. F0.25\nX52.\nG0 X70.": [
        (-40.0, 28.0),
        (-40.0, 31.0),
        (-40.0, 26.0),
        (-40.0, 31.0),
    ],
    f"{BAR}G90 X50. Z-40. R-2. F0.25": [(-40.0, 25.0), (-40.0, 31.0)],
    f"{BAR}G94 X0. Z1. F0.2\nZ0.": [(1.0, 0.0), (2.0, 0.0), (0.0, 0.0), (2.0, 0.0)],
    f"{BAR}G92 X56. Z-25. F2.\nX55.": [(-25.0, 28.0), (-25.0, 27.5)],
    f"{BAR}G76 X58. Z-30. K1. D0.5 F1.5": [
        (-30.0, 29.5),
        (-30.0, 29.5 - 0.5 * (2**0.5 - 1)),
        (-30.0, 29.134),
        (-30.0, 29.0),
    ],
    f"{BAR}G0 Z-10.\nG75 R1.\nG75 X56. Z-14. P2000 Q4000 F0.1": [
        (-10.0, 29.0),
        (-10.0, 28.0),
        (-14.0, 29.0),
        (-14.0, 28.0),
    ],
    f"{BAR}G0 X0.\nG74 Z-5. Q9000 F0.1\nG83 Z-8. Q2. F0.1": [(-5.0, 0.0), (-8.0, 0.0)],
    f"{BAR}{LOOP}": [(-40.0, 28.0), (-40.0, 26.0), (-40.0, 24.0)],
    f"{BAR}{JUMP}": [(-3.0, 25.0), (-2.0, 20.0), (-1.0, 15.0)],
    f"DIAMON G71 G95 G97 S500 F0.2 M3\nG0 X20 Z0\n{AGAIN}": [
        (-2.0, 10.0),
        (-1.0, 10.0),
        (-1.0, 9.5),
    ],
    f"{BAR}G1 X56. F0.25\n/2 Z-10.\n/Z-12.": [(2.0, 28.0), (-10.0, 28.0), (-12.0, 28.0)],
    "\ufeff%\nG21 G91 G28 X0. Z0.\nG90\nG99 G97 S500 M3\nG0 X62. Z2.\nG1 Z-5. F0.2 (A (NESTED) COMMENT\nM30%": [
        (-5.0, 31.0)
    ],
    "G50 X200. Z100.\nG21 G99 G97 S500 M3\nG1 U-80. F0.2": [(100.0, 60.0)],
    "TRANS Z100\nDIAMON G71 G95 G97 S500 M3\nG0 X30 Z5\nG33 Z-25 K1.5 SF=0": [(-25.0, 15.0)],
    f"{BAR}G1 X60. Z0. F0.2\nX50. ,A135.\nG2 X52. Z-10. R9.\nZ-12.": [
        (0.0, 30.0),
        (5.0, 25.0),
        (-10.0, 26.0),
        (-12.0, 26.0),
    ],
    f"{AT_20}G1 X=IC(2) Z=IC(-3)": [(-3.0, 11.0)],
    f"{AT_20}G91 G1 X2 Z-3": [(-3.0, 11.0)],
    f"{AT_20}DIAM90 G91 G1 X2 Z-3": [(-3.0, 12.0)],
    f"{AT_20}DIAMOF G1 X15 Z-3": [(-3.0, 15.0)],
    f"{AT_20}G91 G1 X=AC(30) Z-3": [(-3.0, 15.0)],
}


@pytest.mark.parametrize("text", CUTS)
def test_everyday_words_make_the_cuts_of_a_control(text: str) -> None:
    made = [move.path for move in moves(text).moves if move.kind in ("feed", "thread")]
    assert [path.end for path in made if path.end != path.start] == [
        pytest.approx(end, abs=1e-3) for end in CUTS[text]
    ]


PROFILE = "N10 G0 X{first}\nG1 Z-20.\nX{last}\n{more}N20 {leave}\nG0 X100."


def roughing(start: str = "62.", cycle: str = "U0.4 W0.1", **changed: str) -> str:
    words = {"first": "20.", "last": "60.", "more": "", "leave": "G0 G40 Z2."} | changed
    return f"{BAR}G0 X{start}\nG71 U2. R1.\nG71 P10 Q20 {cycle} F0.25\n{PROFILE.format(**words)}"


@pytest.mark.parametrize(
    ("text", "side"),
    [
        (roughing(), "outside"),
        (roughing(more="Z-40.\n", leave="G1 X62."), "outside"),
        (roughing(more="Z-40.\nX62.\n", leave="G1 G40 X66. Z2."), "outside"),  # departs at feed
        (roughing(first="50.", last="20."), "outside"),  # whatever the ends of the contour
        (roughing("18.", "U-0.4 W0.1", first="50.", last="20."), "inside"),
        (roughing("18.", "W0.1", first="50.", last="20."), "inside"),
        (roughing("-62.", "U-0.4", first="-20.", last="-60."), "outside"),  # beyond the axis
        (SIEMENS.replace(",9)", ",1)"), "outside"),
        (SIEMENS.replace(",9)", ",3)"), "inside"),
    ],
)
def test_the_side_is_that_of_the_control(text: str, side: str) -> None:
    made = moves(text)
    assert [each.name for each in made.sides.values()] == [side]
    levels = [
        abs(move.path.end[1]) for move in made.moves if move.cycle_pass == 1 and move.kind == "feed"
    ]
    assert (levels[0] > 20.0) == (side == "outside")


def test_a_given_side_wins_and_a_contradiction_names_it() -> None:
    wrong = roughing("18.", "U0.4 W0.1", first="50.", last="20.")
    with pytest.raises(NcError, match=r"line 6: .*--side 6=outside"):
        moves(wrong)
    assert [
        side.name for side in run(divide(wrong), Reading(sides={6: "inside"})).sides.values()
    ] == ["inside"]
    with pytest.raises(NcError, match="line 5"):
        run(divide(wrong), Reading(sides={5: "inside"}))


def test_a_program_without_a_unit_is_in_millimetres_with_a_note_or_in_the_given_unit() -> None:
    text = "G99 G97 S500 M3\nG0 X2. Z0.\nG1 Z-1. F0.01"
    assert any("--unit inch" in note for note in moves(text).notes)
    last = run(divide(text), Reading(unit="inch")).moves[-1]
    assert (last.path.end, last.feed.value) == ((-25.4, 25.4), pytest.approx(0.254))


def test_cycles_of_programs_with_decimal_points_count_steps() -> None:
    text = "G20 G99 G97 S500 M3\nG0 X2.5 Z.1\nG71 U625 R500\nG71 P1 Q2 U420 W100 F.01\nN1 G0 X2.\nN2 G1 Z-1.\n"
    cuts = [move.path.end for move in moves(text).moves if move.kind == "feed"]
    assert cuts[-1] == pytest.approx((-0.99 * 25.4, 1.021 * 25.4))
    assert cuts[0][1] == pytest.approx((1.25 - 0.0625) * 25.4)


@pytest.mark.parametrize(
    ("line", "control"),
    [
        ("NAT01", "Okuma"),
        ("G85 NLAP1", "Okuma"),
        ("O100 IF [#1 GT 2]", "LinuxCNC"),
        ("%00042", "Fagor"),
        ("UNO. 1", "Mazatrol"),
    ],
)
def test_controls_that_are_not_read_are_named(line: str, control: str) -> None:
    with pytest.raises(NcError, match=f"line 2: .*{control}"):
        divide(f"G21\n{line}\n")
    with pytest.raises(NcError, match=r"Mazak.*read as Fanuc(?s:.*)line 4"):
        moves(f"{BAR}G53.5")


def test_notes_stand_once_with_their_lines() -> None:
    made = moves(
        BAR
        + "G1 Z-5. F0.2 M77\nZ-6. M77\n"
        + "/Z-7.\n" * 7
        + "G75 R0.5\nG75 X20. P1000\nG75 X10. P2000"
    )
    lines = ["line 1", "lines 4, 5", "lines 6, 7, 8, 9, 10, ... (7 lines)", "lines 14, 15"]
    assert [note.partition(":")[0] for note in made.notes] == lines
