"""Model cards of the agents that come with the project: what each is, how it was trained, its results and its limits."""

import importlib
from collections.abc import Sequence
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from leaderboard import columns, generalisation
from leaderboard.columns import Cell
from leaderboard.information import CLASSES, GIVEN, SEEN
from leaderboard.ranking import Leaderboard, read_leaderboard
from leaderboard.result import ResultError, result_files, result_folder, write_whole
from train.agents import agent_file
from train.agents.agent_file import ONNX_SUFFIX, AgentFile
from turning_env import SPLITS

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
        env_id, scenario = folder.parts[-2:]
        leaderboard = read_leaderboard(result_folder(results, env_id, scenario))
        splits = [other for name in SPLITS if name != scenario and result_files(other := result_folder(results, env_id, name))]
        across = generalisation.across([leaderboard, *map(read_leaderboard, splits)])
        played = {result.policy.label: result.policy.sha256 for result in leaderboard.results}
        for name, files in _agents(folder).items():
            for file in files:
                if played.get(file.label) != file.digest:
                    raise ResultError(f"{folder / file.label}{ONNX_SUFFIX} has no results in {results}: play it first")
            path = folder / f"{name}.md"
            write_whole(path, render(files, leaderboard, across, folder / f"{files[0].label}{ONNX_SUFFIX}"))
            written.append(path)
    return written


def render(files: Sequence[AgentFile], leaderboard: Leaderboard, across: generalisation.Across | None, example: Path) -> str:
    """Return the card of an agent as Markdown.

    Args:
        files: one per training seed.
        leaderboard: the agent's results on the scenario that it was trained on, among others.
        across: its results on the splits.
        example: the file that the example loads.
    """
    metadata = files[0].metadata
    name = leaderboard.names[files[0].label]
    standing = next(standing for standing in leaderboard.standings if standing.name == name)
    shown = (*columns.RETURNS, *columns.COMPARISONS, *columns.CONSTRAINT, *columns.LIMITS, *columns.WORKSHOP)
    low, high = metadata.observation_space.low, metadata.observation_space.high
    elsewhere: list[tuple[str, Cell, bool]] = []  # split, return there, whether feasible there
    if across and across.tuned_for == metadata.scenario.name and standing.name in across.rows:
        for split in across.scenarios[1:]:
            if (cell := across.cell(standing.name, split)) is not None:
                elsewhere.append((split, cell, across.feasible(standing.name, split)))
    templates = Environment(  # what it writes is Markdown, not HTML
        loader=FileSystemLoader(Path(__file__).parent), autoescape=False, undefined=StrictUndefined, trim_blocks=True
    )
    return (
        templates.get_template("model_card.md.j2").render(
            files=files,
            metadata=metadata,
            memory_size=files[0].memory_size,
            title=_title(metadata.algorithm),
            ranges=", ".join(f"{first:g} to {last:g}" for first, last in zip(low, high, strict=True)),
            seeds=len(leaderboard.task.seeds),
            standing=standing,
            classes=CLASSES,
            given=GIVEN,
            seen=SEEN,
            cells=[(column, column.cell(standing)) for column in columns.applying(shown, [standing])],
            elsewhere=elsewhere,
            example=example,
        )
        + "\n"
    )


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
        place = Path(metadata.env_id) / metadata.scenario.name / f"{file.label}{ONNX_SUFFIX}"
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
