"""Figure 5 of the roughness control paper: constant force by feed."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from baselines.constant_force import ConstantForce
from baselines.fixed import FixedParameters
from baselines.models.part_program import PartProgram
from leaderboard.seeds import tuning_seeds
from research.papers import record
from research.papers.figures import legend, lettered
from turning_env import Scenario
from turning_env.rendering import plot_style as style

_FREE: dict[str, Any] = {"color": style.ORANGE, "linewidth": 0.8, "linestyle": (0, (4, 1))}
_HELD: dict[str, Any] = {"color": style.BLUE, "linewidth": 0.8}
_REFERENCE: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.9, "linestyle": ":"}


def draw_control() -> Figure:
    """Draw Ra, force and feed over time while the reference changes."""
    scenario = Scenario.load("surface")
    control = scenario.control
    speed = control.initial_cutting_speed
    feed = control.initial_feed
    programmed = FixedParameters(scenario, speed, feed=feed)
    constant_force = ConstantForce(PartProgram(scenario, {}), 1)
    free = record(programmed, scenario, tuning_seeds(1))
    held = record(constant_force, scenario, tuning_seeds(1))
    steps = len(free["feed"])
    time = control.interval * np.arange(1, steps + 1)

    labels = {
        "roughness": "Ra [µm]",
        "thrust_force": "force [N]",
        "feed": "feed [mm/rev]",
    }
    figure, panels = lettered((style.DOUBLE, 4.8), rows=3, columns=1, sharex=True)
    for axes, (name, label) in zip(panels, labels.items(), strict=True):
        axes.plot(time, free[name], **_FREE)
        axes.plot(time, held[name], **_HELD)
        if name == "roughness":
            # The info of a step holds the reference for the next one.
            reference = held["roughness_reference"][:-1]
            axes.plot(time[:-1], reference, drawstyle="steps-post", **_REFERENCE)
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0.0)
        axes.set_xlim(0.0, time[-1])
    panels[-1].set_xlabel("time [s]")
    figure.align_ylabels()
    looks = {
        "feed as programmed": _FREE,
        "constant force": _HELD,
        "reference of Ra": _REFERENCE,
    }
    legend(figure, looks, columns=len(looks))
    return figure
