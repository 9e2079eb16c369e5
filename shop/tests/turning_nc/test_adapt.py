"""Adapted feeds and speeds: surfaces of the part keep their feeds, other tools all their words.

Finishing contours keep one speed, and small changes are left out.
"""

import itertools
import re
from typing import NamedTuple

import pytest

pytest.importorskip("shapely")

from turning_nc.adapt import adapt
from turning_nc.adaptable_words import Where
from turning_nc.cutting import AssumedMachine, Situation, play
from turning_nc.edges import change_wear
from turning_nc.removal import remove
from turning_nc.report import rows
from turning_nc.stock import read_stock
from turning_nc.words import NcError, divide

from shop.tests.turning_nc.programs import moves
from turning_env import Scenario

HEAD = "G21 G99\nG50 S3000\nT0101\nG96 S150 M3\nG0 X62. Z2.\n"
ROUGH = "G1 X56. F0.25\nZ-60.\nG0 X64.\nZ2.\nG1 X52.\nZ-40.\nG0 X64.\nZ2.\n"
# The shoulders that roughing left are up to 4 mm deep, the rest of the contour 0.25 mm.
FINISH = (
    "T0202\nG96 S180\nG0 X40. Z2.\nG1 Z0. F0.12\nX51.5 Z-6.\nZ-40.\nX55.5 Z-45.\nZ-60.\nG0 X64.\n"
)
FINISHING_LINES = range(18, 22)


BOTH = ("T0101", "T0202")
RELEASED = "G1 X51. F0.1\nZ-40.\nX55.\nZ-60.\nG0 X64.\n"
"""A cut behind ROUGH by the same tool that takes its surfaces away."""


def situated(text: str, *described: str, stock: str = "bar:60x80") -> Situation:
    """Return a program on a bar, and the tools that the scenario describes."""
    made = moves(text)
    kinds = {"T0303": "groove:3"} if "T0303" in text else {}
    removal = remove(made, read_stock(stock), kinds)
    scenario = Scenario.load("rough_turning")
    return Situation(scenario, AssumedMachine(), made, removal, described=described)


def adapted_text(text: str, where: Where) -> str:
    """Return a program with other feeds and speeds of both tools."""
    adapted = adapt(situated(text, *BOTH), where=where)
    assert adapted.text != text
    return adapted.text


@pytest.mark.parametrize("where", ["words", "blocks"])
def test_a_finishing_contour_keeps_its_feed_and_one_speed(where: Where) -> None:
    text = adapted_text(HEAD + ROUGH + FINISH, where)
    made = moves(text).moves
    contour = [move for move in made if move.line in FINISHING_LINES]
    assert len(contour) == len(FINISHING_LINES)
    assert {move.feed.value for move in contour} == {0.12}
    assert len({move.speed.value for move in contour}) == 1


def test_words_that_repeat_the_speed_in_a_finishing_contour_change_together() -> None:
    finish = FINISH.replace("Z-40.\n", "Z-40. S180\n").replace("Z-45.\n", "Z-45. S180\n")
    adapted = adapt(situated(HEAD + ROUGH + finish, *BOTH), life=1.5)
    speeds = re.findall(r"S(\d+)", adapted.text)[2:]
    assert len(speeds) == 3
    assert len(set(speeds)) == 1
    assert speeds[0] != "180"


@pytest.mark.parametrize("where", ["words", "blocks"])
def test_speeds_that_the_program_changes_within_a_finishing_contour_stay(where: Where) -> None:
    finish = FINISH.replace("Z-40.\n", "Z-40. S160\n")
    text = adapted_text(HEAD + ROUGH + finish, where)
    made = moves(text).moves
    speeds = [move.speed.value for move in made if move.line in FINISHING_LINES]
    assert speeds == [180.0, 160.0, 160.0, 160.0]


def test_the_report_saves_no_time_in_a_finishing_contour() -> None:
    situation = situated(HEAD + ROUGH + FINISH, *BOTH)
    played = play(situation, change_wear(situation))
    saves = {row.line: row.saves for row in rows(situation, played)}
    assert all(saves[line] == 0.0 for line in FINISHING_LINES)
    assert saves[7] > 1.0


@pytest.mark.parametrize("where", ["words", "blocks"])
def test_an_adapted_program_is_left_alone(where: Where) -> None:
    # Its best values differ by less than 2 %, as words are rounded.
    text = adapted_text(HEAD + ROUGH + FINISH, where)
    again = adapt(situated(text, *BOTH), where=where)
    assert again.text == text
    assert again.changes == ()


def test_a_small_change_that_a_limit_needs_is_made() -> None:
    wear = 0.2
    at_limit = adapt(situated(HEAD + ROUGH + RELEASED), wear).text
    feed = float(re.findall(r"F([\d.]+)", at_limit)[0])
    situation = situated(at_limit.replace(f"F{feed}", f"F{1.012 * feed:.3f}"))
    assert play(situation, wear).load.max() > 1.003
    after = adapt(situation, wear)
    assert after.changes
    assert after.played.load.max() <= 1.001


