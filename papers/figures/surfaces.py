"""Figure 5 of Alaskari and Oraby (2018): objective and constraints of the second minute in three dimensions."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from papers.figures.contours import limit_handles, limits
from papers.figures.minutes import paper_run, plane, responses, wear_before
from papers.figures.optima import PAPER
from papers.figures.plate import Plate
from turning_env.workshop import plot_style as style

MINUTE = 2
_WITHIN, _BEYOND = style.SKY, "#CCCCCC"
_COLOURED, _LINED = np.s_[::2, :], np.s_[::12, ::15]
"""Those of the plane's points, (feeds, cutting speeds), between which a colour lies, and those that carry a line."""


def draw() -> Figure:
    """Removal rate, wear, force and power over the plane; where a limit is broken, in grey."""
    found = plane(MINUTE)
    panels = {
        "removal rate [cm³/min]": "removal_rate",
        "wear [mm]": "wear",
        "thrust force [N]": "thrust_force",
        "power [kW]": "power",
    }
    pair = paper_run().chosen(wear_before(MINUTE), MINUTE - 1.0)
    assert pair is not None
    chosen = responses(MINUTE, *(np.array([value]) for value in pair))
    edges = [(look, responses(MINUTE, *path.T)) for look, path in limits(MINUTE)]
    figure = Figure(figsize=(style.DOUBLE, 5.4))
    figure.subplots_adjust(left=0.03, right=0.97, bottom=0.11, top=1.03, wspace=0.12, hspace=0.05)
    colours = np.where(found.within[_COLOURED], _WITHIN, _BEYOND)
    for place, (letter, (label, name)) in enumerate(zip("abcd", panels.items(), strict=True), 1):
        axes: Any = figure.add_subplot(2, 2, place, projection="3d", computed_zorder=False)
        surface = (found.speed[_COLOURED], found.feed[_COLOURED], getattr(found, name)[_COLOURED])
        axes.plot_surface(*surface, rstride=1, cstride=1, facecolors=colours, shade=False, linewidth=0.3, rasterized=True)
        lines = (found.speed[_LINED], found.feed[_LINED], getattr(found, name)[_LINED])
        axes.plot_wireframe(*lines, rstride=1, cstride=1, color=style.GREY, linewidth=0.3)
        for look, edge in edges:
            axes.plot(edge.speed, edge.feed, getattr(edge, name), **look)
        axes.plot(*pair, getattr(chosen, name), **style.CHOSEN, zorder=10)
        axes.view_init(elev=24.0, azim=-128.0)
        axes.set_box_aspect(None, zoom=0.9)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.set_pane_color("white")
        axes.set_xticks((50, 100, 150, 200))
        axes.set_yticks((0.1, 0.3, 0.5))
        axes.set_xlabel("cutting speed [m/min]")
        axes.set_ylabel("feed [mm/rev]")
        axes.set_zlabel(label, labelpad=6.0)
        axes.text2D(0.04, 0.88, letter, transform=axes.transAxes, fontweight="bold")
    figure.legend(handles=legend(), loc="lower center", ncols=3)
    return figure


def legend() -> list[Line2D | Patch]:
    """What the colours and lines say."""
    handles: list[Line2D | Patch] = [
        Patch(facecolor=_WITHIN, edgecolor=style.GREY, label="all limits kept"),
        Patch(facecolor=_BEYOND, edgecolor=style.GREY, label="force or power beyond"),
    ]
    return [*handles, *limit_handles(), Line2D([], [], **style.CHOSEN, label="chosen pair")]


PLATES = (
    Plate(
        "grid_search_05",
        f"{PAPER}, Figure 5",
        "Objective and constraints of the second minute over cutting speed and feed: a) removal rate, b) wear at its end, "
        "c) thrust force, d) power. Diamond: the pair that the grid search chooses, the highest of a) that keeps all limits.",
        draw,
        remark='The paper draws "transformed data" without saying how they were transformed: here they are as they are. '
        "Its values at the best feeds are those of Table 2 (grid_search_04).",
    ),
)
