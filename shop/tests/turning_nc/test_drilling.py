"""Drilling cycles drill where X and Z say, from where R says."""

import itertools
import math
from typing import NamedTuple

import pytest

pytest.importorskip("shapely")

from turning_nc.moves import Moves
from turning_nc.removal import remove
from turning_nc.stock import read_stock
from turning_nc.words import NcError

from shop.tests.turning_nc.programs import moves

FANUC = "G21 G99\nT0202\nG97 S800 M3\n"
LINUXCNC = "G21 G7 G18 G95\nT2 M6\nM3 S800\n"
NAMES = {FANUC: "T0202", LINUXCNC: "T2"}


class Hole(NamedTuple):
    """A hole on the axis, and how a program drills it."""

    head: str
    code: int
    start: tuple[float, float]  # X as a diameter and Z before the cycle [mm]
    x: str  # the word of X in the cycle's block; empty if the tool already is on the axis
    depth: float  # [mm]
    diameter: float  # of the drill [mm]
    near: str  # the word R; empty if there is none

    @property
    def text(self) -> str:
        """The program."""
        x, z = self.start
        cycle = f"G{self.code} {self.x} Z-{self.depth} {self.near} F0.1"
        return f"{self.head}G0 X{x} Z{z}\n{cycle}\nG80\nG0 Z50.\nM30"

    @property
    def volume(self) -> float:
        """The volume of the hole [mm3]."""
        return math.pi / 4.0 * self.diameter**2 * self.depth


def holes() -> list[Hole]:
    """Return holes by both controls, from the axis, from beside it, and from point R."""
    made = []
    for head, code in itertools.product((FANUC, LINUXCNC), (81, 82, 83)):
        for x, word in ((0.0, ""), (20.0, "X0."), (64.0, "X0."), (-16.0, "X0.")):
            for depth, diameter in ((25.0, 10.0), (7.5, 22.0)):
                near = ""
                if depth > 10.0:
                    near = "R2." if head == LINUXCNC else "R-3."
                made.append(Hole(head, code, (x, 5.0), word, depth, diameter, near))
    return made


def drilled(hole: Hole) -> float:
    """Return the volume that a hole's drill removes from a bar [mm3]."""
    kind = f"drill:{hole.diameter}"
    removal = remove(moves(hole.text), read_stock("bar:60x40"), {NAMES[hole.head]: kind})
    return float(removal.slices.volume.sum())


@pytest.mark.parametrize("hole", holes(), ids=lambda hole: " ".join(hole.text.split()[6:]))
def test_a_cycle_drills_on_the_axis_from_wherever_it_begins(hole: Hole) -> None:
    assert drilled(hole) == pytest.approx(hole.volume, rel=1e-3)


def fed(made: Moves) -> list[tuple[float, float, float]]:
    """Return start, end and X of the moves at feed [mm]."""
    return [
        (move.path.start.z, move.path.end.z, 2.0 * move.path.end.x)
        for move in made.moves
        if move.kind == "feed"
    ]


@pytest.mark.parametrize(
    ("text", "start"),
    [
        pytest.param(f"{FANUC}G0 X20. Z5.\nG83 X0. Z-25. Q5000 F0.1", 5.0, id="no R"),
        pytest.param(f"{FANUC}G0 X20. Z5.\nG83 X0. Z-25. R-4. F0.1", 1.0, id="distance"),
        pytest.param(f"{FANUC}G0 X20. Z5.\nG83 X0. Z-25. R2. F0.1", 2.0, id="place"),
        pytest.param(f"{LINUXCNC}G0 X20 Z5\nG81 X0 Z-25 R2 F0.1", 2.0, id="LinuxCNC"),
        pytest.param(f"{LINUXCNC}G0 X20 Z1\nG81 X0 Z-25 R2 F0.1", 2.0, id="LinuxCNC, below R"),
        pytest.param(f"{LINUXCNC}G98\nG0 X20 Z5\nG81 X0 Z-25 R2 F0.1", 2.0, id="G98 is no feed"),
    ],
)
def test_a_cycle_feeds_from_point_r(text: str, start: float) -> None:
    assert fed(moves(text)) == [(start, -25.0, 0.0)]


@pytest.mark.parametrize("near", ["R-40.", "R9."])
def test_a_point_r_beyond_the_hole_is_refused(near: str) -> None:
    with pytest.raises(NcError, match=r"line 5: R.* is not between"):
        moves(f"{FANUC}G0 X0. Z5.\nG83 Z-25. {near} F0.1")


def test_repeats_of_a_hole_are_refused() -> None:
    with pytest.raises(NcError, match="line 5: G83 with K3"):
        moves(f"{FANUC}G0 X0. Z5.\nG83 Z-25. K3 F0.1")


def test_a_cycle_waits_at_the_bottom() -> None:
    made = moves(f"{FANUC}G0 X0. Z5.\nG82 Z-25. P500 F0.1")
    assert [move.time for move in made.moves if move.kind == "dwell"] == [0.5]


@pytest.mark.parametrize("block", ["G83 Z-25. F0.1", "G83 X24. Z-25. F0.1", "G1 Z-25. F0.1"])
def test_a_drill_beside_the_axis_is_refused(block: str) -> None:
    made = moves(f"{FANUC}G0 X20. Z5.\n{block}")
    with pytest.raises(NcError, match=r"line 5: the drill T0202 cuts at X2.*on the axis"):
        remove(made, read_stock("bar:50x40"), {"T0202": "drill:10"})


def test_a_tap_goes_to_its_hole_and_is_refused_beside_the_axis() -> None:
    made = moves(f"{FANUC}G0 X20. Z5.\nG84 X0. Z-15. F1.5\nG80")
    (tapped,) = [move for move in made.moves if move.kind == "thread"]
    assert tapped.path.end == (-15.0, 0.0)
    assert tapped.feed.value == 1.5
    with pytest.raises(NcError, match=r"line 5: a fixed tap cuts on the axis"):
        moves(f"{FANUC}G0 X20. Z5.\nG84 Z-15. F1.5\nG80")


def test_a_drill_at_its_own_diameter_is_programmed_by_its_corner() -> None:
    made = moves(f"{FANUC}G0 X12.5 Z2.\nG83 Z-20. F0.1\nG80\nG0 Z50.")
    removal = remove(made, read_stock("bar:60x60"), {"T0202": "drill:12.5"})
    assert removal.slices.volume.sum() == pytest.approx(math.pi / 4.0 * 12.5**2 * 20.0, rel=1e-3)
    assert any("corner" in note for note in removal.notes)


def test_a_drill_that_waits_at_its_own_radius_goes_to_the_axis() -> None:
    # The way from X10 to X0 is none for a drill of 10 mm whose corner is programmed.
    made = moves(f"{LINUXCNC}G0 X10 Z5\nG81 X0 Z-30 R2 F0.1\nG80\nG0 Z50")
    removal = remove(made, read_stock("bar:50x40"), {"T2": "drill:10"})
    assert removal.slices.volume.sum() == pytest.approx(math.pi / 4.0 * 10.0**2 * 30.0, rel=1e-3)
    assert not any("corner" in note for note in removal.notes)
