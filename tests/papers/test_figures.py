"""The figures of the papers: fit for print, true to what is played and printed, and written the same every time."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from papers.figures import __main__ as command
from papers.figures import minutes, override, roughness, servo
from papers.figures.paper_figure import PaperFigure
from papers.figures.responses import best_at_each_speed, responses, sides
from papers.reproduce import constant_force, servo_current
from papers.reproduce.alaskari_oraby import rows
from papers.reproduce.checks import Check, claim
from papers.stepped_bar import stepped_bar
from turning_env import Scenario
from turning_render import plot_style as style

DOCS = Path(__file__).parents[2] / "docs" / "figures"
UNITLESS = ("test at fixed speed and feed", "the two limits along which speed and feed are set", "")


@pytest.fixture(autouse=True)
def for_print() -> Iterator[None]:
    with style.for_print():
        yield


@pytest.fixture
def short_plays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two simulations of roughness, a bar of two depths, two seconds of current, all with one seed."""
    monkeypatch.setattr(override, "stepped_bar", lambda depths: stepped_bar((1.0, 3.0), 10.0))
    monkeypatch.setattr(constant_force, "NUM_SEEDS", 1)
    monkeypatch.setattr(constant_force, "SHOWN", ())
    few = constant_force.rows()[:2]
    monkeypatch.setattr(constant_force, "rows", lambda: few)
    monkeypatch.setattr(roughness, "outcomes", constant_force.outcomes.__wrapped__)
    current = servo_current.record(Scenario.load("override_current"), 2.0)
    monkeypatch.setattr(servo, "stepped", lambda: current)
    monkeypatch.setattr(servo, "lines", lambda: (np.array([200.0, 400.0]), np.array([1.8, 2.4]), np.linspace(0.9, 1.1, 4)))


@pytest.mark.soak
@pytest.mark.usefixtures("short_plays")
@pytest.mark.parametrize("name", command.FIGURES)
def test_every_figure_suits_print(name: str) -> None:
    """No title, a unit on every axis that has a label, and nothing too small or wider than a page."""
    figure = command.FIGURES[name].draw()
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
@pytest.mark.parametrize(("minute", "table"), [(1, "table1.csv"), (2, "table2.csv")])
def test_points_lie_on_what_the_paper_prints(minute: int, table: str) -> None:
    feeds = [float(row["feed_mm_rev"]) for row in rows(table)]
    np.testing.assert_allclose(best_at_each_speed(minute).feed, feeds, rtol=1e-12)
    roundings = {"thrust force [N]": 1.0, "power [kW]": 0.01, "wear [mm]": 1e-5, "removal rate [cm³/min]": 0.5}
    for axes in minutes.draw_best(minute).axes:
        ours, _, printed, *_ = axes.lines
        np.testing.assert_allclose(
            np.asarray(ours.get_ydata()), np.asarray(printed.get_ydata()), atol=roundings[axes.get_ylabel()]
        )


@pytest.mark.slow
def test_the_plane_shows_the_chosen_pair_at_the_region_s_edge_and_lines_on_the_limits() -> None:
    for minute, (speed, feed, _) in minutes.STATED.items():
        assert minutes.draw_plane(minute).axes[0].lines[-1].get_xydata()[0] == pytest.approx((speed, feed))
        inside, outside = responses(minute, np.array([speed, speed]), np.array([feed, feed + 0.01])).within
        assert inside
        assert not outside
    assert [sides(minute) for minute in (1, 2, 14, 15)] == [5, 6, 3, 0]
    (look, path), *_ = minutes.limits(14)
    assert look["color"] == style.VERMILLION
    np.testing.assert_allclose(responses(14, *path.T).thrust_force, 1500.0, rtol=1e-3)


