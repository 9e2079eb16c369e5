"""Figures 7 and 10 to 12 of the servo current paper.

They show the feed motor's current, and the force calculated from it.
"""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from research.papers.figures import legend, lettered
from research.papers.reproduce.servo_current import (
    FEED_VELOCITIES,
    SETTINGS,
    currents_of_depths,
    no_load_currents,
    stepped,
)
from turning_env import Scenario
from turning_env.rendering import plot_style as style

_TRUE: dict[str, Any] = {"color": style.BLACK, "linewidth": 1.0}
_PLAIN: dict[str, Any] = {"color": style.SKY, "linewidth": 0.6}
_FILTERED: dict[str, Any] = {"color": style.VERMILLION, "linewidth": 1.2, "linestyle": (0, (5, 1))}


def draw_current() -> Figure:
    """Draw current over force, and idle current over feed velocity."""
    forces, currents = currents_of_depths()
    figure, (left, right) = lettered((style.DOUBLE, 2.5), rows=1, columns=2)
    markers = style.OURS | {"markersize": 4.0}
    points = markers | {"linestyle": "none"}
    left.plot(forces, currents, **points, label="mean measured current")

    # Equations (3) and (8): the current is linear in the force.
    ends = np.array([0.0, forces[-1]])
    fitted = np.polyval(np.polyfit(forces, currents, deg=1), ends)
    left.plot(
        ends,
        fitted,
        color=style.GREY,
        linewidth=0.9,
        linestyle="--",
        zorder=0,
        label="straight line",
    )
    left.set_xlabel("thrust force [N]")
    left.set_ylabel("current [A]")
    left.legend(loc="upper left")

    right.plot(FEED_VELOCITIES, no_load_currents(), **markers)
    right.set_xlabel("feed velocity [mm/min]")
    right.set_ylabel("current at no load [A]")
    for axes in (left, right):
        axes.set_xlim(left=0.0)
        axes.set_ylim(0.0, 1.1 * axes.dataLim.y1)
    return figure


def draw_estimate() -> Figure:
    """Draw the measured current on the stepped bar, and the force calculated from it.

    The true force is beside it.
    """
    kept = stepped()
    interval = Scenario.load("override_current").control.interval
    time = interval * np.arange(1, len(kept.force) + 1)
    figure, (upper, lower) = lettered(
        (style.DOUBLE, 4.0), rows=2, columns=1, sharex=True, height_ratios=(1.0, 1.5)
    )
    # The first of the seeds, and the first of the settings.
    upper.plot(time, kept.current[:, 0], **_PLAIN)
    upper.set_ylabel("current [A]")
    upper.set_ylim(bottom=0.0)
    lower.plot(time, kept.plain[:, 0], **_PLAIN)
    lower.plot(time, kept.force[:, 0], **_TRUE)
    lower.plot(time, kept.estimates[0, :, 0], **_FILTERED)
    lower.set_ylabel("thrust force [N]")
    lower.set_xlabel("time [s]")
    lower.set_xlim(0.0, time[-1])
    lower.set_ylim(bottom=0.0)
    figure.align_ylabels()
    setting = SETTINGS[0]
    filtered = f"filtered, cut-off {setting.cutoff}, {setting.window} samples"
    looks = {"every sample": _PLAIN, filtered: _FILTERED, "true force": _TRUE}
    legend(figure, looks, columns=len(looks))
    return figure
