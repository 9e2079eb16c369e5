"""The figures of the papers: complete, true to the printed numbers, and the same every time."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from research.papers.catalogue import FIGURES
from research.papers.figures import minutes
from research.papers.figures.__main__ import DRAW, INDEX, main
from turning_env.rendering import plot_style as style

DOCS = Path(__file__).parents[3] / "docs" / "figures"


@pytest.fixture(autouse=True)
def for_print() -> Iterator[None]:
    with style.for_print():
        yield


@pytest.mark.slow
@pytest.mark.parametrize("minute", [1, 2])
def test_points_lie_on_what_the_paper_prints(minute: int) -> None:
    roundings = {
        "thrust force [N]": 1.0,
        "power [kW]": 0.01,
        "wear [mm]": 1e-5,
        "removal rate [cm³/min]": 0.5,
    }
    panels = minutes.draw_best(minute).axes
    assert [axes.get_ylabel() for axes in panels] == list(roundings)
    for axes, rounding in zip(panels, roundings.values(), strict=True):
        ours, _, printed, *_ = axes.lines
        ours_values = np.asarray(ours.get_ydata())
        printed_values = np.asarray(printed.get_ydata())
        np.testing.assert_allclose(ours_values, printed_values, atol=rounding)


def test_the_figures_that_come_with_the_project_are_all_figures() -> None:
    files = {f"{name}.png" for name in FIGURES}
    assert DRAW.keys() == FIGURES.keys()
    assert {path.name for path in DOCS.iterdir()} == files | {INDEX}
    assert max((DOCS / file).stat().st_size for file in files) < 150_000


@pytest.mark.slow
def test_a_figure_is_written_the_same_every_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        arguments = ["--out", str(folder), "--only", "part_programming_psi"]
        arguments += ["--format", *style.FORMATS]
        assert main(arguments) == 0
        assert capsys.readouterr().out.startswith("part_programming_psi\n  The gain psi")
        written.append({path.name: path.read_bytes() for path in folder.iterdir()})
    first, second = written
    assert first == second
    assert first.keys() == {f"part_programming_psi.{kind}" for kind in style.FORMATS}
