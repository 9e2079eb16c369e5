"""Rankings as text, and as data for ``--json``; and a table of full costs over a leaderboard and its splits."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from leaderboard.columns import FULL_COST, GROUPS, Cell, Column, Training, groups, ranking
from leaderboard.ranking import Leaderboard
from leaderboard.result import ResultError
from leaderboard.standings import Standing, ranked_by
from turning_env import SPLITS
from turning_env.scoring.policy import ScenarioId
from turning_env.scoring.statistics import Feasibility

COLUMNS = {
    column.field: column for group in GROUPS.values() for column in group
}  # all columns by field
UNITS = {
    field: each.unit if each.factor == 1.0 else "share"
    for field, each in COLUMNS.items()
    if not isinstance(each, Training)
}
"""Units of the numbers of a standing."""


def as_data(leaderboards: Sequence[Leaderboard]) -> dict[str, Any]:
    """Return the leaderboards with all numbers of their standings: see ``leaderboard.standings.Standing``.

    A number with an interval has ``value``, ``low`` and ``high``.
    """
    return {
        "units": UNITS,
        "leaderboards": [
            {
                "env_id": each.task.env_id,
                "scenario": each.task.scenario.name,
                "seeds": each.task.seeds,
                "task": each.task.digest,
                "ranked_by": ranked_by(each.task.scenario),
                "standings": [asdict(standing) for standing in each.standings],
            }
            for each in leaderboards
        ],
    }


def render(leaderboard: Leaderboard) -> str:
    """Return a leaderboard as tables, one per subject, under a line that names the task."""
    task = leaderboard.task
    about = f"{task.env_id}, scenario {task.scenario.name}, {len(task.seeds)} seeds, task {task.digest[:12]}"
    lines = [f"{about}, ranked by {ranking(task.scenario).heading}"]
    for heading, columns in groups(leaderboard.standings).items():
        lines += ["", heading, "", aligned(_rows(leaderboard.standings, columns), left=1)]
    return "\n".join(lines)


def selection(
    leaderboards: Sequence[Leaderboard], fields: Sequence[str], policies: Collection[str]
) -> str:
    """Return some numbers of some policies, or of all if none is named, as a Markdown table; without numbers, ``across``."""
    if not fields and (splits := across(leaderboards)):
        head, *rows = _across_rows(splits)
        return markdown(
            [
                dict(zip(head, row, strict=True))
                for row in rows
                if not policies or row[0] in policies
            ]
        )
    fields = list(dict.fromkeys(fields))
    found = []
    for each in leaderboards:
        head, units, *rows = _rows(each.standings, [COLUMNS[field] for field in fields])
        titles = [f"{title} {unit}".strip() for title, unit in zip(head, units, strict=True)]
        first = {"scenario": each.task.scenario.name} if len(leaderboards) > 1 else {}
        named = (row for row in rows if not policies or row[1] in policies)
        found += [
            first | {"policy": f"`{row[1]}`"} | dict(zip(titles[3:], row[3:], strict=True))
            for row in named
        ]
    if not found:
        raise ResultError(f"no policy is called {' or '.join(policies)}")
    return markdown(found)


def markdown(rows: Sequence[Mapping[str, str]]) -> str:
    """Return a Markdown table of texts by heading."""
    headings = list(
        dict.fromkeys(
            heading for cells in sorted(rows, key=lambda cells: -len(cells)) for heading in cells
        )
    )
    lines = [
        headings,
        ["---"] * len(headings),
        *([cells.get(heading, "") for heading in headings] for cells in rows),
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def agent_places(leaderboard: Leaderboard, labels: Collection[str]) -> list[str]:
    """Return a line on the place of each agent whose label is one of these, with one's own last."""
    names = leaderboard.names
    asked = {names.get(label) for label in labels}
    task, column = leaderboard.task, ranking(leaderboard.task.scenario)
    ranked = [standing.name for standing in leaderboard.standings if standing.unranked is None]
    lines = []
    for standing in sorted(leaderboard.standings, key=lambda each: each.own):
        if standing.kind != "agent" or standing.name not in asked:
            continue
        cell = column.cell(standing)
        value = f"{cell.text} {column.unit} ({cell.interval})" if cell.text else "none"
        whose = "your agent" if standing.own else "agent that ships with the project"
        if standing.unranked is None:
            place = f"rank {ranked.index(standing.name) + 1} of {len(ranked)}"
        else:
            place = f"no rank ({standing.unranked})"
        where = f"{standing.name} on {task.env_id}, scenario {task.scenario.name}"
        lines.append(f"{whose}: {place}, {column.heading} {value}: {where}")
    return lines


