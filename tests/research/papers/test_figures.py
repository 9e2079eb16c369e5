"""The figures of the papers: fit for print, true to what is played and printed, and written the same every time."""

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
    for axes in minutes.draw_best(minute).axes:
        ours, _, printed, *_ = axes.lines
        np.testing.assert_allclose(
            np.asarray(ours.get_ydata()),
            np.asarray(printed.get_ydata()),
            atol=roundings[axes.get_ylabel()],
        )


def test_the_figures_that_come_with_the_project_are_all_figures() -> None:
    assert DRAW.keys() == FIGURES.keys()
    assert {path.name for path in DOCS.iterdir()} == {INDEX, *(f"{name}.png" for name in FIGURES)}
    assert max((DOCS / f"{name}.png").stat().st_size for name in FIGURES) < 150_000


@pytest.mark.slow
def test_a_figure_is_written_the_same_every_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    written = []
    for folder in (tmp_path / "a", tmp_path / "b"):
        assert (
            main(
                ["--out", str(folder), "--only", "part_programming_psi", "--format", *style.FORMATS]
            )
            == 0
        )
        written.append({path.name: path.read_bytes() for path in folder.iterdir()})
        assert capsys.readouterr().out.startswith("part_programming_psi\n  The gain psi")
    assert written[0] == written[1]
    assert written[0].keys() == {f"part_programming_psi.{kind}" for kind in style.FORMATS}
