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
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from turning_shop.__main__ import main
from turning_shop.advise import cheapest
from turning_shop.allowed import NO_STRENGTH
from turning_shop.plots import draw_map
from turning_shop.prediction import Evidence, LawEvidence
from turning_shop.whatif import what_if

from tests.turning_env.playing import infos
from turning_env import Scenario
from turning_env.action import set_point_action

pytestmark = pytest.mark.slow

BASE = Scenario()
UNLIMITED = {"power": 1e4, "thrust_force": 1e6}


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
    predict = partial(
        what_if,
        BASE,
        speed,
        feed,
        depth_of_cut=depth,
        hardness=hardness,
    )
    worn = predict(wear=0.2)
    again = predict(time=worn.time)
    for name, value in worn._asdict().items():
        assert getattr(again, name) == pytest.approx(value, rel=1e-9), name
    assert predict(time=worn.tool_life).wear_share == pytest.approx(1.0)


SPEEDS = ["--cutting-speed", "120", "150", "165", "180"]
FEEDS = ["--feed", "0.2", "0.3", "0.4"]
WHATIF = ["whatif", "rough_turning", *SPEEDS, *FEEDS]
COMBINATIONS = [*WHATIF, "--wear", "0.1", "0.2", "--depth", "2", "3"]


def test_every_combination_gives_a_row(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*COMBINATIONS, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) == 4 * 3 * 2 * 2
    assert [row["feed"] for row in rows[:3]] == [0.2, 0.3, 0.4]
    assert sorted({row["cutting_speed"] for row in rows}) == [120, 150, 165, 180]


def test_a_csv_table_has_the_numbers_of_the_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*COMBINATIONS, "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert main([*COMBINATIONS, "--csv"]) == 0
    table = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    for row, table_row in zip(rows, table, strict=True):
        assert list(table_row) == list(row)
        assert float(table_row["power"]) == row["power"]


