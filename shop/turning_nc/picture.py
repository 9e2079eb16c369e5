"""Draw a program: stock, part and passes coloured by load, and the load over time."""

from typing import Any

import numpy as np
from turning_nc.cutting import Play, Situation

from turning_env.extras import needed

with needed():
    import shapely
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LinearSegmentedColormap, Normalize
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

from turning_env.rendering.plot_style import BLUE, GREY, LIGHT, LIMIT, ORANGE, VERMILLION

_LOADS = LinearSegmentedColormap.from_list("loads", ["#9ECAE1", BLUE, ORANGE, VERMILLION])
_PART = "#B0B0B0"
_ABOVE: dict[str, Any] = {
    "loc": "lower center",
    "bbox_to_anchor": (0.5, 1.0),
    "ncols": 3,
    "fontsize": "small",
    "frameon": False,
}
"""Place of a legend: above its panel."""
_TOP = 1.5  # load at which the colours end


def draw(situation: Situation, played: Play, title: str) -> Figure:
    """Draw the stock and the passes above, and both loads over time below."""
    figure = Figure(figsize=(9.0, 7.4), layout="constrained")
    above, below = figure.subplots(2, 1, height_ratios=(3, 2))
    removal = situation.removal
    for polygon, colour in ((removal.stock, LIGHT), (removal.part, _PART)):
        for piece in shapely.get_parts(polygon):
            above.fill(*piece.exterior.xy, color=colour, linewidth=0)
            for hole in piece.interiors:
                above.fill(*hole.xy, color="white", linewidth=0)
    slices = removal.slices
    segments = list(np.stack((slices.start, slices.end), axis=1)[situation.fed])
    percent, norm = 100.0 * played.load[situation.fed], Normalize(0.0, 100.0 * _TOP)
    lines = LineCollection(segments, array=percent, cmap=_LOADS, norm=norm, linewidths=1.6)
    above.add_collection(lines)
    rapid = [move.path for move in situation.moves.moves if move.kind == "rapid"]
    above.add_collection(
        LineCollection(
            [(path.start, path.end) for path in rapid], colors=GREY, linewidths=0.4, linestyles=":"
        )
    )
    low_z, low_x, high_z, high_x = shapely.total_bounds([removal.stock, removal.part])
    margin = 0.04 * (high_z - low_z)
    bottom = max(low_x - margin, 0.0) if low_x > 0 else 0.0
    above.set(
        xlim=(low_z - margin, high_z + 3 * margin),
        ylim=(bottom, high_x + 2 * margin),
        aspect="equal",
    )
    above.set(xlabel="Z [mm]", ylabel="X, radius [mm]")
    figure.suptitle(title, x=0.01, horizontalalignment="left", fontsize="medium")
    rapid_mark = Line2D([], [], color=GREY, lw=0.8, ls=":", label="rapid")
    above.legend(
        handles=[Patch(color=LIGHT, label="stock"), Patch(color=_PART, label="part"), rapid_mark],
        **_ABOVE,
    )
    figure.colorbar(
        lines, ax=above, label="load [% of its limit]", shrink=0.8, extend="max", panchor=(0.5, 0.5)
    )
    ends = np.cumsum(played.time)
    times = np.repeat(np.concatenate(([0.0], ends)), 2)[1:-1]
    for name, share, colour in (
        ("thrust force", played.force_share, ORANGE),
        ("power", played.power_share, BLUE),
    ):
        below.plot(times, 100.0 * np.repeat(share, 2), color=colour, linewidth=1.0, label=name)
    below.axhline(100.0, **LIMIT, label="limit")
    below.set(xlim=(0.0, max(ends[-1], 1e-3)), xlabel="time [s]", ylabel="load [% of its limit]")
    below.set_ylim(bottom=0.0)
    below.legend(**_ABOVE)
    below.spines[["top", "right"]].set_visible(False)
    return figure
