"""Broken corners and cycles: the moves of a control, and LinuxCNC's where it has the same cycle."""

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely")

import shapely
from turning_nc.moves import ReadingChoices, run
from turning_nc.removal import remove
from turning_nc.stock import read_stock
from turning_nc.words import NcError, divide

from shop.tests.turning_nc.linuxcnc import INSTALLED, canonical
from shop.tests.turning_nc.programs import BAR, DREH, SIEMENS, TURN, moves
from tests.programs import NO_LINUXCNC

START = "G7 G90 G18 G21 G95\nT101 M6\n"
SET_UP = "G96 D2500 S150 M3\nF0.28 G0 X102. Z2.\n"

# Corners.

CORNER = (-20.0, 10.0)
BROKEN = [(-18.0, 10.0), (-20.0, 12.0), (-20.0, 30.0)]
ROUNDED = [(-19.0, 10.0), (-20.0, 11.0), (-20.0, 29.0), (-21.0, 30.0), (-30.0, 30.0)]


@pytest.mark.parametrize(
    ("text", "ends", "radius"),
    [
        pytest.param(f"{TURN}Z-20. ,C2.\nX60.", BROKEN, 0.0, id=",C"),
        pytest.param(f"{TURN}Z-20. ,R2.\nX60.", BROKEN, 2.0, id=",R"),
        pytest.param(f"{DREH}Z-20 CHR=2\nX60", BROKEN, 0.0, id="CHR"),
        pytest.param(f"{DREH}Z-20 CHF={math.sqrt(8.0):.9f}\nX60", BROKEN, 0.0, id="CHF"),
        pytest.param(f"{DREH}Z-20 RND=2\nX60", BROKEN, 2.0, id="RND"),
        # The second corner stands before RNDM=0.
        pytest.param(f"{DREH}RNDM=1\nZ-20\nX60\nRNDM=0\nZ-30", ROUNDED, 1.0, id="RNDM"),
    ],
)
def test_corners_are_broken(text: str, ends: list[tuple[float, float]], radius: float) -> None:
    paths = [move.path for move in moves(text).moves[2:]]
    assert [path.end for path in paths] == [pytest.approx(end) for end in ends]
    arcs = [path for path in paths if path.centre is not None]
    assert bool(arcs) == (radius > 0.0)
    for arc in arcs:
        # The shorter way round.
        assert arc.length == pytest.approx(0.5 * math.pi * radius)


def test_a_chamfer_of_an_obtuse_corner_is_as_long_as_written() -> None:
    first, chamfer, last = [move.path for move in moves(f"{DREH}Z-20 CHF=3\nX40 Z-40").moves[-3:]]
    assert chamfer.length == pytest.approx(3.0)
    assert math.dist(first.end, CORNER) == pytest.approx(math.dist(last.start, CORNER))


# Roughing.

POCKETS = (
    "G1 Z-10.\nX44. Z-20.\nZ-30.\nX70. Z-40.\nZ-45.\nX60. Z-55.\nG2 X80. Z-65. R10.\nG1 Z-80.\n"
)
RADII_OF_POCKETS = {
    -5.0: 25.0,
    -25.0: 22.0,
    -42.0: 35.0,
    -54.9: 30.05,
    -75.0: 40.0,
}
STEPS = "G1 Z-30.\nG2 X60. Z-35. R5.\nG1 Z-60.\nX80. Z-80.\n"


@pytest.mark.skipif(not INSTALLED, reason=NO_LINUXCNC)
@pytest.mark.parametrize("contour", [STEPS, POCKETS], ids=["steps", "pockets"])
def test_passes_of_g71_are_those_of_linuxcnc(contour: str, tmp_path: Path) -> None:
    sub_program = f"O100 sub\nG0 X50.\n{contour}X102.\nO100 endsub\n"
    reference = canonical(f"{START}{sub_program}{SET_UP}G71 Q100 I2.5 R0.5 D0\nM30\n", tmp_path)
    cycle = "G71 U2.5 R0.5\nG71 P1 Q2\n"
    made = moves(f"G99\n{SET_UP}{cycle}N1 G0 X50.\n{contour}N2 X102.\nM30").moves
    reference_ends = [move.end for move in reference if move.kind == "feed"]
    cuts = [move.path for move in made if move.kind == "feed" and move.cycle_pass]

    # LinuxCNC's arcs are chords here.
    long_cuts = [path for path in cuts if path.length > 3.0]
    assert len(long_cuts) > 10
    for path in long_cuts:
        assert min(math.dist(path.end, end) for end in reference_ends) < 0.02
    for end in reference_ends:
        # LinuxCNC begins with a pass in air.
        if end != (-80.0, 51.0):
            assert min(math.dist(move.path.end, end) for move in made) < 0.02


