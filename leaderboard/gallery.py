"""Compare the behaviour of policies on the same held-out seeds, in pictures and numbers."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any, Self

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.models.process import Process
from leaderboard.result import ResultError
from leaderboard.table import aligned
from leaderboard.trajectories import play_trajectory
from turning_env import Scenario
from turning_env.scoring.policy import PolicySpec
from turning_render import plot_style as style

Array = NDArray[np.float64]
LIFE_STAGES = 5
"""Equal parts into which an edge's life is divided."""
MAX_POLICIES = 6
"""Largest number of policies in a picture; more could not be distinguished."""
METRICS = {
    "minutes_per_edge": ("machine time per edge [min]", 2),
    "removed_per_edge": ("metal per edge [cm3]", 0),
    "first_cutting_speed": ("mean cutting speed in the first fifth of life [m/min]", 1),
    "last_cutting_speed": ("mean cutting speed in the last fifth of life [m/min]", 1),
    "first_feed": ("mean feed in the first fifth of life [mm/rev]", 3),
    "last_feed": ("mean feed in the last fifth of life [mm/rev]", 3),
    "overload_share": ("cutting time over a limit [%]", 2),
    "severe_overload_share": ("cutting time over a limit by more than the tolerance [%]", 2),
}
"""Heading with unit, and decimals, of each number."""
_SERIES = (
    *("path", "depth_of_cut", "hardness", "cutting_speed", "feed", "thrust_force", "power", "used_life"),
    *("engaged_time", "removed", "edges_used", "overload_time", "severe_overload_time"),
)
"""Fields of ``info`` at a step's end, and sums over a step."""
_PANEL = 2.8  # width that a panel's title needs at least [inch]
_LEVEL = 0.02  # width of a histogram's bin, in limits
_BARS = 3  # drawn one after another
# Of use, from fresh to worn: rises evenly in darkness, so that it survives grey print.
_LIFE = LinearSegmentedColormap.from_list("life", ["#9FD0F0", style.BLUE, "#12233F"])
_WORN = (0.1, 0.5, 1.0)  # used shares of life for which limits are drawn
_LIMIT_STYLES: dict[str, Any] = {"force": "-", "power": "--"}
_LEGEND: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "borderaxespad": 0.1}


@dataclass(frozen=True)
class Episode:
    """One episode: ``minutes``, the machine time elapsed, and fields of ``info``, arrays of shape (steps,)."""

    seed: int
    scenario: Scenario
    series: dict[str, Array]

    @classmethod
    def of(cls, spec: PolicySpec, scenario: Scenario, seed: int) -> Self:
        """Play it.

        Raises:
            ResultError: the policy's actions have the wrong shape or are not finite.
        """
        try:
            series = play_trajectory(spec.make, scenario, seed, _SERIES)
        except ValueError as error:
            raise ResultError(f"{spec.label} cannot play: {error}") from error
        return cls(seed, scenario, {name: np.array(values) for name, values in series.items()})

    def __getitem__(self, name: str) -> Array:
        return self.series[name]

    @property
    def cutting(self) -> NDArray[np.bool_]:
        """Whether the tool is in metal at each step's end; after a whole part it never is."""
        return (self["depth_of_cut"] > 0.0) & (self.scenario.control.action != "part")

    @property
    def force_load(self) -> Array:
        """Thrust force over its limit [-]."""
        return self["thrust_force"] / self.scenario.limits.thrust_force

    @property
    def power_load(self) -> Array:
        """Power over its limit [-]."""
        return self["power"] / self.scenario.limits.power

    def bar_start(self, bar: int) -> float:
        """Return the position on the path at which a bar's metal begins [mm]."""
        workpiece = self.scenario.workpiece
        return bar * (workpiece.bar_length + workpiece.approach) + workpiece.approach

    @property
    def whole_bars(self) -> int:
        """Number of bars that were cut from end to end."""
        workpiece = self.scenario.workpiece
        return int((self["path"][-1] + 1e-6) / (workpiece.bar_length + workpiece.approach))


