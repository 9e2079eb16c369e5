"""The leaderboard as one self-contained HTML file.

The template, the style and the scripts of the page lie beside this file and are put into it.
"""

import hashlib
import re
import shlex
from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from baselines.comparators import CAUSAL, comparators
from baselines.policy_spec import PolicySpec
from leaderboard import columns, table
from leaderboard.agents.agent_file import ONNX_SUFFIX
from leaderboard.columns import Cell
from leaderboard.inputs import CLASSES
from leaderboard.page.charts import chart_data
from leaderboard.ranking import Leaderboard
from leaderboard.scoring import SPLIT
from leaderboard.shown import MAX_COMMAND, MAX_VALUES, few, limited
from leaderboard.standings import Standing, best_rule
from leaderboard.statistics import CONFIDENCE, RESAMPLES
from turning_env import IDS, SPLITS, Scenario, presets
from turning_env.rendering.plot_style import policy_look
from turning_env.scenario.family import families

SHOWN_AT_FIRST = ("Score", "Result", "Limits")
SHOWN_ON_PHONES = ("Score", "Result")
MARKED = {
    "best rule": "rule",
    "best model-free agent": "model-free agent",
}
"""Classes of policies whose best scores stand above a ranking, by title."""
VERDICTS = {
    "feasible": "",
    "not shown": "? feasibility not shown",
    "infeasible": "\N{MULTIPLICATION X} infeasible",
}
_HERE = Path(__file__).parent
_SCRIPTS = ("tables.js", "charts.js", "start.js")
# Whole numbers of five digits or more, outside names.
_LARGE = re.compile(r"(?<![\w.-])[1-9]\d{4,14}(?!\w)")


def render(leaderboards: Sequence[Leaderboard]) -> str:
    """Return the page as HTML, which needs no other file."""
    scripts = [(_HERE / name).read_text("utf-8") for name in _SCRIPTS]
    script = "\n".join(["'use strict';", *scripts])
    sections = [_section(leaderboard) for leaderboard in leaderboards]
    # Sections of one id follow one another.
    sections_by_id = {
        env_id: list(group)
        for env_id, group in groupby(sections, lambda section: section["leaderboard"].task.env_id)
    }
    return (
        _templates()
        .get_template("page.html.j2")
        .render(
            sections=sections,
            opening=_opening(sections),
            tasks=sections_by_id,
            across=table.across(leaderboards),
            column_groups=list(columns.GROUPS),
            classes=_classes(leaderboards),
            shown_at_first=SHOWN_AT_FIRST,
            shown_on_phones=SHOWN_ON_PHONES,
            verdicts=VERDICTS,
            max_values=MAX_VALUES,
            max_command=MAX_COMMAND,
            confidence=f"{100 * CONFIDENCE:g} %",
            resamples=RESAMPLES,
            style=Markup((_HERE / "style.css").read_text("utf-8")),
            script=Markup(script),
            # No script but this one runs, whatever a submission is called.
            script_digest=b64encode(hashlib.sha256(script.encode()).digest()).decode(),
        )
    )


