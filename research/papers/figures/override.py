"""Figures 5 and 7 of the fuzzy override paper: step responses of the laws of feed override.

The bar is undisturbed (``research/papers/stepped_bar.py``): 1, 2, 3, 1 and 3 mm deep. All controls that have a target have the same,
60 % of the torque that the main drive has at its speed; what else they have is set by hand.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from baselines import fuzzy_override, load_override
from baselines.rule import Parameters
from research.papers.stepped_bar import Trajectory, play_bar, stepped_bar
from turning_env import Scenario
from turning_env.rendering import plot_style as style

DEPTHS = (
    1.0,
    2.0,
    3.0,
    1.0,
    3.0,
)  # depths of cut [mm], those of the preset `override`: steps up by 1 and by 2 mm, and down by 2

SHOWN: dict[str, tuple[str, Parameters]] = {
    "programmed_feed": ("programmed feed", {}),
    "one_line_law": ("override = 160 - 2 load", {}),
    "fuzzy_override": ("fuzzy override, first form", {}),
    "modified_fuzzy_override": ("fuzzy override, modified", {}),
    "iadapts": ("constant load (iAdaptS)", {"target": 1.0, "gain": 8.0}),
    "tmac": ("learned power (TMAC)", {"target": 1.0, "gain": 8.0, "extreme": 3.0}),
    "omative": ("air-gap control (ACM)", {"target": 1.0, "entry": 1.0, "rise": 10.0}),
}
"""Title and parameters of each rule."""
RULES = fuzzy_override.RULES | load_override.RULES


_OVERRIDE: dict[str, Any] = {"color": style.BLUE, "linewidth": 1.3}
_LOAD: dict[str, Any] = {"color": style.VERMILLION, "linewidth": 1.3, "linestyle": (0, (4, 1))}
_TARGET: dict[str, Any] = {"color": style.GREY, "linewidth": 0.9, "linestyle": ":"}


def draw(scenario: Scenario | None = None) -> Figure:
    """Draw the trajectories of all rules on a bar, by default of ``DEPTHS``: depth of cut, override and load over time."""
    scenario = scenario or stepped_bar(DEPTHS)
    runs = {}
    for name, (title, parameters) in SHOWN.items():
        policy = RULES[name].controller(scenario, 1, **RULES[name].fixed | parameters)
        runs[title] = play_bar(lambda num_envs, policy=policy: policy, scenario)  # type: ignore[misc]
    figure = Figure(figsize=(style.DOUBLE, 6.0), layout="constrained")
    panels = figure.subplots(4, 4, sharex=True, sharey="row", height_ratios=(1, 3, 1, 3))
    panels[0, 0].set_xlim(0.0, max(run.time[-1] for run in runs.values()))
    pairs = [
        (panels[row, column], panels[row + 1, column]) for row in (0, 2) for column in range(4)
    ]
    for (above, below), (title, run) in zip(pairs, runs.items(), strict=False):
        above.fill_between(run.time, run.depth, color=style.LIGHT, step="pre")
        above.plot(run.time, run.depth, color=style.GREY, linewidth=0.9, drawstyle="steps-pre")
        above.set_ylim(0.0, 3.6)
        above.set_yticks((1, 2, 3))
        _draw_response(below, run, scenario)
        above.set_title(title, fontsize="medium", loc="left")
        below.tick_params(labelbottom=True)
        below.set_xlabel("time [s]")
    for above, below in pairs[::4]:
        above.set_ylabel("depth\n[mm]")
        below.set_ylabel("override, load [%]")
    for axes in pairs[-1]:
        axes.set_axis_off()
    looks = {
        "feed override, commanded": _OVERRIDE,
        "share of torque; highest value": _LOAD,
        "target load": _TARGET,
    }
    handles = [Line2D([], [], label=label, **look) for label, look in looks.items()]
    pairs[-1][1].legend(handles=handles, loc="upper right", frameon=False).set_in_layout(
        False
    )  # else its column would be wider
    figure.align_ylabels()
    return style.readable(figure)


def _draw_response(axes: Axes, run: Trajectory, scenario: Scenario) -> None:
    axes.axhline(100.0 * scenario.limits.power / scenario.machine.rated_power, **_TARGET)
    axes.plot(run.time, 100.0 * run.override, **_OVERRIDE)
    axes.plot(run.time, 100.0 * run.load, **_LOAD)
    highest = int(np.argmax(run.load))
    axes.annotate(
        f"{100.0 * run.load[highest]:.0f} %",
        (run.time[highest], 100.0 * run.load[highest]),
        xytext=(4, 3),
        textcoords="offset points",
        color=style.VERMILLION,
        fontsize="small",
    )
    axes.set_ylim(0.0, 215.0)
    axes.set_yticks(range(0, 201, 50))
