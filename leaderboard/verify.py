"""Check that results are valid, and play them again to see whether every number comes back.

Numbers of agents and of the bound are compared bit for bit. Those of policies with a ``tolerance``, the rules, may differ by so
much from one processor to another.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from baselines.oracles import clairvoyant
from leaderboard import oracles, run
from leaderboard.result import (
    MANIFEST_FILE,
    SUFFIX,
    Entry,
    Manifest,
    Result,
    ResultError,
    read_part,
    read_result,
    result_files,
    write_whole,
)
from leaderboard.shipped import agent_files
from leaderboard.standings import CLAIRVOYANT
from train.agents import onnx_policy
from train.agents.agent_file import ONNX_SUFFIX
from train.agents.sandbox import LIMITS
from turning_env import MODEL_VERSION, Scenario, presets
from turning_env.scoring.play import EPISODE_FIELDS, Episodes
from turning_env.scoring.policy import PolicySpec, ScenarioId
from turning_env.scoring.workers import Workers, spread


@dataclass(frozen=True)
class Selection:
    """Which results and agents' files to verify. None: all."""

    env_id: str | None = None
    scenario: str | None = None
    policies: Sequence[str] | None = None
    """Names, with or without the training seed."""

    def holds(self, path: Path, suffix: str) -> bool:
        """Return whether a file ``id/scenario/label`` of results or agents is selected."""
        label = path.name.removesuffix(suffix)
        return (
            self.env_id in (None, path.parent.parent.name)
            and self.scenario in (None, path.parent.name)
            and (self.policies is None or any(re.fullmatch(rf"{re.escape(name)}(-seed\d+)?", label) for name in self.policies))
        )


def verify(
    results: Path,
    agents: Path,
    selection: Selection,
    memory: Path,
    seeds: int | None = None,
    over: Workers | None = None,
) -> list[str]:
    """Play every selected result again.

    Args:
        results: folder of results.
        agents: folder of agents' ONNX files.
        selection: which of them.
        memory: file that remembers what has come back, so that an interrupted verification goes on; removed at the end.
        seeds: play only so many of the first seeds of each result, and remember nothing; None: all.
        over: who plays; None: this process.

    Returns:
        Complaints, each with the file's path: a task or policy has changed, a number differs, an agent has no result, a policy
        earns more than the bound. Empty if all is well.

    Raises:
        ResultError: there is nothing to verify, or the memory cannot be read or written.
    """
    found, complaints = _examine(results, agents, selection)
    if not found and not complaints:
        raise ResultError(f"{results} holds no such results")
    known = set() if seeds is not None else _remembered(memory)
    wanted = {path: each for path, each in found.items() if each.player is not None and each.result.checksum not in known}
    complaints += _beyond_the_bound({path: each.result for path, each in found.items()})
    with tqdm(total=len(found), initial=len(found) - len(wanted), unit="result", dynamic_ncols=True, disable=None) as bar:
        for paths, played in spread(over, _attempts, _pieces(wanted, seeds)):
            for path, attempt in zip(paths, played, strict=True):
                result, tolerance = wanted[path].result, wanted[path].tolerance
                bar.set_description(result.policy.label)
                bar.update()
                wrong = [str(attempt)] if isinstance(attempt, ResultError) else differences(result, attempt, tolerance)
                complaints += [_complaint(path, each) for each in wrong]
                if not wrong and seeds is None:
                    known.add(result.checksum)
                    write_whole(memory, json.dumps(sorted(known), indent=1) + "\n")
    if seeds is None:
        memory.unlink(missing_ok=True)
    return sorted(complaints)


def check(results: Path, agents: Path, selection: Selection) -> list[str]:
    """Return complaints about results that are no longer valid, without playing: see ``verify``.

    A result is valid until the model's version, a scenario's value, or a rule's version or parameters change, or an agent's file.
    """
    return _examine(results, agents, selection)[1]


class _Found(NamedTuple):
    """A result, and who played it: a rule or an oracle, an agent's file, None if neither is still there and the same."""

    result: Result
    player: PolicySpec | Path | None

    @property
    def tolerance(self) -> float:
        return self.player.tolerance if isinstance(self.player, PolicySpec) else 0.0


def _examine(results: Path, agents: Path, selection: Selection) -> tuple[dict[Path, _Found], list[str]]:
    """Return all results that can be read, and the complaints about them, about other files and about agents without one."""
    found: dict[Path, _Found] = {}
    complaints, files = list[str](), agent_files(agents)
    for folder in sorted(results.glob("*/*")):
        manifest = folder / MANIFEST_FILE
        entries: dict[str, Entry] = {}
        try:
            entries = read_part(Manifest, manifest).results if manifest.is_file() else {}
        except ResultError as error:
            complaints.append(_complaint(manifest, error))
        for path in result_files(folder):
            if selection.holds(path, SUFFIX):
                try:
                    found[path] = _Found(read_result(path), None)
                    found[path] = _Found(result := found[path].result, player_of(result, files))
                    if entries.get(result.policy.label) != Entry.of(result):
                        raise ResultError(f"{manifest.name} beside it says otherwise: run python -m leaderboard run again")
                except ResultError as error:
                    complaints.append(_complaint(path, error))
    played = {(path.parent, each.result.policy.sha256) for path, each in found.items()}
    for digest, path in files.items():
        folder = results / path.parent.relative_to(agents)
        if selection.holds(path, ONNX_SUFFIX) and len(path.relative_to(agents).parts) == 3 and (folder, digest) not in played:
            complaints.append(f"{path}: has no result in {folder}")
    return found, complaints


