"""A model card beside every agent that comes with the project: what it is, how it was trained, what it does, and its limits."""

import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from leaderboard import columns, generalisation
from leaderboard.columns import Cell, Column
from leaderboard.ranking import Leaderboard, read_leaderboard
from leaderboard.result import ResultError, result_files, result_folder, write_whole
from leaderboard.standings import Standing
from train.agents import agent_file
from train.agents.agent_file import ONNX_SUFFIX, AgentFile, Space
from turning_env import SPLITS, Scenario

_ALIKE = ("algorithm", "env_id", "scenario", "parameters", "trained_steps", "versions")
"""What all files of one card must have in common."""


@dataclass(frozen=True)
class Card:
    """What a card tells."""

    files: list[AgentFile]
    """One per training seed."""
    board: Leaderboard
    across: generalisation.Across | None
    example: Path

    @property
    def name(self) -> str:
        """The algorithm's."""
        return self.files[0].metadata.algorithm

    @property
    def env_id(self) -> str:
        """On which it was trained."""
        return self.files[0].metadata.env_id

    @property
    def scenario(self) -> Scenario:
        """On which it was trained."""
        return self.files[0].metadata.scenario

    @property
    def what(self) -> str:
        """One sentence of what it is."""
        try:
            title = importlib.import_module(f"train.{self.name}").ALGORITHM.title
        except (ModuleNotFoundError, AttributeError):  # of an algorithm that is not the project's
            title = self.name
        memory = f"with a memory of {self.memory_size} numbers" if self.memory_size else "a function of the present observation"
        return f"A controller trained with {title}, {memory}."

    @property
    def intervals(self) -> int:
        """Of each training."""
        return self.files[0].metadata.trained_steps

    @property
    def parameters(self) -> Mapping[str, Any]:
        """The algorithm's hyperparameters."""
        return self.files[0].metadata.parameters

    @property
    def versions(self) -> str:
        """Of what made the files."""
        return ", ".join(f"{name} {version}" for name, version in self.files[0].metadata.versions.items())

    @property
    def observation(self) -> Space:
        """Ranges of the entries."""
        return self.files[0].metadata.observation_space

    @property
    def ranges(self) -> str:
        """The same as text."""
        return ", ".join(f"{low:g} to {high:g}" for low, high in zip(self.observation.low, self.observation.high, strict=True))

    @property
    def action(self) -> Space:
        """Ranges of the actions."""
        return self.files[0].metadata.action_space

    @property
    def memory_size(self) -> int:
        """0: no memory."""
        return self.files[0].memory_size

    @property
    def draws(self) -> int:
        """On how many it was scored."""
        return len(self.board.task.seeds)

    @property
    def standing(self) -> Standing:
        """On the scenario on which it was trained."""
        return next(standing for standing in self.board.standings if standing.name == self.name)

    @property
    def cells(self) -> list[tuple[Column, Cell]]:
        """All numbers of the board."""
        shown = (*columns.RETURNS, *columns.COMPARISONS, *columns.LIMITS, *columns.WORKSHOP)
        return [(column, column.cell(self.standing)) for column in columns.applying(shown, [self.standing])]

    @property
    def elsewhere(self) -> list[tuple[str, Cell, bool]]:
        """Of each other scenario: return, and whether it is feasible there."""
        across = self.across
        if across is None or across.tuned_for != self.scenario.name or self.name not in across.rows:
            return []
        cells = [(name, across.cell(self.name, name), across.feasible(self.name, name)) for name in across.scenarios[1:]]
        return [(name, cell, feasible) for name, cell, feasible in cells if cell is not None]


def write_all(rows: Path, agents: Path) -> list[Path]:
    """Write the card of every agent in ``agents``, with the results in ``rows``, and return where they are.

    Raises:
        ResultError: a file is no agent's, or in the wrong place, or has no results; agents of one name are not alike; a card
            cannot be written.
    """
    folders = sorted({path.parent for path in agents.glob(f"*/*/*{ONNX_SUFFIX}")})
    if not folders:
        raise ResultError(f"{agents} holds no agents")
    written = []
    for folder in folders:
        board, across = _results(rows, *folder.parts[-2:])
        for name, files in _agents(folder).items():
            scored = {result.policy.label: result.policy.sha256 for result in board.results}
            for file in files:
                if scored.get(file.label) != file.digest:
                    raise ResultError(f"{folder / file.label}{ONNX_SUFFIX} has no results in {rows}: play it first")
            path = folder / f"{name}.md"
            write_whole(path, render(Card(files, board, across, folder / f"{files[0].label}{ONNX_SUFFIX}")))
            written.append(path)
    return written


def render(card: Card) -> str:
    """The card as Markdown."""
    templates = Environment(  # what it writes is Markdown, not HTML
        loader=FileSystemLoader(Path(__file__).parent), autoescape=False, undefined=StrictUndefined, trim_blocks=True
    )
    return templates.get_template("model_card.md.j2").render(card=card) + "\n"


def _results(rows: Path, env_id: str, scenario: str) -> tuple[Leaderboard, generalisation.Across | None]:
    """The board of a scenario, and the table over it and its splits."""
    board = read_leaderboard(result_folder(rows, env_id, scenario))
    splits = [folder for name in SPLITS if result_files(folder := result_folder(rows, env_id, name)) and name != scenario]
    return board, generalisation.across([board, *map(read_leaderboard, splits)])


def _agents(folder: Path) -> dict[str, list[AgentFile]]:
    """The agents of a folder by name, each by training seed."""
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
        agents.setdefault(metadata.algorithm, []).append(file)
    for files in agents.values():
        files.sort(key=lambda file: file.metadata.seed)
        _check_alike(files, folder)
    return agents


def _check_alike(files: Sequence[AgentFile], folder: Path) -> None:
    for field in _ALIKE:
        values = [getattr(file.metadata, field) for file in files]
        if any(value != values[0] for value in values):
            raise ResultError(
                f"{folder}: the files of {files[0].metadata.algorithm} cannot share a card, as they differ in {field}"
            )
