"""Check that results are valid, and play them again to see whether every number comes back.

Numbers are compared bit for bit.
"""

import json
import math
import re
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from baselines.oracles import clairvoyant
from leaderboard.family import family_of
from leaderboard.policies import CLAIRVOYANT, agent_files, agents, one_named
from leaderboard.result import (
    MANIFEST_FILE,
    Entry,
    ExcessShares,
    Manifest,
    Result,
    ResultError,
    read_part,
    read_results,
    write_whole,
)
from leaderboard.run import Attempt, attempt
from turning_env import MODEL_VERSION, Scenario, presets
from turning_env.scoring.play import Episodes
from turning_env.scoring.policy import PolicySpec, ScenarioId
from turning_env.scoring.workers import Workers, spread

BOUND_SEEDS = (
    4  # seeds of a result in a quick look for one of a bound, which takes seconds per seed
)


@dataclass(frozen=True)
class Selection:
    """Which results and agents' files to verify. None: all."""

    env_id: str | None = None
    scenario: str | None = None
    policies: Sequence[str] | None = None  # names, with or without the training seed

    def holds(self, path: Path) -> bool:
        """Return whether a result or an agent, ``id/scenario/label``, is selected."""
        return (
            self.env_id in (None, path.parent.parent.name)
            and self.scenario in (None, path.parent.name)
            and (
                self.policies is None
                or not {path.name, re.sub(r"-seed\d+$", "", path.name)}.isdisjoint(self.policies)
            )
        )


def verify(
    results: Path,
    agents_folder: Path,
    selection: Selection,
    memory: Path,
    seeds: int | None = None,
    over: Workers | None = None,
) -> list[str]:
    """Play every selected result again.

    Args:
        results: folder of results.
        agents_folder: folder of agents' ONNX files.
        selection: which of them.
        memory: file that remembers what has come back, so that an interrupted verification goes on; removed at the end.
        seeds: play only so many seeds of each result, those of its shortest episodes, and remember nothing; None: all.
        over: who plays; None: this process.

    Returns:
        Complaints, each with the folder and the policy's label: a task or policy has changed, a number differs, an agent has no
        result, a policy earns more than the bound. Empty if all is well.

    Raises:
        ResultError: there is nothing to verify, or the memory cannot be read or written.
    """
    found, complaints = _examine(results, agents_folder, selection)
    if not found and not complaints:
        raise ResultError(f"{results} holds no such results")
    known = set() if seeds is not None else _remembered(memory)
    wanted = [
        (path, each)
        for path, each in found.items()
        if each.player is not None and each.result.checksum not in known
    ]
    # A bound has no steps, and takes as long as any.
    longest_first = sorted(
        wanted, key=lambda each: -(max(each[1].result.episodes["steps"]) or math.inf)
    )
    complaints += _beyond_the_bound({path: each.result for path, each in found.items()})
    with tqdm(
        total=len(found),
        initial=len(found) - len(wanted),
        unit="result",
        dynamic_ncols=True,
        disable=None,
    ) as bar:
        for path, played in spread(
            over,
            _play,
            [(path, (each, _chosen(each.result, seeds))) for path, each in longest_first],
        ):
            result = found[path].result
            bar.set_description(result.policy.label)
            bar.update()
            wrong = (
                [str(played)]
                if isinstance(played, ResultError)
                else differences(result, played, _chosen(result, seeds))
            )
            complaints += [_complaint(path, each) for each in wrong]
            if not wrong and seeds is None:
                known.add(result.checksum)
                write_whole(memory, json.dumps(sorted(known), indent=1) + "\n")
    if seeds is None:
        memory.unlink(missing_ok=True)
    return sorted(complaints)


def check(results: Path, agents_folder: Path, selection: Selection) -> list[str]:
    """Return complaints about results that are no longer valid, without playing: see ``verify``.

    A result is valid until the model's version, a scenario's value, or a rule's version or parameters change, or an agent's file.
    """
    found, complaints = _examine(results, agents_folder, selection)
    return complaints + _beyond_the_bound({path: each.result for path, each in found.items()})


class _Found(NamedTuple):
    """A result, and who played it: a rule or an oracle, an agent's file, None if neither is there and the same."""

    result: Result
    player: PolicySpec | Path | None


def _examine(
    results: Path, agents_folder: Path, selection: Selection
) -> tuple[dict[Path, _Found], list[str]]:
    """Return all results that can be read, by folder and label, and the complaints about them and about agents without one."""
    found: dict[Path, _Found] = {}
    complaints, files, absent = list[str](), agent_files(agents_folder), 0
    for folder in sorted(results.glob("*/*")):
        if selection.env_id not in (None, folder.parent.name) or selection.scenario not in (
            None,
            folder.name,
        ):
            continue
        manifest = folder / MANIFEST_FILE
        entries: dict[str, Entry] = {}
        try:
            entries = read_part(Manifest, manifest).results if manifest.is_file() else {}
        except ResultError as error:
            complaints.append(_complaint(manifest, error))
        for label, result in read_results(folder, complaints.append).items():
            if not selection.holds(place := folder / label):
                continue
            found[place] = _Found(result, None)
            try:
                found[place] = _Found(result, player_of(result, files))
                absent += found[place].player is None
                if entries.get(label) != Entry.of(result):
                    raise ResultError(
                        f"{manifest.name} beside it says otherwise: run python -m leaderboard run again"
                    )
            except ResultError as error:
                complaints.append(_complaint(place, error))
    if absent:
        tqdm.write(
            f"not played: {absent} results of training seeds that are not in {agents_folder}: make seeds",
            file=sys.stderr,
        )
    played = {
        (place.parent.with_name(each.result.task.home), each.result.policy.sha256)
        for place, each in found.items()
    }
    for digest, path in files.items():
        folder = results / path.parent.relative_to(agents_folder)
        selected = (
            selection.holds(path.with_suffix(""))
            and len(path.relative_to(agents_folder).parts) == 3
        )
        if selected and (folder, digest) not in played:
            complaints.append(f"{path}: has no result in {folder}")
    return found, complaints


