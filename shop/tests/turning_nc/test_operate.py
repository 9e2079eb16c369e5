"""Cycles of SINUMERIK Operate: stock removal of a corner and of a contour."""

import pytest

pytest.importorskip("shapely")

from turning_nc.adapt import adapt
from turning_nc.cutting import Machine, Situation
from turning_nc.moves import Move
from turning_nc.paths import Point
from turning_nc.removal import remove
from turning_nc.stock import read_stock
from turning_nc.words import NcError

from shop.tests.turning_nc.programs import moves
from turning_env import Scenario

HEAD = 'G18 G90 G95 G71 DIAMON\nT="DREHER" D1\nG96 S180 LIMS=2500 M4\nG0 X{x} Z2\n'
CONTOUR = (
    "E_LAB_A_WELLE: ;#SM Z:2\nG18 G90 DIAMOF;*GP*\nG0 Z0 X10 ;*GP*\nG1 Z-20 ;*GP*\n"
    "X15 ;*GP*\nG1 X25 Z-30 ;*GP*\nE_LAB_E_WELLE:\n"
)
ROUGH = (
    'CYCLE952("P1",,"",2101311,0.3,0.15,0,2,0.1,0.1,0.4,0.2,0.1,0,1,60,1,,,,,2,2,1,,0,1,,0,2,110)'
)


def cut(text: str) -> list[Move]:
    """Return the moves at feed of a program."""
    return [move for move in moves(text).moves if move.kind == "feed"]


def depths_of_passes(text: str, axis: str) -> list[float]:
    """Return the places of all passes but the last along X (radii) or Z [mm]."""
    made = cut(text)
    last = max(move.cycle_pass for move in made)
    passes = [move for move in made if move.cycle_pass < last]
    return [round(getattr(move.path.end, axis), 4) for move in passes]


def corner(x: float, end: float, position: int, variant: int, z: float = -50.0) -> str:
    """Return a program that removes the stock of a corner."""
    geometry = f"{x},0,{end},{z},0,0,{position}"
    technology = f"2.5,0,0,{variant},0,0,0,1,0.3,0,2,1110000"
    return f"{HEAD.format(x=x)}CYCLE951({geometry},{technology})\n"


def test_a_corner_is_roughed_along_its_cylinder() -> None:
    text = corner(80.0, 60.0, position=1, variant=11)
    assert depths_of_passes(text, "x") == [37.5, 35.0, 32.5]
    made = cut(text)
    assert {move.feed.value for move in made} == {0.3}
    assert [move.path.end for move in made[-2:]] == [(-50.0, 30.0), (-50.0, 40.0)]


def test_a_corner_is_roughed_along_its_face() -> None:
    text = corner(80.0, 60.0, position=1, variant=12, z=-5.0)
    assert depths_of_passes(text, "z") == [-2.5]
    assert [move.path.end for move in cut(text)[-2:]] == [(-5.0, 30.0), (0.0, 30.0)]


def test_a_corner_inside_is_roughed_away_from_the_axis() -> None:
    text = corner(20.0, 30.0, position=3, variant=11)
    assert depths_of_passes(text, "x") == [12.5]
    assert [side.name for side in moves(text).sides.values()] == ["inside"]


def test_a_corner_is_finished_along_its_contour() -> None:
    made = cut(corner(80.0, 60.0, position=1, variant=21))
    assert [move.path.end for move in made] == [(0.0, 30.0), (-50.0, 30.0), (-50.0, 40.0)]


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [
        pytest.param(",11,", ",31,", "argument 11", id="machining"),
        pytest.param(",0,0,1,2.5", ",0,0,3,2.5", "inside", id="position"),
        pytest.param("1110000)", "1110001)", "argument 19", id="increment"),
        pytest.param(",0,0,0,1,0.3,0,", ",2,0,0,1,0.3,1,", "argument 12", id="chamfer"),
    ],
)
def test_what_is_not_read_of_a_corner_is_refused(old: str, new: str, named: str) -> None:
    text = corner(80.0, 60.0, position=1, variant=11)
    assert old in text
    with pytest.raises(NcError, match=f"line 5: CYCLE951: .*{named}"):
        moves(text.replace(old, new))


