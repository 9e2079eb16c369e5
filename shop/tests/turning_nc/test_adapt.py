"""Adapted feeds and speeds: finishing contours keep one speed, and small changes are left out."""

import re

import pytest

pytest.importorskip("shapely")

from turning_nc.adapt import adapt
from turning_nc.adaptable_words import Where
from turning_nc.cutting import Machine, Situation, play
from turning_nc.edges import change_wear
from turning_nc.removal import remove
from turning_nc.report import rows
from turning_nc.stock import read_stock
from turning_nc.words import divide

from shop.tests.turning_nc.programs import moves
from turning_env import Scenario

HEAD = "G21 G99\nG50 S3000\nT0101\nG96 S150 M3\nG0 X62. Z2.\n"
ROUGH = "G1 X56. F0.25\nZ-60.\nG0 X64.\nZ2.\nG1 X52.\nZ-40.\nG0 X64.\nZ2.\n"
# The shoulders that roughing left are up to 4 mm deep, the rest of the contour 0.25 mm.
FINISH = (
    "T0202\nG96 S180\nG0 X40. Z2.\nG1 Z0. F0.12\nX51.5 Z-6.\nZ-40.\nX55.5 Z-45.\nZ-60.\nG0 X64.\n"
)
FINISHING_LINES = range(18, 22)


def situated(text: str) -> Situation:
    """Return a program on a bar."""
    made = moves(text)
    removal = remove(made, read_stock("bar:60x80"))
    return Situation(Scenario.load("rough_turning"), Machine(), made, removal)


def adapted_text(text: str, where: Where) -> str:
    """Return a program with other feeds and speeds."""
    adapted = adapt(situated(text), where=where)
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
    adapted = adapt(situated(HEAD + ROUGH + finish), life=1.5)
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
    situation = situated(HEAD + ROUGH + FINISH)
    played = play(situation, change_wear(situation))
    saves = {row.line: row.saves for row in rows(situation, played)}
    assert all(saves[line] == 0.0 for line in FINISHING_LINES)
    assert saves[7] > 1.0


@pytest.mark.parametrize("where", ["words", "blocks"])
def test_an_adapted_program_is_left_alone(where: Where) -> None:
    # Its best values differ by less than 2 %, as words are rounded.
    text = adapted_text(HEAD + ROUGH + FINISH, where)
    again = adapt(situated(text), where=where)
    assert again.text == text
    assert again.changes == ()


def test_a_small_change_that_a_limit_needs_is_made() -> None:
    wear = 0.2
    at_limit = adapt(situated(HEAD + ROUGH), wear).text
    feed = float(re.findall(r"F([\d.]+)", at_limit)[0])
    situation = situated(at_limit.replace(f"F{feed}", f"F{1.012 * feed:.3f}"))
    assert play(situation, wear).load.max() > 1.003
    after = adapt(situation, wear)
    assert after.changes
    assert after.played.load.max() <= 1.001


def test_a_word_is_put_into_blocks_only_where_its_value_is_not_in_force() -> None:
    cuts = "".join(f"X{58 - 2 * number}.\nZ-60.\nG0 X64.\nZ2.\nG1 " for number in range(3))
    text = f"{HEAD}G1 F0.25 {cuts}X62."
    adapted = adapt(situated(text), where="blocks")
    put_in = [change for change in adapted.changes if not change.before]
    feeds = {move.feed.value for move in moves(adapted.text).moves if move.kind == "feed"}
    assert len(feeds) <= len({change.after for change in put_in if change.feeds}) + 1
    lines = adapted.text.split("\n")
    for before, after in zip(divide(text).parts[""], lines, strict=True):
        assert after.startswith(before.text)
