"""Users' programs: the moves that they stand for, and words that are not understood."""

import contextlib
import random
from typing import NamedTuple

import pytest

pytest.importorskip("shapely")

from turning_nc.dialects import FANUC, SINUMERIK
from turning_nc.moves import ReadingChoices, run
from turning_nc.words import NcError, divide

from shop.examples.adapt_programs import COLLECTION, path_of
from shop.tests.turning_nc.programs import BAR, EVERYDAY, ISO, SIEMENS, moves


def test_both_dialects_are_told_from_the_text() -> None:
    assert divide(ISO).dialect == FANUC
    assert divide(SIEMENS).dialect == SINUMERIK
    assert list(divide(SIEMENS).parts) == ["TEST", "KONTUR", "L5"]
    assert divide(ISO, SINUMERIK).dialect == SINUMERIK


DIAMETER_NOTE = "line 3: X is taken as a diameter, as usual (assumption); --radius sets a radius"


@pytest.mark.parametrize(
    ("text", "notes"),
    [pytest.param(ISO, (DIAMETER_NOTE,), id="ISO"), pytest.param(SIEMENS, (), id="SINUMERIK")],
)
def test_programs_and_their_sub_programs_are_run_with_any_ends_of_lines(
    text: str, notes: tuple[str, ...]
) -> None:
    made = moves(text)
    paths = [move.path for move in made.moves]
    assert made.notes == notes
    assert paths[-1].end.z == 1.0
    assert [move.path for move in moves(text.replace("\n", "\r\n")).moves] == paths


@pytest.mark.parametrize("name", EVERYDAY)
def test_everyday_words_make_the_cuts_of_a_control(name: str) -> None:
    example = EVERYDAY[name]
    cuts = [move.path for move in moves(example.text).moves if move.kind in ("feed", "thread")]
    ends = [path.end for path in cuts if path.end != path.start]
    assert ends == [pytest.approx(end, abs=1e-3) for end in example.ends]


# Words that are not understood.


class Damage(NamedTuple):
    """A change of a program, and how it is refused."""

    text: str
    old: str
    new: str
    line: int
    named: str


