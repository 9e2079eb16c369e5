"""The ranking and two trajectories as one picture for print."""

from collections.abc import Sequence
from pathlib import Path
from textwrap import fill

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from leaderboard.ranking import Leaderboard
from leaderboard.result import ResultError
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


def write(leaderboard: Leaderboard, path: Path) -> None:
    """Draw a leaderboard, whole or not at all: at most eight policies, and two of them on the same bar."""
    recorded = leaderboard.trajectories.episodes if leaderboard.trajectories else []
    episodes = [episode for episode in recorded if episode.seed == recorded[0].seed]
    if len(episodes) < 2:
        what = f"{leaderboard.task.env_id} on scenario {leaderboard.task.scenario.name}"
        raise ResultError(
            f"two trajectories are needed; python -m leaderboard run records those of {what}"
        )
    first = {standing.policy_class: standing.name for standing in reversed(leaderboard.standings)}
    pair = (first.get("rule"), first.get("model-free agent"))  # the best of each, or the first two
    episodes.sort(key=lambda episode: leaderboard.names[episode.policy.label] not in pair)
    with style.for_print():
        figure = Figure(figsize=(5.4, 6.2), layout="constrained")  # narrow: phones show it, too
        upper, lower = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.5, 1))[:, 0]
        _draw_ranking(upper.subplots(), leaderboard)
        _draw_same_bar(
            lower.subplots(2, 1, sharex=True), (episodes[0], episodes[1]), leaderboard.task.scenario
        )
        try:
            style.save(style.readable(figure), path)
        except ValueError as error:
            raise ResultError(str(error)) from error


def _draw_ranking(axes: Axes, leaderboard: Leaderboard) -> None:
    known = [standing for standing in leaderboard.standings if standing.name in PLAIN_NAMES]
    standings = (known if len(known) == len(PLAIN_NAMES) else leaderboard.standings)[:MAX_POLICIES]
    standings = sorted(standings, key=lambda standing: -standing.mean_return.value)
    for place, standing in enumerate(standings):
        estimate, (colour, _) = standing.mean_return, style.policy_look(standing.name)
        ranked = standing.feasible or standing.kind == "oracle"
        axes.plot([estimate.low, estimate.high], [place, place], color=colour, linewidth=2.5)
        axes.plot(
            estimate.value, place, "o", color=colour, markerfacecolor=colour if ranked else "white"
        )
        axes.annotate(
            f"{estimate.value:.0f} s",
            (estimate.value, place),
            (0, 7),
            textcoords="offset points",
            ha="center",
        )
        over = (
            f"{100.0 * (standing.overload_share or 0.0):.1f} ({100.0 * standing.severe_share:.1f})"
        )
        axes.annotate(
            over, (1.16, place), xycoords=("axes fraction", "data"), ha="center", va="center"
        )
    axes.annotate(
        "time over a limit\n(by > 5 %) [%]",
        (1.16, 1.01),
        xycoords="axes fraction",
        ha="center",
        va="bottom",
    )
    names = [
        fill(PLAIN_NAMES.get(standing.name, standing.name), MAX_LETTERS) for standing in standings
    ]
    axes.set_yticks(range(len(standings)), names)
    axes.set_ylim(len(standings) - 0.5, -0.7)
    axes.set_xlabel("mean return [s of machine time], 95 % interval; higher is better")
    axes.set_title(
        f"{len(leaderboard.task.seeds)} held-out seeds\nhollow: not feasible", loc="left"
    )
    axes.grid(axis="x")
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)


def _draw_same_bar(
    panels: Sequence[Axes], episodes: tuple[Trajectory, Trajectory], scenario: Scenario
) -> None:
    """Draw feed and thrust force of two policies along one bar, half-way through the shorter trajectory."""
    pitch = scenario.workpiece.bar_length + scenario.workpiece.approach
    bar = int(min(episode.series["path"][-1] for episode in episodes) / 2.0 // pitch)
    subjects = (
        ("feed", "feed\n[mm/rev]", 1.0, None),
        ("thrust_force", "thrust force\n[kN]", 1000.0, scenario.limits.thrust_force),
    )
    for axes, (series, what, divisor, limit) in zip(panels, subjects, strict=True):
        for episode, dashes in zip(episodes, ("-", "--"), strict=True):
            place = np.array(episode.series["path"]) - bar * pitch - scenario.workpiece.approach
            on_bar = (
                (place > 0.0)
                & (place < scenario.workpiece.bar_length)
                & (np.array(episode.series["depth_of_cut"]) > 0.0)
            )
            values = np.array(episode.series[series])[on_bar] / divisor
            name, (colour, _) = episode.policy.name, style.policy_look(episode.policy.name)
            axes.plot(
                place[on_bar],
                values,
                dashes,
                color=colour,
                label=PLAIN_NAMES.get(name, episode.policy.label),
            )
        if limit is not None:
            axes.axhline(limit / divisor, **style.LIMIT)
            axes.annotate(
                "limit",
                (1.0, limit / divisor),
                xycoords=("axes fraction", "data"),
                color=style.VERMILLION,
            )
        axes.set_ylabel(what)
    panels[0].set_ylim(bottom=0.0)
    panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2)
    panels[-1].set_xlabel(f"place along bar {bar + 1} [mm]")
    panels[0].figure.align_ylabels(panels)
