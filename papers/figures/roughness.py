"""Figure 5 and Table 1 of the roughness control paper: constant force by feed."""

from functools import cache
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from baselines.constant_force import ConstantForce
from baselines.fixed import FixedParameters
from baselines.models.part_program import PartProgram
from papers import record
from papers.figures import legend, lettered
from papers.reproduce.constant_force import outcomes
from turning_env import Scenario
from turning_env.scoring.seeds import tuning_seeds
from turning_render import plot_style as style

_FREE: dict[str, Any] = {"color": style.ORANGE, "linewidth": 0.8, "linestyle": (0, (4, 1))}
_HELD: dict[str, Any] = {"color": style.BLUE, "linewidth": 0.8}
_REFERENCE: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.9, "linestyle": ":"}


@cache
def trajectories() -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]]:
    """Return an episode of the preset ``surface`` without control and under control, arrays of shape (steps, 1)."""
    scenario = Scenario.load("surface")
    control = scenario.control
    free = FixedParameters(scenario, control.initial_cutting_speed, control.initial_feed)
    held = ConstantForce(PartProgram(scenario, {}), 1)
    return record(free, scenario, tuning_seeds(1)), record(held, scenario, tuning_seeds(1))


def draw_control() -> Figure:
    """Draw Ra, force and feed over time while the reference changes."""
    free, held = trajectories()
    interval = Scenario.load("surface").control.interval
    time = interval * np.arange(1, len(free["feed"]) + 1)
    subjects = (("roughness", "Ra [µm]"), ("thrust_force", "force [N]"), ("feed", "feed [mm/rev]"))
    figure, panels = lettered((style.DOUBLE, 4.8), 3, 1, sharex=True)
    for axes, (name, label) in zip(panels, subjects, strict=True):
        axes.plot(time, free[name], **_FREE)
        axes.plot(time, held[name], **_HELD)
        if name == "roughness":
            # A step's report tells the reference for the next step.
            axes.plot(time[:-1], held["roughness_reference"][:-1], drawstyle="steps-post", **_REFERENCE)
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0.0)
        axes.set_xlim(0.0, time[-1])
    axes.set_xlabel("time [s]")
    figure.align_ylabels()
    legend(figure, {"feed as programmed": _FREE, "constant force": _HELD, "reference of Ra": _REFERENCE}, 3)
    return figure


def draw_table() -> Figure:
    """Draw Ra, force and feed under control over the reference, in the eight simulations, beside the printed."""
    results = outcomes()
    references = [row.reference for row, *_ in results]
    subjects = (
        ("Ra reached [µm]", [held.roughness.mean() for _, _, held, _ in results], [row.roughness for row, *_ in results]),
        ("force under control [N]", [held.force for _, _, held, _ in results], [row.force for row, *_ in results]),
        ("feed under control [mm/rev]", [held.feed for _, _, held, _ in results], [row.feed for row, *_ in results]),
    )
    figure, panels = lettered((style.DOUBLE, 2.6), 1, 3)
    for axes, (label, ours, printed) in zip(panels, subjects, strict=True):
        axes.plot(references, ours, **style.OURS)
        axes.plot(references, printed, **style.PRINTED)
        if axes is panels[0]:
            axes.plot(references, references, **_REFERENCE)
        axes.set_xlabel("reference of Ra [µm]")
        axes.set_ylabel(label)
        axes.set_ylim(0.0, 1.08 * max(*ours, *printed))
    looks = {"project, mean over seeds": style.OURS, "printed in Table 1": style.PRINTED, "as wanted": _REFERENCE}
    legend(figure, looks, 3)
    return figure