VERDICTS: dict[Feasibility, str] = {"feasible": "yes", "not shown": "not shown", "infeasible": "NO"}
"""Feasibility in a table: by the confidence limits of the share of severe overload, see ``turning_env.scoring.statistics``."""
MARKS: dict[Feasibility, str] = {"feasible": "", "not shown": " ?", "infeasible": " NO"}
"""Feasibility beside a number."""
MEANING = "NO: infeasible; ?: feasibility not shown"


def _rows(standings: Sequence[Standing], columns: Sequence[Column]) -> list[list[str]]:
    rows = [
        ["rank", "policy", "trainings", "feasible", *(column.heading for column in columns)],
        ["", "", "", "", *(f"[{column.unit}]" if column.unit else "" for column in columns)],
    ]
    for place, standing in enumerate(standings, 1):
        ranked = standing.unranked is None
        feasible = VERDICTS[standing.feasibility] if standing.kind != "oracle" else ""
        cells = [column.cell(standing) for column in columns]
        if not any(cell.text for cell in cells):
            continue
        name = f"{standing.name} (yours)" if standing.own else standing.name
        row = [
            str(place) if ranked else "",
            name,
            str(len(standing.training_seeds) or ""),
            feasible,
        ]
        rows.append(
            row
            + [f"{cell.text} ({cell.interval})" if cell.interval else cell.text for cell in cells]
        )
    return rows


def aligned(rows: Sequence[Sequence[str]], left: int = 0) -> str:
    """Return rows of texts as lines, every column to the right but the one at place ``left``."""
    widths = [max(map(len, texts)) for texts in zip(*rows, strict=True)]
    sides: list[Callable[[str, int], str]] = [
        str.ljust if place == left else str.rjust for place in range(len(widths))
    ]
    return "\n".join(
        "  ".join(
            side(*each) for side, each in zip(sides, zip(row, widths, strict=True), strict=True)
        ).rstrip()
        for row in rows
    )


@dataclass(frozen=True)
class Across:
    """Policies over scenarios."""

    tuned_for: str  # the scenario to which the rules are tuned and on which the agents are trained: the first column
    scenarios: list[str]
    rows: dict[str, dict[str, tuple[Cell, Feasibility]]]
    """For each policy by name, its full cost and whether it is feasible, on each scenario on which it has played."""


def across(leaderboards: Sequence[Leaderboard]) -> Across | None:
    """Return the table over the first leaderboard that others are splits of, and these; None if there is none.

    A policy counts on a split if it was tuned for the first leaderboard's scenario, and so does an oracle.
    """
    splits = {
        each.task.scenario.name: each for each in leaderboards if each.task.scenario.name in SPLITS
    }
    tuned_for = [result.policy.tuned_for for each in splits.values() for result in each.results]
    for base in leaderboards:
        home = ScenarioId.of(base.task.scenario)
        if home not in tuned_for or home.name in splits:
            continue
        chosen = [
            each
            for name in SPLITS
            if (each := splits.get(name)) and each.task.env_id == base.task.env_id
        ]
        rows = {
            each.name: {home.name: _full_cost(each)} for each in base.standings if each.full_cost
        }
        for split in chosen:
            names, policies = split.names, [result.policy for result in split.results]
            counted = {
                names[policy.label]
                for policy in policies
                if policy.tuned_for == home or policy.kind == "oracle"
            }
            for standing in split.standings:
                if standing.name in rows and standing.name in counted:
                    rows[standing.name][split.task.scenario.name] = _full_cost(standing)
        return Across(home.name, [each.task.scenario.name for each in (base, *chosen)], rows)
    return None


def _full_cost(standing: Standing) -> tuple[Cell, Feasibility]:
    return FULL_COST.cell(
        standing
    ), "feasible" if standing.kind == "oracle" else standing.feasibility


def render_across(table: Across) -> str:
    """Return the table as text."""
    head = (
        f"full cost [min/dm3] of policies tuned for {table.tuned_for} on other scenarios; {MEANING}"
    )
    return f"{head}\n\n{aligned(_across_rows(table))}"


def _across_rows(table: Across) -> list[list[str]]:
    rows = [["policy", *table.scenarios]]
    for policy, cells in table.rows.items():
        texts = {
            scenario: cell.text + MARKS[feasibility]
            for scenario, (cell, feasibility) in cells.items()
        }
        rows.append([policy, *(texts.get(scenario, "") for scenario in table.scenarios)])
    return rows
