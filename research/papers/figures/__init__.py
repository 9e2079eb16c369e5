"""The figures of the papers, drawn with the project's own models and controllers.

Run ``python -m research.papers.figures``.
"""

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
    """Return a figure of a size [inch], and its panels a, b, ..., row by row.

    For the options see ``Figure.subplots``.
    """
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(rows, columns, squeeze=False, **options)
    panels = list(grid.flat)
    for axes, letter in zip(panels, "abcd", strict=False):
        axes.set_title(letter, loc="left", fontweight="bold")
    return figure, panels


def legend(
    figure: Figure, looks: Mapping[str, dict[str, Any]], columns: int, **options: Any
) -> None:
    """Explain looks by their labels, below a figure unless the options say otherwise.

    A look with a face colour is an area, any other a line or markers. For the options see
    ``Figure.legend``.
    """
    handles: list[Line2D | Patch] = []
    for label, look in looks.items():
        if "facecolor" in look:
            handles.append(Patch(**look, label=label))
        else:
            handles.append(Line2D([], [], **look, label=label))
    options.setdefault("loc", "outside lower center")
    figure.legend(handles=handles, ncols=columns, **options)
