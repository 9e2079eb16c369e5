"""The pictures for print: a ranking with two trajectories, and scores over the tasks."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from leaderboard.aggregate import (
    BEST_AGENT,
    BEST_RULE,
    Entry,
    TaskScores,
    entries,
    levels_and_shares,
    mean_score,
)
from leaderboard.ranking import Leaderboard
from leaderboard.result import ResultError
from leaderboard.standings import Standing
from leaderboard.trajectories import Trajectory
from turning_env import Scenario
from turning_env.rendering import plot_style as style

PLAIN_NAMES = {
    "causal": "oracle: depth, hardness and wear known",
    "analytic_gradient": "agent: trained with model gradients",
    "predictive": "Kalman filter and optimiser",
    "ppo_belief": "agent: PPO, shown the filter",
    "ppo": "agent: PPO",
    "adaptive_pn": "published adaptive control, rule [PN]",
    "grid_search": "published grid search",
    "fixed_tuned": "best fixed speed and feed",
}
"""The policies of RoughTurning-v0 in the picture, with names that a stranger understands."""
MAX_POLICIES = 8
MAX_LETTERS = 28  # in a line of a name
_SHARES_AT = 1.16  # place of the shares of time over a limit, in widths of the axes


_LEVELS = np.linspace(-50.0, 110.0, 161)  # scores at which profiles are drawn
_STUB = 10.0  # length of the line of a mean below these scores
_KIND_LOOKS = {
    "random": style.LINES[6],
    "best fixed": style.LineLook(style.GREY, "-"),
    "best simple search": style.LINES[5],
    "best published": style.LINES[4],
    BEST_AGENT: style.LINES[3],
    BEST_RULE: style.LINES[0],
    "best privileged agent": style.LINES[2],
}
"""Colour and dashes of kinds of policies in the picture of scores. Vermillion is left to limits."""


def write(leaderboard: Leaderboard, path: Path) -> None:
    """Draw a leaderboard, whole or not at all.

    The picture shows at most eight policies, and two of them on the same bar. Raise ResultError if
    fewer than two policies have trajectories of the same seed, or the suffix names no format.
    """
    recorded = leaderboard.trajectories.episodes if leaderboard.trajectories else []
    same_seed = [episode for episode in recorded if episode.seed == recorded[0].seed]
    if len(same_seed) < 2:
        task = leaderboard.task
        raise ResultError(
            "two trajectories are needed; python -m leaderboard run records those of "
            f"{task.env_id} on scenario {task.scenario.name}"
        )
    # The best rule and the best agent that learned from rewards alone, or the first two.
    pair = [
        _best_of(("rule",), leaderboard.standings),
        _best_of(("model-free agent", "agent on a belief"), leaderboard.standings),
    ]
    same_seed.sort(key=lambda episode: leaderboard.names[episode.policy.label] not in pair)
    with style.for_print():
        figure = Figure(figsize=(5.4, 6.2), layout="constrained")  # narrow: phones show it, too
        subfigures = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.5, 1))
        upper, lower = subfigures[:, 0]
        _draw_ranking(upper.subplots(), leaderboard)
        panels = lower.subplots(2, 1, sharex=True)
        _draw_same_bar(panels, same_seed[:2], leaderboard.task.scenario)
        try:
            style.save(style.readable(figure), path)
        except ValueError as error:
            raise ResultError(str(error)) from error


def _best_of(classes: Sequence[str], standings: Sequence[Standing]) -> str | None:
    """Return the name of the first standing of some classes; None if there is none."""
    names = (standing.name for standing in standings if standing.about.policy_class in classes)
    return next(names, None)


def _draw_ranking(axes: Axes, leaderboard: Leaderboard) -> None:
    """Draw the policies of ``PLAIN_NAMES`` or, unless all of them have played, the first ones."""
    known = [standing for standing in leaderboard.standings if standing.name in PLAIN_NAMES]
    standings = known if len(known) == len(PLAIN_NAMES) else leaderboard.standings
    standings = sorted(standings[:MAX_POLICIES], key=lambda standing: -standing.mean_return.value)
    for place, standing in enumerate(standings):
        _draw_standing(axes, standing, place)
    axes.annotate(
        "time over a limit\n(by > 5 %) [%]",
        (_SHARES_AT, 1.01),
        xycoords="axes fraction",
        ha="center",
        va="bottom",
    )
    names = [PLAIN_NAMES.get(standing.name, standing.name) for standing in standings]
    axes.set_yticks(range(len(names)), [fill(name, MAX_LETTERS) for name in names])
    axes.set_ylim(len(standings) - 0.5, -0.7)
    axes.set_xlabel("mean return [s of machine time], 95 % interval; higher is better")
    axes.set_title(
        f"{len(leaderboard.task.seeds)} held-out seeds\nhollow: not feasible", loc="left"
    )
    axes.grid(axis="x")
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)


def _draw_standing(axes: Axes, standing: Standing, place: int) -> None:
    """Draw the return of a policy with its interval, and its shares of time over a limit."""
    estimate = standing.mean_return.estimate
    colour, _ = style.policy_look(standing.name)
    is_filled = standing.feasible or standing.kind == "oracle"
    axes.plot([estimate.low, estimate.high], [place, place], color=colour, linewidth=2.5)
    axes.plot(
        estimate.value,
        place,
        "o",
        color=colour,
        markerfacecolor=colour if is_filled else "white",
    )
    axes.annotate(
        f"{estimate.value:.{estimate.decimals()}f} s",
        (estimate.value, place),
        (0, 7),
        textcoords="offset points",
        ha="center",
    )
    over = 100.0 * (standing.overload.overload_share or 0.0)
    severely_over = 100.0 * standing.overload.severe_share
    axes.annotate(
        f"{over:.1f} ({severely_over:.1f})",
        (_SHARES_AT, place),
        xycoords=("axes fraction", "data"),
        ha="center",
        va="center",
    )


class _Panel(NamedTuple):
    """A panel of the picture: the series that it shows along a bar."""

    series: str
    label: str
    divisor: float  # from the unit of the series to that of the label
    limit: float | None  # in the unit of the series


def _draw_same_bar(
    axes_of_panels: Sequence[Axes], episodes: Sequence[Trajectory], scenario: Scenario
) -> None:
    """Draw feed and thrust force of two policies along one bar.

    The bar lies half-way through the shorter trajectory.
    """
    pitch = scenario.workpiece.bar_length + scenario.workpiece.approach
    shortest_path = min(episode.series["path"][-1] for episode in episodes)
    bar = int(shortest_path / 2.0 // pitch)
    panels = (
        _Panel("feed", "feed\n[mm/rev]", divisor=1.0, limit=None),
        _Panel(
            "thrust_force",
            "thrust force\n[kN]",
            divisor=1000.0,
            limit=scenario.limits.thrust_force,
        ),
    )
    for axes, panel in zip(axes_of_panels, panels, strict=True):
        for episode, dashes in zip(episodes, ("-", "--"), strict=True):
            _draw_along_bar(axes, panel, episode, dashes=dashes, bar=bar, scenario=scenario)
        if panel.limit is not None:
            limit = panel.limit / panel.divisor
            axes.axhline(limit, **style.LIMIT)
            axes.annotate(
                "limit", (1.0, limit), xycoords=("axes fraction", "data"), color=style.VERMILLION
            )
        axes.set_ylabel(panel.label)
    upper, lower = axes_of_panels
    upper.set_ylim(bottom=0.0)
    upper.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
    lower.set_xlabel(f"place along bar {bar + 1} [mm]")
    upper.figure.align_ylabels(axes_of_panels)


def _draw_along_bar(
    axes: Axes, panel: _Panel, episode: Trajectory, dashes: str, bar: int, scenario: Scenario
) -> None:
    """Draw a series of one policy along a bar, where the tool is in metal."""
    length = scenario.workpiece.bar_length
    approach = scenario.workpiece.approach
    start = bar * (length + approach)
    place = np.array(episode.series["path"]) - start - approach
    in_metal = np.array(episode.series["depth_of_cut"]) > 0.0
    on_bar = (place > 0.0) & (place < length) & in_metal
    values = np.array(episode.series[panel.series])[on_bar] / panel.divisor
    name = episode.policy.name
    colour, _ = style.policy_look(name)
    axes.plot(
        place[on_bar],
        values,
        dashes,
        color=colour,
        label=PLAIN_NAMES.get(name, episode.policy.label),
    )


def write_scores(tasks: Sequence[TaskScores], path: Path) -> None:
    """Draw scores over the tasks, whole or not at all: means and performance profiles.

    The lines of the means, which bear the names, are the legend of the profiles. Raise ResultError
    if the suffix names no format.
    """
    every_kind = entries(tasks)
    listed = {title: every_kind[title] for title in _KIND_LOOKS if title in every_kind}
    with style.for_print():
        figure = Figure(figsize=(4.8, 4.6), layout="constrained")  # narrow: phones show it, too
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1.0, 1.25))
        _draw_mean_scores(upper, listed)
        _draw_profiles(lower, listed)
        for axes in (upper, lower):
            for end in (0.0, 100.0):
                axes.axvline(end, color=style.GREY, linewidth=0.6, zorder=0.0)
        try:
            style.save(style.readable(figure), path)
        except ValueError as error:
            raise ResultError(str(error)) from error


def _draw_mean_scores(axes: Axes, listed: Mapping[str, Entry]) -> None:
    """Draw the interquartile mean over tasks of each kind, the best on top.

    A mean below the scale is shown by a short line and its value.
    """
    means = {title: mean_score(entry).estimate for title, entry in listed.items()}
    titles = sorted(listed, key=lambda title: means[title].value)
    left = _LEVELS[0]
    for place, title in enumerate(titles):
        look = _KIND_LOOKS[title]
        estimate = means[title]
        is_on_scale = estimate.value > left
        end = estimate.value if is_on_scale else left + _STUB
        text = f"{estimate.value:.0f}".replace("-", "\N{MINUS SIGN}")
        axes.plot([left, end], [place, place], color=look.colour, linestyle=look.dashes)
        if is_on_scale:
            ends = [estimate.low, estimate.high]
            axes.plot(ends, [place, place], color=look.colour, linewidth=3.0)
            axes.plot(estimate.value, place, "o", color=look.colour)
        axes.annotate(
            text if is_on_scale else f"{text}, off the scale",
            (max(estimate.high, end), place),
            (7, 0),
            textcoords="offset points",
            va="center",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
        )
    names = [f"{title} ({len(listed[title])})" for title in titles]
    axes.set_yticks(range(len(titles)), names)
    axes.set_ylim(-0.6, len(titles) - 0.4)
    axes.set_title("interquartile mean over tasks (number of tasks)", loc="left", pad=24.0)
    for end, meaning in (
        (0.0, "0: best fixed\nspeed and feed"),
        (100.0, "100: oracle\nof the state"),
    ):
        axes.annotate(
            meaning,
            (end, 1.0),
            (0, 2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            ha="center",
        )
    axes.spines[["left", "bottom"]].set_visible(False)
    axes.tick_params(length=0, labelbottom=False)


def _draw_profiles(axes: Axes, listed: Mapping[str, Entry]) -> None:
    """Draw the share of episodes above each score, with its interval."""
    for title, entry in listed.items():
        look = _KIND_LOOKS[title]
        shares = levels_and_shares(entry, _LEVELS)
        axes.plot(_LEVELS, 100.0 * shares["value"], color=look.colour, linestyle=look.dashes)
        axes.fill_between(
            _LEVELS,
            100.0 * shares["low"],
            100.0 * shares["high"],
            color=look.colour,
            alpha=0.2,
            linewidth=0.0,
        )
    axes.set_xlim(_LEVELS[0], _LEVELS[-1])
    axes.set_ylim(0.0, 101.0)
    axes.set_xlabel("score, with 95 % intervals")
    axes.set_ylabel("episodes above the score [%]")