Played = Mapping[str, Sequence[Episode]]
"""The episodes of each policy, by its label: of all policies with the same seeds."""


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
        raise ResultError(f"{len(specs)} policies cannot be distinguished in a picture: at most {MAX_POLICIES}")
    played: dict[str, list[Episode]] = {spec.label: [] for spec in specs}
    with tqdm(total=len(specs) * len(seeds), unit="episode", disable=None) as bar:
        for spec in specs:
            for seed in seeds:
                played[spec.label].append(Episode.of(spec, scenario, seed))
                bar.update()
    return played


def measure(episodes: Sequence[Episode]) -> dict[str, float]:
    """Return each of ``METRICS`` over all episodes of one policy; NaN if a metric does not apply."""
    edges, removed, engaged, overload, severe = (
        sum(float(episode[name].sum()) for episode in episodes)
        for name in ("edges_used", "removed", "engaged_time", "overload_time", "severe_overload_time")
    )
    speeds, feeds = by_life_stage(episodes, "cutting_speed"), by_life_stage(episodes, "feed")
    values = (
        _ratio(sum(float(episode["minutes"][-1]) for episode in episodes), edges),
        _ratio(removed, edges),
        *(float(each) for each in (speeds[0], speeds[-1], feeds[0], feeds[-1])),
        100.0 * _ratio(overload, engaged),
        100.0 * _ratio(severe, engaged),
    )
    return dict(zip(METRICS, values, strict=True))


def by_life_stage(episodes: Sequence[Episode], name: str) -> Array:
    """Return means of a series over the cutting time in each stage of life, shape (LIFE_STAGES,); NaN for stages not reached."""
    values, weights, used = (_while_cutting(episodes, itemgetter(key)) for key in (name, "engaged_time", "used_life"))
    stage = np.clip((LIFE_STAGES * used).astype(np.int64), 0, LIFE_STAGES - 1)
    sums, times = (np.bincount(stage, what, LIFE_STAGES) for what in (values * weights, weights))
    means: Array = np.divide(sums, times, out=np.full(LIFE_STAGES, np.nan), where=times > 0.0)
    return means


def render(played: Played) -> str:
    """Return the metrics as text: a line each, a column for every policy."""
    measured = [measure(episodes) for episodes in played.values()]
    rows = [["", *played]]
    for name, (heading, decimals) in METRICS.items():
        rows.append([heading, *(f"{each[name]:.{decimals}f}" if math.isfinite(each[name]) else "" for each in measured)])
    return aligned(rows)


def write(played: Played, folder: Path) -> list[Path]:
    """Write every picture that applies into a folder, each whole or not at all; returns the paths."""
    written = []
    scenario = next(iter(played.values()))[0].scenario
    with style.for_print():
        for name, draw in PICTURES.items():
            if figure := draw(played, scenario):
                style.save(style.readable(figure), folder / name)
                written.append(folder / name)
    return written


def draw_operating_points(played: Played, scenario: Scenario) -> Figure | None:
    """Draw cutting speed and feed as an edge wears, a panel for each policy; None if the speed is fixed or nothing is seen."""
    if scenario.control.action in ("override", "part") or not _all_cut(played):
        return None
    figure = Figure(figsize=(max(style.DOUBLE, _PANEL * len(played)), 4.0), layout="constrained")
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
        axes.set_title(f"{label}\nfrom {ends[0]}\nto {ends[1]}", loc="left")
        axes.set_xlabel("cutting speed [m/min]")
    panels[0].set_ylabel("feed [mm/rev]")
    for axis, name in (("x", "cutting_speed"), ("y", "feed")):
        values = np.concatenate([_while_cutting(episodes, itemgetter(name)) for episodes in played.values()])
        panels[0].set(**{f"{axis}lim": (0.95 * values.min(), 1.05 * values.max())})
    for axes in panels:
        _draw_limits(axes, scenario)
    figure.colorbar(ScalarMappable(Normalize(0.0, 1.0), _LIFE), ax=list(panels), label="used share of the edge's life", pad=0.01)
    handles = [
        Line2D([], [], color=_LIFE(0.5), linestyle=line, label=f"{name} over limit above") for name, line in _LIMIT_STYLES.items()
    ]
    handles.append(Line2D([], [], color="black", marker="o", markerfacecolor=_LIFE(0.5), label="mean of each fifth of life"))
    figure.legend(handles=handles, loc="outside lower left", ncols=3, alignment="left")
    shares = ", ".join(f"{100.0 * used:g}" for used in _WORN)
    return _headline(
        figure,
        "Speed and feed over edge life",
        f"limits at {scenario.workpiece.depth_of_cut:g} mm depth of cut and nominal hardness, for edges of {shares} % used life, "
        f"in their colours; {_seeds_of(played)}",
    )


