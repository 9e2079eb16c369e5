"""The leaderboard as one self-contained HTML file: the page's parts lie beside this one and are put into it."""

import hashlib
import re
import shlex
from base64 import b64encode
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from baselines.guided import HOLD
from leaderboard import columns, table
from leaderboard.information import CLASSES
from leaderboard.page.charts import chart_data
from leaderboard.ranking import Leaderboard
from leaderboard.shown import MAX_COMMAND, MAX_VALUES, few, limited
from leaderboard.standings import best_rule
from train.agents.agent_file import ONNX_SUFFIX
from turning_env import IDS, Scenario, presets
from turning_env.rendering.plot_style import policy_look
from turning_env.scenario.family import families
from turning_env.scoring.statistics import CONFIDENCE, RESAMPLES

SHOWN_AT_FIRST = ("Result", "Constraint track", "Limits")
_HERE = Path(__file__).parent
_SCRIPTS = ("tables.js", "charts.js", "start.js")
_LARGE = re.compile(
    r"(?<![\w.-])[1-9]\d{4,14}(?!\w)"
)  # whole numbers of five digits or more, outside names


def render(leaderboards: Sequence[Leaderboard]) -> str:
    """Return the page as HTML, which needs no other file."""
    loader = FileSystemLoader(_HERE)
    templates = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    templates.filters["number"] = lambda text: re.sub(r"-(?=\d)", "\N{MINUS SIGN}", str(text))
    templates.filters["grouped"] = lambda text: _LARGE.sub(
        lambda digits: f"{int(digits[0]):,}", str(text)
    )
    templates.filters["unit"] = lambda text: str(text).replace("m3", "m\N{SUPERSCRIPT THREE}")
    templates.filters["short"] = lambda number: "" if number is None else f"{number:.6g}"
    templates.filters["limited"] = limited
    templates.filters["few"] = few
    templates.filters["colour"] = lambda name: policy_look(name)[0]
    script = "\n".join(["'use strict';", *((_HERE / name).read_text("utf-8") for name in _SCRIPTS)])
    sections = [_section(each) for each in leaderboards]
    shown = {standing.policy_class for each in leaderboards for standing in each.standings}
    return templates.get_template("page.html.j2").render(
        sections=sections,
        tasks={
            env_id: list(group)
            for env_id, group in groupby(
                sections, lambda section: section["leaderboard"].task.env_id
            )
        },
        across=table.across(leaderboards),
        column_groups=list(columns.GROUPS),
        classes={name: meaning for name, meaning in CLASSES.items() if name in shown},
        shown_at_first=SHOWN_AT_FIRST,
        verdicts={
            "feasible": "",
            "not shown": "? feasibility not shown",
            "infeasible": "\N{MULTIPLICATION X} infeasible",
        },
        max_values=MAX_VALUES,
        hold=HOLD,
        max_command=MAX_COMMAND,
        confidence=f"{100 * CONFIDENCE:g} %",
        resamples=RESAMPLES,
        style=Markup((_HERE / "style.css").read_text("utf-8")),
        script=Markup(script),
        # No script but this one runs, whatever a submission is called.
        script_digest=b64encode(hashlib.sha256(script.encode()).digest()).decode(),
    )


def _section(leaderboard: Leaderboard) -> dict[str, Any]:
    shown = columns.groups(leaderboard.standings)
    names = leaderboard.names
    best = best_rule(leaderboard.standings)
    place = f"{leaderboard.task.env_id}/{leaderboard.task.scenario.name}"
    return {
        "place": place,
        "link": quote(place),
        "column_groups": shown,
        "columns": [(heading, column) for heading, group in shown.items() for column in group],
        "leaderboard": leaderboard,
        "ranking": columns.ranking(leaderboard.task.scenario),
        "chart_data": chart_data(leaderboard),
        "best_rule": best,
        "policies": {
            standing.name: [
                result.policy
                for result in leaderboard.results
                if names[result.policy.label] == standing.name
            ]
            for standing in leaderboard.standings
        },
        "command": reproducing_command(leaderboard),
    }


def reproducing_command(leaderboard: Leaderboard) -> str:
    """Return the command line that plays the leaderboard's results again."""
    task, policies = leaderboard.task, [result.policy for result in leaderboard.results]
    words = ["python", "-m", "leaderboard", "run", "--env", task.env_id]
    tuned_for = {
        policy.tuned_for.name
        for policy in policies
        if policy.kind == "rule" and policy.tuned_for is not None
    }
    if task.of_family:
        family = task.of_family.family.name
        words += [
            "--scenario",
            family if family in families() else "FAMILY.toml",
            "--split",
            task.of_family.split,
        ]
        tuned_for = set()
    elif tuned_for:  # a split: played with the scenario that it is a split of
        words += ["--scenario", min(tuned_for), "--splits"]
    elif task.env_id not in IDS or Scenario.load(IDS[task.env_id]) != task.scenario:
        known = (
            task.scenario.name in presets() and Scenario.load(task.scenario.name) == task.scenario
        )
        words += ["--scenario", task.scenario.name if known else "SCENARIO.toml"]
    words += ["--split-seeds" if tuned_for else "--seeds", str(len(task.seeds))]
    words += ["--private-key", "KEY", "--policies"] if task.private else ["--policies"]
    words += [
        policy.name for policy in policies if policy.kind != "agent" and policy.title == policy.name
    ]
    files = [f"{policy.label}{ONNX_SUFFIX}" for policy in policies if policy.kind == "agent"]
    return shlex.join([*words, "--agents", *files] if files else words)
