"""Check that results are valid, and play them again to see whether every number comes back.

Numbers are compared bit for bit.
"""

import hashlib
import json
import math
import re
import secrets
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from baselines.oracles import clairvoyant
from baselines.policy_spec import PolicySpec, ScenarioId
from leaderboard.family import family_of
from leaderboard.pieces import Attempt, Piece, attempt
from leaderboard.play import Episodes
from leaderboard.policies import CLAIRVOYANT, agent_files, agents, one_named
from leaderboard.result import (
    MANIFEST_FILE,
    MAX_BYTES,
    ExcessShares,
    Manifest,
    ManifestEntry,
    Result,
    ResultError,
    read_part,
    read_results,
)
from leaderboard.workers import Workers, spread
from turning_env import MODEL_VERSION, Scenario, presets
from turning_env.files import read_regular, write_file
from turning_env.progress import progress

_KEY_BITS = 63
BOUND_SEEDS = 4
"""Seeds of a result in a quick look for each seed of a bound, which takes seconds per seed."""


@dataclass(frozen=True)
class Selection:
    """The results and agents' files to verify; None: all."""

    env_id: str | None = None
    scenario: str | None = None
    policies: Sequence[str] | None = None  # names, with or without the training seed

    def holds_folder(self, folder: Path) -> bool:
        """Return whether the results of a folder ``id/scenario`` are selected, if any."""
        is_of_id = self.env_id in (None, folder.parent.name)
        return is_of_id and self.scenario in (None, folder.name)

    def holds(self, path: Path) -> bool:
        """Return whether a result or an agent, ``id/scenario/label``, is selected."""
        if not self.holds_folder(path.parent):
            return False
        if self.policies is None:
            return True
        without_seed = re.sub(r"-seed\d+$", "", path.name)
        return path.name in self.policies or without_seed in self.policies


class Draw(NamedTuple):
    """A draw of seeds to play in a quick look.

    Whoever wrote the results must not know beforehand which seeds are played, nor decide it by
    what the results hold. So the key is fresh, and printed, as it repeats the draw.
    """

    seeds: int  # of each result; of a bound, one for BOUND_SEEDS
    key: int

    @classmethod
    def fresh(cls, seeds: int) -> "Draw":
        """Return a draw that nobody can foresee."""
        return cls(seeds, secrets.randbits(_KEY_BITS))

    def places(self, result: Result, is_bound: bool) -> list[int]:
        """Return the places of the seeds to play among those of a result, in order.

        ``is_bound``: whether it is an upper bound, which takes much longer to play.
        """
        count = math.ceil(self.seeds / BOUND_SEEDS) if is_bound else self.seeds

        def lot(place: int) -> bytes:
            """Return a number that nobody can foresee without the key; the lowest are drawn."""
            return hashlib.sha256(f"{self.key} {result.checksum} {place}".encode()).digest()

        places = sorted(range(len(result.task.seeds)), key=lot)
        return sorted(places[:count])


class _Verifiable(NamedTuple):
    """A result, and who played it: a rule or an oracle, or an agent's file.

    The player is None if it is not there, or no longer the same.
    """

    result: Result
    player: PolicySpec | Path | None


class _Replay(NamedTuple):
    """A piece of work: a result to play again, on some of its seeds by their places."""

    result: Result
    player: PolicySpec | Path
    places: list[int]


def verify(
    results: Path,
    agents_folder: Path,
    selection: Selection,
    memory: Path,
    draw: Draw | None = None,
    over: Workers | None = None,
) -> list[str]:
    """Play every selected result again.

    Args:
        results: folder of results.
        agents_folder: folder of agents' ONNX files.
        selection: which of them to verify.
        memory: file that remembers what has come back, so that an interrupted verification goes
            on; removed at the end.
        draw: play only these seeds of each result, and remember nothing; None: all.
        over: who plays; None: this process.

    Returns:
        Complaints, each with the folder and the policy's label: a task or policy has changed, a
        number differs, an agent has no result, a policy earns more than the bound. Empty if all is
        well.

    Raises:
        ResultError: there is nothing to verify, or the memory cannot be read or written.
    """
    examined = _examine(results, agents_folder, selection)
    if not examined.results and not examined.complaints:
        raise ResultError(f"{results} holds no such results")
    complaints = examined.complaints + _beyond_the_bound(examined.results)

    came_back = set() if draw is not None else _remembered(memory)
    replays = {}
    for path, verifiable in examined.results.items():
        result, player = verifiable
        if player is not None and result.checksum not in came_back:
            replays[path] = _Replay(result, player, _places(result, player, draw))
    # The longest first, so that no worker plays on long after the others have finished.
    longest_first = sorted(replays, key=lambda path: -_length(replays[path].result))
    pieces = [(path, replays[path]) for path in longest_first]

    with progress(
        total=len(examined.results),
        initial=len(examined.results) - len(pieces),
        unit="result",
        dynamic_ncols=True,
    ) as bar:
        for path, played in spread(over, _play, pieces):
            result = replays[path].result
            bar.set_description_str(result.policy.label)
            bar.update()
            if isinstance(played, ResultError):
                faults = [str(played)]
            else:
                faults = differences(result, played, replays[path].places)
            complaints += [_complaint(path, fault) for fault in faults]
            if not faults and draw is None:
                came_back.add(result.checksum)
                write_file(memory, json.dumps(sorted(came_back), indent=1) + "\n")
    if draw is None:
        memory.unlink(missing_ok=True)
    return sorted(complaints)


