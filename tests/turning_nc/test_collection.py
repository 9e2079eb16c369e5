"""The collection: the same moves and times as LinuxCNC, the metal of the polygons, and shorter times at equal limits."""

import itertools
import math
import re
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely")

from examples.adapt_programs import COLLECTION, WEAR, path_of, situation_of
from tests.turning_nc.linuxcnc import INSTALLED, Canonical, canonical, translated
from turning_nc.adapt import adapt, schedule
from turning_nc.cutting import Machine, motion, play
from turning_nc.report import summary
from turning_nc.stock import volume

WITHOUT_CYCLES = [name for name, entry in COLLECTION.items() if not entry.get("cycles")]
QUICK = ("inch_bar", "grooves_in_sub_program", "feed_per_minute", "welle", "gewinde", "abspanen")


@pytest.mark.skipif(not INSTALLED, reason="LinuxCNC is not installed")
@pytest.mark.parametrize("name", WITHOUT_CYCLES)
def test_moves_and_times_are_those_of_linuxcnc(name: str, tmp_path: Path) -> None:
    situation = situation_of(name, Machine(max_spindle_speed=1e9, tool_change=0.0))
    moves = situation.moves
    reference = canonical(translated(path_of(name).read_text(), moves.program.dialect.name), tmp_path)
    expected: list[Canonical] = []
    here = reference[0].end  # the first moves to where our tool stands before the program
    for move in reference[1:]:
        if move.kind == "dwell" or move.centre is not None or math.dist(here, move.end) > 1e-6:
            expected.append(move)
            here = move.end
    assert len(moves.moves) == len(expected)
    for ours, theirs in zip(moves.moves, expected, strict=True):
        assert ours.path.end == pytest.approx(theirs.end, abs=1e-3), ours.line
        assert (ours.path.centre is None) == (theirs.centre is None)
        if theirs.centre is not None:
            assert ours.path.centre == pytest.approx(theirs.centre, abs=1e-3)
            assert ours.path.clockwise == theirs.clockwise
    time = motion(situation, situation.feed, situation.speed)[0].sum()
    assert time == pytest.approx(sum(move.time for move in expected), rel=0.02)


@pytest.mark.parametrize("name", COLLECTION)
def test_removed_metal_is_the_difference_of_the_polygons(name: str) -> None:
    removal = situation_of(name).removal
    assert removal.slices.volume.sum() == pytest.approx(volume(removal.stock) - volume(removal.part), rel=1e-3)
    assert removal.notes == ()


@pytest.mark.parametrize("name", [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in COLLECTION])
@pytest.mark.parametrize("where", ["words", "blocks"])
def test_an_adapted_program_differs_in_words_of_feed_and_speed_alone(name: str, where: str) -> None:
    situation = situation_of(name)
    adapted = adapt(situation, WEAR, where)  # type: ignore[arg-type]
    before = situation.moves.program.text
    number = r"\d+\.?\d*"
    if where == "words":  # same lines, in which only numbers of F, S, and CYCLE95's feeds differ
        pairs = list(zip(before.split("\n"), adapted.text.split("\n"), strict=True))
        for old, new in pairs:
            blank = rf"(?<=[FS]){number}" if "CYCLE95" not in old else number
            assert re.sub(blank, "#", old) == re.sub(blank, "#", new)
    else:
        for old, new in zip(before.split("\n"), adapted.text.split("\n"), strict=True):
            if "CYCLE95" not in old:
                assert re.sub(rf" ?[FS]{number}", "", old) == re.sub(rf" ?[FS]{number}", "", new)
    first, second = play(situation, WEAR), adapted.played
    assert second.load.max() <= 1.001
    assert second.used_life.sum() <= first.used_life.sum() * 1.001
    assert second.wear.max() <= first.wear.max() * 1.001


@pytest.mark.slow
def test_the_collection_takes_a_tenth_less_time_at_equal_limits() -> None:
    before = after = 0.0
    for name in COLLECTION:
        situation = situation_of(name, Machine(max_feed=0.4))
        first = summary(situation, play(situation, WEAR))
        second = adapt(situation, WEAR)
        if first.max_load <= 1.0:  # others do not keep the limits
            before += first.time
            after += summary(second.situation, second.played).time
    assert after < 0.9 * before


@pytest.mark.parametrize("name", ["flange", "welle"])
def test_a_schedule_by_position_keeps_limits_and_is_shortest(name: str) -> None:
    situation = situation_of(name)
    before, blocks = play(situation, WEAR), adapt(situation, WEAR, "blocks").played
    sections, played = schedule(situation, WEAR)
    assert played.load.max() <= 1.001
    assert played.used_life.sum() <= before.used_life.sum() * 1.001
    assert played.time.sum() <= 1.001 * blocks.time.sum()
    here = [each for each in sections if each.line == sections[-1].line]
    assert all(first.z[1] == second.z[0] for first, second in itertools.pairwise(here))
    assert {each.line for each in sections} == set(situation.line[situation.engaged].tolist())


def test_finishing_keeps_its_feed() -> None:
    situation = situation_of("stepped_shaft")
    adapted = adapt(situation, WEAR)
    assert "F0.12" in adapted.text
    assert not any(change.before == "F0.12" for change in adapted.changes)


def test_an_overload_is_found_and_removed() -> None:
    situation = situation_of("flange")
    first = play(situation, WEAR)
    assert set(situation.line[first.load > 1.0]) == {23}
    adapted = adapt(situation, WEAR, "blocks")
    assert np.all(adapted.played.load <= 1.001)
    assert adapted.played.time.sum() < first.time.sum()
