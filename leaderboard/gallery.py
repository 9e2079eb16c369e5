"""Pictures of what policies do, for print: each shows one thing, on the same held-out bars for all."""

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
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.process import Process
from leaderboard.contestants import Contestant, Player
from leaderboard.figure import BLUE, GREY, ORANGE, VERMILLION
from leaderboard.habits import AFTER, BEFORE, Array, Course, fifths, habits
from leaderboard.results import ResultError
from turning_env import Scenario
from turning_env.files import replace_file

Courses = Mapping[str, Sequence[Course]]
"""The episodes of each policy, by its label: of all policies on the same draws."""

# Okabe and Ito's colours, and line styles for those who see none. Vermillion is for limits.
_COLOURS = (BLUE, ORANGE, "#009E73", "#CC79A7", "#56B4E9", "#000000")
_STYLES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (8, 2)))
MOST_POLICIES = len(_COLOURS)
# Of use, from fresh to worn: rises evenly in darkness, so that it survives grey print.
_LIFE = LinearSegmentedColormap.from_list("life", ["#9FD0F0", BLUE, "#12233F"])
_WORN = (0.1, 0.5, 1.0)  # used shares of life for which limits are drawn
_LIMIT_STYLES: dict[str, Any] = {"force": "-", "power": "--"}
_BARS = 3  # drawn one after another
_LEVEL = 0.02  # width of a histogram's bar, in limits
_WIDTH, _PANEL = 7.2, 2.8  # [inch]: a page's text, and the least that a panel's title needs
_LIMIT: dict[str, Any] = {"color": VERMILLION, "linewidth": 0.9}
_THIN: dict[str, Any] = {"linewidth": 0.6, "alpha": 0.4}


def play(players: Sequence[Player], scenario: Scenario, draws: Sequence[int]) -> dict[str, list[Course]]:
    """Play every policy on the same draws, with a progress bar.

    Raises:
        ResultError: there are none or too many to tell apart, one is a reference, which acts on more than observations, or one
            cannot play.
    """
    contestants = [player for player in players if isinstance(player, Contestant)]
    if others := [player.policy.label for player in players if not isinstance(player, Contestant)]:
        raise ResultError(f"{', '.join(others)} cannot be drawn: only what acts on observations can")
    if not contestants:
        raise ResultError("there is nothing to draw: name a policy or give an agent")
    if len(contestants) > MOST_POLICIES:
        raise ResultError(f"{len(contestants)} policies cannot be told apart in a picture: at most {MOST_POLICIES}")
    courses: dict[str, list[Course]] = {contestant.policy.label: [] for contestant in contestants}
    with tqdm(total=len(contestants) * len(draws), unit="episode", disable=None) as bar:
        for contestant in contestants:
            for draw in draws:
                courses[contestant.policy.label].append(Course.of(contestant, scenario, draw))
                bar.update()
    return courses


