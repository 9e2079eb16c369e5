"""Figures 5 and 7 of the fuzzy override paper: step responses of the laws of feed override.

The bar is undisturbed (``research/papers/stepped_bar.py``): 1, 2, 3, 1 and 3 mm deep. All controls
that have a target have the same, 60 % of the torque that the main drive has at its speed. Their
other parameters are set by hand.
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

# Depths of cut [mm], those of the preset `override`: steps up by 1 and by 2 mm, and down by 2.
DEPTHS = (1.0, 2.0, 3.0, 1.0, 3.0)

TITLES = {
    "programmed_feed": "programmed feed",
    "one_line_law": "override = 160 - 2 load",
    "fuzzy_override": "fuzzy override, first form",
    "modified_fuzzy_override": "fuzzy override, modified",
    "iadapts": "constant load (iAdaptS)",
    "tmac": "learned power (TMAC)",
    "omative": "air-gap control (ACM)",
}
"""Titles of the rules that are shown."""
PARAMETERS: dict[str, Parameters] = {
    "iadapts": {"target": 1.0, "gain": 8.0},
    "tmac": {"target": 1.0, "gain": 8.0, "extreme": 3.0},
    "omative": {"target": 1.0, "entry": 1.0, "rise": 10.0},
}
"""Parameters of the rules that are not fixed."""
RULES = fuzzy_override.RULES | load_override.RULES

_OVERRIDE: dict[str, Any] = {"color": style.BLUE, "linewidth": 1.3}
_LOAD: dict[str, Any] = {"color": style.VERMILLION, "linewidth": 1.3, "linestyle": (0, (4, 1))}
_TARGET: dict[str, Any] = {"color": style.GREY, "linewidth": 0.9, "linestyle": ":"}


def draw(scenario: Scenario | None = None) -> Figure:
    """Draw the trajectories of all rules on a bar: depth of cut, override and load over time.

    Args:
        scenario: scenario of the bar; by default one of ``DEPTHS``.
    """
    scenario = scenario or stepped_bar(DEPTHS)
    trajectories = {name: _play(name, scenario) for name in TITLES}
    ends = [trajectory.time[-1] for trajectory in trajectories.values()]

    # Two rows of four rules, each with its depth above its response.
    figure = Figure(figsize=(style.DOUBLE, 6.0), layout="constrained")
    panels = figure.subplots(
        4,
        4,
        sharex=True,
        sharey="row",
        height_ratios=(1, 3, 1, 3),
    )
    panels[0, 0].set_xlim(0.0, max(ends))
    depth_panels = panels[::2].ravel()
    response_panels = panels[1::2].ravel()
    for index, (name, trajectory) in enumerate(trajectories.items()):
        depth_axes = depth_panels[index]
        depth_axes.set_title(TITLES[name], fontsize="medium", loc="left")
        _draw_depth(depth_axes, trajectory)
        _draw_response(response_panels[index], trajectory, scenario=scenario)
    for row in (0, 2):
        panels[row, 0].set_ylabel("depth\n[mm]")
        panels[row + 1, 0].set_ylabel("override, load [%]")

    # The last place is the legend's.
    depth_panels[-1].set_axis_off()
    response_panels[-1].set_axis_off()
    looks = {
        "feed override, commanded": _OVERRIDE,
        "share of torque; highest value": _LOAD,
        "target load": _TARGET,
    }
    handles = []
    for label, look in looks.items():
        handles.append(Line2D([], [], label=label, **look))
    legend = response_panels[-1].legend(handles=handles, loc="upper right", frameon=False)
    legend.set_in_layout(False)  # else its column would be wider
    figure.align_ylabels()
    return style.readable(figure)


def _play(name: str, scenario: Scenario) -> Trajectory:
    rule = RULES[name]
    parameters = rule.fixed | PARAMETERS.get(name, {})
    return play_bar(lambda num_envs: rule.controller(scenario, num_envs, **parameters), scenario)


def _draw_depth(axes: Axes, trajectory: Trajectory) -> None:
    time = trajectory.time
    depth = trajectory.depth
    axes.fill_between(time, depth, color=style.LIGHT, step="pre")
    axes.plot(time, depth, color=style.GREY, linewidth=0.9, drawstyle="steps-pre")
    axes.set_ylim(0.0, 3.6)
    axes.set_yticks((1, 2, 3))


def _draw_response(axes: Axes, trajectory: Trajectory, scenario: Scenario) -> None:
    time = trajectory.time
    load_percent = 100.0 * trajectory.load
    target = 100.0 * scenario.limits.power / scenario.machine.rated_power
    axes.axhline(target, **_TARGET)
    axes.plot(time, 100.0 * trajectory.override, **_OVERRIDE)
    axes.plot(time, load_percent, **_LOAD)
    highest = int(np.argmax(load_percent))
    axes.annotate(
        f"{load_percent[highest]:.0f} %",
        (time[highest], load_percent[highest]),
        xytext=(4, 3),
        textcoords="offset points",
        color=style.VERMILLION,
        fontsize="small",
    )
    axes.set_ylim(0.0, 215.0)
    axes.set_yticks(range(0, 201, 50))
    axes.tick_params(labelbottom=True)
    axes.set_xlabel("time [s]")
