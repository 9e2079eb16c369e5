"""Rankings as text and as data for ``--json``; full costs over a leaderboard and its splits."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, fields, is_dataclass
from typing import Any, NamedTuple

from baselines.policy_spec import ScenarioId
from leaderboard.columns import (
    FULL_COST,
    GROUPS,
    TRAINING_GROUPS,
    Cell,
    Column,
    applying,
    groups,
    ranking,
)
from leaderboard.ranking import Leaderboard
from leaderboard.result import ResultError
from leaderboard.standings import About, Costs, Leads, Operation, Overload, Standing, ranked_by
from leaderboard.statistics import VERDICTS_IN_WORDS, Feasibility, Mean
from turning_env import SPLITS
from turning_env.scenario.section import names_instead

COLUMNS = {column.key: column for group in GROUPS.values() for column in group}
"""All columns by their names in the output of ``--json``."""


def _units() -> dict[str, str]:
    """Return the unit of each number of a standing. A column in per cent shows a share."""
    units = {}
    for heading, columns in GROUPS.items():
        if heading in TRAINING_GROUPS:
            continue
        for column in columns:
            units[column.key] = column.unit if column.factor == 1.0 else "share"
    return units


UNITS = _units()


def as_data(leaderboards: Sequence[Leaderboard]) -> dict[str, Any]:
    """Return the leaderboards with all numbers of their standings; see ``standing_data``."""
    entries = []
    for leaderboard in leaderboards:
        task = leaderboard.task
        entries.append(
            {
                "env_id": task.env_id,
                "scenario": task.scenario.name,
                "seeds": task.seeds,
                "task": task.digest,
                "ranked_by": ranked_by(task.scenario),
                "standings": [standing_data(standing) for standing in leaderboard.standings],
            }
        )
    return {"units": UNITS, "leaderboards": entries}


def standing_data(standing: Standing) -> dict[str, Any]:
    """Return all numbers of a standing by name, whatever part of it they belong to.

    A number with an interval has ``value``, ``low`` and ``high``.
    """
    data: dict[str, Any] = {}
    for name, value in _fields(standing).items():
        if isinstance(value, About | Overload | Leads | Costs | Operation):
            data |= {part_name: _plain(part) for part_name, part in _fields(value).items()}
        elif name != "returns":
            data[name] = _plain(value)
    data["feasible"] = standing.feasible
    return data


def _fields(record: Any) -> dict[str, Any]:
    return {field.name: getattr(record, field.name) for field in fields(record)}


def _plain(value: Any) -> Any:
    """Return a number of a standing as JSON can hold it."""
    if isinstance(value, Mean):
        value = value.estimate
    return asdict(value) if is_dataclass(value) and not isinstance(value, type) else value


def render(leaderboard: Leaderboard) -> str:
    """Return a leaderboard as tables, one per subject, under a line that names the task."""
    lines = [_title(leaderboard)]
    for heading, columns in groups(leaderboard.standings).items():
        rows = _headings(["rank", "policy", "trainings", "feasible"], columns)
        for row in _rows(leaderboard.standings, columns):
            rows.append([row.rank, row.policy, row.trainings, row.feasible, *row.numbers])
        lines += ["", heading, "", aligned(rows, left=1)]
    labels = [result.policy.label for result in leaderboard.results]
    alike = same_returns(leaderboard, labels)
    if alike:
        lines += ["", *alike]
    return "\n".join(lines)


def _title(leaderboard: Leaderboard) -> str:
    """Return the line that names a leaderboard's task."""
    task = leaderboard.task
    return (
        f"{task.env_id}, scenario {task.scenario.name}, {len(task.seeds)} seeds, "
        f"task {task.digest[:12]}, ranked by {ranking(task.scenario).heading}"
    )


def ranking_table(leaderboard: Leaderboard) -> str:
    """Return the ranking as one table, under the line that names the task.

    It has the number that ranks policies and the score; ``render`` has all numbers.
    """
    by_rank = ranking(leaderboard.task.scenario)
    columns = applying([by_rank, COLUMNS["score"]], leaderboard.standings)
    rows = _headings(["rank", "policy", "kind", "feasible"], columns)
    for row in _rows(leaderboard.standings, columns):
        rows.append([row.rank, row.policy, row.kind, row.feasible, *row.numbers])
    return f"{_title(leaderboard)}\n\n{aligned(rows, left=1)}"


def _headings(first: Sequence[str], columns: Sequence[Column]) -> list[list[str]]:
    """Return the first two rows of a table: headings and units."""
    titles = list(first)
    units = [""] * len(first)
    for column in columns:
        titles.append(column.heading)
        units.append(_in_brackets(column.unit))
    return [titles, units]


