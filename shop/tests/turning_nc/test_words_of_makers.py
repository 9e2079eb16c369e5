"""Words that some makers' controls have: Haas, LinuxCNC, and bar pullers."""

import pytest

pytest.importorskip("shapely")

from turning_nc.cutting import AssumedMachine, Situation, play
from turning_nc.moves import Move
from turning_nc.removal import remove
from turning_nc.stock import read_stock
from turning_nc.words import NcError

from shop.tests.turning_nc.programs import BAR, moves
from turning_env import Scenario

# LinuxCNC's G76 from the drive line X32: crest at X30, height 0.46 mm in radius.
THREAD = (
    "G21 G7 G18 G95 G97\nT3 M6\nM3 S500\nG0 X32 Z4\n"
    "G76 P1.5 Z-20 I-2 J0.2 R1 K0.92 Q29.5 H1\nG0 X40 Z20\nM2\n"
)
ROUGHING = (
    "G21 G99 T0101\nG97 S800 M3\nG0 X62. Z2.\n"
    "G71 P1 Q2 U0.4 W0.1 D2.5{extra} F0.25\nN1 G0 X40.\nG1 Z-30.\nN2 X62.\nM30\n"
)


def fed(text: str) -> list[Move]:
    """Return the moves of a program at feed."""
    return [move for move in moves(text).moves if move.kind in ("feed", "thread")]


def test_a_thread_of_linuxcnc_goes_down_by_steps_to_its_root() -> None:
    cuts = fed(THREAD)
    depths = [round(15.0 - cut.path.end.x, 6) for cut in cuts]
    assert depths == [0.1, 0.2, 0.3, 0.4, 0.46, 0.46]
    assert {cut.feed.value for cut in cuts} == {1.5}
    assert {cut.path.end.z for cut in cuts} == {-20.0}


@pytest.mark.parametrize(
    ("degression", "second"), [("R1", 0.2), ("R2", 0.1 * 2**0.5), ("R1.5", 0.1 * 2 ** (2 / 3))]
)
def test_the_degression_of_a_thread_sets_its_steps(degression: str, second: float) -> None:
    _, cut, *_ = fed(THREAD.replace("R1 ", f"{degression} "))
    assert 15.0 - cut.path.end.x == pytest.approx(second)


def test_a_thread_of_linuxcnc_in_radii_and_inside() -> None:
    inside = THREAD.replace("G7 ", "G8 ").replace("X32", "X10").replace("I-2 J0.2", "I1 J0.46")
    cuts = fed(inside)
    assert [round(cut.path.end.x, 6) for cut in cuts] == [11.46, 11.92, 11.92]


@pytest.mark.parametrize("word", ["P1.5", "Z-20", "I-2", "J0.2", "K0.92"])
def test_a_thread_of_linuxcnc_needs_its_words(word: str) -> None:
    with pytest.raises(NcError, match=r"line 5: G76 of LinuxCNC needs P"):
        moves(THREAD.replace(word, ""))


def test_i_and_k_of_haas_leave_metal_for_a_pass_along_the_contour() -> None:
    plain = fed(ROUGHING.format(extra=""))
    stepped = fed(ROUGHING.format(extra=" I0.5 K0.2"))
    # The last pass along the contour ends on the same allowance as without I and K.
    assert stepped[-2].path.end == plain[-2].path.end == pytest.approx((-29.9, 20.2))
    radii = {round(move.path.end.x, 6) for move in stepped if move.path.end.z < -29.0}
    assert 20.7 in radii


def test_i_and_k_have_no_meaning_without_a_contour() -> None:
    text = ROUGHING.format(extra="").replace("G71 P1", "G71 U2.5 R0.5 I1.\nG71 P1")
    with pytest.raises(NcError, match=r"line 4: I1\. has no meaning"):
        moves(text)


def test_zero_offsets_of_haas_and_a_null_shift_are_read() -> None:
    made = moves(f"{BAR}G154 P12\nG52 X0. Z0.\nG187 P1\nG1 X56. F0.2\nG154 P13\nZ-20.")
    assert made.moves[-1].path.end == (-20.0, 28.0)
    assert any("G154 P13 after G154 P12" in note for note in made.notes)
    with pytest.raises(NcError, match="G52 is not understood, a shift of the zero point"):
        moves(f"{BAR}G52 Z5.\nG1 X56. F0.2")


