"""The ranking and two trajectories as one picture for print."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from leaderboard.gallery import save
from leaderboard.ranking import Leaderboard
from leaderboard.result import ResultError
from leaderboard.standings import comparators
from leaderboard.trajectories import Trajectory
from turning_env import Scenario
from turning_env.workshop.plot_style import BLUE, GREY, ORANGE, VERMILLION

PLAIN_NAMES = {
    "causal": "oracle: told depth, hardness and wear",
    "analytic_gradient": "agent: recurrent, trained with model gradients",
    "predictive": "Kalman filter and optimiser",
    "recurrent_ppo": "agent: recurrent PPO",
    "ppo": "agent: PPO",
    "rescaled_grid_search": "published controller, rescaled online",
    "grid_search": "published controller",
    "fixed_tuned": "best fixed speed and feed",
}
"""What the picture shows of RoughTurning-v0's policies, and how a stranger would call them."""
MAX_POLICIES = 8


def write(leaderboard: Leaderboard, path: Path) -> None:
    """Draw a leaderboard as a PNG, whole or not at all: at most eight policies, and two of them on the same bar.

    Raises:
        ResultError: fewer than two trajectories were recorded.
    """
    recorded = leaderboard.trajectories.episodes if leaderboard.trajectories else []
    episodes = [episode for episode in recorded if episode.seed == recorded[0].seed]
    if len(episodes) < 2:
        what = f"{leaderboard.task.env_id} on scenario {leaderboard.task.scenario.name}"
        raise ResultError(f"two trajectories are needed; python -m leaderboard run records those of {what}")
    # The first of the ranking against the published controller, or against the next.
    published = comparators(leaderboard.task.scenario).published
    second = next((episode for episode in episodes[1:] if episode.policy.name == published), episodes[1])
    figure = Figure(figsize=(12, 4.6), layout="constrained")
    left, right = figure.subfigures(1, 2, squeeze=False, width_ratios=(1.5, 1))[0]
    _draw_ranking(left.subplots(), leaderboard)
    _draw_same_bar(right.subplots(3, 1, sharex=True), (episodes[0], second), leaderboard.task.scenario)
    save(figure, path)


def _draw_ranking(axes: Axes, leaderboard: Leaderboard) -> None:
    known = [standing for standing in leaderboard.standings if standing.name in PLAIN_NAMES]
    standings = (known if len(known) == len(PLAIN_NAMES) else leaderboard.standings)[:MAX_POLICIES]
    standings = sorted(standings, key=lambda standing: -standing.mean_return.value)
    for place, standing in enumerate(standings):
        estimate, colour = standing.mean_return, BLUE if standing.feasible else VERMILLION
        colour = GREY if standing.kind == "oracle" else colour
        axes.plot([estimate.low, estimate.high], [place, place], color=colour, linewidth=2.5)
        axes.plot(estimate.value, place, "o", color=colour)
        axes.annotate(
            f"{estimate.value:.0f} s", (estimate.value, place), (0, 7), textcoords="offset points", ha="center", color=colour
        )
        overload = f"{100.0 * standing.severe_share:.1f} %"
        axes.annotate(overload, (1.1, place), xycoords=("axes fraction", "data"), ha="center", va="center", color=colour)
    axes.annotate("time in\noverload", (1.1, 1.01), xycoords="axes fraction", ha="center", va="bottom")
    axes.set_yticks(range(len(standings)), [PLAIN_NAMES.get(standing.name, standing.name) for standing in standings])
    axes.set_ylim(len(standings) - 0.5, -0.7)
    axes.set_xlabel("mean return per edge [s of machine time], 95 % interval; higher is better")
    axes.set_title(f"{len(leaderboard.task.seeds)} held-out seeds; red: infeasible", loc="left", fontsize="small")
    axes.grid(axis="x", linewidth=0.4)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(axis="y", length=0)


def _draw_same_bar(panels: Sequence[Axes], episodes: tuple[Trajectory, Trajectory], scenario: Scenario) -> None:
    """Draw feed, thrust force and power of two policies along one bar, half-way through the shorter trajectory."""
    pitch = scenario.workpiece.bar_length + scenario.workpiece.approach
    bar = int(min(episode.series["path"][-1] for episode in episodes) / 2.0 // pitch)
    subjects = (
        ("feed", "feed [mm/rev]", 1.0, None),
        ("thrust_force", "thrust force [kN]", 1000.0, scenario.limits.thrust_force),
        ("power", "power [kW]", 1.0, scenario.limits.power),
    )
    for axes, (name, label, divisor, limit) in zip(panels, subjects, strict=True):
        for episode, colour, style in zip(episodes, (BLUE, ORANGE), ("-", "--"), strict=True):
            place = np.array(episode.series["path"]) - bar * pitch - scenario.workpiece.approach
            on_bar = (place > 0.0) & (place < scenario.workpiece.bar_length) & (np.array(episode.series["depth_of_cut"]) > 0.0)
            values = np.array(episode.series[name])[on_bar] / divisor
            axes.plot(
                place[on_bar],
                values,
                style,
                color=colour,
                linewidth=1.2,
                label=PLAIN_NAMES.get(episode.policy.name, episode.policy.label),
            )
        if limit is not None:
            axes.axhline(limit / divisor, color=VERMILLION, linewidth=0.8, linestyle=":")
            axes.annotate("limit", (1.0, limit / divisor), xycoords=("axes fraction", "data"), fontsize="small", color=VERMILLION)
        axes.set_ylabel(label)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylim(bottom=0.0)
    panels[0].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False, borderaxespad=0.2)
    panels[-1].set_xlabel(f"place along bar {bar + 1} [mm]")
    panels[0].figure.align_ylabels(panels)