def same_returns(leaderboard: Leaderboard, labels: Collection[str]) -> list[str]:
    """Return a line on each group of policies with the same return on every seed.

    They act alike: perhaps one is a copy. A group has a policy with one of the ``labels``.
    """
    groups_by_returns: dict[tuple[float, ...], list[str]] = {}
    for result in leaderboard.results:
        returns = tuple(result.episodes["return"])
        groups_by_returns.setdefault(returns, []).append(result.policy.label)

    names = leaderboard.names
    lines = []
    for group in groups_by_returns.values():
        # Training seeds of one agent may be alike.
        alike = sorted({names[label] for label in group})
        if len(alike) > 1 and not set(labels).isdisjoint(group):
            seeds = len(leaderboard.task.seeds)
            lines.append(f"{', '.join(alike)}: same returns on all {seeds} seeds")
    return lines


def selection(
    leaderboards: Sequence[Leaderboard], fields: Sequence[str], policies: Collection[str]
) -> str:
    """Return some numbers of some policies as a Markdown table.

    Without ``fields``, return the full costs of ``across``; without ``policies``, return all. Raise
    ResultError if no leaderboard has the policies.
    """
    splits = across(leaderboards)
    if not fields and splits is not None:
        rows = _across_rows(splits)
        return markdown([row for row in rows if not policies or row["policy"] in policies])
    rows = []
    for leaderboard in leaderboards:
        for row in _selected(leaderboard, fields, policies):
            if len(leaderboards) > 1:
                row = {"scenario": leaderboard.task.scenario.name} | row
            rows.append(row)
    if not rows:
        present = set()
        for leaderboard in leaderboards:
            present |= {standing.name for standing in leaderboard.standings}
        first = next(iter(policies), "")
        instead = names_instead(first, sorted(present), max_listed=len(present))
        raise ResultError(f"no policy is called {' or '.join(policies)}; {instead}")
    return markdown(rows)


def _selected(
    leaderboard: Leaderboard, fields: Sequence[str], policies: Collection[str]
) -> Iterator[dict[str, str]]:
    """Yield some numbers of some policies of a leaderboard, as texts by heading."""
    columns = [COLUMNS[field] for field in dict.fromkeys(fields)]
    titles = [f"{column.heading} {_in_brackets(column.unit)}".strip() for column in columns]
    for row in _rows(leaderboard.standings, columns):
        if policies and row.policy not in policies:
            continue
        texts = {"policy": f"`{row.policy}`", "feasible": row.feasible}
        yield texts | dict(zip(titles, row.numbers, strict=True))


def _in_brackets(unit: str) -> str:
    return f"[{unit}]" if unit else ""


def markdown(rows: Sequence[Mapping[str, str]]) -> str:
    """Return a Markdown table of texts by heading."""
    # The longest row comes first, as its headings are in order; a dict drops those that repeat.
    headings: dict[str, None] = {}
    for row in sorted(rows, key=len, reverse=True):
        headings |= dict.fromkeys(row)
    lines = [list(headings), ["---"] * len(headings)]
    for row in rows:
        lines.append([row.get(heading, "") for heading in headings])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def agent_places(leaderboard: Leaderboard, labels: Collection[str]) -> list[str]:
    """Return two lines on each agent with one of these labels: its place and its merit.

    Agents that come with the project are first.
    """
    names = leaderboard.names
    wanted = {names.get(label) for label in labels}
    standings = [
        standing
        for standing in leaderboard.standings
        if standing.kind == "agent" and standing.name in wanted
    ]
    standings.sort(key=lambda standing: standing.about.own)
    lines = []
    for standing in standings:
        lines.append(_agent_place(leaderboard, standing))
        lines.append(_agent_merit(standing))
    return lines


def _agent_merit(standing: Standing) -> str:
    """Return a line on an agent's feasibility and its lead over the best rule."""
    overload = f"severe overload in {standing.overload.severe_share:.2%} of cutting time"
    feasibility = VERDICTS_IN_WORDS[standing.overload.feasibility]
    leads = standing.leads
    if leads.over_best_rule is None:
        return f"{feasibility}: {overload}"
    lead = COLUMNS["over_best_rule"].cell(standing)
    sign = "+" if leads.over_best_rule.value > 0.0 else ""
    rule = f"the best rule, {leads.best_rule}"
    return f"{feasibility}: {overload}; {sign}{lead.text} s ({lead.interval}) over {rule}"


def _agent_place(leaderboard: Leaderboard, standing: Standing) -> str:
    """Return a line on the place of an agent."""
    task = leaderboard.task
    if standing.rank is None:
        place = f"no rank ({standing.unranked})"
    else:
        ranked = sum(other.rank is not None for other in leaderboard.standings)
        place = f"rank {standing.rank} of {ranked}"
    column = ranking(task.scenario)
    cell = column.cell(standing)
    value = f"{cell.text} {column.unit} ({cell.interval})" if cell.text else "none"
    whose = "your agent" if standing.about.own else "agent that ships with the project"
    where = f"{standing.name} on {task.env_id}, scenario {task.scenario.name}"
    return f"{whose}: {place}, {column.heading} {value}: {where}"