def _chosen(result: Result, seeds: int | None) -> list[int]:
    """Return the places of the seeds to play: all, or those of the shortest episodes; of a bound without steps, the first."""
    steps = np.array(result.episodes["steps"])
    if seeds is not None and not steps.any():
        seeds = -(-seeds // BOUND_SEEDS)
    return sorted(np.argsort(steps, kind="stable")[:seeds].tolist())


def _play(piece: tuple[_Found, list[int]]) -> Attempt:
    """Play a result's seeds at some places again."""
    (result, player), places = piece
    task, seeds = result.task, [result.task.seeds[place] for place in places]
    try:
        if isinstance(player, Path):
            (player,) = agents([player], task, forgets=result.policy.forgets)
    except ResultError as error:
        return error
    assert player is not None
    return attempt((player, task.scenario, seeds))


def _complaint(path: Path, what: object) -> str:
    return f"{path}: {str(what).removeprefix(f'{path}: ')}"


def player_of(result: Result, files: Mapping[str, Path]) -> PolicySpec | Path | None:
    """Return the rule, oracle or agent's file (see ``agent_files``) that plays a result again; ResultError if it has changed.

    None: an agent whose file is not there, only its SHA-256.
    """
    policy, task, scenario = result.policy, result.task, result.task.scenario
    if task.private is not None:
        raise ResultError(
            "was played on private seeds: only the owner of their key can play it again, by run --private-key KEY"
        )
    if task.model_version != MODEL_VERSION:
        raise ResultError(
            f"was played with version {task.model_version} of the model, which is now {MODEL_VERSION}"
        )
    if task.of_family:
        family_of(task)
    elif scenario.name in presets() and Scenario.load(scenario.name) != scenario:
        raise ResultError(f"is not of the present preset {scenario.name!r}: values differ")
    if policy.kind == "agent":
        if (path := files.get(policy.sha256 or "")) is None:
            raise ResultError(
                f"{policy.label} is no longer what played: none of the agents' files has its SHA-256"
            )
        return path if path.exists() else None
    now = one_named(policy.name, task, _tuned_on(policy.tuned_for), policy.knows, policy.forgets)
    if fields := [
        name for name, value in now.identity.items() if value != policy.identity.get(name)
    ]:
        raise ResultError(f"{policy.label} is no longer what played: {', '.join(fields)} differ")
    return now


def _tuned_on(known: ScenarioId | None) -> Scenario | None:
    """Return the scenario to which a rule was tuned, if not the one that it plays."""
    if known is None:
        return None
    scenario = Scenario.load(known.name)
    if ScenarioId.of(scenario) != known:
        raise ResultError(
            f"is not of the present preset {scenario.name!r}, which its policy was tuned for: values differ"
        )
    return scenario


def differences(result: Result, episodes: Episodes, places: Sequence[int]) -> list[str]:
    """Return a complaint for every field of a result that differs from episodes of its seeds at ``places``; see the module."""
    complaints = []
    for name, values in result.episodes.items():
        played = episodes[name]
        recorded = np.array(values)[places]
        other = recorded.view(np.int64) != played.view(np.int64)
        if other.any():
            largest = float(np.max(np.abs(recorded - played)))
            complaints.append(
                f"{name} differs for {int(other.sum())} of {len(other)} seeds, by up to {largest:g}"
            )
    whole = len(places) == len(result.task.seeds)
    if whole and result.excess is not None and result.excess != ExcessShares.of(episodes):
        complaints.append(
            f"excess is {result.excess}, but comes back as {ExcessShares.of(episodes)}"
        )
    return complaints


def _beyond_the_bound(results: Mapping[Path, Result]) -> list[str]:
    """Return a complaint for every result that earns more on a seed than the clairvoyant bound, beyond its tolerance."""
    complaints = []
    bounds = {
        folder: read_results(folder, lambda _: None).get(CLAIRVOYANT)
        for folder in {path.parent for path in results}
    }
    for path, result in results.items():
        bound = bounds[path.parent]  # ``check`` tells of one that cannot be read
        if bound is None or bound.task.digest != result.task.digest:
            continue
        allowed = np.array(bound.episodes["return"]) + clairvoyant.TOLERANCE * np.array(
            result.episodes["time"]
        )
        beyond = np.array(result.episodes["return"]) - allowed
        if count := int((beyond > 0.0).sum()):
            complaints.append(
                f"{path}: beyond the clairvoyant bound for {count} seeds, by up to {float(beyond.max()):g} s"
            )
    return complaints


def _remembered(memory: Path) -> set[str]:
    if not memory.exists():
        return set()
    try:
        return {str(key) for key in json.loads(memory.read_text("utf-8"))}
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise ResultError(f"{memory} cannot be read: {error}; delete it") from error
