"""What was hidden along a few bars, and what was done about it."""

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from leaderboard.behaviour import Array, Course
from leaderboard.gallery.drawing import LIMIT, WIDTH, Courses, cuts, headline, scenario_of, with_looks
from turning_env.workshop.plot_style import GREY

_BARS = 3  # drawn one after another


def draw(courses: Courses) -> Figure | None:
    """A few bars of the first draw, half-way through the shortest episode; none where no whole bar is seen."""
    first = {label: episodes[0] for label, episodes in courses.items()}
    whole = min(course.whole_bars for course in first.values())
    if whole < 1 or not cuts(courses):
        return None
    scenario = scenario_of(courses)
    count = min(_BARS, whole)
    bar = (whole - count) // 2
    start, end = (pitch * (scenario.workpiece.bar_length + scenario.workpiece.approach) for pitch in (bar, bar + count))
    figure = Figure(figsize=(WIDTH, 8.2), layout="constrained")
    panels = figure.subplots(6, 1, sharex=True)
    subjects: tuple[tuple[str, Callable[[Course], Array]], ...] = (
        ("cutting speed\n[m/min]", lambda course: course["cutting_speed"]),
        ("feed\n[mm/rev]", lambda course: course["feed"]),
        ("force / limit", lambda course: course.force_share),
        ("power / limit", lambda course: course.power_share),
    )
    seen = {label: (course["path"] > start) & (course["path"] <= end) & course.cutting for label, course in first.items()}
    # All see the same bars: the one that looks most often draws them.
    finest = max(seen, key=lambda label: int(seen[label].sum()))
    hidden = (("depth_of_cut", "depth of cut\n[mm]", scenario.workpiece.depth_of_cut), ("hardness", "hardness\n/ nominal", 1.0))
    for axes, (name, what, nominal) in zip(panels, hidden, strict=False):
        _along(axes, first[finest], first[finest][name], seen[finest], color="black", linewidth=1.0)
        axes.axhline(nominal, color=GREY, linewidth=0.7, linestyle=":")
        axes.set_ylabel(what)
    over = []
    for label, colour, style in with_looks(courses):
        course, here = first[label], seen[label]
        for axes, (what, values) in zip(panels[2:], subjects, strict=True):
            _along(axes, course, values(course), here, color=colour, linestyle=style, linewidth=1.1, label=label)
            axes.set_ylabel(what)
        beyond = np.maximum(course.force_share, course.power_share)[here] > 1.0
        over.append(f"{label} {100.0 * np.average(beyond, weights=course['engaged_time'][here]):.0f} %")
    for axes in panels[4:]:
        axes.axhline(1.0, **LIMIT)
    for axes in panels:
        for number in range(bar, bar + count):
            metal = first[finest].bar_start(number)
            axes.axvspan(metal - scenario.workpiece.approach, metal, color=GREY, alpha=0.25, linewidth=0)
    panels[2].legend(loc="lower left", bbox_to_anchor=(0.0, 0.95), ncols=3, borderaxespad=0.1)
    panels[-1].set_xlabel("path [mm]")
    panels[-1].set_xlim(start, end)
    figure.align_ylabels(panels)
    which = "bar 1" if count == 1 else f"bars {bar + 1} to {bar + count}"
    headline(
        figure,
        "What was hidden, and what was done about it",
        f"{which} of draw {first[finest].draw}; cutting time over a limit: {', '.join(over)}; grey: air; red: limits",
    )
    return figure


def _along(axes: Axes, course: Course, values: Array, seen: NDArray[np.bool_], **style: Any) -> None:
    """Draw a series over the path, interrupted where the tool is not in metal."""
    axes.plot(course["path"], np.where(seen, values, np.nan), **style)
