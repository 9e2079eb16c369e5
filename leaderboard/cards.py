"""Model cards of the agents that come with the project: what each is, how it was trained, its results and its limits."""

import importlib
from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from leaderboard import columns, generalisation
from leaderboard.columns import Cell
from leaderboard.family_table import read_boards
from leaderboard.information import CLASSES, GIVEN, SEEN, class_of
from leaderboard.ranking import read_leaderboard
from leaderboard.result import ResultError, result_files, result_folder, write_whole
from train.agents import agent_file
from train.agents.agent_file import ONNX_SUFFIX, AgentFile
from turning_env import FAMILY_ID, SPLITS, Family
from turning_env.scoring.statistics import Estimate

_SHARED = ("algorithm", "env_id", "scenario", "parameters", "trained_steps", "versions")
"""What all files of one card must have in common."""


def write_all(results: Path, agents: Path) -> list[Path]:
    """Write the card of every agent in ``agents``, with its results in ``results``, and return the cards' paths.

    Raises:
        ResultError: a file is no agent's, or in the wrong place, or has no results; agents of one name differ in more than the
            training seed; a card cannot be written.
    """
    folders = sorted({path.parent for path in agents.glob(f"*/*/*{ONNX_SUFFIX}")})
    if not folders:
        raise ResultError(f"{agents} holds no agents")
    written = []
    for folder in folders:
        env_id, home = folder.parts[-2:]
        played, shown = _of_family(results, home) if env_id == FAMILY_ID else _of_scenario(results, env_id, home)
        for name, files in _agents(folder).items():
            for file in files:
                if played.get(file.label) != file.digest:
                    raise ResultError(f"{folder / file.label}{ONNX_SUFFIX} has no results in {results}: play it first")
            path = folder / f"{name}.md"
            write_whole(path, render(files, shown(files[0]), folder / f"{files[0].label}{ONNX_SUFFIX}"))
            written.append(path)
    return written


Shown = Callable[[AgentFile], dict[str, Any]]
"""Returns what a card shows of an agent's results, by the names of the template."""
Played = dict[str, str | None]
"""SHA-256 of the files that have played, by the policies' labels."""


def _of_scenario(results: Path, env_id: str, scenario: str) -> tuple[Played, Shown]:
    leaderboard = read_leaderboard(result_folder(results, env_id, scenario))
    splits = [other for name in SPLITS if name != scenario and result_files(other := result_folder(results, env_id, name))]
    across = generalisation.across([leaderboard, *map(read_leaderboard, splits)])

    def shown(file: AgentFile) -> dict[str, Any]:
        name = leaderboard.names[file.label]
        standing = next(standing for standing in leaderboard.standings if standing.name == name)
        columns_of = (*columns.RETURNS, *columns.COMPARISONS, *columns.CONSTRAINT, *columns.LIMITS, *columns.WORKSHOP)
        elsewhere: list[tuple[str, Cell, bool]] = []  # split, full cost there, whether feasible there
        if across and across.tuned_for == file.metadata.scenario.name and name in across.rows:
            for split in across.scenarios[1:]:
                if (cell := across.cell(name, split)) is not None:
                    elsewhere.append((split, cell, across.feasible(name, split)))
        return {
            "name": name,
            "policy_class": standing.policy_class,
            "information": standing.information,
            "family": None,
            "seeds": len(leaderboard.task.seeds),
            "feasible": standing.feasible,
            "cells": [(column, column.cell(standing)) for column in columns.applying(columns_of, [standing])],
            "elsewhere": elsewhere,
        }

    return {result.policy.label: result.policy.sha256 for result in leaderboard.results}, shown


def _of_family(results: Path, family: str) -> tuple[Played, Shown]:
    boards = read_boards(results, f"{family}-*")
    played = [{each.label: each.sha256 for group in board.policies.values() for each in group} for board in boards]
    everywhere = {
        label: digest for label, digest in (played or [{}])[0].items() if all(digest == each.get(label) for each in played)
    }

    def shown(file: AgentFile) -> dict[str, Any]:
        rows = []
        for board in boards:
            name = next(name for name, group in board.policies.items() if file.label in [each.label for each in group])
            rows.append((board, next(each for each in board.comparisons if each.name == name)))
        return {
            "name": name,
            "policy_class": class_of(board.policies[name][0]),
            "information": board.information[name],
            "family": board.task.family,
            "rows": rows,
        }

    return everywhere, shown


def render(files: Sequence[AgentFile], shown: Mapping[str, Any], example: Path) -> str:
    """Return the card of an agent as Markdown.

    Args:
        files: one per training seed.
        shown: what the card shows of its results.
        example: the file that the example loads.
    """
    metadata = files[0].metadata
    bounds = zip(metadata.observation_space.low, metadata.observation_space.high, strict=True)
    ranges = [(text, len(list(group))) for text, group in groupby(f"{low:g} to {high:g}" for low, high in bounds)]
    templates = Environment(  # what it writes is Markdown, not HTML
        loader=FileSystemLoader(Path(__file__).parent), autoescape=False, undefined=StrictUndefined, trim_blocks=True
    )
    return (
        templates.get_template("model_card.md.j2").render(
            shown,
            files=files,
            metadata=metadata,
            memory_size=files[0].memory_size,
            title=_title(metadata.algorithm),
            ranges=", ".join(f"{count} times {text}" if count > 7 else ", ".join([text] * count) for text, count in ranges),
            classes=CLASSES,
            given=GIVEN,
            seen=SEEN,
            example=example,
            interval=_interval,
        )
        + "\n"
    )


def _interval(estimate: Estimate, factor: float = 1.0) -> str:
    value, low, high = (f"{factor * each:.0f}" for each in (estimate.value, estimate.low, estimate.high))
    return f"{value} ({low} to {high})"


def _title(algorithm: str) -> str:
    """Return an algorithm's name in words; a name that is not one of the project's as it is."""
    try:
        title: str = importlib.import_module(f"train.{algorithm}").ALGORITHM.title
    except (ModuleNotFoundError, AttributeError):
        return algorithm
    return title


def _agents(folder: Path) -> dict[str, list[AgentFile]]:
    """Return the agents of a folder by name, each by training seed."""
    agents: dict[str, list[AgentFile]] = {}
    for path in sorted(folder.glob(f"*{ONNX_SUFFIX}")):
        try:
            file = agent_file.read(path)
        except (OSError, ValueError) as error:
            raise ResultError(str(error)) from error
        metadata = file.metadata
        family: Any = metadata.parameters.get("family")
        home = Family.load(family).name if metadata.env_id == FAMILY_ID else metadata.scenario.name
        place = Path(metadata.env_id) / home / f"{file.label}{ONNX_SUFFIX}"
        if place.parts != path.parts[-3:]:
            raise ResultError(f"{path} holds {file.label} and should be at {place} in the folder of agents")
        agents.setdefault(file.label.rpartition("-seed")[0], []).append(file)
    for name, files in agents.items():
        files.sort(key=lambda file: file.metadata.seed)
        for field in _SHARED:
            first, *others = (getattr(file.metadata, field) for file in files)
            if any(value != first for value in others):
                raise ResultError(f"{folder}: the files of {name} cannot share a card, as they differ in {field}")
    return agents