def write(courses: Courses, folder: Path) -> list[Path]:
    """Write every picture that applies into a folder, each whole or not at all; returns the paths.

    Raises:
        ResultError: a file cannot be written.
    """
    written = []
    with rc_context({"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False}):
        for name, draw in PICTURES.items():
            figure = draw(courses)
            if figure is not None:
                _save(figure, folder / name)
                written.append(folder / name)
    return written


def operating_point(courses: Courses) -> Figure | None:
    """Cutting speed and feed as an edge wears, a panel for each policy; none where the speed is fixed or nothing is seen."""
    scenario = _scenario(courses)
    if scenario.control.action in ("override", "part") or not _cuts(courses):
        return None
    figure = Figure(figsize=(max(_WIDTH, _PANEL * len(courses)), 4.0), layout="constrained")
    panels = figure.subplots(1, len(courses), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (label, episodes) in zip(panels, courses.items(), strict=True):
        for course in episodes:
            speed, feed, used = (course[name][course.cutting] for name in ("cutting_speed", "feed", "used_life"))
            axes.scatter(speed, feed, 7, used, cmap=_LIFE, vmin=0.0, vmax=1.0, alpha=0.35, linewidths=0)
        speeds, feeds = fifths(episodes, "cutting_speed"), fifths(episodes, "feed")
        axes.plot(speeds, feeds, color="white", linewidth=2.6, zorder=3)
        axes.plot(speeds, feeds, color="black", linewidth=1.0, zorder=4)
        middles = (np.arange(len(speeds)) + 0.5) / len(speeds)
        axes.scatter(speeds, feeds, 46, middles, cmap=_LIFE, vmin=0.0, vmax=1.0, edgecolors="black", linewidths=0.9, zorder=5)
        done = np.flatnonzero(np.isfinite(speeds))
        ends = [f"{speeds[place]:.0f} m/min, {feeds[place]:.2f} mm/rev" for place in (done[0], done[-1])]
        moves = f"from {ends[0]}\nto {ends[1]}" if ends[0] != ends[1] else f"stays at\n{ends[0]}"
        axes.set_title(f"{label}\n{moves}", loc="left", fontsize="medium")
        axes.set_xlabel("cutting speed [m/min], log scale")
    panels[0].set_ylabel("feed [mm/rev], log scale")
    _zoom(panels, courses, scenario)
    for axes in panels:
        _limits_of_wear(axes, scenario)
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
        "Where an edge is used, as it wears",
        f"limits at {depth:g} mm depth of cut and nominal hardness, for edges of {shares} % used life, in their colours; "
        f"{_of_draws(courses)}",
    )
    return figure


def bar_entry(courses: Courses) -> Figure | None:
    """Feed and load around the start of every bar, a column for each policy; none where no entry is seen."""
    places = np.arange(-BEFORE, AFTER + 0.5)
    entries = {
        label: [(course, place, near) for course in episodes for _, place, near in course.entries()]
        for label, episodes in courses.items()
    }
    if not all(entries.values()):
        return None
    figure = Figure(figsize=(max(_WIDTH, _PANEL * len(courses)), 4.6), layout="constrained")
    grid = figure.subplots(2, len(courses), sharex=True, sharey="row", squeeze=False)
    scenario = _scenario(courses)
    for column, (label, colour) in enumerate(_with_colour(courses)):
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
        grid[1, column].axhline(1.0, **_LIMIT)
        share = habits(courses[label])["feed_at_entry"]
        grid[0, column].set_title(f"{label}\nenters at {share:.0f} % of its feed in the bar", loc="left", fontsize="medium")
        grid[1, column].set_xlabel("place from the bar's start [mm]")
        grid[1, column].set_xlim(-BEFORE, AFTER)
    grid[0, 0].set_ylim(bottom=0.0)
    grid[0, 0].set_ylabel("feed [mm/rev]")
    grid[1, 0].set_ylabel("force / limit or power / limit,\nthe higher of the two")
    number = ", ".join(str(len(of_policy)) for of_policy in entries.values())
    _headline(
        figure,
        "Whether a policy slows down before a bar's start or after it",
        f"{number} entries; black: their mean; grey: air; red: limit",
    )
    return figure


def limits(courses: Courses) -> Figure | None:
    """How force and power are distributed over cutting time; none where they are not seen."""
    if not _cuts(courses):
        return None
    scenario = _scenario(courses)
    figure = Figure(figsize=(_WIDTH, 3.6), layout="constrained")
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
        for (label, colour), style in zip(_with_colour(courses), _STYLES, strict=False):
            weights = np.concatenate([course["engaged_time"][course.cutting] for course in courses[label]])
            percent = 100.0 * weights / weights.sum()
            over = percent[samples[label] > 1.0].sum()
            inside = np.clip(samples[label], edges[0], edges[-1] - _LEVEL / 2)
            axes.hist(inside, edges, weights=percent, histtype="stepfilled", color=colour, alpha=0.15)
            what = f"{label}: {over:.1f} % of cutting time above"
            axes.hist(inside, edges, weights=percent, histtype="step", color=colour, linestyle=style, label=what)
        axes.axvline(1.0, **_LIMIT)
        axes.axvline(tolerated, linestyle=":", **_LIMIT)
        axes.set_xlabel(f"{name} / limit")
        axes.legend(loc="lower left", bbox_to_anchor=(-0.02, 1.0), borderaxespad=0.1)
    panels[0].set_ylabel(f"cutting time [%] in steps of {_LEVEL:g}")
    _headline(
        figure,
        "How close to the limits policies cut",
        f"red: limit; dotted: the tolerance of {100.0 * scenario.limits.overload_tolerance:g} %; {_of_draws(courses)}",
    )
    return figure


def used_life(courses: Courses) -> Figure:
    """Metal removed and wear over time, all policies in the same panels."""
    figure = Figure(figsize=(_WIDTH, 4.8), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for (label, colour), style in zip(_with_colour(courses), _STYLES, strict=False):
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
    panels[1].axhline(_scenario(courses).tool.wear_criterion, **_LIMIT)
    panels[1].set_ylabel("flank wear [mm]")
    panels[1].set_xlabel("machine time [min]")
    panels[1].set_xlim(left=0.0)
    for axes in panels:
        axes.set_ylim(bottom=0.0)
    figure.align_ylabels(panels)
    _headline(figure, "What is made of an edge", f"red: wear criterion; dots: the episode ends; {_of_draws(courses)}")
    return figure


def bars(courses: Courses) -> Figure | None:
    """A few bars of the first draw, half-way through the shortest episode; none where no whole bar is seen."""
    first = {label: episodes[0] for label, episodes in courses.items()}
    whole = min(course.whole_bars for course in first.values())
    if whole < 1 or not _cuts(courses):
        return None
    scenario = _scenario(courses)
    count = min(_BARS, whole)
    bar = (whole - count) // 2
    start, end = (pitch * (scenario.workpiece.bar_length + scenario.workpiece.approach) for pitch in (bar, bar + count))
    figure = Figure(figsize=(_WIDTH, 8.2), layout="constrained")
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
    for (label, colour), style in zip(_with_colour(courses), _STYLES, strict=False):
        course, here = first[label], seen[label]
        for axes, (what, values) in zip(panels[2:], subjects, strict=True):
            _along(axes, course, values(course), here, color=colour, linestyle=style, linewidth=1.1, label=label)
            axes.set_ylabel(what)
        beyond = np.maximum(course.force_share, course.power_share)[here] > 1.0
        over.append(f"{label} {100.0 * np.average(beyond, weights=course['engaged_time'][here]):.0f} %")
    for axes in panels[4:]:
        axes.axhline(1.0, **_LIMIT)
    for axes in panels:
        for number in range(bar, bar + count):
            metal = first[finest].bar_start(number)
            axes.axvspan(metal - scenario.workpiece.approach, metal, color=GREY, alpha=0.25, linewidth=0)
    panels[2].legend(loc="lower left", bbox_to_anchor=(0.0, 0.95), ncols=3, borderaxespad=0.1)
    panels[-1].set_xlabel("path [mm]")
    panels[-1].set_xlim(start, end)
    figure.align_ylabels(panels)
    which = "bar 1" if count == 1 else f"bars {bar + 1} to {bar + count}"
    _headline(
        figure,
        "What was hidden, and what was done about it",
        f"{which} of draw {first[finest].draw}; cutting time over a limit: {', '.join(over)}; grey: air; red: limits",
    )
    return figure


PICTURES: dict[str, Callable[[Courses], Figure | None]] = {
    "operating_point.png": operating_point,
    "bar_entry.png": bar_entry,
    "limits.png": limits,
    "used_life.png": used_life,
    "bars.png": bars,
}
"""File names, and what draws them: None where a picture does not apply to a scenario."""


def _save(figure: Figure, path: Path) -> None:
    try:
        replace_file(path, lambda partial: figure.savefig(partial, dpi=200, format="png"))
    except OSError as error:
        raise ResultError(f"{path} cannot be written: {error.strerror}") from error


def _scenario(courses: Courses) -> Scenario:
    return next(iter(courses.values()))[0].scenario


def _cuts(courses: Courses) -> bool:
    return all(any(course.cutting.any() for course in episodes) for episodes in courses.values())


def _shares(course: Course) -> dict[str, Array]:
    return {"thrust force": course.force_share, "power": course.power_share}


def _with_colour(courses: Courses) -> list[tuple[str, str]]:
    return list(zip(courses, _COLOURS, strict=False))


def _of_draws(courses: Courses) -> str:
    number = len(next(iter(courses.values())))
    return f"{number} draws" if number > 1 else "1 draw"


def _headline(figure: Figure, what: str, how: str) -> None:
    figure.suptitle(what, x=0.01, ha="left", fontweight="bold")
    if not figure.legends:
        figure.supxlabel(how, x=0.01, ha="left", fontsize="small", color=GREY)
    else:  # both would lie at the bottom
        figure.legends[0].set_title(how, FontProperties(size="small"))
        figure.legends[0].get_title().set_color(GREY)


def _zoom(panels: Sequence[Axes], courses: Courses, scenario: Scenario) -> None:
    """Both axes logarithmic, around what was used."""
    for axis, name in (("x", "cutting_speed"), ("y", "feed")):
        values = np.concatenate([course[name][course.cutting] for episodes in courses.values() for course in episodes])
        low, high = (getattr(scenario.machine, f"{name}_{end}") for end in ("min", "max"))
        bounds = max(values.min() / 1.1, low / 1.02), min(values.max() * 1.1, high * 1.02)
        digits = (1, 1.5, 2, 3, 4, 6) if bounds[1] > 3.0 * bounds[0] else (1, 1.2, 1.4, 1.6, 1.8, 2, 2.5, 3, 4, 5, 6, 8)
        ticks = [digit * 10.0**power for power in range(-4, 5) for digit in digits]
        for axes in panels:
            getattr(axes, f"set_{axis}scale")("log")
            getattr(axes, f"set_{axis}lim")(*bounds)
            subject = getattr(axes, f"{axis}axis")
            subject.set_major_locator(FixedLocator([tick for tick in ticks if bounds[0] <= tick <= bounds[1]]))
            subject.set_major_formatter("{x:g}")
            subject.set_minor_locator(NullLocator())


def _limits_of_wear(axes: Axes, scenario: Scenario) -> None:
    """Where force and power reach their limits at nominal depth and hardness, for a fresh and a worn edge."""
    process = Process.of(scenario)
    speeds = np.geomspace(*axes.get_xlim(), 100)
    for used in _WORN:
        wear = process.wear_criterion * used**process.wear.time
        for limit, style in zip((process.thrust_force, process.power), _LIMIT_STYLES.values(), strict=True):
            line = limit.line(scenario.workpiece.depth_of_cut, 1.0, wear)
            axes.plot(speeds, np.exp(line.highest_feed(np.log(speeds))), color=_LIFE(used), linestyle=style, linewidth=1.2)


def _along(axes: Axes, course: Course, values: Array, seen: NDArray[np.bool_], **style: Any) -> None:
    """Draw a series over the path, interrupted where the tool is not in metal."""
    axes.plot(course["path"], np.where(seen, values, np.nan), **style)