def test_a_word_is_put_into_blocks_only_where_its_value_is_not_in_force() -> None:
    cuts = "".join(f"X{58 - 2 * number}.\nZ-60.\nG0 X64.\nZ2.\nG1 " for number in range(3))
    text = f"{HEAD}G1 F0.25 {cuts}X62.\nG0 Z2.\nG1 X53. F0.1\nZ-60."
    adapted = adapt(situated(text), where="blocks")
    put_in = [change for change in adapted.changes if not change.before]
    feeds = {move.feed.value for move in moves(adapted.text).moves if move.kind == "feed"}
    # F0.25 and F0.1 stay in the blocks that have them.
    assert len(feeds) <= len({change.after for change in put_in if change.feeds}) + 2
    lines = adapted.text.split("\n")
    for before, after in zip(divide(text).parts[""], lines, strict=True):
        assert after.startswith(before.text)


# Surfaces of the part, and tools that the scenario does not describe.


class Part(NamedTuple):
    """A part that is roughed in several passes, and how its surface is made."""

    faces: bool  # whether its face is turned first
    finisher: str  # tool of the last pass; empty if the last roughing pass makes the surface
    finishing_depth: float  # of the last pass [mm]
    grooves: bool  # whether a grooving tool follows
    length: float  # [mm]

    @property
    def blocks(self) -> list[tuple[str, bool]]:
        """The blocks of the program, and whether each must stay as it is."""
        blocks = [("G21 G99\nG50 S3000\nT0101\nG96 S150 M3", False)]
        if self.faces:
            blocks += [("G0 X62. Z0.", True), ("G1 X-1.6 F0.12", True)]
        blocks.append(("G0 X62. Z2.", True))
        for number, diameter in enumerate((56.0, 52.0)):
            feed = " F0.2" if number == 0 else ""
            blocks.append((f"G1 X{diameter}{feed}", False))
            blocks += [(f"Z-{self.length}", True), ("G0 X64.", True), ("Z2.", True)]
        if self.finisher == "T0202":
            blocks.append(("T0202\nG96 S250", True))
        last = 52.0 - 2.0 * self.finishing_depth
        blocks += [(f"G1 X{last} F0.3", True), (f"Z-{self.length}", True), ("G0 X64.", True)]
        if self.grooves:
            blocks.append(("T0303\nG96 S100\nG0 Z-15.\nG1 X40. F0.1\nG0 X64.", True))
        blocks.append(("G0 Z50.\nM30", True))
        return blocks


PARTS = [
    Part(faces, finisher, depth, grooves, length)
    for faces, finisher, depth, grooves, length in itertools.product(
        (True, False), ("T0101", "T0202"), (0.3, 1.0, 2.0), (True, False), (25.0, 40.0)
    )
]
"""48 parts; in many of them the last pass is deeper than a usual finishing cut."""


@pytest.mark.parametrize(
    "part",
    [part if part.length < 30.0 else pytest.param(part, marks=pytest.mark.slow) for part in PARTS],
)
def test_what_makes_the_surface_and_what_has_no_law_stays(part: Part) -> None:
    text = "\n".join(block for block, _ in part.blocks)
    adapted = adapt(situated(text, stock="bar:60x60+1"))
    lines = adapted.text.split("\n")
    place = 0
    for block, stays in part.blocks:
        count = block.count("\n") + 1
        after = "\n".join(lines[place : place + count])
        place += count
        if stays:
            assert after == block
    assert "F0.2\n" not in adapted.text
    assert adapted.played.time.sum() < play(situated(text), 0.2).time.sum()


def test_a_feed_that_also_roughs_stays_if_its_last_pass_makes_the_surface() -> None:
    text = f"{HEAD}G1 X56. F0.25\nZ-40.\nG0 X64.\nZ2.\nG1 X52.\nZ-40.\nG0 X64."
    assert "F0.25" in adapt(situated(text)).text
    in_blocks = moves(adapt(situated(text), where="blocks").text)
    passes = [move for move in in_blocks.moves if move.kind == "feed" and move.path.end.z == -40.0]
    first, last = passes
    assert first.feed.value > 0.25
    assert last.feed.value == 0.25


def test_a_surface_that_a_later_tool_takes_away_does_not_keep_its_feed() -> None:
    text = f"{HEAD}G1 X52. F0.25\nZ-40.\nG0 X64.\n"
    assert "F0.25" in adapt(situated(text)).text
    assert "F0.25" not in adapt(situated(text + "T0202\nG0 Z2.\nG1 X51. F0.1\nZ-40.")).text


def test_the_feed_of_a_surface_falls_only_to_keep_a_limit() -> None:
    text = f"{HEAD}G1 X44. F0.5\nZ-40.\nG0 X64."
    situation = situated(text)
    assert play(situation, change_wear(situation)).load.max() > 1.1
    adapted = adapt(situation)
    (feed,) = re.findall(r"F([\d.]+)", adapted.text)
    assert float(feed) < 0.5
    assert adapted.played.load.max() <= 1.001


def test_a_tool_that_is_described_may_be_named() -> None:
    text = HEAD + ROUGH + FINISH
    first = adapt(situated(text)).text
    assert "S180" in first
    assert "S150" not in first
    second = adapt(situated(text, "T0202"), life=1.5).text
    assert "S180" not in second
    assert "S150" in second
    assert "F0.25" in second
    with pytest.raises(NcError, match="'T0909' is not in the program"):
        situated(text, "T0909")
