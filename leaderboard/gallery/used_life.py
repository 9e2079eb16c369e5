"""What is made of an edge: metal and wear over time."""

import numpy as np
from matplotlib.figure import Figure

from leaderboard.behaviour import habits
from leaderboard.gallery.drawing import LIMIT, WIDTH, Courses, headline, of_draws, scenario_of, with_looks


def draw(courses: Courses) -> Figure:
    """Metal removed and wear over time, all policies in the same panels."""
    figure = Figure(figsize=(WIDTH, 4.8), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for label, colour, style in with_looks(courses):
        of_policy = habits(courses[label])
        legend = f"{label}: {of_policy['removed_per_edge']:.0f} cm3 in {of_policy['minutes_per_edge']:.1f} min per edge"
        for course in courses[label]:
            removed = np.cumsum(course["removed"])
            for axes, values in zip(panels, (removed, course["wear"]), strict=True):
                axes.plot(course["minutes"], values, color=colour, linestyle=style, linewidth=1.0, label=legend)
                axes.plot(course["minutes"][-1], values[-1], "o", color=colour, markersize=4)
                legend = "_"
    panels[0].set_ylabel("metal removed [cm3]")
    panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1)
    panels[1].axhline(scenario_of(courses).tool.wear_criterion, **LIMIT)
    panels[1].set_ylabel("flank wear [mm]")
    panels[1].set_xlabel("machine time [min]")
    panels[1].set_xlim(left=0.0)
    for axes in panels:
        axes.set_ylim(bottom=0.0)
    figure.align_ylabels(panels)
    headline(figure, "What is made of an edge", f"red: wear criterion; dots: the episode ends; {of_draws(courses)}")
    return figure
