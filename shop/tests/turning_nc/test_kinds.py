"""Kinds of tools that are not given.

The side that a tool finishes is that of the cycle, or of the metal.
"""

from typing import NamedTuple

import pytest

pytest.importorskip("shapely")

from turning_nc.cutting import AssumedMachine, Situation, play
from turning_nc.removal import remove
from turning_nc.stock import guessed_stock, read_stock
from turning_nc.words import NcError

from shop.tests.turning_nc.programs import moves
from turning_env import Scenario

HEAD = "G21 G40 G99\nT0101\nG50 S2500\nG96 S180 M3\n"
NEXT = "G0 X150. Z100.\nT0202\nG96 S220 M3\n"
HUB = "G0 Z-15.\nG1 X30. F0.1\nZ-1.\nX28. Z0."


class Cycle(NamedTuple):
    """A roughing cycle and its contour."""

    start: str
    words: str
    contour: str
    is_inside: bool = False

    def finished(self) -> str:
        """Return a program in which a second tool finishes the contour with G70."""
        first, *between, last = self.contour.split("\n")
        blocks = "\n".join([f"N1 {first}", *between, f"N2 {last}"])
        roughing = f"{HEAD}{self.start}\n{self.words}\n{blocks}\n"
        return f"{roughing}{NEXT}{self.start}\nG70 P1 Q2\nG0 X150. Z100.\nM30"


OUTSIDE = "G0 X64. Z2."
CYCLES = {
    "G72": Cycle(OUTSIDE, "G72 W2. R0.5\nG72 P1 Q2 U0.4 W0.1 F0.25", HUB),
    "G73": Cycle(OUTSIDE, "G73 U4. W4. R5\nG73 P1 Q2 U0.4 W0.1 F0.25", HUB),
    "G71": Cycle(
        OUTSIDE,
        "G71 U2. R0.5\nG71 P1 Q2 U0.4 W0.1 F0.25",
        "G0 X28.\nG1 Z0.\nX30. Z-1.\nZ-15.\nX62.",
    ),
    "G71 inside": Cycle(
        "G0 X18. Z2.",
        "G71 U2. R0.5\nG71 P1 Q2 U-0.4 W0.1 F0.25",
        "G0 X42.\nG1 Z0.\nX40. Z-1.\nZ-15.\nX19.",
        is_inside=True,
    ),
}


@pytest.mark.parametrize("name", CYCLES)
def test_a_tool_that_finishes_a_contour_turns_its_side(name: str) -> None:
    cycle = CYCLES[name]
    made = moves(cycle.finished())
    removal = remove(made, read_stock("tube:60x20x60" if cycle.is_inside else "bar:60x60"))
    assert removal.tools["T0202"] == ("inside" if cycle.is_inside else "outside")
    situation = Situation(Scenario.load("rough_turning"), AssumedMachine(), made, removal)
    finishing = situation.tool == "T0202"
    assert 0.0 < removal.slices.depth[finishing].max() < 1.0
    assert play(situation, 0.1).load[finishing].max() < 0.5
    _, description = guessed_stock(made)
    assert description.startswith("tube" if cycle.is_inside else "bar")


def kind_of(text: str, stock: str, tool: str = "T0101") -> str:
    """Return the kind that a tool of a program has on a stock."""
    return remove(moves(text), read_stock(stock)).tools[tool]


@pytest.mark.parametrize(
    "block",
    [
        pytest.param(HUB, id="hub"),
        pytest.param("G0 Z-15.\nG1 X30. F0.1\nZ-0.5\nX29. Z0.", id="hub with a small chamfer"),
    ],
)
def test_a_hub_that_is_finished_from_its_back_is_turned_outside(block: str) -> None:
    text = f"{HEAD}G0 X64. Z2.\n{block}\nG0 X64. Z2.\nX150. Z100.\nM30"
    assert kind_of(text, "bar:60x60") == "outside"


BORING = "G0 X20. Z2.\nG1 Z-30. F0.2\nX18.\nG0 Z2.\n"


def test_nothing_is_turned_inside_without_a_hole() -> None:
    text = f"{HEAD}{BORING}M30"
    solid = remove(moves(text), read_stock("bar:60x60"))
    assert solid.tools["T0101"] == "outside"
    assert any("no hole" in note and "T0101=KIND" in note for note in solid.notes)
    assert kind_of(text, "tube:60x18x60") == "inside"


def test_a_kind_that_is_given_needs_no_hole() -> None:
    made = moves(f"{HEAD}{BORING}M30")
    removal = remove(made, read_stock("bar:60x60"), {"T0101": "inside"})
    assert removal.tools["T0101"] == "inside"


@pytest.mark.parametrize(
    "drill",
    [
        pytest.param("X0. Z2.\nG1 Z-40. F0.1\nG0 Z5.", id="drill"),
        pytest.param("X-18. Z2.\nG1 Z-40. F0.1\nG0 Z5.", id="boring beyond the axis"),
    ],
)
def test_a_tool_after_a_drill_may_turn_inside(drill: str) -> None:
    text = f"{HEAD}G0 {drill}\n{NEXT}{BORING}M30"
    assert kind_of(text, "bar:60x60", tool="T0202") == "inside"


PECKS = "G1 Z-5. F0.1\nG0 Z-3.\n" * 3


@pytest.mark.parametrize("diameter", ["0.006", "10000.", "150000."])
def test_no_drill_is_guessed_that_could_not_be_given(diameter: str) -> None:
    made = moves(f"{HEAD}G0 X{diameter} Z2.\n{PECKS}G0 Z5.\nM30")
    stock, _ = guessed_stock(made)
    assert not remove(made, stock).tools["T0101"].startswith("drill")


def test_a_tool_that_pecks_at_one_diameter_is_a_drill_of_it() -> None:
    text = f"{HEAD}G0 X12.5 Z2.\n{PECKS}G0 Z5.\nM30"
    assert kind_of(text, "bar:60x60") == "drill:12.5"


FACE_GROOVE = "G21 G99 T0303\nG97 S600 M3\nG0 X40. Z2.\nG74 R0.5\nG74 X44. Z-6. P2000 Q2000 F0.08"


@pytest.mark.parametrize(
    ("kind", "inner", "outer"), [("face-groove:4", 20.0, 26.0), ("face-groove:4-outer", 16.0, 22.0)]
)
def test_a_groove_in_a_face_is_as_wide_as_its_tool_and_its_shift(
    kind: str, inner: float, outer: float
) -> None:
    stock = read_stock("bar:60x40")
    removal = remove(moves(FACE_GROOVE), stock, {"T0303": kind})
    low_z, low_x, high_z, high_x = stock.difference(removal.part).bounds
    assert low_z == -6.0
    assert high_z == 0.0
    assert low_x == inner
    assert high_x == outer
    # The second plunge has 2 mm left.
    assert removal.slices.depth.max() == pytest.approx(4.0)
    assert removal.gouged == {}


@pytest.mark.parametrize("kind", ["face-groove:4-inside", "groove:3-outer", "drill:8-inside"])
def test_a_mark_that_a_tool_does_not_have_is_refused(kind: str) -> None:
    with pytest.raises(NcError, match="no kind of tool"):
        remove(moves(FACE_GROOVE), read_stock("bar:60x40"), {"T0303": kind})
