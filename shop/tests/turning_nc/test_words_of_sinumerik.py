"""Words of SINUMERIK that everyday programs hold: each is read, or refused with what to write."""

import pytest

pytest.importorskip("shapely")

from turning_nc.words import NcError

from shop.tests.turning_nc.programs import DREH, moves


def ends(body: str) -> list[tuple[float, float]]:
    """Return Z and diameter at the ends of the moves behind ``DREH``."""
    made = [move.path.end for move in moves(f"{DREH}{body}\nM30").moves[2:]]
    return [(end.z, 2.0 * end.x) for end in made]


def test_for_counts_up_to_its_last_value() -> None:
    assert ends("FOR R1=1 TO 3\nG1 Z=-R1\nENDFOR\nG1 X=30+R1") == [
        (-1.0, 20.0),
        (-2.0, 20.0),
        (-3.0, 20.0),
        (-3.0, 34.0),
    ]


def test_a_for_that_begins_beyond_its_last_value_is_not_run() -> None:
    assert ends("R2=1\nFOR R1=R2+1 TO R2\nG1 Z-5\nENDFOR\nG1 X30") == [(0.0, 30.0)]


def test_loops_of_for_lie_within_each_other() -> None:
    body = "FOR R1=1 TO 2\nFOR R2=1 TO 2\nG1 Z=-10*R1-R2\nENDFOR\nENDFOR"
    assert [z for z, _ in ends(body)] == [-11.0, -12.0, -21.0, -22.0]


@pytest.mark.parametrize(("value", "diameter"), [(1, 30.0), (2, 40.0)])
def test_else_is_the_other_branch(value: int, diameter: float) -> None:
    body = f"R1={value}\nIF R1==1\nG1 X30\nELSE\nG1 X40\nENDIF\nG1 Z-5"
    assert ends(body) == [(0.0, diameter), (-5.0, diameter)]


@pytest.mark.parametrize(("value", "place"), [(1, [(-2.0, 20.0)]), (3, [])])
def test_if_needs_no_else_and_holds_others(value: int, place: list[tuple[float, float]]) -> None:
    body = f"R1={value}\nIF R1<3\nIF R1==2\nG1 X50\nENDIF\nG1 Z-2\nENDIF"
    assert ends(body) == place


def test_a_number_in_brackets_is_that_of_the_parameter() -> None:
    assert ends("R[1]=5\nG1 Z=-R[1] X=20+2*R[ 1 ]") == [(-5.0, 30.0)]


def test_indices_that_say_nothing_are_read() -> None:
    made = moves("G90 G95 G71 DIAMON T1 D1\nG96 S150 LIMS[1]=900 SCC[X] M4\nG0 X9 Z2\nG1 Z0 F0.2")
    assert made.moves[-1].max_spindle_speed == 900.0


@pytest.mark.parametrize("shift", ["TRANS", "TRANS X0 Z0", "ATRANS Z0"])
def test_a_shift_by_nothing_changes_nothing(shift: str) -> None:
    assert ends(f"{shift}\nG1 Z-5") == [(-5.0, 20.0)]


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        pytest.param("ATRANS Z5", "ATRANS after the first move .* one zero point", id="shift"),
        pytest.param("R[R1]=7", "an index in brackets is read as a number alone", id="index"),
        pytest.param("DEF REAL DEPTH=2", "DEF is not read: .* an R parameter", id="variable"),
        pytest.param(
            'EXTCALL "SP1"', "EXTCALL is not read: .* by name alone", id="program outside"
        ),
        pytest.param("MCALL CYCLE81(2,0,2,-9)", "MCALL is not read: .* moves", id="modal cycle"),
        pytest.param("REPEAT\nG1 Z-5\nUNTIL R1>3", "REPEAT is not read: .* WHILE", id="repeat"),
        pytest.param("CASE R1 OF 1 GOTOF A\nA:", "CASE is not read: .* IF", id="choice"),
        pytest.param("GOTOF A1\nA1: G1 Z-5", "the label A1: begins like a word", id="label"),
        pytest.param("G33 Z-5 I2", "needs its lead: K, as it is longer along Z", id="lead"),
        pytest.param("G33 X30 K2", "needs its lead: I, as it is longer along X", id="lead of X"),
        pytest.param("G33 Z-5 I2 K2", "I and K of G33 both state its lead", id="two leads"),
        pytest.param("G1 Z-5 GOTOF A\nA:", "G1 Z-5 before GOTOF must be", id="move and jump"),
        pytest.param("FOR R1=1.5 TO 3\nENDFOR", "must count from a whole number", id="count"),
        pytest.param("FOR R1=1 TO 3\nG1 Z-5", "the loop has no other end", id="open loop"),
        pytest.param("R1=1\nIF R1==1\nG1 Z-5", "IF needs a jump", id="open branch"),
        pytest.param("G3 X24 Z-2 AR=90", "write its radius, CR=", id="angle of an arc"),
        pytest.param("CYCLE93(35,60,30)", "a groove: write its moves", id="groove"),
        pytest.param("CYCLE83(2,0,2,-20)", "deep drilling: write its moves", id="drilling"),
    ],
)
def test_what_is_not_read_is_refused_with_what_to_write(body: str, reason: str) -> None:
    with pytest.raises(NcError, match=f"line [56]: .*{reason}"):
        moves(f"{DREH}{body}\nG1 Z-9\nM30")


def test_a_shift_along_x_is_refused() -> None:
    with pytest.raises(NcError, match="line 1: TRANS along X, which would shift the axis"):
        moves(f"TRANS X5 Z10\n{DREH}G1 Z-9\nM30")
