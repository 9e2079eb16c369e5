"""The gallery: numbers from courses made by hand, pictures that apply, and the command line."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from leaderboard import behaviour, gallery
from leaderboard.__main__ import main
from leaderboard.behaviour import HABITS, Course
from leaderboard.contestants import Contestant
from leaderboard.gallery import limits, operating_point
from leaderboard.oracles import references
from leaderboard.result import ResultError
from leaderboard.trajectories import record
from tests.leaderboard.conftest import Steady, contestant, record_of
from turning_env import Scenario

BAR = {"bar_length": 100.0, "approach": 5.0}
MakeCourse = Callable[..., Course]


@pytest.fixture
def make_course() -> MakeCourse:
    """A course along three bars, in intervals of 5 mm and a second, at 100 m/min and 0.2 mm/rev but for what is given."""

    def make(**series: Any) -> Course:
        path = np.arange(5.0, 3 * 105.0 + 0.1, 5.0)
        metal = path % 105.0 > 5.0
        metal |= path % 105.0 == 0.0
        plain = {
            "path": path,
            "minutes": np.arange(1, len(path) + 1) / 60.0,
            "depth_of_cut": 2.5 * metal,
            "hardness": 1.0 * metal,
            "cutting_speed": 100.0,
            "feed": 0.2,
            "thrust_force": 750.0 * metal,
            "power": 3.5 * metal,
            "wear": 0.1,
            "used_life": np.linspace(0.0, 1.0, len(path)),
            "engaged_time": 1.0 * metal,
            "removed": 2.0 * metal,
            "edges_used": 1.0 / len(path),
            "overload_time": 0.0,
            "severe_overload_time": 0.0,
        }
        scenario = Scenario.model_validate({"workpiece": BAR})
        return Course(7, scenario, {name: np.broadcast_to(values, path.shape) for name, values in (plain | series).items()})

    return make


def test_an_edge_is_counted_by_what_is_used_of_it(make_course: MakeCourse) -> None:
    course = make_course()
    assert behaviour.habits([course])["minutes_per_edge"] == pytest.approx(63 / 60)
    assert behaviour.habits([course])["removed_per_edge"] == pytest.approx(2.0 * 60)
    half = make_course(edges_used=0.5 / 63)
    assert behaviour.habits([course, half])["minutes_per_edge"] == pytest.approx(2 * 63 / 60 / 1.5)
    assert math.isnan(behaviour.habits([make_course(edges_used=0.0)])["minutes_per_edge"])


def test_fifths_are_of_life_and_weighted_by_cutting_time(make_course: MakeCourse) -> None:
    used = np.where(np.arange(63) < 42, 0.1, 0.9)
    course = make_course(used_life=used, cutting_speed=np.where(used < 0.5, 150.0, 190.0), feed=np.arange(63.0))
    speeds = behaviour.fifths([course], "cutting_speed")
    np.testing.assert_allclose(speeds, [150.0, np.nan, np.nan, np.nan, 190.0])
    of_policy = behaviour.habits([course])
    assert (of_policy["first_cutting_speed"], of_policy["last_cutting_speed"]) == (150.0, 190.0)
    engaged = course.cutting * np.where(np.arange(63) == 1, 3.0, 1.0)  # path 10 mm, in metal
    weighted = make_course(used_life=used, feed=np.arange(63.0), engaged_time=engaged)
    in_metal = np.flatnonzero(course.cutting & (used < 0.5))
    assert behaviour.habits([weighted])["first_feed"] == pytest.approx((in_metal.sum() + 2 * 1) / (len(in_metal) + 2))


def test_overload_is_a_share_of_cutting_time(make_course: MakeCourse) -> None:
    over, severe = np.zeros(63), np.zeros(63)
    over[10:16], severe[10:13] = 1.0, 1.0
    of_policy = behaviour.habits([make_course(overload_time=over, severe_overload_time=severe), make_course()])
    assert of_policy["overload_share"] == pytest.approx(100 * 6 / 120)
    assert of_policy["severe_overload_share"] == pytest.approx(100 * 3 / 120)


def test_feed_at_entry_is_that_of_later_bars_at_their_start(make_course: MakeCourse) -> None:
    path = make_course()["path"]
    # Bars start at 5, 110 and 215 mm. What is 10 mm before the third, still deep in the second, counts there too.
    deep = (0.4 * 12 - 0.1) / 12 + 0.4
    slow = np.isin(path, [5.0, 110.0, 215.0])
    before = np.isin(path, [100.0, 205.0])
    of_policy = behaviour.habits([make_course(feed=0.4 - 0.3 * slow - 0.1 * before)])
    assert of_policy["feed_before_entry"] == pytest.approx(100 * 0.6 / deep)
    assert of_policy["feed_at_entry"] == pytest.approx(100 * 0.2 / deep)
    assert of_policy["feed_after_entry"] == pytest.approx(100 * 0.8 / deep)
    first_bar_only = behaviour.habits([make_course(feed=np.where(path == 5.0, 0.1, 0.4))])
    assert first_bar_only["feed_at_entry"] == pytest.approx(100.0)


def test_entries_need_long_bars_and_short_intervals(make_course: MakeCourse) -> None:
    course = make_course()
    assert [bar for bar, _, _ in course.entries()] == [1, 2]
    coarse = Course(7, course.scenario, {name: values[::3] for name, values in course.series.items()})
    assert not list(coarse.entries())
    short = Scenario.model_validate({"workpiece": BAR | {"bar_length": 40.0}})
    assert not list(Course(7, short, course.series).entries())


def test_table_and_json_hold_every_number(make_course: MakeCourse) -> None:
    played = {"one": [make_course()], "two": [make_course(used_life=0.1, feed=0.3)]}
    lines = behaviour.render(played).splitlines()
    assert lines[0].split() == ["one", "two"]
    assert len(lines) == 1 + len(HABITS)
    assert len(set(map(len, lines))) == 1
    told = json.loads(json.dumps(behaviour.as_json(played), allow_nan=False))
    assert told["two"]["first_feed"] == pytest.approx(0.3)
    assert told["two"]["last_feed"] is None
    assert set(told["one"]) == {habit.name for habit in HABITS}


def test_courses_are_what_trajectories_record(scenario: Scenario) -> None:
    player = contestant("steady", (0.1, 0.2))
    course = Course.of(player, scenario, 7)
    recorded = record(player.policy, player.make, scenario, 7).series
    for name in ("minutes", "path", "feed", "power", "wear"):
        np.testing.assert_allclose(course[name], recorded[name], rtol=1e-3)


def test_every_picture_is_drawn(make_course: MakeCourse, tmp_path: Path) -> None:
    courses = {"one": [make_course(), make_course()], "two": [make_course(power=8.0)]}
    written = gallery.write(courses, tmp_path / "new")
    assert [path.name for path in written] == list(gallery.PICTURES)
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == sorted(gallery.PICTURES)
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in written)


def test_titles_say_what_is_seen(make_course: MakeCourse) -> None:
    moving = make_course(cutting_speed=np.linspace(100.0, 200.0, 63))
    figure = operating_point.draw({"moves": [moving], "rests": [make_course()]})
    assert figure is not None
    titles = [axes.get_title(loc="left") for axes in figure.axes[:2]]
    assert titles[0].startswith("moves\nfrom 11")
    assert titles[1] == "rests\nstays at\n100 m/min, 0.20 mm/rev"
    figure = limits.draw({"over": [make_course(power=8.0)]})
    assert figure is not None
    texts = [axes.get_legend().get_texts()[0].get_text() for axes in figure.axes]
    assert texts == ["over: 0.0 % above", "over: 100.0 % above"]


@pytest.mark.parametrize(
    ("preset", "control", "actions", "drawn"),
    [
        ("override", {"time_limit": 0.02}, 1, {"limits.png", "used_life.png"}),
        ("batch_casting", {}, None, {"used_life.png"}),
        ("rough_turning", {"time_limit": 0.02}, 2, {"used_life.png"}),  # one interval, in air
    ],
)
def test_pictures_that_do_not_apply_are_left_out(
    preset: str, control: dict[str, float], actions: int | None, drawn: set[str], tmp_path: Path
) -> None:
    values = Scenario.load(preset).model_dump()
    values["control"] |= control
    if preset == "rough_turning":
        values["workpiece"]["approach"] = 50.0
    scenario = Scenario.model_validate(values)
    size = actions or 2 + 2 * scenario.control.passes_max
    steady = Contestant(record_of("steady"), lambda num_envs: Steady(num_envs, (0.0,) * size))  # type: ignore[arg-type]
    courses = gallery.play([steady], scenario, [7])
    assert {path.name for path in gallery.write(courses, tmp_path)} == drawn


def test_what_cannot_be_drawn_is_refused(scenario: Scenario) -> None:
    with pytest.raises(ResultError, match="nothing to draw"):
        gallery.play([], scenario, [7])
    with pytest.raises(ResultError, match=r"7 policies .* at most 6"):
        gallery.play([contestant(f"p{number}") for number in range(7)], scenario, [7])
    with pytest.raises(ResultError, match="causal cannot be drawn"):
        gallery.play([reference for reference in references(scenario) if reference.policy.name == "causal"], scenario, [7])
    with pytest.raises(ResultError, match="wrong cannot play"):
        gallery.play([Contestant(record_of("wrong"), lambda num_envs: Steady(num_envs, (math.nan, 0.0)))], scenario, [7])


def test_a_picture_that_cannot_be_written_is_an_error(make_course: MakeCourse, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ResultError, match=r"operating_point\.png cannot be written"):
        gallery.write({"one": [make_course()]}, tmp_path / "file")


def test_command(scenario: Scenario, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    scenario.save(tmp_path / "short.toml")
    common = ["gallery", "--scenario", str(tmp_path / "short.toml"), "--draws", "1", "--out", str(tmp_path / "pictures")]
    assert main([*common, "--policies", "fixed_handbook"]) == 0
    printed = capsys.readouterr().out
    assert f"wrote {tmp_path / 'pictures' / 'used_life.png'}" in printed
    assert "not drawn, as there is nothing of it to see: bar_entry.png, bars.png" in printed
    assert main([*common, "--policies", "fixed_handbook", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["draws"] == [2_000_000_000]
    assert told["policies"]["fixed_handbook"]["first_feed"] > 0.0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "nothing to draw"),
        (["--policies", "nonsense"], "no policy is called nonsense"),
        (["--agents", "nowhere.onnx"], "no agent can be loaded from nowhere.onnx"),
        (["--scenario", "nonsense"], "nonsense"),
    ],
)
def test_bad_input_gets_a_message(arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gallery", "--out", str(tmp_path), *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
