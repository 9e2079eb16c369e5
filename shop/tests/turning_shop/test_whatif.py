"""Tables of cuts and operating maps agree with the laws and the environment."""

import csv
import io
import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from turning_shop.plots import draw_map
from turning_shop.prediction import Evidence, LawEvidence
from turning_shop.whatif import what_if

from tests.turning_env.playing import infos
from turning_env import Scenario
from turning_env.__main__ import main
from turning_env.action import set_point_action

BASE = Scenario()


def test_the_environment_says_the_same() -> None:
    scenario = Scenario.load("paper")
    machine = scenario.machine
    speed = set_point_action(150, machine.cutting_speed_min, high=machine.cutting_speed_max)
    feed = set_point_action(0.3, machine.feed_min, high=machine.feed_max)
    action = np.array([speed, feed], np.float32)
    # A step of this scenario takes a minute.
    for minutes, info in enumerate(infos(scenario, [action] * 3), 1):
        cuts = what_if(scenario, 150, 0.3, time=minutes)
        assert cuts.wear == pytest.approx(info["wear"], rel=1e-4)
        assert cuts.thrust_force == pytest.approx(info["thrust_force"], rel=1e-4)
        assert cuts.power == pytest.approx(info["power"], rel=1e-4)
        assert cuts.removal_rate == pytest.approx(info["removed"], rel=1e-4)
        assert cuts.spindle_speed == pytest.approx(info["spindle_speed"], rel=1e-4)


@settings(max_examples=15)
@given(
    speed=st.floats(50, 200),
    feed=st.floats(0.06, 0.6),
    depth=st.floats(0.5, 5),
    hardness=st.floats(0.7, 1.4),
)
def test_time_and_wear_are_two_sides_of_one_law(
    speed: float, feed: float, depth: float, hardness: float
) -> None:
    predict = partial(what_if, BASE, speed, feed, depth_of_cut=depth, hardness=hardness)
    worn = predict(wear=0.2)
    again = predict(time=worn.time)
    for name, value in worn._asdict().items():
        assert getattr(again, name) == pytest.approx(value, rel=1e-9), name
    assert predict(time=worn.tool_life).wear_share == pytest.approx(1.0)


SPEEDS = ["--cutting-speed", "120", "150", "165", "180"]
FEEDS = ["--feed", "0.2", "0.3", "0.4"]
WHATIF = ["whatif", "rough_turning", *SPEEDS, *FEEDS]


def test_every_combination_gives_a_row(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*WHATIF, "--wear", "0.1", "0.2", "--depth", "2", "3", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) == 4 * 3 * 2 * 2
    assert [row["feed"] for row in rows[:3]] == [0.2, 0.3, 0.4]
    assert sorted({row["cutting_speed"] for row in rows}) == [120, 150, 165, 180]
    assert main([*WHATIF, "--wear", "0.1", "0.2", "--depth", "2", "3", "--csv"]) == 0
    table = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert [float(row["power"]) for row in table] == [row["power"] for row in rows]
    assert list(table[0]) == list(rows[0])


def test_text_names_the_limits_that_are_exceeded(capsys: pytest.CaptureFixture[str]) -> None:
    settings = ["--cutting-speed", "60", "200", "--feed", "0.6", "--time", "200"]
    assert main(["whatif", "rough_turning", *settings]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    assert lines[0].split()[:3] == ["speed", "feed", "depth"]
    assert lines[1].split()[:3] == ["m/min", "mm/rev", "mm"]
    assert lines[2].endswith("wear, thrust")
    assert lines[3].endswith("wear, thrust, power")


def test_the_map_marks_where_most_metal_is_removed() -> None:
    axes, _ = draw_map(BASE, Evidence(), wear=0.2).axes
    (mark,) = [line for line in axes.lines if line.get_marker() == "o"]
    speed = float(mark.get_xdata()[0])
    feed = float(mark.get_ydata()[0])
    cuts = what_if(BASE, speed, feed, wear=0.2)
    assert cuts.within_limits
    assert max(cuts.power_share, cuts.thrust_force_share) > 0.99
    labels = [text.get_text() for text in axes.texts]
    start = f"{speed:.0f} m/min, {feed:.3g} mm/rev:"
    assert [label for label in labels if label.startswith(start)] != []


def test_the_map_labels_removal_rates_at_the_highest_speed() -> None:
    _, axes = draw_map(BASE, Evidence(), wear=0.2).axes
    rates = [float(label.get_text()) for label in axes.get_yticklabels()]
    feeds = axes.get_yticks()
    cuts = what_if(BASE, BASE.machine.cutting_speed_max, feeds, wear=0.2)
    assert cuts.removal_rate == pytest.approx(rates, rel=1e-3)


@pytest.mark.parametrize(
    ("lowest_speed", "ending"),
    [
        pytest.param(1.0, "min", id="measured"),
        pytest.param(1.1, "min *", id="below the lowest measured speed"),
    ],
)
def test_a_star_marks_a_cut_that_extrapolates(lowest_speed: float, ending: str) -> None:
    axes, _ = draw_map(BASE, Evidence(), wear=0.2).axes
    (mark,) = [line for line in axes.lines if line.get_marker() == "o"]
    speed = float(mark.get_xdata()[0])
    law = LawEvidence(
        coefficient=1.0,
        terms=(),
        covariance=((0.01,),),
        degrees=5,
        scatter=0.1,
        measured={"cutting_speed": (lowest_speed * speed, 300.0)},
    )
    axes, _ = draw_map(BASE, Evidence(laws={"wear": law}), wear=0.2).axes
    labels = [text.get_text() for text in axes.texts]
    assert [label for label in labels if label.endswith(ending)] != []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("preset", "ending", "start"),
    [
        ("forging", "png", b"\x89PNG"),
        ("override", "svg", b"<?xm"),
        ("batch_casting", "svg", b"<?xm"),
    ],
)
def test_maps_are_written(tmp_path: Path, preset: str, ending: str, start: bytes) -> None:
    path = tmp_path / "maps" / f"{preset}.{ending}"
    assert main(["map", preset, "--wear", "0.15", "--hardness", "1.1", "--out", str(path)]) == 0
    assert path.read_bytes().startswith(start)
