"""A figure of a paper with its caption and comparisons, and the parts that figures share: lettered panels and a legend."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from papers.reproduce.checks import Check

GRID_SEARCH = "Alaskari and Oraby (2018)"


@dataclass(frozen=True)
class PaperFigure:
    """One figure."""

    name: str
    """Name of its files, without suffix."""
    source: str
    """Paper and figure that it reproduces."""
    caption: str
    draw: Callable[[], Figure]
    """Called within ``style.for_print``."""
    checks: Callable[[], Iterable[Check]] = tuple
    """Comparisons of values that the paper prints or states with the project's."""
    remark: str = ""
    """Differences that the checks cannot express."""

    def description(self) -> list[str]:
        """Return lines: the caption with its source, how many checks agree, each that does not, and the remark."""
        lines, checks = [f"{self.caption} ({self.source}.)"], list(self.checks())
        if checks:
            agreeing = sum(check.verdict == "ok" for check in checks)
            lines.append(f"Agrees with the paper: {agreeing} of {len(checks)} numbers and claims.")
        for check in checks:
            if check.verdict != "ok":
                values = "" if check.relation == "true" else f" paper {check.paper:.4g}, project {check.ours:.4g};"
                lines.append(f"{check.verdict.capitalize()}: {check.what}:{values} {check.not_reproduced}".rstrip(" ;") + ".")
        return [*lines, self.remark] if self.remark else lines


def lettered(size: tuple[float, float], rows: int, columns: int, **options: Any) -> tuple[Figure, list[Axes]]:
    """Return a figure of a size [inch] with panels a, b, ..., row by row; for options see ``Figure.subplots``."""
    figure = Figure(figsize=size, layout="constrained")
    panels = list(figure.subplots(rows, columns, squeeze=False, **options).flat)
    for axes, letter in zip(panels, "abcd", strict=False):
        axes.set_title(letter, loc="left", fontweight="bold")
    return figure, panels


def legend(figure: Figure, looks: Mapping[str, dict[str, Any]], columns: int, **options: Any) -> None:
    """Explain looks by their labels below a figure: areas by their face colour, lines and markers otherwise."""
    handles = [
        Patch(**look, label=label) if "facecolor" in look else Line2D([], [], **look, label=label)
        for label, look in looks.items()
    ]
    figure.legend(handles=handles, **{"loc": "outside lower center"} | options, ncols=columns)
