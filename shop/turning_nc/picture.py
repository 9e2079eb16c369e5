"""Draw a played program: stock, part and passes coloured by load, and the load over time."""

from typing import Any

import numpy as np
from turning_nc.cutting import Play, Situation
from turning_shop.units import METRIC, Unit, Units

from turning_env.extras import needed

with needed():
    import shapely
    from matplotlib.axes import Axes
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LinearSegmentedColormap, Normalize
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

from turning_env.rendering.plot_style import BLUE, GREY, LIGHT, LIMIT, ORANGE, VERMILLION

_LOADS = LinearSegmentedColormap.from_list("loads", ["#9ECAE1", BLUE, ORANGE, VERMILLION])
_PART = "#B0B0B0"
_MAX_COLOURED = 1.5  # load at which the colours end [-]
_ABOVE: dict[str, Any] = {
    "loc": "lower center",
    "bbox_to_anchor": (0.5, 1.0),
    "ncols": 3,
    "fontsize": "small",
    "frameon": False,
}
"""Place of a legend: above its panel."""


def draw(situation: Situation, played: Play, title: str, units: Units = METRIC) -> Figure:
    """Draw the stock and the passes above, and both loads over time below.

    Args:
        situation: a program on its stock.
        played: how it is run.
        title: of the figure.
        units: units of lengths; times and shares of loads have none to convert.
    """
    length = units.unit("mm")
    figure = Figure(figsize=(9.0, 7.4), layout="constrained")
    figure.suptitle(title, x=0.01, horizontalalignment="left", fontsize="medium")
    above, below = figure.subplots(2, 1, height_ratios=(3, 2))
    _draw_metal(above, situation, unit=length)
    passes = _draw_passes(above, situation, played=played, unit=length)
    _draw_rapids(above, situation, unit=length)
    _frame_metal(above, situation, unit=length)
    figure.colorbar(
        passes,
        ax=above,
        label="load [% of its limit]",
        shrink=0.8,
        extend="max",
        panchor=(0.5, 0.5),
    )
    _draw_loads(below, played)
    return figure


def _draw_metal(axes: Axes, situation: Situation, unit: Unit) -> None:
    """Draw the stock, and the part over it; lengths are in a unit."""
    removal = situation.removal
    for polygon, colour in ((removal.stock, LIGHT), (removal.part, _PART)):
        for piece in shapely.get_parts(polygon):
            outline = unit.factor * np.array(piece.exterior.xy)
            axes.fill(*outline, color=colour, linewidth=0)
            for hole in piece.interiors:
                outline = unit.factor * np.array(hole.xy)
                axes.fill(*outline, color="white", linewidth=0)


def _draw_passes(axes: Axes, situation: Situation, played: Play, unit: Unit) -> LineCollection:
    """Draw the moves at feed, coloured by load."""
    slices = situation.removal.slices
    segments = unit.factor * np.stack((slices.start, slices.end), axis=1)[situation.fed]
    passes = LineCollection(
        list(segments),
        array=100.0 * played.load[situation.fed],
        cmap=_LOADS,
        norm=Normalize(0.0, 100.0 * _MAX_COLOURED),
        linewidths=1.6,
    )
    axes.add_collection(passes)
    return passes


def _draw_rapids(axes: Axes, situation: Situation, unit: Unit) -> None:
    segments = []
    for move in situation.moves.moves:
        if move.kind == "rapid":
            ends = np.array((move.path.start, move.path.end))
            segments.append(unit.factor * ends)
    lines = LineCollection(segments, colors=GREY, linewidths=0.4, linestyles=":")
    axes.add_collection(lines)


def _frame_metal(axes: Axes, situation: Situation, unit: Unit) -> None:
    """Set the limits of the panel around the metal, its labels and its legend."""
    removal = situation.removal
    bounds = shapely.total_bounds([removal.stock, removal.part])
    low_z, low_x, high_z, high_x = unit.factor * bounds
    margin = 0.04 * (high_z - low_z)
    bottom = max(low_x - margin, 0.0) if low_x > 0 else 0.0
    axes.set(
        xlim=(low_z - margin, high_z + 3 * margin),
        ylim=(bottom, high_x + 2 * margin),
        aspect="equal",
        xlabel=f"Z [{unit.name}]",
        ylabel=f"X, radius [{unit.name}]",
    )
    handles = [
        Patch(color=LIGHT, label="stock"),
        Patch(color=_PART, label="part"),
        Line2D([], [], color=GREY, lw=0.8, ls=":", label="rapid"),
    ]
    axes.legend(handles=handles, **_ABOVE)


def _draw_loads(axes: Axes, played: Play) -> None:
    """Draw both loads over time, as steps: they are constant over a slice."""
    ends = np.cumsum(played.time)
    borders = np.concatenate(([0.0], ends))
    times = np.repeat(borders, 2)[1:-1]
    for name, share, colour in (
        ("thrust force", played.force_share, ORANGE),
        ("power", played.power_share, BLUE),
    ):
        percent = 100.0 * np.repeat(share, 2)
        axes.plot(times, percent, color=colour, linewidth=1.0, label=name)
    axes.axhline(100.0, **LIMIT, label="limit")
    duration = max(ends[-1], 1e-3)
    axes.set(
        xlim=(0.0, duration),
        xlabel="time [s]",
        ylabel="load [% of its limit]",
    )
    axes.set_ylim(bottom=0.0)
    axes.legend(**_ABOVE)
    axes.spines[["top", "right"]].set_visible(False)