def _templates() -> Environment:
    """Return the environment of the page's template, with its filters."""
    templates = Environment(
        loader=FileSystemLoader(_HERE),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    templates.filters |= {
        "number": _with_minus_sign,
        "grouped": _with_commas,
        "unit": _with_exponent,
        "short": _shortened,
        "limited": limited,
        "few": few,
        "colour": _colour,
    }
    return templates


def _with_minus_sign(text: object) -> str:
    return re.sub(r"-(?=\d)", "\N{MINUS SIGN}", str(text))


def _with_commas(text: object) -> str:
    return _LARGE.sub(lambda digits: f"{int(digits[0]):,}", str(text))


def _with_exponent(text: object) -> str:
    return str(text).replace("m3", "m\N{SUPERSCRIPT THREE}")


def _shortened(number: float | None) -> str:
    return "" if number is None else f"{number:.6g}"


def _colour(name: str) -> str:
    colour, _ = policy_look(name)
    return colour


def _classes(leaderboards: Sequence[Leaderboard]) -> dict[str, str]:
    """Return the classes of policies that some leaderboard shows, with their meaning."""
    shown = set()
    for leaderboard in leaderboards:
        shown |= {standing.about.policy_class for standing in leaderboard.standings}
    return {name: meaning for name, meaning in CLASSES.items() if name in shown}


def _section(leaderboard: Leaderboard) -> dict[str, Any]:
    """Return the variables of a leaderboard's section, as the template calls them."""
    task = leaderboard.task
    column_groups = columns.groups(leaderboard.standings)
    # The score comes first: it is the only number that means the same on all tasks.
    if "Score" in column_groups:
        column_groups = {"Score": column_groups["Score"]} | column_groups
    marks = _marks(leaderboard.standings)
    # The heading of its group beside each column, in the order of the table.
    with_heading = []
    for heading, group in column_groups.items():
        with_heading += [(heading, column) for column in group]
    # The trainings of a policy share its row, by the name on the leaderboard.
    policies: dict[str, list[PolicySpec]] = {}
    names = leaderboard.names
    for result in leaderboard.results:
        policies.setdefault(names[result.policy.label], []).append(result.policy)
    place = f"{task.env_id}/{task.scenario.name}"
    return {
        "place": place,
        "link": quote(place),
        "column_groups": column_groups,
        "columns": with_heading,
        "leaderboard": leaderboard,
        "ranking": columns.ranking(task.scenario),
        "chart_data": chart_data(leaderboard),
        "best_rule": best_rule(leaderboard.standings),
        "fixed": comparators(task.scenario, on_family=task.of_family is not None).fixed,
        "oracle": CAUSAL,
        "marks": marks,
        "room": _room(leaderboard, marks),
        "policies": policies,
        "command": reproducing_command(leaderboard),
    }


@dataclass(frozen=True)
class Mark:
    """The best policy of a class on the scale of scores."""

    title: str
    standing: Standing
    score: float
    cell: Cell

    @property
    def share(self) -> float:
        """Return the part of the scale that lies below the score [%]."""
        return min(max(self.score, 0.0), 100.0)


def _marks(standings: Sequence[Standing]) -> list[Mark]:
    """Return the best policies of the classes in ``MARKED``, as far as they have a score."""
    (score_column, *_) = columns.SCORE
    marks = []
    for title, policy_class in MARKED.items():
        for standing in standings:
            if standing.about.policy_class == policy_class and standing.unranked is None:
                if standing.score is not None:
                    cell = score_column.cell(standing)
                    marks.append(Mark(title, standing, standing.score.value, cell))
                break
    return marks


def _room(leaderboard: Leaderboard, marks: Sequence[Mark]) -> float | None:
    """Return the score of the best rule less that of the best model-free agent.

    Return None if there is not one of each, or if the leaderboard is of a split on which nothing
    is tuned or trained.
    """
    task = leaderboard.task
    is_split = task.scenario.name in SPLITS
    if task.of_family is not None:
        is_split = task.of_family.split != SPLIT
    if is_split or len(marks) < len(MARKED):
        return None
    rule, agent = marks
    return rule.score - agent.score


def _opening(sections: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the section with which the page opens: that with most room, or the first."""
    with_room = [section for section in sections if section["room"] is not None]
    return max(with_room, key=lambda section: section["room"], default=sections[0])


def reproducing_command(leaderboard: Leaderboard) -> str:
    """Return the command line that plays the leaderboard's results again."""
    task = leaderboard.task
    policies = [result.policy for result in leaderboard.results]
    words = ["python", "-m", "leaderboard", "run", "--env", task.env_id]
    seeds_option = "--seeds"
    tuned_for = sorted(
        policy.tuned_for.name
        for policy in policies
        if policy.kind == "rule" and policy.tuned_for is not None
    )
    if task.of_family:
        family = task.of_family.family.name
        source = family if family in families() else "FAMILY.toml"
        words += ["--scenario", source, "--split", task.of_family.split]
    elif tuned_for:  # a split: played with the scenario that it is a split of
        words += ["--scenario", tuned_for[0], "--splits"]
        seeds_option = "--split-seeds"
    elif task.env_id not in IDS or Scenario.load(IDS[task.env_id]) != task.scenario:
        words += ["--scenario", _source(task.scenario)]
    words += [seeds_option, str(len(task.seeds))]
    if task.private:
        words += ["--private-key", "KEY"]
    words.append("--policies")
    # Variants that know more or forget have names that no option takes.
    words += [
        policy.name for policy in policies if policy.kind != "agent" and policy.title == policy.name
    ]
    files = [f"{policy.label}{ONNX_SUFFIX}" for policy in policies if policy.kind == "agent"]
    if files:
        words += ["--agents", *files]
    return shlex.join(words)


def _source(scenario: Scenario) -> str:
    """Return the name of a preset, or a placeholder for the file of another scenario."""
    is_preset = scenario.name in presets() and Scenario.load(scenario.name) == scenario
    return scenario.name if is_preset else "SCENARIO.toml"