def _draw_limits(axes: Axes, scenario: Scenario) -> None:
    """Draw the limits of force and power at nominal depth and hardness, for edges of several wears."""
    process = Process.of(scenario)
    speeds = np.linspace(*axes.get_xlim(), 100)
    for used in _WORN:
        wear = process.wear_criterion * used**process.wear.time
        for limit, dashes in zip((process.thrust_force, process.power), _LIMIT_STYLES.values(), strict=True):
            line = limit.line(scenario.workpiece.depth_of_cut, 1.0, wear)
            axes.plot(speeds, np.exp(line.highest_feed(np.log(speeds))), color=_LIFE(used), linestyle=dashes, linewidth=1.2)


def draw_loads(played: Played, scenario: Scenario) -> Figure | None:
    """Draw the distributions of force and power over cutting time; None if they are not seen."""
    if not _all_cut(played):
        return None
    figure = Figure(figsize=(style.DOUBLE, 3.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    tolerated = 1.0 + scenario.limits.overload_tolerance
    for axes, name, load in zip(panels, ("thrust force", "power"), ("force_load", "power_load"), strict=True):
        samples = {label: _while_cutting(episodes, attrgetter(load)) for label, episodes in played.items()}
        # The rarest are drawn at the ends, so that one broken edge does not stretch the axis.
        low, high = np.quantile(np.concatenate(list(samples.values())), (0.002, 0.998))
        first, last = np.floor(min(low, 0.9) / _LEVEL), np.ceil(max(high, tolerated + 0.1) / _LEVEL)
        bins = np.arange(first, last + 1.5) * _LEVEL
        for label, look in _looks(played).items():
            times = _while_cutting(played[label], itemgetter("engaged_time"))
            percent = 100.0 * times / times.sum()
            over = percent[samples[label] > 1.0].sum()
            inside = np.clip(samples[label], bins[0], bins[-1] - _LEVEL / 2)
            axes.hist(inside, bins, weights=percent, histtype="stepfilled", color=look["color"], alpha=0.15)
            axes.hist(inside, bins, weights=percent, histtype="step", **look, label=f"{label}: {over:.1f} % above")
        axes.axvline(1.0, **style.LIMIT)
        axes.axvline(tolerated, **style.LIMIT | {"linestyle": ":"})
        axes.set_xlabel(f"{name} / limit")
        axes.legend(**_LEGEND)
    panels[0].set_ylabel(f"cutting time [%] in steps of {_LEVEL:g}")
    tolerance = f"the tolerance of {100.0 * scenario.limits.overload_tolerance:g} %"
    return _headline(figure, "Loads and their limits", f"red: limit; dotted: {tolerance}; {_seeds_of(played)}")


def draw_bars(played: Played, scenario: Scenario) -> Figure | None:
    """Draw a few bars of the first seed, half-way through the shortest episode; None if no whole bar is seen."""
    first = {label: episodes[0] for label, episodes in played.items()}
    whole = min(episode.whole_bars for episode in first.values())
    if whole < 1 or not _all_cut(played):
        return None
    workpiece, count = scenario.workpiece, min(_BARS, whole)
    bar = (whole - count) // 2
    start, end = (number * (workpiece.bar_length + workpiece.approach) for number in (bar, bar + count))
    figure = Figure(figsize=(style.DOUBLE, 8.2), layout="constrained")
    panels = figure.subplots(6, 1, sharex=True)
    seen = {label: (each["path"] > start) & (each["path"] <= end) & each.cutting for label, each in first.items()}
    # All see the same bars: the one that looks most often draws them, interrupted where the tool is not in metal.
    finest = max(seen, key=lambda label: int(seen[label].sum()))
    for axes, name, nominal in zip(panels[:2], ("depth_of_cut", "hardness"), (workpiece.depth_of_cut, 1.0), strict=True):
        axes.plot(first[finest]["path"], np.where(seen[finest], first[finest][name], np.nan), color="black", linewidth=1.0)
        axes.axhline(nominal, color=style.GREY, linewidth=0.7, linestyle=":")
    over = []
    for label, look in _looks(played).items():
        episode, here = first[label], seen[label]
        drawn = (episode["cutting_speed"], episode["feed"], episode.force_load, episode.power_load)
        for axes, values in zip(panels[2:], drawn, strict=True):
            axes.plot(episode["path"], np.where(here, values, np.nan), **look, linewidth=1.1, label=label)
        beyond = np.maximum(episode.force_load, episode.power_load)[here] > 1.0
        over.append(f"{label} {100.0 * np.average(beyond, weights=episode['engaged_time'][here]):.0f} %")
    subjects = (
        "depth of cut\n[mm]",
        "hardness\n/ nominal",
        "cutting speed\n[m/min]",
        "feed\n[mm/rev]",
        "force / limit",
        "power / limit",
    )
    for axes, subject in zip(panels, subjects, strict=True):
        axes.set_ylabel(subject)
        for number in range(bar, bar + count):
            metal = first[finest].bar_start(number)
            axes.axvspan(metal - workpiece.approach, metal, color=style.GREY, alpha=0.25, linewidth=0)
    for axes in panels[4:]:
        axes.axhline(1.0, **style.LIMIT)
    panels[2].legend(**_LEGEND, ncols=3)
    panels[-1].set(xlabel="path [mm]", xlim=(start, end))
    figure.align_ylabels(panels)
    which = "bar 1" if count == 1 else f"bars {bar + 1} to {bar + count}"
    return _headline(
        figure,
        "Hidden quantities and the response to them",
        f"{which} of seed {first[finest].seed}; cutting time over a limit: {', '.join(over)}; grey: air; red: limits",
    )


PICTURES: dict[str, Callable[[Played, Scenario], Figure | None]] = {
    "operating_point.png": draw_operating_points,
    "limits.png": draw_loads,
    "bars.png": draw_bars,
}
"""Drawing functions by file name. A function returns None if its picture does not apply to the scenario."""


def _looks(played: Played) -> dict[str, dict[str, Any]]:
    """Return each policy's look: the same in every picture."""
    looks = zip(played, style.policy_looks(played), strict=True)
    return {label: {"color": colour, "linestyle": dashes} for label, (colour, dashes) in looks}


def _all_cut(played: Played) -> bool:
    """Return whether every policy is seen in metal."""
    return all(any(episode.cutting.any() for episode in episodes) for episodes in played.values())


def _while_cutting(episodes: Sequence[Episode], values: Callable[[Episode], Array]) -> Array:
    """Return values of every step in metal, one episode after another."""
    return np.concatenate([values(episode)[episode.cutting] for episode in episodes])


def _seeds_of(played: Played) -> str:
    number = len(next(iter(played.values())))
    return f"{number} seeds" if number > 1 else "1 seed"


def _headline(figure: Figure, what: str, how: str) -> Figure:
    """Write a picture's title above it, and instructions below it or in its legend; return the picture."""
    figure.suptitle(what, x=0.01, ha="left", fontweight="bold")
    if not figure.legends:
        figure.supxlabel(how, x=0.01, ha="left", size=style.MIN_FONT, color=style.GREY)
    else:  # both would lie at the bottom
        figure.legends[0].set_title(how)
        figure.legends[0].get_title().set_color(style.GREY)
    return figure


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0.0 else math.nan
