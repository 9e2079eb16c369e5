from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from papers.figures import __main__ as command
from papers.figures import catalogue, contours, index, life, minutes, optima, override, roughness, servo
from papers.figures.plate import Plate
from papers.reproduce import constant_force, servo_current
from papers.reproduce.alaskari_oraby import rows, whole_run
from papers.reproduce.checks import Check, claim
from papers.stepped_bar import stepped_bar
from turning_env import Scenario
from turning_env.workshop import plot_style as style

DOCS = Path(__file__).parents[2] / "docs" / "figures"
QUICK = [name for name in catalogue.PLATES if name.startswith("grid_search") or name == "part_programming_psi"]
SLOW = [name for name in catalogue.PLATES if name not in QUICK]


@pytest.fixture(autouse=True)
def for_print() -> Iterator[None]:
    with style.for_print():
        yield


@pytest.fixture
def short_plays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two simulations of roughness, a bar of two depths, two seconds of current, all on one draw; other tests see none of it."""
    monkeypatch.setattr(override, "stepped_bar", lambda depths: stepped_bar((1.0, 3.0), 10.0))
    monkeypatch.setattr(constant_force, "DRAWS", 1)
    monkeypatch.setattr(constant_force, "SHOWN", ())
    few = constant_force.rows()[:2]
    monkeypatch.setattr(constant_force, "rows", lambda: few)
    monkeypatch.setattr(roughness, "outcomes", constant_force.outcomes.__wrapped__)
    current = servo_current.record(Scenario.load("override_current"), 2.0)
    monkeypatch.setattr(servo, "stepped", lambda: current)
    monkeypatch.setattr(servo, "lines", lambda: (np.array([200.0, 400.0]), np.array([1.8, 2.4]), np.linspace(0.9, 1.1, 4)))


def check_for_print(figure: Figure) -> None:
    """No title, a unit on every axis that has a label, and nothing too small or wider than a page."""
    assert figure.get_suptitle() == ""
    width, _ = figure.get_size_inches()
    assert width in (style.SINGLE, style.DOUBLE)
    figure.draw_without_rendering()
    page = figure.bbox
    for text in figure.findobj(lambda artist: hasattr(artist, "get_fontsize") and artist.get_visible() and artist.get_text()):
        assert text.get_fontsize() >= style.MIN_FONT, text
    for axes in figure.axes:
        if not axes.axison:
            continue
        labels = [axis.get_label_text() for name in ("x", "y", "z") if (axis := getattr(axes, f"{name}axis", None))]
        unitless = ("test at fixed speed and feed", "the two limits along which speed and feed are set", "")
        assert all("[" in label for label in labels if label not in unitless), labels
        box = axes.get_tightbbox()
        assert box is not None
        assert box.x0 > page.x0 - 1.0
        assert box.x1 < page.x1 + 1.0


@pytest.mark.parametrize("name", QUICK)
def test_every_quick_figure_suits_print(name: str) -> None:
    check_for_print(catalogue.PLATES[name].draw())


@pytest.mark.usefixtures("short_plays")
@pytest.mark.parametrize("name", SLOW)
def test_every_slow_figure_suits_print(name: str) -> None:
    check_for_print(catalogue.PLATES[name].draw())


@pytest.mark.parametrize(("minute", "table"), optima.TABLES.items())
def test_points_lie_on_what_the_paper_prints(minute: int, table: str) -> None:
    found = minutes.best_at_each_speed(minute)
    np.testing.assert_allclose(found.feed, [float(row["feed_mm_rev"]) for row in rows(table)], rtol=1e-12)
    drawn = {axes.get_ylabel(): axes.lines for axes in optima.draw(minute).axes}
    for label, rounding in (
        ("thrust force [N]", 1.0),
        ("power [kW]", 0.01),
        ("wear [mm]", 1e-5),
        ("removal rate [cm³/min]", 0.5),
    ):
        ours, _, printed, *_ = drawn[label]
        np.testing.assert_allclose(np.asarray(ours.get_ydata()), np.asarray(printed.get_ydata()), atol=rounding)


def test_life_is_drawn_as_played() -> None:
    force, power, rate = life.draw_responses().axes
    for axes, name in ((force, "thrust_force"), (power, "power"), (rate, "removed")):
        assert list(axes.lines[0].get_ydata()) == [getattr(interval, name) for interval in whole_run()]
    assert life.stated("cutting speed") == {1: 150.0, 2: 140.0, 14: 200.0}
    speed, feed = life.draw_pairs().axes
    for axes in (speed, feed):
        ours, stated = (dict(zip(*line.get_data(), strict=True)) for line in axes.lines)
        assert stated == pytest.approx({minute: ours[minute] for minute in stated})


def test_the_plane_shows_the_pair_that_is_chosen_at_the_region_s_edge() -> None:
    for minute, pair in ((1, (150.0, 0.58)), (2, (140.0, 0.58)), (14, (200.0, 0.205))):
        assert contours.draw(minute).axes[0].lines[-1].get_xydata()[0] == pytest.approx(pair)
        speed, feed = pair
        inside, outside = minutes.responses(minute, np.array([speed, speed]), np.array([feed, feed + 0.01])).within
        assert inside
        assert not outside
    assert [minutes.sides(minute) for minute in (1, 2, 14, 15)] == [5, 6, 3, 0]


def test_lines_of_limits_lie_on_the_limits() -> None:
    (look, path), *_ = contours.limits(14)
    assert look["color"] == style.VERMILLION
    np.testing.assert_allclose(minutes.responses(14, *path.T).thrust_force, 1500.0, rtol=1e-3)


@pytest.mark.parametrize("name", [name for name in QUICK if name.startswith("grid_search")])
def test_what_is_said_of_the_grid_search_holds(name: str) -> None:
    assert all(check.passed for check in catalogue.PLATES[name].checks())


def test_all_figures_of_the_grid_search_paper_are_there() -> None:
    """All but the flowchart, Figure 1; 13 to 15 are one."""
    assert {f"Alaskari and Oraby (2018), Figure {number}" for number in range(2, 13)} <= {
        plate.source for plate in catalogue.PLATES.values()
    }


def test_the_figures_that_come_with_the_project_are_those_of_the_catalogue() -> None:
    text = (DOCS / index.NAME).read_text("utf-8")
    assert {path.name for path in DOCS.iterdir()} == {index.NAME, *(f"{name}.png" for name in catalogue.PLATES)}
    for name, plate in catalogue.PLATES.items():
        assert f"## {name}\n\n![{name}]({name}.png)\n\n{plate.caption} ({plate.source}.)\n" in text
        assert (DOCS / f"{name}.png").stat().st_size < 150_000


def test_agreement_says_what_agrees_and_why_not() -> None:
    checks = (claim("a", True), Check("b [N]", 2.0, 3.0, not_reproduced="c is missing"), Check("d", 1.0, 2.0))
    plate = Plate("name", "Paper, Figure 1", "Caption.", Figure, lambda: checks, "Remark.")
    assert index.described(plate) == [
        "Caption. (Paper, Figure 1.)",
        "Agrees with the paper: 1 of 3 figures and claims.",
        "Not reproduced: b [N]: paper 2, project 3; c is missing.",
        "Mismatch: d: paper 1, project 2.",
        "Remark.",
    ]


@pytest.fixture
def two_plates(monkeypatch: pytest.MonkeyPatch) -> None:
    def draw() -> Figure:
        figure = Figure(figsize=(1.0, 1.0))
        figure.subplots().plot([0.0, 1.0])
        return figure

    plates = {name: Plate(name, "Paper, Figure 1", f"Caption of {name}.", draw) for name in ("one", "two")}
    monkeypatch.setattr(catalogue, "PLATES", plates)


@pytest.mark.usefixtures("two_plates")
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


@pytest.mark.usefixtures("two_plates")
def test_some_figures_are_drawn_without_the_index(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--out", str(tmp_path), "--only", "two"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["two.png"]
    assert capsys.readouterr().out == "two\n  Caption of two. (Paper, Figure 1.)\n"


@pytest.mark.usefixtures("two_plates")
def test_bad_input_is_an_error_of_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--out", str(tmp_path), "--only", "two", "three"]) == 2
    assert capsys.readouterr().err == "error: there is no figure three; there are one, two\n"
    (tmp_path / "file").write_text("")
    assert command.main(["--out", str(tmp_path / "file")]) == 2
    assert "file: File exists" in capsys.readouterr().err
    with pytest.raises(ValueError, match=r"its suffix must be \.png or \.svg or \.pdf"):
        style.save(Figure(), tmp_path / "one.gif")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.usefixtures("two_plates")
def test_an_interruption_leaves_whole_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save = style.save

    def interrupted(figure: Figure, path: Path) -> None:
        if path.name == "two.png":
            raise KeyboardInterrupt
        save(figure, path)

    monkeypatch.setattr(style, "save", interrupted)
    assert command.main(["--out", str(tmp_path)]) == 130
    assert [path.name for path in tmp_path.iterdir()] == ["one.png"]