@pytest.mark.parametrize("offset", ["G54.1 P3", "G54 P3", "G154 P3", "G187 P3 E0.01", "G187"])
def test_zero_offsets_with_a_number_and_smoothness_change_no_move(offset: str) -> None:
    made = fed(f"{BAR}{offset}\nG1 X56. F0.2\nZ-20.")
    assert [move.path.end for move in made] == [(2.0, 28.0), (-20.0, 28.0)]


LOCAL = f"{BAR}G1 X56. F0.2\nM97 P100{{times}}\nG1 X58.\nM30\nN100 G1 W-4.\nM99\n"


@pytest.mark.parametrize(("times", "z"), [("", -2.0), (" L3", -10.0)])
def test_m97_of_haas_runs_a_block_and_those_behind_it(times: str, z: float) -> None:
    made = moves(LOCAL.format(times=times))
    assert made.moves[-1].path.end == (z, 29.0)
    assert not any("M97" in note for note in made.notes)


def test_m97_names_a_block_that_is_not_there() -> None:
    with pytest.raises(NcError, match="line 5: M97 calls N100, which is not in this part"):
        moves(LOCAL.format(times="").replace("N100 ", ""))


@pytest.mark.parametrize(
    ("block", "reason"),
    [
        pytest.param("M99 P50", "M99 returns behind its call", id="M99 P"),
        pytest.param("G1 Z-5. K2.", "write ,C for a chamfer", id="chamfer by K"),
        pytest.param("G76 P1.5 Z-20. I-2. J.2 K.9", "G7 .* or G8", id="LinuxCNC's thread"),
        pytest.param("G7\nG71 Q100 X40. Z3. D.5", "G71 of LinuxCNC is not read", id="its G71"),
        pytest.param("G65 P9100 A1.", "a macro call: write the macro's moves", id="macro"),
        pytest.param(
            "G1 X50. GOTO 10\nN10",
            "G1 X50. before GOTO must be a block of its own",
            id="move and jump",
        ),
    ],
)
def test_words_that_are_not_read_say_what_to_write(block: str, reason: str) -> None:
    with pytest.raises(NcError, match=reason):
        moves(f"{BAR}G1 X56. F0.2\n{block}\nZ-20.\nM30")


CONTOUR = "N1 G0 X40.\nG1 Z-30. F0.2\nN2 X62.\nM30\n"


@pytest.mark.parametrize(
    ("cycle", "word"),
    [
        ("G71 U2. R1. X50.\nG71 P1 Q2 U0.4 W0.1", "X50."),
        ("G71 U2. R1. W0.1\nG71 P1 Q2 U0.4 W0.1", "W0.1"),
        ("G71 U2. R1. Q7\nG71 P1 Q2 U0.4 W0.1", "Q7"),
        ("G71 U2. R1.\nG71 P1 Q2 U0.4 W0.1 R1.", "R1."),
    ],
)
def test_words_that_a_cycle_does_not_use_are_named(cycle: str, word: str) -> None:
    with pytest.raises(NcError, match=rf"{word} has no meaning in this block"):
        moves(f"{BAR}{cycle}\n{CONTOUR}")


def test_words_of_roughing_do_not_change_finishing() -> None:
    text = f"{BAR}G71 U2. R1.\nG71 P1 Q2 U0.4 W0.1 F0.2\n{CONTOUR.replace('M30', 'G70 P1 Q2')}"
    made = moves(text.replace("G70 P1 Q2", "G70 P1 Q2 U0.4 W0.1 D1."))
    ends = [move.path.end for move in moves(text).moves]
    assert [move.path.end for move in made.moves] == ends
    assert any("U, W and D of G70 are left out" in note for note in made.notes)