def _length(result: Result) -> float:
    """Return the steps of a result's longest episode, by which the longest is played first.

    A bound has no steps, and takes as long as any.
    """
    return max(result.episodes["steps"]) or math.inf


def check(results: Path, agents_folder: Path, selection: Selection) -> list[str]:
    """Return complaints about results that are no longer valid, without playing: see ``verify``.

    A result is valid until the model's version, a scenario's value, or a rule's version or
    parameters change, or an agent's file.
    """
    examined = _examine(results, agents_folder, selection)
    return examined.complaints + _beyond_the_bound(examined.results)


@dataclass
class _Examined:
    """Results that can be read, by folder and label, and complaints about them and about agents."""

    results: dict[Path, _Verifiable] = field(default_factory=dict)
    complaints: list[str] = field(default_factory=list)
    without_file: int = 0  # results of agents whose files are not there


def _examine(results: Path, agents_folder: Path, selection: Selection) -> _Examined:
    """Examine all selected results, and whether the selected agents have one."""
    examined = _Examined()
    files = agent_files(agents_folder, examined.complaints.append)
    for folder in sorted(results.glob("*/*")):
        if selection.holds_folder(folder):
            _examine_folder(folder, files, selection, examined=examined)
    if examined.without_file:
        tqdm.write(
            f"not played: {examined.without_file} results of training seeds that are not in "
            f"{agents_folder}: make seeds",
            file=sys.stderr,
        )

    # An agent has its results where it was trained, and perhaps others on splits.
    homes = set()
    for path, verifiable in examined.results.items():
        home = path.parent.with_name(verifiable.result.task.home)
        homes.add((home, verifiable.result.policy.sha256))
    for digest, path in files.items():
        place = path.relative_to(agents_folder)
        if len(place.parts) != 3 or not selection.holds(path.with_suffix("")):
            continue
        home = results / place.parent
        if (home, digest) not in homes:
            examined.complaints.append(f"{path}: has no result in {home}")
    return examined


def _examine_folder(
    folder: Path, files: Mapping[str, Path], selection: Selection, examined: _Examined
) -> None:
    """Add the selected results of a folder to those examined, and the complaints about them."""
    manifest = folder / MANIFEST_FILE
    entries: dict[str, ManifestEntry] = {}
    if manifest.is_file():
        try:
            entries = read_part(Manifest, manifest).results
        except ResultError as error:
            examined.complaints.append(_complaint(manifest, error))
    for label, result in read_results(folder, examined.complaints.append).items():
        path = folder / label
        if not selection.holds(path):
            continue
        player = None
        try:
            player = player_of(result, files)
            if player is None:
                examined.without_file += 1
            if entries.get(label) != ManifestEntry.of(result):
                raise ResultError(
                    f"{manifest.name} beside it says otherwise: run python -m leaderboard run again"
                )
        except ResultError as error:
            examined.complaints.append(_complaint(path, error))
        examined.results[path] = _Verifiable(result, player)


def _places(result: Result, player: PolicySpec | Path, draw: Draw | None) -> list[int]:
    """Return the places of the seeds to play among those of a result: all, or those of a draw."""
    if draw is None:
        return list(range(len(result.task.seeds)))
    is_bound = isinstance(player, PolicySpec) and player.compute is not None
    return draw.places(result, is_bound)


def _play(replay: _Replay) -> Attempt:
    """Play some seeds of a result again."""
    result, player, places = replay
    task = result.task
    try:
        if isinstance(player, Path):
            (player,) = agents([player], task, forgets=result.policy.forgets)
    except ResultError as error:
        return error
    return attempt(Piece(player, task.scenario, [task.seeds[place] for place in places]))


