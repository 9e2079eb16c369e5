"""Cycles, chamfers, radii and variables: the moves that blocks stand for."""

import math
from pathlib import Path

import pytest

pytest.importorskip("shapely")

import shapely

from tests.turning_nc.linuxcnc import INSTALLED, canonical
from turning_nc.moves import Moves, run
from turning_nc.stock import read_stock, remove
from turning_nc.words import divide

FANUC = "G21 G99 T0101\nG96 S150 M3\nG0 X20. Z2.\nG1 Z0. F0.2\n"
SINUMERIK = "G90 G95 G71 DIAMON T1 D1\nG96 S150 M4\nG0 X20 Z2\nG1 Z0 F0.2\n"
START = "G7 G90 G18 G21 G95\nT101 M6\n"
SET_UP = "G96 D2500 S150 M3\nF0.28 G0 X102. Z2.\n"


def moves(text: str) -> Moves:
    return run(divide(text))


# Chamfers, radii and variables.


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        (f"{FANUC}Z-20. ,C2.\nX60.", [(-18.0, 10.0), (-20.0, 12.0), (-20.0, 30.0)]),
        (f"{FANUC}Z-20. ,R2.\nX60.", [(-18.0, 10.0), (-20.0, 12.0), (-20.0, 30.0)]),
        (f"{SINUMERIK}Z-20 CHR=2\nX60", [(-18.0, 10.0), (-20.0, 12.0), (-20.0, 30.0)]),
        (f"{SINUMERIK}Z-20 CHF={math.sqrt(8.0):.9f}\nX60", [(-18.0, 10.0), (-20.0, 12.0), (-20.0, 30.0)]),
        (f"{SINUMERIK}Z-20 RND=2\nX60", [(-18.0, 10.0), (-20.0, 12.0), (-20.0, 30.0)]),
        (f"{SINUMERIK}RNDM=1\nZ-20\nX60\nRNDM=0\nZ-30", [(-19.0, 10.0), (-20.0, 11.0), (-20.0, 30.0), (-30.0, 30.0)]),
    ],
)
def test_corners_are_broken(text: str, ends: list[tuple[float, float]]) -> None:
    if "RNDM" in text:  # the first corner alone is rounded, as the second stands after RNDM=0
        ends = [*ends[:2], (-20.0, 29.0), (-21.0, 30.0), ends[-1]]
    made = moves(text).moves[2:]
    assert [move.path.end for move in made] == [pytest.approx(end) for end in ends]
    for move in made:
        if move.path.centre is not None:
            radius = 1.0 if "RNDM" in text else 2.0
            assert math.dist(move.path.centre, move.path.start) == pytest.approx(radius)
            assert move.path.length == pytest.approx(0.5 * math.pi * radius)  # the shorter way round


def test_a_chamfer_of_an_obtuse_corner_is_as_long_as_written() -> None:
    made = moves(f"{SINUMERIK}Z-20 CHF=3\nX40 Z-40").moves
    assert made[-2].path.length == pytest.approx(3.0)
    first, last = made[-3].path, made[-1].path
    assert math.dist(first.end, (-20.0, 10.0)) == pytest.approx(math.dist(last.start, (-20.0, 10.0)))


@pytest.mark.parametrize(
    ("text", "end", "feed"),
    [
        ("G21 G99 T0101\nG97 S500 M3\n#100=-20.\n#2=[#100*2.+4.]\nG0 X#100 Z2.\nG1 X[10.-#2] Z#2 F[1./5.]", (-36.0, 23.0), 0.2),
        (
            "G90 G95 G71 DIAMON\nG97 S500 M4\nR1=5\nR2=-R1*2 R3=R1/20\nR2=R2-1\nG0 X60 Z0\nG1 X=R1+20 Z=IC(R2) F=R3",
            (-11.0, 12.5),
            0.25,
        ),
        ("G90 G95 G71 DIAMON\nG97 S500 M4\nL5 P3\nG1 X20 Z=R9 F0.1\nM30\n%_N_L5_SPF\nR9=-7\nRET", (-7.0, 10.0), 0.1),
    ],
)
def test_variables_are_computed(text: str, end: tuple[float, float], feed: float) -> None:
    last = moves(text).moves[-1]
    assert last.path.end == pytest.approx(end)
    assert last.feed.value == pytest.approx(feed)
    assert (last.feed.span is None) == (feed != 0.1)  # only a plain number can be changed


# Roughing.

POCKETS = "G1 Z-10.\nX44. Z-20.\nZ-30.\nX70. Z-40.\nZ-45.\nX60. Z-55.\nG2 X80. Z-65. R10.\nG1 Z-80.\n"
STEPS = "G1 Z-30.\nG2 X60. Z-35. R5.\nG1 Z-60.\nX80. Z-80.\n"