Plays = tuple[PolicySpec | Path, list[tuple[Scenario, Sequence[int]]]]
"""A policy with the scenarios and seeds that it plays."""


def _pieces(wanted: Mapping[Path, _Found], seeds: int | None) -> list[tuple[list[Path], Plays]]:
    """Return results and what comes back if they are right: all of an agent's file in one piece, and long pieces first."""
    pieces: dict[Path, tuple[list[Path], Plays]] = {}
    steps = dict[Path, float]()
    for path, (result, player) in wanted.items():
        assert player is not None
        key = player if isinstance(player, Path) else path
        paths, (_, plays) = pieces.setdefault(key, ([], (player, [])))
        paths.append(path)
        plays.append((result.task.scenario, result.task.seeds[:seeds]))
        # A bound has no steps, and takes as long as any.
        steps[key] = steps.get(key, 0.0) + (max(result.episodes["steps"][:seeds]) or math.inf)
    return [pieces[key] for key in sorted(pieces, key=lambda key: -steps[key])]


def _attempts(piece: Plays) -> list[run.Attempt]:
    """Play one thing after another; an agent's file does so in one process, which may use as much as one each."""
    player, plays = piece
    if isinstance(player, PolicySpec):
        return [run.attempt((player, *each)) for each in plays]
    try:
        with onnx_policy.opened(player, replace(LIMITS, computing=LIMITS.computing * len(plays))) as agent:
            return [run.attempt((agent, *each)) for each in plays]
    except (OSError, ValueError) as error:
        return [ResultError(f"no agent can be loaded: {error}") for _ in plays]


def _complaint(path: Path, what: object) -> str:
    return f"{path}: {str(what).removeprefix(f'{path}: ')}"


def player_of(result: Result, files: Mapping[str, Path]) -> PolicySpec | Path:
    """Return who plays a result again: the rule or the oracle, or the path of the agent's file (see ``agent_files``).

    Raises:
        ResultError: the policy is no longer there, or no longer the same, or the task is not.
    """
    policy, task, scenario = result.policy, result.task, result.task.scenario
    if task.private is not None:
        raise ResultError("was played on private seeds: only the owner of their file can play it again, by run --seeds FILE")
    if task.model_version != MODEL_VERSION:
        raise ResultError(f"was played with version {task.model_version} of the model, which is now {MODEL_VERSION}")
    if scenario.name in presets() and Scenario.load(scenario.name) != scenario:
        raise ResultError(f"is not of the present preset {scenario.name!r}: values differ")
    if policy.kind == "agent":
        if (path := files.get(policy.sha256 or "")) is None:
            raise ResultError(f"{policy.label} is no longer what played: none of the agents' files has its SHA-256")
        return path
    if policy.kind == "rule":
        now = run.rule(policy.name, scenario, _tuned_on(policy.tuned_for))
    elif known := [oracle for oracle in oracles.oracles(scenario) if oracle.name == policy.name]:
        (now,) = known
    else:
        raise ResultError(f"there is no oracle {policy.name!r} for scenario {scenario.name!r}")
    if fields := [name for name, value in now.identity.items() if value != policy.identity[name]]:
        raise ResultError(f"{policy.label} is no longer what played: {', '.join(fields)} differ")
    return now


def _tuned_on(known: ScenarioId | None) -> Scenario | None:
    """Return the scenario to which a rule was tuned, if not the one that it plays."""
    if known is None:
        return None
    scenario = Scenario.load(known.name)
    if ScenarioId.of(scenario) != known:
        raise ResultError(f"is not of the present preset {scenario.name!r}, which its policy was tuned for: values differ")
    return scenario


def differences(result: Result, episodes: Episodes, tolerance: float) -> list[str]:
    """Return a complaint for every field of a result that differs from episodes on its first seeds; see the module."""
    complaints = []
    for name in EPISODE_FIELDS:
        played = episodes[name]
        recorded = np.array(result.episodes[name])[: len(played)]
        other = recorded.view(np.int64) != played.view(np.int64) if tolerance == 0.0 else abs(recorded - played) > tolerance
        if other.any():
            largest = float(np.max(np.abs(recorded - played)))
            complaints.append(f"{name} differs for {int(other.sum())} of {len(other)} seeds, by up to {largest:g}")
    return complaints


def _beyond_the_bound(results: Mapping[Path, Result]) -> list[str]:
    """Return a complaint for every result that earns more on a seed than the clairvoyant bound, beyond its tolerance."""
    complaints, read_bound = [], cache(read_result)
    for path, result in results.items():
        try:
            bound = read_bound(path.with_name(f"{CLAIRVOYANT}{SUFFIX}"))
        except ResultError:  # ``check`` tells of it, or there is no bound
            continue
        if bound.task.digest != result.task.digest:
            continue
        allowed = np.array(bound.episodes["return"]) + clairvoyant.TOLERANCE * np.array(result.episodes["time"])
        beyond = np.array(result.episodes["return"]) - allowed
        if count := int((beyond > 0.0).sum()):
            complaints.append(f"{path}: beyond the clairvoyant bound for {count} seeds, by up to {float(beyond.max()):g} s")
    return complaints


def _remembered(memory: Path) -> set[str]:
    if not memory.exists():
        return set()
    try:
        return {str(key) for key in json.loads(memory.read_text("utf-8"))}
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise ResultError(f"{memory} cannot be read: {error}; delete it") from error
