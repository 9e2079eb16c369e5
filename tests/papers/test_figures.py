"""The figures of the papers: fit for print, true to what is played and printed, and written the same every time."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from papers.catalogue import FIGURES
from papers.figures import life, minutes, override
from papers.figures.__main__ import DRAW, INDEX, main
from papers.grid_search import before, responses, sides
from papers.reproduce.alaskari_oraby import STATED
from papers.stepped_bar import stepped_bar
from turning_env import Scenario
from turning_render import plot_style as style

DOCS = Path(__file__).parents[2] / "docs" / "figures"
UNITLESS = ("test at fixed speed and feed", "the two limits along which speed and feed are set", "")


@pytest.fixture(autouse=True)
def for_print() -> Iterator[None]:
    with style.for_print():
        yield


@pytest.mark.soak
@pytest.mark.parametrize("name", DRAW)
def test_every_figure_suits_print(name: str) -> None:
    """No title, a unit on every axis that has a label, and nothing too small or wider than a page."""
    figure = DRAW[name]()
    assert figure.get_suptitle() == ""
    assert figure.get_size_inches()[0] in (style.SINGLE, style.DOUBLE)
    figure.draw_without_rendering()
    page = figure.bbox
    for text in figure.findobj(lambda artist: hasattr(artist, "get_fontsize") and artist.get_visible() and artist.get_text()):
        assert text.get_fontsize() >= style.MIN_FONT, text
    for axes in (axes for axes in figure.axes if axes.axison):
        labels = [axis.get_label_text() for each in ("x", "y", "z") if (axis := getattr(axes, f"{each}axis", None))]
        assert all("[" in label for label in labels if label not in UNITLESS), labels
        box = axes.get_tightbbox()
        assert box is not None
        assert box.x0 > page.x0 - 1.0
        assert box.x1 < page.x1 + 1.0


@pytest.mark.slow
@pytest.mark.parametrize("minute", [1, 2])
def test_points_lie_on_what_the_paper_prints(minute: int) -> None:
    roundings = {"thrust force [N]": 1.0, "power [kW]": 0.01, "wear [mm]": 1e-5, "removal rate [cm³/min]": 0.5}
    for axes in minutes.draw_best(minute).axes:
        ours, _, printed, *_ = axes.lines
        np.testing.assert_allclose(
            np.asarray(ours.get_ydata()), np.asarray(printed.get_ydata()), atol=roundings[axes.get_ylabel()]
        )


@pytest.mark.slow
def test_the_plane_shows_the_chosen_pair_at_the_region_s_edge_and_lines_on_the_limits() -> None:
    for minute, (speed, feed, _) in STATED.items():
        assert minutes.draw_plane(minute).axes[0].lines[-1].get_xydata()[0] == pytest.approx((speed, feed))
        inside, outside = responses(*before(minute), np.array([speed, speed]), np.array([feed, feed + 0.01])).within
        assert inside
        assert not outside
    assert [sides(minute) for minute in (1, 2, 14, 15)] == [5, 6, 3, 0]
    (look, path), *_ = minutes.limits(14)
    assert look["color"] == style.VERMILLION
    np.testing.assert_allclose(responses(*before(14), *path.T).thrust_force, 1500.0, rtol=1e-3)
    speed_axes, feed_axes = life.draw_pairs().axes
    for place, axes in enumerate((speed_axes, feed_axes)):
        assert axes.lines[1].get_xydata().tolist() == [[minute, stated[place]] for minute, stated in STATED.items()]


@pytest.mark.slow
def test_every_law_of_override_is_shown() -> None:
    assert override.SHOWN.keys() == {name for name, rule in override.RULES.items() if rule.plays(Scenario.load("override"))}
    titles = [axes.get_title(loc="left") for axes in override.draw(stepped_bar((1.0, 3.0), 10.0)).axes]
    assert [title for title in titles if title] == [title for title, _ in override.SHOWN.values()]


def test_the_figures_that_come_with_the_project_are_all_figures() -> None:
    assert DRAW.keys() == FIGURES.keys()
    assert {path.name for path in DOCS.iterdir()} == {INDEX, *(f"{name}.png" for name in FIGURES)}
    assert max((DOCS / f"{name}.png").stat().st_size for name in FIGURES) < 150_000


@pytest.mark.slow
def test_a_figure_is_written_the_same_every_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        assert main(["--out", str(folder), "--only", "part_programming_psi", "--format", *style.FORMATS]) == 0
        written.append({path.name: path.read_bytes() for path in folder.iterdir()})
        assert capsys.readouterr().out.startswith("part_programming_psi\n  The gain psi")
    assert written[0] == written[1]
    assert written[0].keys() == {f"part_programming_psi.{kind}" for kind in style.FORMATS}
