"""How policies use an edge: where in the plane of cutting speed and feed, and what they make of it."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, NullLocator

from baselines.models.process import Process
from leaderboard.behaviour import by_life_stage, measure
from leaderboard.gallery.style import LIMIT, PANEL, WIDTH, Played, all_cut, headline, scenario_of, seeds_of, with_looks
from turning_env import Scenario
from turning_env.workshop.plot_style import BLUE

# Of use, from fresh to worn: rises evenly in darkness, so that it survives grey print.
_LIFE = LinearSegmentedColormap.from_list("life", ["#9FD0F0", BLUE, "#12233F"])
_WORN = (0.1, 0.5, 1.0)  # used shares of life for which limits are drawn
_LIMIT_STYLES: dict[str, Any] = {"force": "-", "power": "--"}


def draw_operating_points(played: Played) -> Figure | None:
    """Draw cutting speed and feed as an edge wears, a panel for each policy; None where the speed is fixed or nothing is seen."""
    scenario = scenario_of(played)
    if scenario.control.action in ("override", "part") or not all_cut(played):
        return None
    figure = Figure(figsize=(max(WIDTH, PANEL * len(played)), 4.0), layout="constrained")
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
    headline(
        figure,
        "Where an edge is used, as it wears",
        f"limits at {depth:g} mm depth of cut and nominal hardness, for edges of {shares} % used life, in their colours; "
        f"{seeds_of(played)}",
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
    figure = Figure(figsize=(WIDTH, 4.8), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for label, colour, style in with_looks(played):
        metrics = measure(played[label])
        legend = f"{label}: {metrics['removed_per_edge']:.0f} cm3 in {metrics['minutes_per_edge']:.1f} min per edge"
        for episode in played[label]:
            for axes, values in zip(panels, (np.cumsum(episode["removed"]), episode["wear"]), strict=True):
                axes.plot(episode["minutes"], values, color=colour, linestyle=style, linewidth=1.0, label=legend)
                axes.plot(episode["minutes"][-1], values[-1], "o", color=colour, markersize=4)
                legend = "_"
    panels[0].set_ylabel("metal removed [cm3]")
    panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1)
    panels[1].axhline(scenario_of(played).tool.wear_criterion, **LIMIT)
    panels[1].set_ylabel("flank wear [mm]")
    panels[1].set_xlabel("machine time [min]")
    panels[1].set_xlim(left=0.0)
    for axes in panels:
        axes.set_ylim(bottom=0.0)
    figure.align_ylabels(panels)
    headline(figure, "What is made of an edge", f"red: wear criterion; dots: the episode ends; {seeds_of(played)}")
    return figure
