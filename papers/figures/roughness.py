"""Figure 5 and Table 1 of the roughness control paper: constant force by feed."""

from functools import cache
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from baselines.constant_force import ConstantForce
from baselines.fixed import FixedParameters
from baselines.models.part_program import PartProgram
from papers.figures.plate import Plate
from papers.reproduce.constant_force import outcomes, record, simulation_checks, text_checks
from turning_env import Scenario
from turning_env.workshop import plot_style as style

PAPER = "Roughness control by constant force"
_FREE: dict[str, Any] = {"color": style.ORANGE, "linewidth": 0.8, "linestyle": (0, (4, 1))}
_HELD: dict[str, Any] = {"color": style.BLUE, "linewidth": 0.8}
_REFERENCE: dict[str, Any] = {"color": style.BLACK, "linewidth": 0.9, "linestyle": ":"}


@cache
def courses() -> tuple[dict[str, NDArray[np.float64]], dict[str, NDArray[np.float64]]]:
    """One episode of the preset ``surface`` without control and under control, arrays of shape (intervals, 1)."""
    scenario = Scenario.load("surface")
    control = scenario.control
    free = FixedParameters(scenario, control.initial_cutting_speed, control.initial_feed)
    return record(free, scenario, 1), record(ConstantForce(PartProgram(scenario, {}), 1), scenario, 1)


def draw_course() -> Figure:
    """Ra, force and feed over time while the reference changes."""
    free, held = courses()
    interval = Scenario.load("surface").control.interval
    time = interval * np.arange(1, len(free["feed"]) + 1)
    panels = (("roughness", "Ra [µm]"), ("thrust_force", "force [N]"), ("feed", "feed [mm/rev]"))
    figure = Figure(figsize=(style.DOUBLE, 4.8), layout="constrained")
    for axes, letter, (name, label) in zip(figure.subplots(3, 1, sharex=True), "abc", panels, strict=True):
        style.letter(axes, letter)
        axes.plot(time, free[name], **_FREE)
        axes.plot(time, held[name], **_HELD)
        if name == "roughness":
            # An interval's report tells the reference for the interval to come.
            axes.plot(time[:-1], held["roughness_reference"][:-1], drawstyle="steps-post", **_REFERENCE)
        axes.set_ylabel(label)
        axes.set_ylim(bottom=0.0)
        axes.set_xlim(0.0, time[-1])
    axes.set_xlabel("time [s]")
    figure.align_ylabels()
    handles = [
        Line2D([], [], **_FREE, label="feed as programmed"),
        Line2D([], [], **_HELD, label="constant force"),
        Line2D([], [], **_REFERENCE, label="reference of Ra"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


def draw_table() -> Figure:
    """The eight simulations: Ra, force and feed under control over the reference, beside the printed."""
    results = outcomes()
    references = [row.reference for row, *_ in results]
    panels = (
        ("Ra reached [µm]", [held.roughness.mean() for _, _, held, _ in results], [row.roughness for row, *_ in results]),
        ("force under control [N]", [held.force for _, _, held, _ in results], [row.force for row, *_ in results]),
        ("feed under control [mm/rev]", [held.feed for _, _, held, _ in results], [row.feed for row, *_ in results]),
    )
    figure = Figure(figsize=(style.DOUBLE, 2.6), layout="constrained")
    for axes, letter, (label, ours, printed) in zip(figure.subplots(1, 3), "abc", panels, strict=True):
        style.letter(axes, letter)
        axes.plot(references, ours, **style.OURS)
        axes.plot(references, printed, **style.PRINTED)
        if letter == "a":
            axes.plot(references, references, **_REFERENCE)
        axes.set_xlabel("reference of Ra [µm]")
        axes.set_ylabel(label)
        axes.set_ylim(0.0, 1.08 * max(*ours, *printed))
    handles = [
        Line2D([], [], **style.OURS, label="project, mean over draws"),
        Line2D([], [], **style.PRINTED, label="printed in Table 1"),
        Line2D([], [], **_REFERENCE, label="as wanted"),
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3)
    return figure


PLATES = (
    Plate(
        "roughness_course",
        f"{PAPER}, Figure 5",
        "Roughness control while the reference changes, on one bar: a) Ra, b) force, c) feed, without control and with feed that "
        "holds the force which the reference asks for.",
        draw_course,
        text_checks,
        "The paper's curves are lost, and its references by section known for two: those here are drawn, four in 15 s.",
    ),
    Plate(
        "roughness_table",
        f"{PAPER}, Table 1",
        "The eight simulations with one reference each: a) Ra reached, b) force, c) feed under control.",
        draw_table,
        simulation_checks,
    ),
)
