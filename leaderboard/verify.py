"""Plays again what comes with the project, and says where it does not come back bit for bit."""

import hashlib
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from baselines.oracles import clairvoyant
from leaderboard import contestants, oracles, run
from leaderboard.contestants import Player, Turn
from leaderboard.result import (
    SUFFIX,
    MadeFor,
    PolicyRecord,
    Result,
    ResultError,
    Task,
    current_digests,
    digest_of,
    present_versions,
    read_result,
    result_files,
    result_folder,
    write_whole,
)
from train.agents import agent_file, onnx_policy
from train.agents import graph as plain_graph
from train.agents import sandbox as onnx_guard
from train.agents import sandbox_child as onnx_child
from train.agents import session as onnx_session
from train.agents.trained import ONNX_SUFFIX
from turning_env import Scenario, presets
from turning_env.score.play import EPISODE_FIELDS, Episodes
from turning_env.score.workers import Workers, spread


@dataclass(frozen=True)
class Selection:
    """Which rows and agents' files are looked at. None: all."""

    env_id: str | None = None
    scenario: str | None = None
    policies: Sequence[str] | None = None
    """By name, with or without the training seed."""

    def holds(self, path: Path, suffix: str) -> bool:
        """Whether it holds a file that lies as results and agents do: id / scenario / label."""
        label = path.name.removesuffix(suffix)
        return (
            self.env_id in (None, path.parent.parent.name)
            and self.scenario in (None, path.parent.name)
            and (self.policies is None or any(re.fullmatch(rf"{re.escape(name)}(-seed\d+)?", label) for name in self.policies))
        )


@dataclass(frozen=True)
class Row:
    """A row that can be played again."""

    path: Path
    result: Result
    player: Player
    key: str
    """Of the row, the agent in it, and the code: see ``key_of``."""


def verify(
    rows: Path,
    agents: Path,
    selection: Selection,
    memory: Path,
    fresh: bool,
    draws: int | None = None,
    over: Workers | None = None,
) -> list[str]:
    """Play every selected row again.

    Args:
        rows: folder of the results that come with the project.
        agents: folder of the agents' files.
        selection: which of them.
        memory: file in which it is kept which rows have come back, so that they need not be played again with the same code.
        fresh: play these as well.
        draws: play only so many of each row's draws, the first; such rows are not kept in ``memory``.
        over: who plays, each row a piece of work; without, this process.

    Returns:
        What is wrong, each with the file that it is wrong with: values that do not come back, rows of other code, agents without
        a row or a file, returns beyond the clairvoyant bound. Empty if nothing is.

    Raises:
        ResultError: there are no such rows, or ``memory`` cannot be read or written.
        WorkersError: the workers have gone, or do not run this code.
    """
    paths = [path for folder in sorted(rows.glob("*/*")) for path in result_files(folder) if selection.holds(path, SUFFIX)]
    if not paths:
        raise ResultError(f"{rows} holds no such rows")
    verified = set() if fresh else _remembered(memory)
    complaints = [*_without_row(rows, agents, selection), *_beyond_the_bound(paths)]

    with tqdm(total=len(paths), unit="row", dynamic_ncols=True, disable=None) as bar:

        def turns() -> Iterator[tuple[Row, Turn]]:
            for path in paths:
                try:
                    row = _row(path, agents)
                except ResultError as error:
                    complaints.append(_complaint(path, error))
                else:
                    if row.key not in verified:
                        yield row, Turn(row.player, row.result.task.scenario, row.result.task.draws[:draws])
                        continue
                bar.update()

        for row, played in spread(over, Turn.attempt, turns()):
            bar.set_description(row.path.name.removesuffix(SUFFIX))
            bar.update()
            found = [str(played)] if isinstance(played, ResultError) else differences(row.result, played)
            complaints += [_complaint(row.path, each) for each in found]
            if not found and draws is None:
                verified.add(row.key)
                write_whole(memory, json.dumps(sorted(verified), indent=1) + "\n")
    return sorted(complaints)


def _row(path: Path, agents: Path) -> Row:
    """Read a row, and find who is to play it again.

    Raises:
        ResultError: it cannot be played again; says why.
    """
    result = read_result(path)
    key = key_of(path)
    _check_task(result)
    return Row(path, result, player_of(result.policy, result.task, agents), key)


def _complaint(path: Path, what: object) -> str:
    return f"{path}: {str(what).removeprefix(f'{path}: ')}"


_PLAY = (agent_file, onnx_child, onnx_guard, onnx_policy, onnx_session, plain_graph, contestants, oracles)


