"""Pictures of how policies behave, for print. Each shows one subject, with the same held-out seeds for all policies.

The numbers of this behaviour belong in ``leaderboard.behaviour``.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullLocator
from tqdm import tqdm

from baselines.models.process import Process
from leaderboard.behaviour import AFTER, BEFORE, Episode, by_life_stage, measure
from leaderboard.result import ResultError
from turning_env import Scenario
from turning_env.files import replace_file
from turning_env.scoring.policy import PolicySpec
from turning_env.workshop.plot_style import BLUE, GREY, ORANGE, VERMILLION

Played = Mapping[str, Sequence[Episode]]
"""The episodes of each policy, by its label: of all policies with the same seeds."""

_WIDTH, _PANEL = 7.2, 2.8
"""Width of a page's text, and the least that a panel's title needs [inch]."""
_LIMIT: dict[str, Any] = {"color": VERMILLION, "linewidth": 0.9}
"""How a line at a limit looks."""
# Okabe and Ito's colours, and line styles for those who see none. Vermillion is for limits.
_COLOURS = (BLUE, ORANGE, "#009E73", "#CC79A7", "#56B4E9", "#000000")
_STYLES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)))
MAX_POLICIES = len(_COLOURS)
"""More cannot be told apart."""
_THIN: dict[str, Any] = {"linewidth": 0.6, "alpha": 0.4}
_LEVEL = 0.02  # width of a histogram's bin, in limits
_BARS = 3  # drawn one after another
# Of use, from fresh to worn: rises evenly in darkness, so that it survives grey print.
_LIFE = LinearSegmentedColormap.from_list("life", ["#9FD0F0", BLUE, "#12233F"])
_WORN = (0.1, 0.5, 1.0)  # used shares of life for which limits are drawn
_LIMIT_STYLES: dict[str, Any] = {"force": "-", "power": "--"}


def play(specs: Sequence[PolicySpec], scenario: Scenario, seeds: Sequence[int]) -> dict[str, list[Episode]]:
    """Play every policy with the same seeds, showing progress; returns the episodes by the policy's label.

    Raises:
        ResultError: there are no policies or too many to tell apart, one is an oracle, which knows more than observations, or
            one cannot play.
    """
    if oracles := [spec.label for spec in specs if spec.kind == "oracle"]:
        raise ResultError(f"{', '.join(oracles)} cannot be drawn: only what acts on observations can")
    if not specs:
        raise ResultError("there is nothing to draw: name a policy or give an agent")
    if len(specs) > MAX_POLICIES:
        raise ResultError(f"{len(specs)} policies cannot be told apart in a picture: at most {MAX_POLICIES}")
    played: dict[str, list[Episode]] = {spec.label: [] for spec in specs}
    with tqdm(total=len(specs) * len(seeds), unit="episode", disable=None) as bar:
        for spec in specs:
            for seed in seeds:
                played[spec.label].append(Episode.of(spec, scenario, seed))
                bar.update()
    return played


def write(played: Played, folder: Path) -> list[Path]:
    """Write every picture that applies into a folder, each whole or not at all; returns the paths."""
    written = []
    with rc_context({"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False}):
        for name, draw in PICTURES.items():
            if figure := draw(played):
                save(figure, folder / name)
                written.append(folder / name)
    return written


def save(figure: Figure, path: Path) -> None:
    """Write a figure as a PNG, whole or not at all."""
    replace_file(path, lambda partial: figure.savefig(partial, dpi=200, format="png"))


def draw_operating_points(played: Played) -> Figure | None:
    """Draw cutting speed and feed as an edge wears, a panel for each policy; None where the speed is fixed or nothing is seen."""
    scenario = _scenario_of(played)
    if scenario.control.action in ("override", "part") or not _all_cut(played):
        return None
    figure = Figure(figsize=(max(_WIDTH, _PANEL * len(played)), 4.0), layout="constrained")
    panels = figure.subplots(1, len(played), sharex=True, sharey=True, squeeze=False)[0]
    shades: dict[str, Any] = {"cmap": _LIFE, "vmin": 0.0, "vmax": 1.0}
    for axes, (label, episodes) in zip(panels, played.items(), strict=True):
        for episode in episodes:
            speed, feed, used = (episode[name][episode.cutting] for name in ("cutting_speed", "feed", "used_life"))
            axes.scatter(speed, feed, 7, used, **shades, alpha=0.35, linewidths=0)
        speeds, feeds = by_life_stage(episodes, "cutting_speed"), by_life_stage(episodes, "feed")
        axes.plot(speeds, feeds, color="white", linewidth=2.6, zorder=3)
        axes.plot(speeds, feeds, color="black", linewidth=1.0, zorder=4)
        middles = (np.arange(len(speeds)) + 0.5) / len(speeds)
        axes.scatter(speeds, feeds, 46, middles, **shades, edgecolors="black", linewidths=0.9, zorder=5)
        done = np.flatnonzero(np.isfinite(speeds))
        ends = [f"{speeds[place]:.0f} m/min, {feeds[place]:.2f} mm/rev" for place in (done[0], done[-1])]
        moves = f"from {ends[0]}\nto {ends[1]}" if ends[0] != ends[1] else f"stays at\n{ends[0]}"
        axes.set_title(f"{label}\n{moves}", loc="left", fontsize="medium")
        axes.set_xlabel("cutting speed [m/min], log scale")
    panels[0].set_ylabel("feed [mm/rev], log scale")
    _zoom(panels, played, scenario)
    for axes in panels:
        _draw_limits(axes, scenario)
    figure.colorbar(ScalarMappable(Normalize(0.0, 1.0), _LIFE), ax=panels, label="used share of the edge's life", pad=0.01)
    handles = [
        Line2D([], [], color=_LIFE(0.5), linestyle=style, label=f"{name} over limit above")
        for name, style in _LIMIT_STYLES.items()
    ]
    handles.append(Line2D([], [], color="black", marker="o", markerfacecolor=_LIFE(0.5), label="mean of each fifth of life"))
    figure.legend(handles=handles, loc="outside lower left", ncols=3, alignment="left")
    depth = scenario.workpiece.depth_of_cut
    shares = ", ".join(f"{100.0 * used:g}" for used in _WORN)
    _headline(
        figure,
        "Speed and feed over edge life",
        f"limits at {depth:g} mm depth of cut and nominal hardness, for edges of {shares} % used life, in their colours; "
        f"{_seeds_of(played)}",
    )
    return figure


def _zoom(panels: Sequence[Axes], played: Played, scenario: Scenario) -> None:
    """Make both axes logarithmic, around what was used."""
    for axis, name in (("x", "cutting_speed"), ("y", "feed")):
        values = np.concatenate([episode[name][episode.cutting] for episodes in played.values() for episode in episodes])
        low, high = (getattr(scenario.machine, f"{name}_{end}") for end in ("min", "max"))
        bounds = max(values.min() / 1.1, low / 1.02), min(values.max() * 1.1, high * 1.02)
        digits = (1, 1.5, 2, 3, 4, 6) if bounds[1] > 3.0 * bounds[0] else (1, 1.2, 1.4, 1.6, 1.8, 2, 2.5, 3, 4, 5, 6, 8)
        ticks = [digit * 10.0**power for power in range(-4, 5) for digit in digits]
        for axes in panels:
            axes.set(**{f"{axis}scale": "log", f"{axis}lim": bounds})
            subject = getattr(axes, f"{axis}axis")
            subject.set_major_locator(FixedLocator([tick for tick in ticks if bounds[0] <= tick <= bounds[1]]))
            subject.set_major_formatter("{x:g}")
            subject.set_minor_locator(NullLocator())


def _draw_limits(axes: Axes, scenario: Scenario) -> None:
    """Draw where force and power reach their limits at nominal depth and hardness, for edges of several wears."""
    process = Process.of(scenario)
    speeds = np.geomspace(*axes.get_xlim(), 100)
    for used in _WORN:
        wear = process.wear_criterion * used**process.wear.time
        for limit, style in zip((process.thrust_force, process.power), _LIMIT_STYLES.values(), strict=True):
            line = limit.line(scenario.workpiece.depth_of_cut, 1.0, wear)
            axes.plot(speeds, np.exp(line.highest_feed(np.log(speeds))), color=_LIFE(used), linestyle=style, linewidth=1.2)


def draw_used_life(played: Played) -> Figure:
    """Draw metal removed and wear over time, all policies in the same panels."""
    figure = Figure(figsize=(_WIDTH, 4.8), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for label, colour, style in _with_looks(played):
        metrics = measure(played[label])
        legend = f"{label}: {metrics['removed_per_edge']:.0f} cm3 in {metrics['minutes_per_edge']:.1f} min per edge"
        for episode in played[label]:
            for axes, values in zip(panels, (np.cumsum(episode["removed"]), episode["wear"]), strict=True):
                axes.plot(episode["minutes"], values, color=colour, linestyle=style, linewidth=1.0, label=legend)
                axes.plot(episode["minutes"][-1], values[-1], "o", color=colour, markersize=4)
                legend = "_"
    panels[0].set_ylabel("metal removed [cm3]")
    panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1)
    panels[1].axhline(_scenario_of(played).tool.wear_criterion, **_LIMIT)
    panels[1].set_ylabel("flank wear [mm]")
    panels[1].set_xlabel("machine time [min]")
    panels[1].set_xlim(left=0.0)
    for axes in panels:
        axes.set_ylim(bottom=0.0)
    figure.align_ylabels(panels)
    _headline(figure, "Metal and wear per edge", f"red: wear criterion; dots: ends of episodes; {_seeds_of(played)}")
    return figure


def draw_entries(played: Played) -> Figure | None:
    """Draw feed and load around the start of every bar, a column for each policy; None where no entry is seen."""
    places = np.arange(-BEFORE, AFTER + 0.5)
    entries = {
        label: [(episode, *entry) for episode in episodes for entry in episode.entries()] for label, episodes in played.items()
    }
    if not all(entries.values()):
        return None
    figure = Figure(figsize=(max(_WIDTH, _PANEL * len(played)), 4.6), layout="constrained")
    grid = figure.subplots(2, len(played), sharex=True, sharey="row", squeeze=False)
    scenario = _scenario_of(played)
    for (upper, lower), (label, colour, _) in zip(grid.T, _with_looks(played), strict=True):
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
        lower.axhline(1.0, **_LIMIT)
        share = measure(played[label])["feed_at_entry"]
        upper.set_title(f"{label}\nenters at {share:.0f} % of its feed in the bar", loc="left", fontsize="medium")
        lower.set_xlabel("distance from the bar's start [mm]")
        lower.set_xlim(-BEFORE, AFTER)
    grid[0, 0].set_ylim(bottom=0.0)
    grid[0, 0].set_ylabel("feed [mm/rev]")
    grid[1, 0].set_ylabel("force / limit or power / limit,\nthe higher of the two")
    number = ", ".join(str(len(of_policy)) for of_policy in entries.values())
    _headline(
        figure,
        "Feed and load at bar entry",
        f"{number} entries; black: their mean; grey: air; red: limit",
    )
    return figure


def draw_loads(played: Played) -> Figure | None:
    """Draw how force and power are distributed over cutting time; None where they are not seen."""
    if not _all_cut(played):
        return None
    limits = _scenario_of(played).limits
    figure = Figure(figsize=(_WIDTH, 3.6), layout="constrained")
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
        for label, colour, style in _with_looks(played):
            weights = np.concatenate([episode["engaged_time"][episode.cutting] for episode in played[label]])
            percent = 100.0 * weights / weights.sum()
            over = percent[samples[label] > 1.0].sum()
            inside = np.clip(samples[label], bins[0], bins[-1] - _LEVEL / 2)
            axes.hist(inside, bins, weights=percent, histtype="stepfilled", color=colour, alpha=0.15)
            what = f"{label}: {over:.1f} % above"
            axes.hist(inside, bins, weights=percent, histtype="step", color=colour, linestyle=style, label=what)
        axes.axvline(1.0, **_LIMIT)
        axes.axvline(tolerated, linestyle=":", **_LIMIT)
        axes.set_xlabel(f"{name} / limit")
        axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), borderaxespad=0.1)
    panels[0].set_ylabel(f"cutting time [%] in steps of {_LEVEL:g}")
    _headline(
        figure,
        "Loads and their limits",
        f"red: limit; dotted: the tolerance of {100.0 * limits.overload_tolerance:g} %; {_seeds_of(played)}",
    )
    return figure


def draw_bars(played: Played) -> Figure | None:
    """Draw a few bars of the first seed, half-way through the shortest episode; None where no whole bar is seen."""
    first = {label: episodes[0] for label, episodes in played.items()}
    whole = min(episode.whole_bars for episode in first.values())
    if whole < 1 or not _all_cut(played):
        return None
    scenario = _scenario_of(played)
    workpiece = scenario.workpiece
    count = min(_BARS, whole)
    bar = (whole - count) // 2
    start, end = (number * (workpiece.bar_length + workpiece.approach) for number in (bar, bar + count))
    figure = Figure(figsize=(_WIDTH, 8.2), layout="constrained")
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
    for label, colour, style in _with_looks(played):
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
        axes.axhline(1.0, **_LIMIT)
    for axes in panels:
        for number in range(bar, bar + count):
            metal = first[finest].bar_start(number)
            axes.axvspan(metal - workpiece.approach, metal, color=GREY, alpha=0.25, linewidth=0)
    panels[2].legend(loc="lower left", bbox_to_anchor=(0.0, 0.95), ncols=3, borderaxespad=0.1)
    panels[-1].set_xlabel("path [mm]")
    panels[-1].set_xlim(start, end)
    figure.align_ylabels(panels)
    which = "bar 1" if count == 1 else f"bars {bar + 1} to {bar + count}"
    _headline(
        figure,
        "Hidden quantities and the response to them",
        f"{which} of seed {first[finest].seed}; cutting time over a limit: {', '.join(over)}; grey: air; red: limits",
    )
    return figure


PICTURES: dict[str, Callable[[Played], Figure | None]] = {
    "operating_point.png": draw_operating_points,
    "bar_entry.png": draw_entries,
    "limits.png": draw_loads,
    "used_life.png": draw_used_life,
    "bars.png": draw_bars,
}
"""Drawing functions by file name. A function returns None if its picture does not apply to the scenario."""


def _with_looks(played: Played) -> list[tuple[str, str, Any]]:
    """Return each policy's label, colour and line style: the same in every picture."""
    return list(zip(played, _COLOURS, _STYLES, strict=False))


def _scenario_of(played: Played) -> Scenario:
    """Return the scenario that all play."""
    return next(iter(played.values()))[0].scenario


def _all_cut(played: Played) -> bool:
    """Return whether every policy is seen in metal."""
    return all(any(episode.cutting.any() for episode in episodes) for episodes in played.values())


def _seeds_of(played: Played) -> str:
    """Return the number of seeds of each policy, in words."""
    number = len(next(iter(played.values())))
    return f"{number} seeds" if number > 1 else "1 seed"


def _headline(figure: Figure, what: str, how: str) -> None:
    """Write a picture's title above it, and how to read it below it or as its legend's title."""
    figure.suptitle(what, x=0.01, ha="left", fontweight="bold")
    if not figure.legends:
        figure.supxlabel(how, x=0.01, ha="left", fontsize="small", color=GREY)
    else:  # both would lie at the bottom
        figure.legends[0].set_title(how, FontProperties(size="small"))
        figure.legends[0].get_title().set_color(GREY)