CUT = "G1 Z-20."
CALL = "N80 M98 P7"
SIEMENS_CALL = "N50 L5"
DAMAGES = {
    "arc without centre and radius": Damage(
        ISO, "G2 X56. Z-22. R2.", "G2 X56. Z-22.", 8, "centre or a radius"
    ),
    "arc with too small a radius": Damage(ISO, "R2.", "R0.5", 8, "radius 0.5"),
    "no feed": Damage(ISO, " F0.25", "", 7, "no feed"),
    "no speed": Damage(ISO, "S150 ", "", 7, "no speed"),
    "negative feed": Damage(ISO, "F0.25", "F-0.25", 7, "negative"),
    "two motions": Damage(ISO, CUT, "G1 G2 Z-20.", 7, "exclude"),
    "second block of G76 alone": Damage(ISO, CUT, "G76 Z-20.", 7, "two blocks"),
    "unknown cycle": Damage(ISO, CUT, "G87 Z-20.", 7, "G87"),
    "radius without comma": Damage(ISO, CUT, "G1 Z-20. R2.", 7, "write ,R"),
    "word without meaning": Damage(ISO, CUT, "G1 Z-20. K2.", 7, "K2. has no meaning"),
    "G90 after G94": Damage(ISO, CUT, "G94\nG90 Z-20.", 8, "cycle on some controls"),
    "rotary axis": Damage(ISO, CUT, "G1 Z-20. C45.", 7, "address C"),
    "variable without value": Damage(ISO, CUT, "G1 Z#101", 7, "#101 has no value"),
    "division by zero": Damage(ISO, CUT, "G1 Z[1./0.]", 7, "zero"),
    "condition beside a move": Damage(ISO, "G1 Z-20.", "IF [#1 EQ 2] GOTO 5", 7, "no word"),
    "zero point after moves": Damage(ISO, CALL, "N80 G50 X100. Z50.", 10, "G50"),
    "missing sub-program": Damage(ISO, "M98 P7", "M98 P8", 10, "sub-program 8"),
    "missing contour": Damage(ISO, "M98 P7", "G71 P100 Q200", 10, "N100 to N200"),
    "contour before its cycle": Damage(ISO, "M98 P7", "G71 U2. R1.\nG71 P90 Q100", 11, "contour"),
    "G73 without its first block": Damage(
        ISO, "M98 P7", "G73 P300 Q301\nN300 G1 X58.\nN301 Z0.", 10, "how often"
    ),
    "thread without lead": Damage(ISO, "M98 P7", "G32 Z-5.", 10, "lead"),
    "missing contour of CYCLE95": Damage(
        SIEMENS, '"KONTUR"', '"CONTOUR"', 5, "'CONTOUR' is neither in this file"
    ),
    "CYCLE95 without depth": Damage(SIEMENS, '"KONTUR",2,', '"KONTUR",0,', 5, "above 0"),
    "unknown kind of machining": Damage(SIEMENS, "0.15,9)", "0.15,13)", 5, "1 to 12"),
    "contour that turns back": Damage(SIEMENS, "N80 Z-20", "N80 X20 Z2", 10, "turns back"),
    "missing sub-program of SINUMERIK": Damage(SIEMENS, SIEMENS_CALL, "N50 L6", 6, "L6"),
    "R parameter without value": Damage(SIEMENS, SIEMENS_CALL, "N50 G1 X=R1", 6, "R1 has no value"),
    "jump to a missing label": Damage(SIEMENS, SIEMENS_CALL, "N50 IF R1==2 GOTOF END", 6, "IF"),
    "CYCLE97 without pitch": Damage(SIEMENS, SIEMENS_CALL, "N50 CYCLE97(,20,0,-30)", 6, "pitch"),
    "TRANS after a move": Damage(SIEMENS, SIEMENS_CALL, "N50 TRANS Z-10", 6, "TRANS"),
    "radius at the end": Damage(SIEMENS, SIEMENS_CALL, "N50 G1 X20 RND=2", 6, "must follow"),
    "chamfer that is too long": Damage(SIEMENS, "N80 Z-20", "N80 Z-20 CHF=60", 11, "of line 10"),
    "action on an unknown variable": Damage(
        SIEMENS, SIEMENS_CALL, "N50 ID=1 DO $AC_OVR=$AC_SECRET", 6, "synchronized actions"
    ),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_words_that_are_not_understood_are_named_with_their_line(name: str) -> None:
    damage = DAMAGES[name]
    assert damage.old in damage.text
    with pytest.raises(NcError) as refused:
        moves(damage.text.replace(damage.old, damage.new, 1))
    assert f"line {damage.line}: " in str(refused.value)
    assert damage.named in str(refused.value)


def test_all_lines_that_are_not_understood_are_named_at_once_or_left_out() -> None:
    text = ISO.replace("N80 M98 P7", "N80 G76 X5.\nN81 G65 P2\nN82 M77")
    # G65 beside G1 takes the feed, too, but no further message says so.
    with pytest.raises(NcError, match=r"(?s)^(?!.*no feed).*line 7: .*line 10: .*line 11: "):
        moves(text.replace("N50 G1", "N50 G65 G1"))
    made = run(divide(text), ReadingChoices(go_on=True))
    lines = [note.split(":")[0] for note in made.notes]
    # Nothing calls the sub-program in line 15 now.
    assert lines == ["line 3", "line 10", "line 11", "line 12", "line 15"]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        pytest.param("", "no blocks", id="empty"),
        pytest.param("(ONLY A COMMENT)", "no blocks", id="comment"),
        pytest.param("G0 X10. Z5.", "no feed move", id="no cut"),
        pytest.param("O1\nG0 X1.\nO2\nM99\nO2\nM99", "line 5", id="part defined twice"),
        pytest.param("O1\nM98 P2\nM30\nO2\nM98 P2\nM99", "more than 8 deep", id="recursion"),
        pytest.param(
            "O1\nM98 P2 L9999\nM30\nO2\nM98 P3 L9999\nM99\nO3\nM99",
            "moves or blocks are run",
            id="a hundred million calls",
            marks=pytest.mark.slow,
        ),
        pytest.param(
            SIEMENS.replace("N80 Z-20", 'N80 CYCLE95("KONTUR",2)'),
            "more than 8 deep",
            id="contour in itself",
        ),
        pytest.param("\n" * 200_001, "lines", id="too many lines"),
    ],
)
def test_programs_that_are_none_are_refused(text: str, named: str) -> None:
    with pytest.raises(NcError, match=named):
        moves(text)


PIECES = (
    "G71",
    "P100",
    "M98 P7",
    "Z-1e5",
    "S0",
    "R1e9",
    "I0 K0",
    "G2",
    "(",
    ";",
    "-",
    "0",
    "CYCLE95(",
    '"',
    "U-5.",
    "AC(",
    "PROC A",
    "R1=",
    "#1=",
    "X=R1",
    "Z#1",
    ",R2.",
    "RND=1",
    "ID=1 DO",
    "$A=",
    "CYCLE97(2,",
    "G76 P1",
    "G73 P1 Q2",
    "U0 W0 R3",
    "ß",
)


