"""Kinds of tools that are not given: the side that a tool finishes is that of the cycle, or of the metal."""

import pytest

pytest.importorskip("shapely")

from turning_nc.cutting import Machine, Situation, play
from turning_nc.removal import remove
from turning_nc.stock import guessed_stock, read_stock

from shop.tests.turning_nc.test_moves import moves
from turning_env import Scenario

HEAD = "G21 G40 G99\nT0101\nG50 S2500\nG96 S180 M3\n"
NEXT = "G0 X150. Z100.\nT0202\nG96 S220 M3\n"
HUB = "G0 Z-15.\nG1 X30. F0.1\nZ-1.\nX28. Z0."
CYCLES = {
    "G72": f"G0 X64. Z2.\nG72 W2. R0.5\nG72 P1 Q2 U0.4 W0.1 F0.25\n{HUB}",
    "G73": f"G0 X64. Z2.\nG73 U4. W4. R5\nG73 P1 Q2 U0.4 W0.1 F0.25\n{HUB}",
    "G71": "G0 X64. Z2.\nG71 U2. R0.5\nG71 P1 Q2 U0.4 W0.1 F0.25\nG0 X28.\nG1 Z0.\nX30. Z-1.\nZ-15.\nX62.",
    "inside": "G0 X18. Z2.\nG71 U2. R0.5\nG71 P1 Q2 U-0.4 W0.1 F0.25\nG0 X42.\nG1 Z0.\nX40. Z-1.\nZ-15.\nX19.",
}


def finished(cycle: str) -> str:
    """Return a program in which a second tool finishes the contour of a cycle with G70."""
    words, *contour = CYCLES[cycle].rsplit("F0.25\n", 1)
    first, *others = contour[0].split("\n")
    blocks = "\n".join([f"N1 {first}", *others[:-1], f"N2 {others[-1]}"])
    start = words.split("\n")[0]
    return f"{HEAD}{words}F0.25\n{blocks}\n{NEXT}{start}\nG70 P1 Q2\nG0 X150. Z100.\nM30"


@pytest.mark.parametrize("cycle", CYCLES)
def test_a_tool_that_finishes_a_contour_turns_its_side(cycle: str) -> None:
    made = moves(finished(cycle))
    side = "inside" if cycle == "inside" else "outside"
    stock = read_stock("tube:60x20x60" if cycle == "inside" else "bar:60x60")
    removal = remove(made, stock)
    assert removal.tools["T0202"] == side
    situation = Situation(Scenario.load("rough_turning"), Machine(), made, removal)
    finishing = situation.tool == "T0202"
    assert 0.0 < removal.slices.depth[finishing].max() < 1.0
    assert play(situation, 0.1).load[finishing].max() < 0.5
    assert guessed_stock(made)[1].startswith("tube" if cycle == "inside" else "bar")


@pytest.mark.parametrize("block", [HUB, "G0 Z-15.\nG1 X30. F0.1\nZ-0.5\nX29. Z0."])
def test_a_hub_that_is_finished_from_its_back_is_turned_outside(block: str) -> None:
    text = f"{HEAD}G0 X64. Z2.\n{block}\nG0 X64. Z2.\nX150. Z100.\nM30"
    assert remove(moves(text), read_stock("bar:60x60")).tools["T0101"] == "outside"


BORING = "G0 X20. Z2.\nG1 Z-30. F0.2\nX18.\nG0 Z2.\n"


def test_nothing_is_turned_inside_without_a_hole() -> None:
    made = moves(f"{HEAD}{BORING}M30")
    solid = remove(made, read_stock("bar:60x60"))
    assert solid.tools["T0101"] == "outside"
    assert any("no hole" in note and "T0101=KIND" in note for note in solid.notes)
    assert remove(made, read_stock("tube:60x18x60")).tools["T0101"] == "inside"
    assert remove(made, read_stock("bar:60x60"), {"T0101": "inside"}).tools["T0101"] == "inside"


@pytest.mark.parametrize(
    "drill", ["X0. Z2.\nG1 Z-40. F0.1\nG0 Z5.", "X-18. Z2.\nG1 Z-40. F0.1\nG0 Z5."]
)
def test_a_tool_after_a_drill_may_turn_inside(drill: str) -> None:
    made = moves(f"{HEAD}G0 {drill}\n{NEXT}{BORING}M30")
    assert remove(made, read_stock("bar:60x60")).tools["T0202"] == "inside"


PECKS = "G1 Z-5. F0.1\nG0 Z-3.\n" * 3


@pytest.mark.parametrize("diameter", ["0.006", "10000.", "150000."])
def test_no_drill_is_guessed_that_could_not_be_given(diameter: str) -> None:
    made = moves(f"{HEAD}G0 X{diameter} Z2.\n{PECKS}G0 Z5.\nM30")
    stock, _ = guessed_stock(made)
    assert not remove(made, stock).tools["T0101"].startswith("drill")


def test_a_tool_that_pecks_at_one_diameter_is_a_drill_of_it() -> None:
    made = moves(f"{HEAD}G0 X12.5 Z2.\n{PECKS}G0 Z5.\nM30")
    assert remove(made, read_stock("bar:60x60")).tools["T0101"] == "drill:12.5"