@pytest.mark.skipif(not INSTALLED, reason="LinuxCNC is not installed")
@pytest.mark.parametrize("contour", [STEPS, POCKETS])
def test_passes_of_g71_are_those_of_linuxcnc(contour: str, tmp_path: Path) -> None:
    theirs = canonical(f"{START}O100 sub\nG0 X50.\n{contour}X102.\nO100 endsub\n{SET_UP}G71 Q100 I2.5 R0.5 D0\nM30\n", tmp_path)
    ours = moves(f"G99\n{SET_UP}G71 U2.5 R0.5\nG71 P1 Q2\nN1 G0 X50.\n{contour}N2 X102.\nM30")
    ends = [move.end for move in theirs if move.kind == "feed"]
    cuts = [move.path for move in ours.moves if move.kind == "feed" and move.cycle_pass and move.path.length > 3.0]
    assert len(cuts) > 10
    assert all(min(math.dist(cut.end, end) for end in ends) < 0.02 for cut in cuts)  # arcs are chords here
    first_ends = [end for end in ends if end != (-80.0, 51.0)]  # theirs begins with a pass in air
    assert all(min(math.dist(move.path.end, end) for move in ours.moves) < 0.02 for end in first_ends)


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
    assert removal.notes == ()  # no rapid move through metal


# Threads.


@pytest.mark.skipif(not INSTALLED, reason="LinuxCNC is not installed")
def test_passes_of_g76_are_those_of_linuxcnc(tmp_path: Path) -> None:
    start = "G8 G90 G18 G21 G95\nT101 M6\nG97 S600 M3\nG0 X16. Z6.\n"
    theirs = canonical(f"{start}G76 P1.5 Z-34. I-1. J0.3 R2 K0.92 Q0 H2 L0 E0\nM30\n", tmp_path)
    ours = moves(f"{FANUC}G97 S600\nG0 X32. Z6.\nG76 P020000 Q20 R0.\nG76 X28.16 Z-34. P920 Q300 F1.5\nM30")
    threads = [move for move in ours.moves if move.kind == "thread"]
    expected = [move for move in theirs if move.kind == "feed"]
    assert [move.path.end for move in threads] == [pytest.approx(move.end, abs=1e-3) for move in expected]
    times = [60.0 * move.path.length / (move.feed.value * move.speed.value) for move in threads]
    assert times == pytest.approx([move.time for move in expected], rel=1e-3)


def test_threads_leave_their_allowance_and_taper() -> None:
    text = f"{FANUC}G97 S600\nG0 X32. Z6.\nG76 P010060 Q50 R0.1\nG76 X28. Z-34. R-2. P1000 Q400 F2.\nG1 X50.\nM30"
    made = moves(text)
    cuts = [move.path for move in made.moves if move.kind == "thread"]
    assert [round(path.end[1], 3) for path in cuts] == [14.6, 14.434, 14.307, 14.2, 14.106, 14.1, 14.0]
    assert all(path.end[1] - path.start[1] == pytest.approx(2.0) for path in cuts)
    assert cuts[-1].start[0] == pytest.approx(6.0 - math.tan(math.radians(30.0)))
    assert "load is not computed" in " ".join(made.notes)


def test_the_lead_of_a_thread_is_never_adapted() -> None:
    text = (
        f"{FANUC}G97 S600\nG0 X32. Z6.\nG76 P010060 Q50 R0.1\nG76 X28. Z-34. P1000 Q400 F2.\nG32 Z-40. F1.5\nG1 X50. Z-45.\nM30"
    )
    last = moves(text).moves[-1]
    assert last.feed.value == 1.5  # as on the control, F stays in force
    assert last.feed.span is None


@pytest.mark.parametrize(("variant", "roots"), [(1, (14.55, 14.1, 14.0, 14.0)), (3, (14.364, 14.1, 14.0, 14.0))])
def test_cycle97_cuts_its_passes(variant: int, roots: tuple[float, ...]) -> None:
    made = moves(f"{SINUMERIK}CYCLE97(1.5,,0,-32,30,30,6,2,1,0.1,30,0,2,1,{variant},1)\nG1 X50\nM30")
    cuts = [move for move in made.moves if move.kind == "thread"]
    assert [move.path.end for move in cuts] == [pytest.approx((-34.0, root), abs=1e-3) for root in roots]
    assert {move.feed.value for move in cuts} == {1.5}
    assert made.moves[-1].feed.value == 0.2
