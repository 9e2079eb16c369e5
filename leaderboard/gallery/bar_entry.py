"""How a policy enters a bar: feed and load around its start."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from leaderboard.behaviour import AFTER, BEFORE, habits
from leaderboard.gallery.drawing import LIMIT, PANEL, WIDTH, Courses, headline, scenario_of, with_looks
from turning_env.workshop.plot_style import GREY

_THIN: dict[str, Any] = {"linewidth": 0.6, "alpha": 0.4}


def draw(courses: Courses) -> Figure | None:
    """Feed and load around the start of every bar, a column for each policy; none where no entry is seen."""
    places = np.arange(-BEFORE, AFTER + 0.5)
    entries = {
        label: [(course, place, near) for course in episodes for _, place, near in course.entries()]
        for label, episodes in courses.items()
    }
    if not all(entries.values()):
        return None
    figure = Figure(figsize=(max(WIDTH, PANEL * len(courses)), 4.6), layout="constrained")
    grid = figure.subplots(2, len(courses), sharex=True, sharey="row", squeeze=False)
    scenario = scenario_of(courses)
    for column, (label, colour, _) in enumerate(with_looks(courses)):
        feeds, loads = [], []
        for course, place, near in entries[label]:
            grid[0, column].plot(place[near], course["feed"][near], color=colour, **_THIN)
            feeds.append(np.interp(places, place, course["feed"]))
            load, mean = np.maximum(course.force_share, course.power_share), np.full(len(places), np.nan)
            for side, seen in ((places < 0.0, course.cutting & (place < 0.0)), (places >= 0.0, course.cutting & (place >= 0.0))):
                grid[1, column].plot(place[near & seen], load[near & seen], color=colour, **_THIN)
                mean[side] = np.interp(places[side], place[seen], load[seen], left=np.nan, right=np.nan)
            loads.append(mean)
        for axes, values in zip(grid[:, column], (np.array(feeds), np.array(loads)), strict=True):
            known = np.isfinite(values)
            sums, counts = np.where(known, values, 0.0).sum(axis=0), known.sum(axis=0)
            # Where less than half of the bars have been sensed, the mean is of other bars than further on.
            means = np.divide(sums, counts, out=np.full(len(places), np.nan), where=2 * counts >= len(values))
            axes.plot(places, means, color="black", linewidth=1.8)
            axes.axvspan(-scenario.workpiece.approach, 0.0, color=GREY, alpha=0.18, linewidth=0)
        grid[1, column].axhline(1.0, **LIMIT)
        share = habits(courses[label])["feed_at_entry"]
        grid[0, column].set_title(f"{label}\nenters at {share:.0f} % of its feed in the bar", loc="left", fontsize="medium")
        grid[1, column].set_xlabel("place from the bar's start [mm]")
        grid[1, column].set_xlim(-BEFORE, AFTER)
    grid[0, 0].set_ylim(bottom=0.0)
    grid[0, 0].set_ylabel("feed [mm/rev]")
    grid[1, 0].set_ylabel("force / limit or power / limit,\nthe higher of the two")
    number = ", ".join(str(len(of_policy)) for of_policy in entries.values())
    headline(
        figure,
        "Whether a policy slows down before a bar's start or after it",
        f"{number} entries; black: their mean; grey: air; red: limit",
    )
    return figure