def _complaint(path: Path, fault: object) -> str:
    """Return a complaint that names the path once."""
    return f"{path}: {str(fault).removeprefix(f'{path}: ')}"


def player_of(result: Result, files: Mapping[str, Path]) -> PolicySpec | Path | None:
    """Return the rule, oracle or agent's file (see ``agent_files``) that plays a result again.

    Return None for an agent whose file is not there, only its SHA-256. Raise ResultError if the
    task or the policy has changed.
    """
    policy = result.policy
    _check_task(result)
    if policy.kind == "agent":
        path = files.get(policy.sha256 or "")
        if path is None:
            raise ResultError(
                f"{policy.label} is no longer what played: none of the agents' files has its "
                "SHA-256"
            )
        return path if path.exists() else None
    present = one_named(
        policy.name,
        result.task,
        tuned_on=_tuned_on(policy.tuned_for),
        knows=policy.knows,
        forgets=policy.forgets,
    )
    identity = policy.identity
    changed = [name for name, value in present.identity.items() if value != identity.get(name)]
    if changed:
        raise ResultError(f"{policy.label} is no longer what played: {', '.join(changed)} differ")
    return present


def _check_task(result: Result) -> None:
    """Raise ResultError if nobody can play the task of a result again."""
    task = result.task
    scenario = task.scenario
    if task.private is not None:
        raise ResultError(
            "was played on private seeds: only the owner of their key can play it again, by run "
            "--private-key KEY"
        )
    if task.model_version != MODEL_VERSION:
        raise ResultError(
            f"was played with version {task.model_version} of the model, which is now "
            f"{MODEL_VERSION}"
        )
    if task.of_family:
        family_of(task)  # raises if the family's values differ
    elif scenario.name in presets() and Scenario.load(scenario.name) != scenario:
        raise ResultError(f"is not of the present preset {scenario.name!r}: values differ")


def _tuned_on(known: ScenarioId | None) -> Scenario | None:
    """Return the scenario to which a rule was tuned, if not the one that it plays."""
    if known is None:
        return None
    scenario = Scenario.load(known.name)
    if ScenarioId.of(scenario) != known:
        raise ResultError(
            f"is not of the present preset {scenario.name!r}, which its policy was tuned for: "
            "values differ"
        )
    return scenario


def differences(result: Result, episodes: Episodes, places: Sequence[int]) -> list[str]:
    """Return a complaint for every field of a result that differs, bit for bit.

    Args:
        result: the recorded result.
        episodes: the episodes of its seeds at ``places``, played again.
        places: places of seeds in the task.
    """
    complaints = []
    for name, values in result.episodes.items():
        played = episodes[name]
        recorded = np.array(values)[places]
        # As integers, so that -0.0 differs from 0.0.
        differs = recorded.view(np.int64) != played.view(np.int64)
        if differs.any():
            largest = float(np.max(np.abs(recorded - played)))
            complaints.append(
                f"{name} differs for {int(differs.sum())} of {len(differs)} seeds, "
                f"by up to {largest:g}"
            )
    # The shares are those of all seeds together.
    if result.excess is not None and len(places) == len(result.task.seeds):
        excess = ExcessShares.of(episodes)
        if result.excess != excess:
            complaints.append(f"excess is {result.excess}, but comes back as {excess}")
    return complaints


def _beyond_the_bound(examined: Mapping[Path, _Verifiable]) -> list[str]:
    """Return a complaint for every result that earns more on a seed than the clairvoyant bound.

    The bound's tolerance is allowed.
    """
    complaints = []
    folders = {path.parent for path in examined}
    # Complaints about files that cannot be read have been made.
    bounds = {folder: read_results(folder, lambda _: None).get(CLAIRVOYANT) for folder in folders}
    for path, verifiable in examined.items():
        result = verifiable.result
        bound = bounds[path.parent]
        if bound is None or bound.task.digest != result.task.digest:
            continue
        time = np.array(result.episodes["time"])
        limits = np.array(bound.episodes["return"]) + clairvoyant.TOLERANCE * time
        beyond = np.array(result.episodes["return"]) - limits
        count = int((beyond > 0.0).sum())
        if count:
            complaints.append(
                f"{path}: beyond the clairvoyant bound for {count} seeds, "
                f"by up to {float(beyond.max()):g} s"
            )
    return complaints


def _remembered(memory: Path) -> set[str]:
    """Return the checksums of the results that have come back before an interruption."""
    if not memory.exists():
        return set()
    try:
        return {str(key) for key in json.loads(read_regular(memory, MAX_BYTES))}
    except (OSError, ValueError, TypeError, RecursionError) as error:
        raise ResultError(f"{memory} cannot be read: {error}; delete it") from error
