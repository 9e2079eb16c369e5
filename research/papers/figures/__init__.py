"""The figures of the papers, drawn with the project's own models and controllers: ``python -m research.papers.figures``."""

from collections.abc import Mapping
from typing import Any

from turning_env.extras import needed

with needed():
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch


def lettered(
    size: tuple[float, float], rows: int, columns: int, **options: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure of a size [inch] with panels a, b, ..., row by row; for options see ``Figure.subplots``."""
    figure = Figure(figsize=size, layout="constrained")
    panels = list(figure.subplots(rows, columns, squeeze=False, **options).flat)
    for axes, letter in zip(panels, "abcd", strict=False):
        axes.set_title(letter, loc="left", fontweight="bold")
    return figure, panels


def legend(
    figure: Figure, looks: Mapping[str, dict[str, Any]], columns: int, **options: Any
) -> None:
    """Explain looks by their labels below a figure: areas by their face colour, lines and markers otherwise."""
    handles = [
        Patch(**look, label=label) if "facecolor" in look else Line2D([], [], **look, label=label)
        for label, look in looks.items()
    ]
    figure.legend(handles=handles, **{"loc": "outside lower center"} | options, ncols=columns)