@pytest.mark.slow
def test_what_is_said_of_the_grid_search_holds() -> None:
    figures = [figure for figure in command.FIGURES.values() if figure.name.startswith("grid_search")]
    assert all(check.passed for figure in figures for check in figure.checks())
    # All but the flowchart, Figure 1; 13 to 15 are one.
    assert {f"Alaskari and Oraby (2018), Figure {number}" for number in range(2, 13)} <= {figure.source for figure in figures}


@pytest.mark.slow
@pytest.mark.usefixtures("short_plays")
def test_every_law_of_override_is_shown_with_all_its_parameters() -> None:
    rules = {name: rule for name, rule in override._RULES.items() if rule.plays(Scenario.load("override"))}
    assert override.SHOWN.keys() == rules.keys()
    for name, (_, parameters) in override.SHOWN.items():
        assert parameters.keys() == rules[name].ranges.keys()
        for key, values in rules[name].ranges.items():
            assert values.low <= parameters[key] <= values.high
    titles = [title for axes in override.draw().axes if (title := axes.get_title(loc="left"))]
    assert titles == [title for title, _ in override.SHOWN.values()]


def test_the_figures_that_come_with_the_project_are_all_figures() -> None:
    text = (DOCS / command.INDEX).read_text("utf-8")
    assert {path.name for path in DOCS.iterdir()} == {command.INDEX, *(f"{name}.png" for name in command.FIGURES)}
    for name, figure in command.FIGURES.items():
        assert f"## {name}\n\n![{name}]({name}.png)\n\n{figure.caption} ({figure.source}.)\n" in text
        assert (DOCS / f"{name}.png").stat().st_size < 150_000


def test_a_description_says_what_agrees_and_why_not() -> None:
    checks = (claim("a", True), Check("b [N]", 2.0, 3.0, not_reproduced="c is missing"), Check("d", 1.0, 2.0))
    assert PaperFigure("name", "Paper, Figure 1", "Caption.", Figure, lambda: checks, "Remark.").description() == [
        "Caption. (Paper, Figure 1.)",
        "Agrees with the paper: 1 of 3 numbers and claims.",
        "Not reproduced: b [N]: paper 2, project 3; c is missing.",
        "Mismatch: d: paper 1, project 2.",
        "Remark.",
    ]


@pytest.fixture
def two_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    def draw() -> Figure:
        figure = Figure(figsize=(1.0, 1.0))
        figure.subplots().plot([0.0, 1.0])
        return figure

    figures = {name: PaperFigure(name, "Paper, Figure 1", f"Caption of {name}.", draw) for name in ("one", "two")}
    monkeypatch.setattr(command, "FIGURES", figures)


@pytest.mark.slow
@pytest.mark.usefixtures("two_figures")
def test_figures_and_index_are_written_the_same_every_time(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    written = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        assert command.main(["--out", str(folder), "--format", *style.FORMATS]) == 0
        written.append({path.name: path.read_bytes() for path in folder.iterdir()})
        assert capsys.readouterr().out == f"{folder / 'README.md'}\n"
    assert written[0] == written[1]
    assert written[0].keys() == {"README.md", *(f"{name}.{kind}" for name in ("one", "two") for kind in style.FORMATS)}
    page = written[0]["README.md"].decode()
    assert "![one](one.png)\n\nCaption of one. (Paper, Figure 1.)\n" in page
    assert "Also as [two.svg](two.svg), [two.pdf](two.pdf)." in page
    assert command.main(["--out", str(tmp_path / "some"), "--only", "two"]) == 0
    assert [path.name for path in (tmp_path / "some").iterdir()] == ["two.png"]
    assert capsys.readouterr().out == "two\n  Caption of two. (Paper, Figure 1.)\n"


@pytest.mark.usefixtures("two_figures")
def test_bad_input_is_an_error_of_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--out", str(tmp_path), "--only", "two", "three"]) == 2
    assert capsys.readouterr().err == "error: there is no figure three; there are one, two\n"
    (tmp_path / "file").write_text("")
    assert command.main(["--out", str(tmp_path / "file")]) == 2
    assert "file: File exists" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
