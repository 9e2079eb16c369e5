"""The leaderboard as one self-contained HTML file."""

import shlex
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from baselines.overload import CONFIDENCE, RESAMPLES
from leaderboard import columns, generalisation
from leaderboard.board import Board
from leaderboard.charts import interval_plot, strips
from leaderboard.results import write_whole
from leaderboard.standings import highest
from train.trained_agent import ONNX_SUFFIX
from turning_env import IDS, Scenario, presets


def write(boards: Sequence[Board], path: Path) -> None:
    """Write the page of some boards, all of it or nothing.

    Raises:
        ResultError: the file cannot be written.
    """
    write_whole(path, render(boards))


def render(boards: Sequence[Board]) -> str:
    """The page as HTML. It needs nothing beside itself."""
    templates = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["number"] = lambda text: str(text).replace("-", "\N{MINUS SIGN}")
    templates.filters["unit"] = lambda text: str(text).replace("m3", "m\N{SUPERSCRIPT THREE}")
    return templates.get_template("page.html.j2").render(
        sections=[_section(board) for board in boards],
        across=generalisation.across(boards),
        confidence=f"{100 * CONFIDENCE:g} %",
        resamples=RESAMPLES,
    )


def _section(board: Board) -> dict[str, Any]:
    trajectories = board.trajectories
    groups = {
        "Return": columns.RETURNS,
        "Score": columns.SCORE,
        "Compared on the same draws": columns.COMPARISONS,
        "Limits": columns.LIMITS,
        "In the workshop": columns.WORKSHOP,
    }
    shown = {heading: columns.applying(group, board.standings) for heading, group in groups.items()}
    return {
        "column_groups": {heading: group for heading, group in shown.items() if group},
        "columns": [column for group in shown.values() for column in group],
        "board": board,
        "digests": board.results[0].digests,
        "versions": board.results[0].versions,
        "plot": interval_plot(board),
        "strips": strips(trajectories.episodes, board.task.scenario) if trajectories else [],
        "draw": trajectories.draw if trajectories else None,
        "best_rules": _best_rules(board),
        "policies": [result.policy for result in board.results],
        "command": reproducing_command(board),
    }


def _best_rules(board: Board) -> list[str]:
    """The best rule, and the one that it is itself compared with."""
    rules = {standing.name: standing for standing in board.standings if standing.kind == "rule"}
    best = highest({name: standing.mean_return.value for name, standing in rules.items()})
    return [] if best is None else [name for name in (best, rules[best].best_rule) if name is not None]


def reproducing_command(board: Board) -> str:
    """The command line that plays the board's results again."""
    task, policies = board.task, [result.policy for result in board.results]
    words = ["python", "-m", "leaderboard", "run", "--env", task.env_id]
    made_for = {policy.made_for.scenario for policy in policies if policy.kind == "rule" and policy.made_for is not None}
    if made_for:  # a split: played with the scenario that it is a split of
        words += ["--scenario", min(made_for), "--splits"]
    elif task.env_id not in IDS or Scenario.load(IDS[task.env_id]) != task.scenario:
        known = task.scenario.name in presets() and Scenario.load(task.scenario.name) == task.scenario
        words += ["--scenario", task.scenario.name if known else "SCENARIO.toml"]
    words += ["--split-draws" if made_for else "--draws", str(len(task.draws)), "--policies"]
    words += [policy.name for policy in policies if policy.kind != "agent"]
    files = [f"{policy.label}{ONNX_SUFFIX}" for policy in policies if policy.kind == "agent"]
    return shlex.join([*words, "--agents", *files] if files else words)