VERDICTS: dict[Feasibility, str] = {"feasible": "yes", "not shown": "not shown", "infeasible": "NO"}
"""Feasibility in a table.

It follows from the confidence limits of the share of severe overload: see
``leaderboard.statistics``.
"""
MARKS: dict[Feasibility, str] = {"feasible": "", "not shown": " ?", "infeasible": " NO"}
"""Feasibility beside a number."""
MEANING = "NO: infeasible; ?: feasibility not shown"


@dataclass(frozen=True)
class _Row:
    """One policy's row of a table, as text."""

    rank: str
    policy: str
    kind: str
    trainings: str
    feasible: str
    numbers: list[str]  # one for each column


def _rows(standings: Sequence[Standing], columns: Sequence[Column]) -> Iterator[_Row]:
    """Yield the row of each policy that has a number in one of the columns."""
    for standing in standings:
        cells = [column.cell(standing) for column in columns]
        if not any(cell.text for cell in cells):
            continue
        yield _Row(
            rank=str(standing.rank or ""),
            policy=f"{standing.name} (yours)" if standing.about.own else standing.name,
            kind=standing.kind,
            trainings=str(len(standing.about.training_seeds) or ""),
            feasible=VERDICTS[standing.overload.feasibility] if standing.kind != "oracle" else "",
            numbers=[_text(cell) for cell in cells],
        )


def _text(cell: Cell) -> str:
    return f"{cell.text} ({cell.interval})" if cell.interval else cell.text


def aligned(rows: Sequence[Sequence[str]], left: int = 0) -> str:
    """Return rows of texts as lines.

    Columns are aligned to the right, but the one at index ``left`` to the left.
    """
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        texts = [text.rjust(width) for text, width in zip(row, widths, strict=True)]
        texts[left] = row[left].ljust(widths[left])
        lines.append("  ".join(texts).rstrip())
    return "\n".join(lines)


class SplitCost(NamedTuple):
    """The full cost of a policy on a scenario, and whether it is feasible there."""

    cost: Cell
    feasibility: Feasibility


@dataclass(frozen=True)
class Across:
    """Full costs of policies over scenarios."""

    # The scenario to which rules are tuned and on which agents are trained: the first column.
    tuned_for: str
    scenarios: list[str]
    # By policy and scenario, as far as the policy has played it.
    rows: dict[str, dict[str, SplitCost]]


def across(leaderboards: Sequence[Leaderboard]) -> Across | None:
    """Return the full costs of policies on a scenario and on its splits; None if there are none.

    The scenario is that of the first leaderboard which is no split, and for which policies on
    splits were tuned. A policy counts on a split if it was tuned for this scenario; oracles count
    as well.
    """
    splits = {}
    tuned_for = []
    for leaderboard in leaderboards:
        if leaderboard.task.scenario.name in SPLITS:
            splits[leaderboard.task.scenario.name] = leaderboard
            tuned_for += [result.policy.tuned_for for result in leaderboard.results]

    for base in leaderboards:
        scenario = base.task.scenario
        if scenario.name in splits or ScenarioId.of(scenario) not in tuned_for:
            continue
        same_id = [
            splits[name]
            for name in SPLITS
            if name in splits and splits[name].task.env_id == base.task.env_id
        ]
        return _across(base, same_id)
    return None


def _across(base: Leaderboard, splits: Sequence[Leaderboard]) -> Across:
    """Return the full costs on a leaderboard's scenario and its splits; see ``across``."""
    home = ScenarioId.of(base.task.scenario)
    rows = {
        standing.name: {home.name: _split_cost(standing)}
        for standing in base.standings
        if standing.costs.full_cost is not None
    }
    for split in splits:
        names = split.names
        counted = set()
        for result in split.results:
            policy = result.policy
            if policy.tuned_for == home or policy.kind == "oracle":
                counted.add(names[policy.label])
        for standing in split.standings:
            if standing.name in rows and standing.name in counted:
                rows[standing.name][split.task.scenario.name] = _split_cost(standing)
    scenarios = [leaderboard.task.scenario.name for leaderboard in (base, *splits)]
    return Across(home.name, scenarios, rows)


def _split_cost(standing: Standing) -> SplitCost:
    feasible: Feasibility = "feasible"
    if standing.kind != "oracle":
        feasible = standing.overload.feasibility
    return SplitCost(FULL_COST.cell(standing), feasible)


def render_across(table: Across) -> str:
    """Return the table as text."""
    title = (
        f"full cost [min/dm3] of policies tuned for {table.tuned_for} on other scenarios; {MEANING}"
    )
    rows = [list(row.values()) for row in _across_rows(table)]
    return f"{title}\n\n{aligned([['policy', *table.scenarios], *rows])}"


def _across_rows(table: Across) -> list[dict[str, str]]:
    """Return the row of each policy, as texts by heading."""
    rows = []
    for policy, costs in table.rows.items():
        row = dict.fromkeys(["policy", *table.scenarios], "")
        row["policy"] = policy
        for scenario, (cost, feasibility) in costs.items():
            row[scenario] = cost.text + MARKS[feasibility]
        rows.append(row)
    return rows
