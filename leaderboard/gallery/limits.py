"""How close to the limits policies cut: distributions of force and power."""

import numpy as np
from matplotlib.figure import Figure

from leaderboard.behaviour import Array, Course
from leaderboard.gallery.drawing import LIMIT, WIDTH, Courses, cuts, headline, of_draws, scenario_of, with_looks

_LEVEL = 0.02  # width of a histogram's bar, in limits


def draw(courses: Courses) -> Figure | None:
    """How force and power are distributed over cutting time; none where they are not seen."""
    if not cuts(courses):
        return None
    scenario = scenario_of(courses)
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    tolerated = 1.0 + scenario.limits.overload_tolerance
    for axes, name in zip(panels, ("thrust force", "power"), strict=True):
        samples = {
            label: np.concatenate([_shares(course)[name][course.cutting] for course in episodes])
            for label, episodes in courses.items()
        }
        # The rarest are drawn at the ends, so that one broken edge does not stretch the axis.
        low, high = np.quantile(np.concatenate(list(samples.values())), (0.002, 0.998))
        first, last = np.floor(min(low, 0.9) / _LEVEL), np.ceil(max(high, tolerated + 0.1) / _LEVEL)
        edges = np.arange(first, last + 1.5) * _LEVEL
        for label, colour, style in with_looks(courses):
            weights = np.concatenate([course["engaged_time"][course.cutting] for course in courses[label]])
            percent = 100.0 * weights / weights.sum()
            over = percent[samples[label] > 1.0].sum()
            inside = np.clip(samples[label], edges[0], edges[-1] - _LEVEL / 2)
            axes.hist(inside, edges, weights=percent, histtype="stepfilled", color=colour, alpha=0.15)
            what = f"{label}: {over:.1f} % above"
            axes.hist(inside, edges, weights=percent, histtype="step", color=colour, linestyle=style, label=what)
        axes.axvline(1.0, **LIMIT)
        axes.axvline(tolerated, linestyle=":", **LIMIT)
        axes.set_xlabel(f"{name} / limit")
        axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), borderaxespad=0.1)
    panels[0].set_ylabel(f"cutting time [%] in steps of {_LEVEL:g}")
    headline(
        figure,
        "How close to the limits policies cut",
        f"red: limit; dotted: the tolerance of {100.0 * scenario.limits.overload_tolerance:g} %; {of_draws(courses)}",
    )
    return figure


def _shares(course: Course) -> dict[str, Array]:
    return {"thrust force": course.force_share, "power": course.power_share}