def turned(cycle: str, name: str = 'CYCLE62("WELLE",1,,)') -> str:
    """Return a program that turns the contour."""
    return f"{HEAD.format(x=62)}{name}\n{cycle}\nG0 X100 Z50\nM30\n{CONTOUR}"


def test_a_contour_of_the_editor_is_roughed_from_its_blank() -> None:
    text = turned(ROUGH)
    # 9 passes of less than 2 mm to the lowest radius, 10 mm and its allowance of 0.4 mm.
    assert len(depths_of_passes(text, "x")) == 9
    assert depths_of_passes(text, "x")[0] == pytest.approx(28.04)
    along = [move.path.end for move in cut(text)[-3:]]
    assert along == [
        pytest.approx((z + 0.2, x + 0.4)) for z, x in ((-20, 10), (-20, 15), (-30, 25))
    ]


@pytest.mark.parametrize(
    ("blank", "first_pass"),
    [
        pytest.param("60,1", 28.04, id="diameter"),
        pytest.param("50,1", 23.525, id="diameter of the contour"),
        pytest.param("5,1", 28.04, id="allowance"),
        pytest.param("0,0", 23.525, id="none"),
    ],
)
def test_passes_begin_at_the_blank(blank: str, first_pass: float) -> None:
    text = turned(ROUGH.replace(",1,60,1,", f",1,{blank},"))
    assert depths_of_passes(text, "x")[0] == pytest.approx(first_pass)


@pytest.mark.parametrize(
    "name", ['CYCLE62(,2,"E_LAB_A_WELLE","E_LAB_E_WELLE")', 'CYCLE62("C",0,,)']
)
def test_a_contour_is_named_by_labels_or_as_a_sub_program(name: str) -> None:
    sub_program = f"%_N_C_SPF\n{CONTOUR}M17\n"
    ends = [move.path.end for move in cut(turned(ROUGH, name) + sub_program)]
    assert ends == [move.path.end for move in cut(turned(ROUGH))]


def test_a_contour_is_finished_without_its_allowance() -> None:
    ends = [move.path.end for move in cut(turned(ROUGH.replace("2101311", "2101321")))]
    assert ends == [(0.0, 10.0), (-20.0, 10.0), (-20.0, 15.0), (-30.0, 25.0)]


def test_a_contour_is_faced_from_outside_in_its_reverse() -> None:
    text = turned(ROUGH.replace("2101311", "2103112"))
    ends = [move.path.end for move in cut(text)[-3:]]
    assert [round(end.x, 3) for end in ends] == [15.4, 10.4, 10.4]
    assert ends[-1] == Point(pytest.approx(0.2), pytest.approx(10.4))


@pytest.mark.parametrize(
    ("cycle", "named"),
    [
        (ROUGH.replace("2101311", "1101311"), "argument 4"),
        (ROUGH.replace("2101311", "2101313"), "argument 4"),
        (ROUGH.replace('"P1",,', '"P1","REST",'), "residual"),
        (ROUGH.replace("60,1,,,", "60,1,30,,"), "limit of the machining area"),
    ],
)
def test_what_is_not_read_of_a_contour_is_refused(cycle: str, named: str) -> None:
    with pytest.raises(NcError, match=f"line 6: CYCLE952: .*{named}"):
        moves(turned(cycle))


def test_a_contour_must_be_named_before() -> None:
    with pytest.raises(NcError, match="CYCLE62"):
        moves(turned(ROUGH, name=""))


def test_feeds_of_the_cycles_are_adapted() -> None:
    made = moves(corner(80.0, 60.0, position=1, variant=11))
    removal = remove(made, read_stock("bar:80x70"))
    situation = Situation(Scenario.load("rough_turning"), Machine(), made, removal)
    (change,) = [change for change in adapt(situation).changes if change.feeds]
    assert change.before == "F0.3"
    assert change.line == 5
