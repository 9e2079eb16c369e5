"""What policies do along bars: how they enter one, how close to the limits they cut, and what was hidden."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from leaderboard.behaviour import AFTER, BEFORE, measure
from leaderboard.gallery.style import LIMIT, PANEL, WIDTH, Played, all_cut, headline, scenario_of, seeds_of, with_looks
from turning_env.workshop.plot_style import GREY

_THIN: dict[str, Any] = {"linewidth": 0.6, "alpha": 0.4}
_LEVEL = 0.02  # width of a histogram's bin, in limits
_BARS = 3  # drawn one after another


def draw_entries(played: Played) -> Figure | None:
    """Draw feed and load around the start of every bar, a column for each policy; None where no entry is seen."""
    places = np.arange(-BEFORE, AFTER + 0.5)
    entries = {
        label: [(episode, *entry) for episode in episodes for entry in episode.entries()] for label, episodes in played.items()
    }
    if not all(entries.values()):
        return None
    figure = Figure(figsize=(max(WIDTH, PANEL * len(played)), 4.6), layout="constrained")
    grid = figure.subplots(2, len(played), sharex=True, sharey="row", squeeze=False)
    scenario = scenario_of(played)
    for (upper, lower), (label, colour, _) in zip(grid.T, with_looks(played), strict=True):
        feeds, loads = [], []
        for episode, place, near in entries[label]:
            upper.plot(place[near], episode["feed"][near], color=colour, **_THIN)
            feeds.append(np.interp(places, place, episode["feed"]))
            load, mean = np.maximum(episode.force_load, episode.power_load), np.full(len(places), np.nan)
            for side, seen in (
                (places < 0.0, episode.cutting & (place < 0.0)),
                (places >= 0.0, episode.cutting & (place >= 0.0)),
            ):
                lower.plot(place[near & seen], load[near & seen], color=colour, **_THIN)
                mean[side] = np.interp(places[side], place[seen], load[seen], left=np.nan, right=np.nan)
            loads.append(mean)
        for axes, values in ((upper, np.array(feeds)), (lower, np.array(loads))):
            known = np.isfinite(values)
            sums, counts = np.where(known, values, 0.0).sum(axis=0), known.sum(axis=0)
            # Where less than half of the bars have been sensed, the mean is of other bars than further on.
            means = np.divide(sums, counts, out=np.full(len(places), np.nan), where=2 * counts >= len(values))
            axes.plot(places, means, color="black", linewidth=1.8)
            axes.axvspan(-scenario.workpiece.approach, 0.0, color=GREY, alpha=0.18, linewidth=0)
        lower.axhline(1.0, **LIMIT)
        share = measure(played[label])["feed_at_entry"]
        upper.set_title(f"{label}\nenters at {share:.0f} % of its feed in the bar", loc="left", fontsize="medium")
        lower.set_xlabel("place from the bar's start [mm]")
        lower.set_xlim(-BEFORE, AFTER)
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


def draw_loads(played: Played) -> Figure | None:
    """Draw how force and power are distributed over cutting time; None where they are not seen."""
    if not all_cut(played):
        return None
    limits = scenario_of(played).limits
    figure = Figure(figsize=(WIDTH, 3.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    tolerated = 1.0 + limits.overload_tolerance
    for axes, name, load in zip(panels, ("thrust force", "power"), ("force_load", "power_load"), strict=True):
        samples = {
            label: np.concatenate([getattr(episode, load)[episode.cutting] for episode in episodes])
            for label, episodes in played.items()
        }
        # The rarest are drawn at the ends, so that one broken edge does not stretch the axis.
        low, high = np.quantile(np.concatenate(list(samples.values())), (0.002, 0.998))
        first, last = np.floor(min(low, 0.9) / _LEVEL), np.ceil(max(high, tolerated + 0.1) / _LEVEL)
        bins = np.arange(first, last + 1.5) * _LEVEL
        for label, colour, style in with_looks(played):
            weights = np.concatenate([episode["engaged_time"][episode.cutting] for episode in played[label]])
            percent = 100.0 * weights / weights.sum()
            over = percent[samples[label] > 1.0].sum()
            inside = np.clip(samples[label], bins[0], bins[-1] - _LEVEL / 2)
            axes.hist(inside, bins, weights=percent, histtype="stepfilled", color=colour, alpha=0.15)
            what = f"{label}: {over:.1f} % above"
            axes.hist(inside, bins, weights=percent, histtype="step", color=colour, linestyle=style, label=what)
        axes.axvline(1.0, **LIMIT)
        axes.axvline(tolerated, linestyle=":", **LIMIT)
        axes.set_xlabel(f"{name} / limit")
        axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), borderaxespad=0.1)
    panels[0].set_ylabel(f"cutting time [%] in steps of {_LEVEL:g}")
    headline(
        figure,
        "How close to the limits policies cut",
        f"red: limit; dotted: the tolerance of {100.0 * limits.overload_tolerance:g} %; {seeds_of(played)}",
    )
    return figure


def draw_bars(played: Played) -> Figure | None:
    """Draw a few bars of the first seed, half-way through the shortest episode; None where no whole bar is seen."""
    first = {label: episodes[0] for label, episodes in played.items()}
    whole = min(episode.whole_bars for episode in first.values())
    if whole < 1 or not all_cut(played):
        return None
    scenario = scenario_of(played)
    workpiece = scenario.workpiece
    count = min(_BARS, whole)
    bar = (whole - count) // 2
    start, end = (number * (workpiece.bar_length + workpiece.approach) for number in (bar, bar + count))
    figure = Figure(figsize=(WIDTH, 8.2), layout="constrained")
    panels = figure.subplots(6, 1, sharex=True)
    seen = {label: (each["path"] > start) & (each["path"] <= end) & each.cutting for label, each in first.items()}
    # All see the same bars: the one that looks most often draws them.
    finest = max(seen, key=lambda label: int(seen[label].sum()))
    hidden = (("depth_of_cut", "depth of cut\n[mm]", workpiece.depth_of_cut), ("hardness", "hardness\n/ nominal", 1.0))
    for axes, (name, what, nominal) in zip(panels, hidden, strict=False):
        values = np.where(seen[finest], first[finest][name], np.nan)  # interrupted where the tool is not in metal
        axes.plot(first[finest]["path"], values, color="black", linewidth=1.0)
        axes.axhline(nominal, color=GREY, linewidth=0.7, linestyle=":")
        axes.set_ylabel(what)
    over = []
    for label, colour, style in with_looks(played):
        episode, here = first[label], seen[label]
        subjects = {
            "cutting speed\n[m/min]": episode["cutting_speed"],
            "feed\n[mm/rev]": episode["feed"],
            "force / limit": episode.force_load,
            "power / limit": episode.power_load,
        }
        for axes, (what, values) in zip(panels[2:], subjects.items(), strict=True):
            shown = np.where(here, values, np.nan)
            axes.plot(episode["path"], shown, color=colour, linestyle=style, linewidth=1.1, label=label)
            axes.set_ylabel(what)
        beyond = np.maximum(episode.force_load, episode.power_load)[here] > 1.0
        over.append(f"{label} {100.0 * np.average(beyond, weights=episode['engaged_time'][here]):.0f} %")
    for axes in panels[4:]:
        axes.axhline(1.0, **LIMIT)
    for axes in panels:
        for number in range(bar, bar + count):
            metal = first[finest].bar_start(number)
            axes.axvspan(metal - workpiece.approach, metal, color=GREY, alpha=0.25, linewidth=0)
    panels[2].legend(loc="lower left", bbox_to_anchor=(0.0, 0.95), ncols=3, borderaxespad=0.1)
    panels[-1].set_xlabel("path [mm]")
    panels[-1].set_xlim(start, end)
    figure.align_ylabels(panels)
    which = "bar 1" if count == 1 else f"bars {bar + 1} to {bar + count}"
    headline(
        figure,
        "What was hidden, and what was done about it",
        f"{which} of seed {first[finest].seed}; cutting time over a limit: {', '.join(over)}; grey: air; red: limits",
    )
    return figure