FINISH = f"N1 G0 X50.\n{POCKETS}N2 X102.\nG70 P1 Q2\nM30"


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(
            f"G99\n{SET_UP}G71 U2.5 R0.5\nG71 P1 Q2 U0.4 W0.1\n{FINISH}",
            id="G71",
        ),
        pytest.param(
            f"G99\n{SET_UP}G73 U25. W0. R11\nG73 P1 Q2 U0.4 W0.1\n{FINISH}",
            id="G73",
        ),
        pytest.param(
            f"G99\n{SET_UP}G73 P1 Q2 I25. K0. D11 U0.4 W0.1\n{FINISH}",
            id="G73 in one block",
        ),
        pytest.param(
            "G90 G95 G71 DIAMON T1 D1\nG96 S150 LIMS=2500 F0.3 M4\nG0 X104 Z5\n"
            'CYCLE95("C",2.5,0.1,0.2,,0.3,,0.15,9,,,1)\nM30\n'
            f"%_N_C_SPF\nG1 X50 Z0\n{POCKETS.replace('R10.', 'CR=10')}X100\nM17",
            id="CYCLE95",
        ),
    ],
)
def test_pockets_are_cut_to_the_contour(text: str) -> None:
    made = moves(text)
    removal = remove(made, read_stock("bar:100x120"), {made.moves[-1].tool: "copying"})
    for z, radius in RADII_OF_POCKETS.items():
        slab = shapely.box(z - 0.01, 0.0, z + 0.01, 100.0)
        *_, max_radius = removal.part.intersection(slab).bounds
        assert max_radius == pytest.approx(radius, abs=0.05)
    is_rough = [bool(move.cycle_pass) and move.kind == "feed" for move in made.moves]
    rough_slices = np.array(is_rough)[removal.slices.move]
    # No pass takes more than its depth and a corner beside it.
    assert 0.0 < removal.slices.depth[rough_slices].max() < 4.5
    assert removal.rapids == {}


def test_cycles_of_programs_with_decimal_points_count_steps() -> None:
    text = (
        "G20 G99 G97 S500 M3\nG0 X2.5 Z.1\nG71 U625 R500\nG71 P1 Q2 U420 W100 F.01\n"
        "N1 G0 X2.\nN2 G1 Z-1.\n"
    )
    ends = [move.path.end for move in moves(text).moves if move.kind == "feed"]
    assert ends[-1] == pytest.approx((-0.99 * 25.4, 1.021 * 25.4))
    assert ends[0].x == pytest.approx((1.25 - 0.0625) * 25.4)


# Sides.


def roughing(
    *,
    start: str = "62.",
    cycle: str = "U0.4 W0.1",
    first: str = "20.",
    last: str = "60.",
    more: str = "",
    leave: str = "G0 G40 Z2.",
) -> str:
    """Return a program that roughs a profile from one diameter to another."""
    profile = f"N10 G0 X{first}\nG1 Z-20.\nX{last}\n{more}N20 {leave}\nG0 X100."
    return f"{BAR}G0 X{start}\nG71 U2. R1.\nG71 P10 Q20 {cycle} F0.25\n{profile}"


@pytest.mark.parametrize(
    ("text", "side"),
    [
        pytest.param(roughing(), "outside", id="outside"),
        pytest.param(roughing(more="Z-40.\n", leave="G1 X62."), "outside", id="leaves along X"),
        pytest.param(
            roughing(more="Z-40.\nX62.\n", leave="G1 G40 X66. Z2."),
            "outside",
            id="departs at feed",
        ),
        pytest.param(roughing(first="50.", last="20."), "outside", id="contour goes down"),
        pytest.param(
            roughing(start="18.", cycle="U-0.4 W0.1", first="50.", last="20."),
            "inside",
            id="inside",
        ),
        pytest.param(
            roughing(start="18.", cycle="W0.1", first="50.", last="20."),
            "inside",
            id="inside without U",
        ),
        pytest.param(
            roughing(start="-62.", cycle="U-0.4", first="-20.", last="-60."),
            "outside",
            id="beyond the axis",
        ),
        pytest.param(SIEMENS.replace(",9)", ",1)"), "outside", id="CYCLE95 outside"),
        pytest.param(SIEMENS.replace(",9)", ",3)"), "inside", id="CYCLE95 inside"),
    ],
)
def test_the_side_is_that_of_the_control(text: str, side: str) -> None:
    made = moves(text)
    assert [chosen.name for chosen in made.sides.values()] == [side]
    first_pass = [move for move in made.moves if move.cycle_pass == 1 and move.kind == "feed"]
    assert (abs(first_pass[0].path.end.x) > 20.0) == (side == "outside")