def test_text_names_the_limits_that_are_exceeded(capsys: pytest.CaptureFixture[str]) -> None:
    settings = ["--cutting-speed", "60", "200", "--feed", "0.6", "--time", "200"]
    assert main(["whatif", "rough_turning", *settings]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 4
    assert lines[0].split()[:3] == ["speed", "feed", "depth"]
    assert lines[1].split()[:3] == ["m/min", "mm/rev", "mm"]
    assert lines[2].endswith("wear, thrust")
    assert lines[3].endswith("wear, thrust, power")


def test_text_names_bending_that_goes_too_far(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slender = tmp_path / "slender.toml"
    workpiece = 'support = "chuck"\ndiameter = 30\nbar_length = 300'
    slender.write_text(f'base = "rough_turning"\n[workpiece]\n{workpiece}\n')
    settings = ["--cutting-speed", "100", "--feed", "0.1", "0.4", "--wear", "0.1"]
    assert main(["whatif", str(slender), *settings]) == 0
    printed = capsys.readouterr()
    assert printed.out.splitlines()[-1].endswith("bending")
    assert "the bar bends by" in printed.err


@pytest.fixture(scope="module")
def usual_map() -> Figure:
    """Return the map of the preset's edge, worn to 0.2 mm."""
    return draw_map(BASE, Evidence(), wear=0.2)


def test_the_map_marks_where_most_metal_is_removed(usual_map: Figure) -> None:
    axes, _ = usual_map.axes
    (mark,) = [line for line in axes.lines if line.get_marker() == "D"]
    speed = float(mark.get_xdata()[0])
    feed = float(mark.get_ydata()[0])
    cuts = what_if(BASE, speed, feed, wear=0.2)
    assert cuts.within_limits
    assert max(cuts.power_share, cuts.thrust_force_share) > 0.99
    labels = [text.get_text() for text in axes.texts]
    start = f"{speed:.0f} m/min, {feed:.3g} mm/rev:"
    assert [label for label in labels if label.startswith(start)] != []


def marks_of(figure: Figure) -> dict[str, tuple[float, float]]:
    """Return the marked speeds and feeds by the labels of their markers in the legend."""
    (legend,) = figure.legends
    labels = {}
    for handle in legend.legend_handles:
        if isinstance(handle, Line2D) and handle.get_marker() in ("o", "D"):
            labels[handle.get_marker()] = handle.get_label()
    marks = {}
    for line in figure.axes[0].lines:
        if line.get_marker() in labels:
            place = (float(line.get_xdata()[0]), float(line.get_ydata()[0]))
            marks[labels[line.get_marker()]] = place
    return marks


def test_the_map_marks_the_advised_cut_beside_the_highest_removal_rate() -> None:
    plan = cheapest(BASE, Evidence())
    marks = marks_of(draw_map(BASE, Evidence(), wear=0.2, advised=plan))
    advised = (float(plan.cuts.cutting_speed), float(plan.cuts.feed))
    assert marks["advised, least cost"] == pytest.approx(advised)
    (highest,) = [place for label, place in marks.items() if label.startswith("highest")]
    assert highest != advised


def test_the_map_ends_where_the_spindle_does() -> None:
    scenario = Scenario.load({"spindle": {"max_speed": 400.0}})  # 126 m/min at 100 mm diameter
    figure = draw_map(scenario, Evidence(), wear=0.1)
    assert figure.axes[0].get_xlim()[1] == pytest.approx(np.pi * 40.0)
    (speed, _), *_ = marks_of(figure).values()
    assert speed <= np.pi * 40.0 + 1e-9


def test_a_speed_beyond_the_spindle_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slow = tmp_path / "slow.toml"
    slow.write_text('base = "rough_turning"\n[spindle]\nmax_speed = 400.0\n')
    settings = ["--cutting-speed", "150", "--feed", "0.3", "--wear", "0.1"]
    assert main(["whatif", str(slow), *settings]) == 0
    assert "--cutting-speed 150 is outside" in capsys.readouterr().err


def test_one_mark_shows_the_advised_cut_that_also_removes_most() -> None:
    scenario = Scenario.load(
        {
            "machine": {"cutting_speed_max": 60.0},
            "limits": UNLIMITED,
            "tool": {"edge_strength": NO_STRENGTH},
        }
    )
    plan = cheapest(scenario, Evidence())
    marks = marks_of(draw_map(scenario, Evidence(), wear=0.1, advised=plan))
    ((label, place),) = marks.items()
    assert "advised" in label
    assert "highest removal rate" in label
    assert place == pytest.approx((float(plan.cuts.cutting_speed), float(plan.cuts.feed)))


def test_a_map_without_an_allowed_cut_says_so_in_the_map() -> None:
    scenario = Scenario.load({"limits": {"power": 0.1}})
    axes = draw_map(scenario, Evidence(), wear=0.2).axes[0]
    assert "nowhere within limits" in [text.get_text() for text in axes.texts]


def test_no_edge_of_the_map_cuts_off_a_tool_life(usual_map: Figure) -> None:
    usual_map.draw_without_rendering()
    axes = usual_map.axes[0]
    within = axes.get_window_extent().padded(1.0)
    labels = [text for text in axes.texts if text.get_text().endswith(" min")]
    assert labels
    for label in labels:
        area = label.get_window_extent()
        assert within.contains(*area.min)
        assert within.contains(*area.max)


@pytest.mark.parametrize("preset", ["rough_turning", "forging", "override"])
def test_callouts_cover_no_label_and_no_mark(preset: str) -> None:
    scenario = Scenario.load(preset)
    plan = cheapest(scenario, Evidence())
    figure = draw_map(scenario, Evidence(), wear=0.15, advised=plan)
    figure.draw_without_rendering()
    texts = [text for text in figure.axes[0].texts if text.get_text()]
    callouts = [text for text in texts if "mm/rev" in text.get_text()]
    labels = [text.get_window_extent() for text in texts if text not in callouts]
    boxes = [Text.get_window_extent(text) for text in callouts]
    assert callouts
    assert labels
    for box in boxes:
        assert not any(box.overlaps(label) for label in labels)
    assert not any(boxes[0].overlaps(box) for box in boxes[1:])


@pytest.mark.parametrize("thrust_force", [1500.0, 1e5])
def test_the_legend_shows_what_the_map_holds(thrust_force: float) -> None:
    limits = BASE.limits.model_copy(update={"thrust_force": thrust_force, "power": 1e3})
    tool = BASE.tool.model_copy(update={"edge_strength": NO_STRENGTH})
    scenario = BASE.model_copy(update={"limits": limits, "tool": tool})
    (legend,) = draw_map(scenario, Evidence(), wear=0.2).legends
    labels = " ".join(text.get_text() for text in legend.get_texts())
    assert ("thrust force" in labels) == (thrust_force == 1500.0)
    assert ("exceeded" in labels) == (thrust_force == 1500.0)
    assert "power" not in labels
    assert "extrapolated" not in labels


def test_the_title_is_the_name_of_the_tool() -> None:
    axes, _ = draw_map(BASE, Evidence(tool="CNMG120408-PM P25"), wear=0.2).axes
    assert axes.get_title(loc="left").startswith("CNMG120408-PM P25:")


def test_the_map_labels_removal_rates_at_the_highest_speed(usual_map: Figure) -> None:
    _, axes = usual_map.axes
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
def test_a_star_marks_a_cut_that_extrapolates(
    lowest_speed: float, ending: str, usual_map: Figure
) -> None:
    axes, _ = usual_map.axes
    (mark,) = [line for line in axes.lines if line.get_marker() == "D"]
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


@pytest.mark.filterwarnings("error")
def test_a_fresh_edge_has_cut_for_no_time() -> None:
    cuts = what_if(BASE, 150.0, 0.3, wear=0.0)
    assert cuts.time == 0.0


@pytest.mark.parametrize(
    ("preset", "ending", "start"),
    [
        pytest.param("forging", "png", b"\x89PNG", id="forging as PNG"),
        pytest.param("override", "svg", b"<?xm", id="override as SVG"),
        pytest.param("batch_casting", "svg", b"<?xm", id="batch as SVG"),
    ],
)
def test_maps_are_written(tmp_path: Path, preset: str, ending: str, start: bytes) -> None:
    path = tmp_path / "maps" / f"{preset}.{ending}"
    assert main(["map", preset, "--wear", "0.15", "--hardness", "1.1", "--out", str(path)]) == 0
    assert path.read_bytes().startswith(start)