def test_i_of_haas_is_the_taper_of_a_box() -> None:
    ends = [move.path.end for move in fed(f"{BAR}G90 X50. Z-40. I-2. F0.25")]
    assert ends == [move.path.end for move in fed(f"{BAR}G90 X50. Z-40. R-2. F0.25")]
    faced = [move.path.end for move in fed(f"{BAR}G94 X50. Z-4. K-1. F0.25")]
    assert faced == [move.path.end for move in fed(f"{BAR}G94 X50. Z-4. R-1. F0.25")]


PULLER = "G21 G98\nT0909\nG0 X0. Z5.\nG1 Z1. F500\nG4 P500\nG1 Z40. F2000\nG0 Z60.\n"
CUT = "T0101\nG99 G97 S800 M3\nG0 X52. Z2.\nG1 Z-20. F0.2\nG0 X60.\nM30\n"


def test_a_bar_puller_moves_without_a_speed() -> None:
    made = moves(PULLER + CUT)
    situation = Situation(
        Scenario.load("rough_turning"),
        AssumedMachine(),
        made,
        remove(made, read_stock("bar:60x60")),
    )
    played = play(situation, 0.2)
    pulled = (situation.line == 6) & situation.fed
    assert played.time[pulled].sum() == pytest.approx(60.0 * 39.0 / 2000.0)
    assert (played.feed[pulled] == 0.0).all()
    with pytest.raises(NcError, match="line 4: no speed is set"):
        moves(PULLER.replace("G98", "G99") + CUT)


LATHE_OF_LINUXCNC = "G21 G7 G18 G95\nT2 M6\nM3 S800\nG0 X30 Z2\n"


@pytest.mark.parametrize("code", ["G154", "G54.1"])
def test_a_numbered_zero_offset_needs_its_number(code: str) -> None:
    with pytest.raises(NcError, match=f"line 4: {code} needs the number of its zero offset: P"):
        moves(f"{BAR}{code}\nG1 X56. F0.2")


def test_the_tolerances_of_linuxcnc_change_no_path() -> None:
    made = moves(f"{LATHE_OF_LINUXCNC}G64 P0.01 Q0.02\nG1 Z-5 F0.2")
    assert made.moves[-1].path.end == (-5.0, 15.0)


@pytest.mark.parametrize(
    ("block", "reason"),
    [
        ("G92.1", "the end of a shift"),
        ("G92.1 X0 Z0", "the end of a shift"),
        ("G90.1", "centres of arcs in absolute coordinates"),
    ],
)
def test_modes_that_are_not_read_are_named_with_a_reason(block: str, reason: str) -> None:
    code = block.split()[0]
    with pytest.raises(NcError, match=f"line 5: {code} is not understood, {reason}"):
        moves(f"{LATHE_OF_LINUXCNC}{block}\nG1 Z-5 F0.2")


@pytest.mark.parametrize(
    ("blocks", "reason"),
    [
        pytest.param("F1.5\nG32 Z-20.", "needs its lead: F; F of a block before it", id="modal F"),
        pytest.param("G32 Z-20.", "needs its lead: F ", id="no F"),
        pytest.param("G32 Z-20. K0.2 F1.5", "F and K of G32 both state its lead", id="K and F"),
        pytest.param("G32 Z-20. F1.5 I2.", "I2. has no meaning", id="I"),
    ],
)
def test_a_thread_states_its_lead_once_in_its_block(blocks: str, reason: str) -> None:
    with pytest.raises(NcError, match=f"line [45]: (G32 )?{reason}"):
        moves(f"{BAR}{blocks}")


def test_k_is_the_lead_of_linuxcnc_beside_a_feed() -> None:
    made = moves(f"{LATHE_OF_LINUXCNC}G33 Z-20 F0.2 K1.5")
    assert made.moves[-1].feed.value == 1.5


@pytest.mark.parametrize(("words", "name"), [("P2000 I2.", "P and I"), ("Q4000 K4.", "Q and K")])
def test_a_groove_states_each_length_once(words: str, name: str) -> None:
    with pytest.raises(NcError, match=f"line 5: {name} of G75 state one length"):
        moves(f"{BAR}G0 Z-10.\nG75 X56. Z-14. {words} F0.1")
