"""Draw one page to pin to the machine: maps for a fresh and a worn edge, recommendations, when to change the edge, warnings."""

import textwrap
from collections.abc import Sequence
from typing import Any

from matplotlib.figure import Figure

from turning_env.scenario import Scenario
from turning_render.plot_style import VERMILLION
from turning_shop.advise import Advice, summary
from turning_shop.plots import draw_map_on
from turning_shop.prediction import Evidence

FRESH = 0.3
"""Wear of the fresh edge's map over the wear criterion [-]: at no wear, the laws of force and power are 0."""
A4 = 11.69, 8.27
"""Size of the page [inch]."""
MAX_WARNINGS = 4
"""Number of warnings on the page."""
RULED = (
    "Nominal values from measured or assumed laws: limits are kept with the edge worn as stated, at nominal depth and hardness. "
    "A simulation's output: try each change carefully."
)


def draw_sheet(scenario: Scenario, evidence: Evidence, advice: Sequence[Advice]) -> Figure:
    """Draw the page, A4 across.

    Args:
        scenario: The machine, material and limits.
        evidence: What is known of the laws, with the warnings.
        advice: Returned by ``advise``.
    """
    criterion = scenario.tool.wear_criterion
    figure = Figure(figsize=A4, layout="constrained")
    pages: Any = figure.subfigures(2, 1, height_ratios=(1.35, 1.0))
    maps, rest = pages
    for axes, wear in zip(maps.subplots(1, 2), (FRESH * criterion, criterion), strict=True):
        handles = draw_map_on(axes, scenario, wear)
        axes.set_title(f"edge worn to {wear:.2g} mm", loc="left", fontsize="medium")
    maps.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize="small")
    maps.suptitle(f"{scenario.name}: {scenario.workpiece.depth_of_cut:g} mm deep", fontsize="large")
    lines = list(summary(scenario, list(advice)))
    table = lines[: lines.index("", 3)] + [line for line in lines[-1:] if line.startswith("*")]
    best = next(each for each in advice if each.aim == "least cost" and len(each.steps) == 1)
    change = f"LEAST COST: {best.steps[0].cutting_speed:.0f} m/min, {best.steps[0].feed:.3f} mm/rev. "
    parts = max(best.change_after, 1)
    change += f"Change the edge after {parts} part{'s' * (parts > 1)}, or at {best.steps[-1].wear:.2f} mm of flank wear."
    warnings = list(evidence.warnings[:MAX_WARNINGS])
    if len(evidence.warnings) > MAX_WARNINGS:
        warnings.append(f"and {len(evidence.warnings) - MAX_WARNINGS} more warnings: see {evidence.source}")
    wrapped = [line for warning in warnings for line in textwrap.wrap(f"! {warning}", 150)]
    rest.text(0.02, 0.97, change, fontsize=13, fontweight="bold", verticalalignment="top")
    rest.text(0.02, 0.85, "\n".join(table), family="monospace", fontsize=8, verticalalignment="top")
    rest.text(0.02, 0.30, "\n".join(wrapped), fontsize=8, color=VERMILLION, verticalalignment="top")
    rest.text(0.02, 0.02, RULED, fontsize=8, verticalalignment="bottom")
    return figure