@pytest.mark.slow
def test_damaged_programs_are_read_or_refused() -> None:
    rng = random.Random(7)
    num_read = 0
    for _ in range(150):
        text = path_of(rng.choice(list(COLLECTION))).read_text()
        for _ in range(rng.randint(1, 5)):
            place = rng.randrange(len(text))
            text = text[:place] + rng.choice(PIECES) + text[place + rng.randrange(6) :]
        # Every other error of a reader fails the test.
        with contextlib.suppress(NcError):
            made = run(divide(text), ReadingChoices(go_on=rng.random() < 0.5))
            assert made.moves
            num_read += 1
    assert 0 < num_read < 150


# Units, notes and tools.


@pytest.mark.parametrize(
    ("units", "feed"),
    [
        pytest.param("G21 G99\nG20", 0.254, id="G20 of a Fanuc"),
        pytest.param("DIAMON G70 G95", 0.01, id="G70 changes lengths alone"),
        pytest.param("DIAMON G700 G95", 0.254, id="G700 changes feeds, too"),
    ],
)
def test_the_same_word_means_what_its_dialect_says(units: str, feed: float) -> None:
    last = moves(f"{units}\nG97 S500 M3\nG0 X2. Z0.\nG1 Z-1. F0.01").moves[-1]
    assert last.path.end == (-25.4, 25.4)
    assert last.feed.value == pytest.approx(feed)


def test_a_program_without_a_unit_is_in_millimetres_with_a_note_or_in_the_given_unit() -> None:
    text = "G99 G97 S500 M3\nG0 X2. Z0.\nG1 Z-1. F0.01"
    assert any("--unit inch" in note for note in moves(text).notes)
    last = run(divide(text), ReadingChoices(unit="inch")).moves[-1]
    assert last.path.end == (-25.4, 25.4)
    assert last.feed.value == pytest.approx(0.254)


def test_compensation_is_noted() -> None:
    assert "nose radius" in moves(ISO.replace("G1 Z-20.", "G42 G1 Z-20.")).notes[1]


def test_units_of_a_sinumerik_are_no_cycles() -> None:
    with pytest.raises(NcError, match="--dialect sinumerik"):
        moves("G90 G71\nG0 X50. Z2.")


def test_a_cancelled_offset_changes_no_tool() -> None:
    made = moves(ISO.replace("N90 M30", "N81 G0 X100. T0100\nN82 T0200\nG0 X101.\nN90 M30"))
    assert [move.tool for move in made.moves[-2:]] == ["T0101", "T0200"]


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


def test_a_control_that_is_read_as_another_is_named_with_its_problems() -> None:
    with pytest.raises(NcError, match=r"Mazak.*read as Fanuc(?s:.*)line 4"):
        moves(f"{BAR}G53.5")


def test_notes_stand_once_with_their_lines() -> None:
    cuts = "G1 Z-5. F0.2 M77\nZ-6. M77\n"
    skipped = "/Z-7.\n" * 7
    grooves = "G75 R0.5\nG75 X20. P1000\nG75 X10. P2000"
    made = moves(f"{BAR}{cuts}{skipped}{grooves}")
    lines = ["line 1", "lines 4, 5", "lines 6, 7, 8, 9, 10, ... (7 lines)", "lines 14, 15"]
    assert [note.partition(":")[0] for note in made.notes] == lines


# Variables.

HASH = (
    "G21 G99 T0101\nG97 S500 M3\n#100=-20.\n#2=[#100*2.+4.]\nG0 X#100 Z2.\n"
    "G1 X[10.-#2] Z#2 F[1./5.]"
)
COMPUTED = (
    "G90 G95 G71 DIAMON\nG97 S500 M4\nR1=5\nR2=-R1*2 R3=R1/20\nR2=R2-1\nG0 X60 Z0\n"
    "G1 X=R1+20 Z=IC(R2) F=R3"
)
SET_BELOW = "G90 G95 G71 DIAMON\nG97 S500 M4\nL5 P3\nG1 X20 Z=R9 F0.1\nM30\n%_N_L5_SPF\nR9=-7\nRET"


@pytest.mark.parametrize(
    ("text", "end", "feed"),
    [
        pytest.param(HASH, (-36.0, 23.0), 0.2, id="Fanuc"),
        pytest.param(COMPUTED, (-11.0, 12.5), 0.25, id="SINUMERIK"),
        pytest.param(SET_BELOW, (-7.0, 10.0), 0.1, id="set in a sub-program"),
    ],
)
def test_variables_are_computed(text: str, end: tuple[float, float], feed: float) -> None:
    last = moves(text).moves[-1]
    assert last.path.end == pytest.approx(end)
    assert last.feed.value == pytest.approx(feed)


@pytest.mark.parametrize(
    ("text", "is_number"), [(HASH, False), (COMPUTED, False), (SET_BELOW, True)]
)
def test_only_a_plain_number_has_a_place_in_the_text(text: str, is_number: bool) -> None:
    span = moves(text).moves[-1].feed.span
    assert (span is not None) == is_number