def key_of(path: Path) -> str:
    """What decides whether a row comes back: the file, which names the environment's and the rules' code, and what else plays."""
    parts = [path, *(Path(module.__file__ or "") for module in _PLAY)]
    return digest_of([*(hashlib.sha256(part.read_bytes()).hexdigest() for part in parts), present_versions()])


def _check_task(result: Result) -> None:
    """See that the row is of the present code and values."""
    task, present = result.task, current_digests(result.task)
    if task.private is not None:
        raise ResultError("was played on private draws: only who has their file can play it again, by run --draws FILE")
    if result.digests != present:
        fields = [name for name, digest in present if digest != getattr(result.digests, name)]
        raise ResultError(f"is not of the present code: its digests of {', '.join(fields)} are others")
    if task.scenario.name in presets() and Scenario.load(task.scenario.name) != task.scenario:
        raise ResultError(f"is not of the present preset {task.scenario.name!r}: values differ")


def player_of(policy: PolicyRecord, task: Task, agents: Path) -> Player:
    """What a row's policy is now: a rule by name from the catalogue, an agent from its file, a reference by name.

    Raises:
        ResultError: it is no longer there, or no longer the same.
    """
    if policy.kind == "agent":
        player: Player = run.agent(_agent_path(policy, task, agents), task.scenario)
    elif policy.kind == "reference":
        known = {reference.policy.name: reference for reference in oracles.references(task.scenario)}
        if policy.name not in known:
            raise ResultError(f"there is no reference {policy.name!r} for scenario {task.scenario.name!r}")
        player = known[policy.name]
    else:
        player = run.rule(policy.name, task.scenario, _made_for(policy))
    if player.policy != policy:
        fields = [name for name, value in player.policy if value != getattr(policy, name)]
        raise ResultError(f"{policy.label} is no longer what played: {', '.join(fields)} differ")
    return player


def _agent_path(policy: PolicyRecord, task: Task, agents: Path) -> Path:
    trained_on = task.scenario.name if policy.made_for is None else policy.made_for.scenario
    path = result_folder(agents, task.env_id, trained_on) / f"{policy.label}{ONNX_SUFFIX}"
    if not path.is_file():
        raise ResultError(f"its agent's file is missing: {path}")
    return path


def _made_for(policy: PolicyRecord) -> Scenario | None:
    """The scenario to which a rule was tuned, if not that which it plays."""
    if policy.made_for is None:
        return None
    scenario = Scenario.load(policy.made_for.scenario)
    if MadeFor.of(scenario) != policy.made_for:
        raise ResultError(f"is not of the present preset {scenario.name!r}, which its policy was made for: values differ")
    return scenario


def differences(result: Result, episodes: Episodes) -> list[str]:
    """The fields of a row, or of its first draws, that have not come back bit for bit, each with the largest difference."""
    complaints = []
    for name in EPISODE_FIELDS:
        played = episodes[name]
        recorded = np.array(result.episodes[name])[: len(played)]
        other = recorded.view(np.int64) != played.view(np.int64)
        if other.any():
            largest = float(np.max(np.abs(recorded - played)))
            complaints.append(f"{name} differs on {int(other.sum())} of {len(other)} draws, by up to {largest:g}")
    return complaints


def _without_row(rows: Path, agents: Path, selection: Selection) -> Iterator[str]:
    """Of the selected agents' files those that have no row of their own on the scenario that they were trained on."""
    for path in sorted(agents.glob(f"*/*/*{ONNX_SUFFIX}")):
        if not selection.holds(path, ONNX_SUFFIX):
            continue
        row = rows / path.relative_to(agents).with_name(path.name.removesuffix(ONNX_SUFFIX) + SUFFIX)
        if not row.is_file():
            yield f"{path}: has no row {row}"


def _beyond_the_bound(paths: Sequence[Path]) -> Iterator[str]:
    """The rows that earned more on a draw than the clairvoyant bound beside them allows, beyond its tolerance."""
    for path in paths:
        limit = path.with_name(f"{oracles.CLAIRVOYANT}{SUFFIX}")
        if path == limit or not limit.is_file():
            continue
        bound, row = read_result(limit), read_result(path)
        if bound.digests.task != row.digests.task:
            continue
        allowed = np.array(bound.episodes["return"]) + clairvoyant.TOLERANCE * np.array(row.episodes["time"])
        beyond = np.array(row.episodes["return"]) - allowed
        if (beyond > 0.0).any():
            yield f"{path}: beyond the clairvoyant bound on {int((beyond > 0.0).sum())} draws, by up to {float(beyond.max()):g} s"


def _remembered(memory: Path) -> set[str]:
    if not memory.exists():
        return set()
    try:
        return {str(key) for key in json.loads(memory.read_text("utf-8"))}
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise ResultError(f"{memory} cannot be read: {error}; delete it, or verify with --fresh") from error