def test_a_given_side_wins_and_a_contradiction_names_it() -> None:
    contradiction = roughing(
        start="18.",
        cycle="U0.4 W0.1",
        first="50.",
        last="20.",
    )
    with pytest.raises(NcError, match=r"line 6: .*--side 6=outside"):
        moves(contradiction)
    made = run(divide(contradiction), ReadingChoices(sides={6: "inside"}))
    assert [side.name for side in made.sides.values()] == ["inside"]
    with pytest.raises(NcError, match="line 5"):
        run(divide(contradiction), ReadingChoices(sides={5: "inside"}))


# Threads.


@pytest.mark.skipif(not INSTALLED, reason=NO_LINUXCNC)
def test_passes_of_g76_are_those_of_linuxcnc(tmp_path: Path) -> None:
    start = "G8 G90 G18 G21 G95\nT101 M6\nG97 S600 M3\nG0 X16. Z6.\n"
    cycle = "G76 P1.5 Z-34. I-1. J0.3 R2 K0.92 Q0 H2 L0 E0\nM30\n"
    reference = [move for move in canonical(f"{start}{cycle}", tmp_path) if move.kind == "feed"]
    blocks = "G97 S600\nG0 X32. Z6.\nG76 P020000 Q20 R0.\nG76 X28.16 Z-34. P920 Q300 F1.5\nM30"
    threads = [move for move in moves(f"{TURN}{blocks}").moves if move.kind == "thread"]
    ends = [move.path.end for move in threads]
    assert ends == [pytest.approx(move.end, abs=1e-3) for move in reference]
    settings = {(move.feed.value, move.speed.value) for move in threads}
    assert settings == {(move.feed, move.speed) for move in reference}


FIRST_BLOCK = f"{TURN}G97 S600\nG0 X32. Z6.\nG76 P010060 Q50 R0.1\n"


def test_threads_leave_their_allowance_and_taper() -> None:
    made = moves(f"{FIRST_BLOCK}G76 X28. Z-34. R-2. P1000 Q400 F2.\nG1 X50.\nM30")
    cuts = [move.path for move in made.moves if move.kind == "thread"]
    radii = [round(path.end.x, 3) for path in cuts]
    assert radii == [14.6, 14.434, 14.307, 14.2, 14.106, 14.1, 14.0]
    for path in cuts:
        assert path.end.x - path.start.x == pytest.approx(2.0)
    assert cuts[-1].start.z == pytest.approx(6.0 - math.tan(math.radians(30.0)))


def test_the_lead_of_a_thread_stays_in_force_and_has_no_place_to_adapt() -> None:
    blocks = "G76 X28. Z-34. P1000 Q400 F2.\nG32 Z-40. F1.5\nG1 X50. Z-45.\nM30"
    last = moves(f"{FIRST_BLOCK}{blocks}").moves[-1]
    assert last.feed.value == 1.5
    assert last.feed.span is None


@pytest.mark.parametrize(
    ("variant", "roots"),
    [
        pytest.param(1, (14.55, 14.1, 14.0, 14.0), id="equal depths"),
        pytest.param(3, (14.364, 14.1, 14.0, 14.0), id="equal chips"),
    ],
)
def test_cycle97_cuts_its_passes(variant: int, roots: tuple[float, ...]) -> None:
    call = f"CYCLE97(1.5,,0,-32,30,30,6,2,1,0.1,30,0,2,1,{variant},1)"
    made = moves(f"{DREH}{call}\nG1 X50\nM30").moves
    cuts = [move for move in made if move.kind == "thread"]
    ends = [move.path.end for move in cuts]
    assert ends == [pytest.approx((-34.0, root), abs=1e-3) for root in roots]
    assert {move.feed.value for move in cuts} == {1.5}
    assert made[-1].feed.value == 0.2
