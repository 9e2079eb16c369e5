"""The leaderboard of one environment on one scenario, as read from its folder.

A folder may hold results on several tasks; those on one task are ranked together.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from baselines.catalogue import RULES
from baselines.policy_spec import PolicySpec
from leaderboard.agents.agent_file import description_of_training
from leaderboard.inputs import Inputs, class_of
from leaderboard.notices import notify_once
from leaderboard.policies import is_external
from leaderboard.result import (
    MANIFEST_FILE,
    TRAJECTORIES_FILE,
    ExcessShares,
    Manifest,
    PartType,
    Result,
    ResultError,
    Task,
    read_part,
    read_results,
    result_files,
)
from leaderboard.standings import About, Played, Standing, rank_together
from leaderboard.trajectories import Trajectories
from turning_env import ALL_IDS, IDS
from turning_env.files import digest_of


@dataclass(frozen=True)
class Leaderboard:
    """Results on one and the same task, ranked."""

    task: Task
    results: list[Result]
    standings: list[Standing]
    trajectories: Trajectories | None
    left_out: list[str]  # results on other tasks, as folder and label

    @property
    def names(self) -> dict[str, str]:
        """Return the name of each result's standing, by its policy's label."""
        return names_of([result.policy for result in self.results])


def read_leaderboard(folder: Path, task: Task | None = None) -> Leaderboard:
    """Rank the results of one environment on one scenario.

    Args:
        folder: where they are; must hold some.
        task: rank the results on this task and leave out others. None: rank those on the
            manifest's task, or without a manifest on the task of most results.

    Raises:
        ResultError: no result can be used, or none is on the task.
    """
    results_by_task: dict[str, dict[str, Result]] = {}
    for label, result in read_results(folder).items():
        results_by_task.setdefault(result.task.digest, {})[label] = result
    if not results_by_task:
        raise ResultError(f"{folder} holds no results")
    digest = _task_to_rank(folder, task, results_by_task)
    if digest not in results_by_task:
        raise ResultError(f"{folder} holds no results on task {digest[:12]}")
    results = list(results_by_task.pop(digest).values())
    left_out = []
    for others in results_by_task.values():
        left_out += [str(folder / label) for label in others]
    return Leaderboard(
        task=results[0].task,
        results=results,
        standings=list(_standings(_Content.of(results))),
        trajectories=_trajectories(folder, results),
        left_out=left_out,
    )


@dataclass(frozen=True)
class _Content:
    """Results, and a key that is equal for equal results."""

    key: tuple[str, ...]
    results: Sequence[Result] = field(compare=False)

    @classmethod
    def of(cls, results: Sequence[Result]) -> "_Content":
        """Return results with their key: checksums cover task and episodes."""
        key = []
        for result in results:
            key += [result.checksum, result.policy.model_dump_json(), str(result.excess)]
        return cls(tuple(key), results)


# A site, its figures and its tables rank the same results: each ranking takes up to a second.
@lru_cache(32)
def _standings(content: _Content) -> tuple[Standing, ...]:
    return tuple(rank(content.results))


def rank(results: Sequence[Result]) -> list[Standing]:
    """Return the standings of all policies of one task, given at least one result.

    ``leaderboard.standings.rank_together`` says in which order.
    """
    task = results[0].task
    names = names_of([result.policy for result in results])
    results_by_name: dict[str, list[Result]] = {}
    for result in results:
        results_by_name.setdefault(names[result.policy.label], []).append(result)
    policies = [_played(name, trainings) for name, trainings in results_by_name.items()]
    return rank_together(policies, task.scenario, on_family=task.of_family is not None)


def _played(name: str, results: Sequence[Result]) -> Played:
    """Return the episodes of a policy by its results: one per training seed; a rule has one."""
    policy = results[0].policy
    episodes = {}
    for field_name in results[0].episodes:
        episodes[field_name] = np.array([result.episodes[field_name] for result in results])
    excess = _excess_shares(results)
    return Played(
        name=name,
        kind=policy.kind,
        episodes=episodes,
        about=_about(results),
        share_above_2_percent=None if excess is None else excess.above_2_percent,
        share_above_10_percent=None if excess is None else excess.above_10_percent,
    )


def _about(results: Sequence[Result]) -> About:
    """Return what a policy is, and what it is given."""
    policy = results[0].policy
    training_seeds: tuple[int, ...] = ()
    inputs = None
    if policy.kind == "agent":
        training_seeds = tuple(sorted(result.policy.training_seed or 0 for result in results))
        scenario = policy.trained_on or results[0].task.scenario
        inputs = Inputs.of(policy.parameters).on(scenario)
    return About(
        policy_class=class_of(policy),
        inputs=inputs,
        description=_description(policy),
        own=is_external(policy),
        training_seeds=training_seeds,
        knows=policy.knows,
        forgets=policy.forgets,
    )


def _excess_shares(results: Sequence[Result]) -> ExcessShares | None:
    """Return the shares of cutting time over a limit; None if a result lacks them."""
    engaged_time = 0.0
    above_2_percent = 0.0
    above_10_percent = 0.0
    for result in results:
        if result.excess is None:
            return None
        engaged = float(np.sum(result.episodes["engaged_time"]))
        engaged_time += engaged
        above_2_percent += engaged * result.excess.above_2_percent
        above_10_percent += engaged * result.excess.above_10_percent
    if engaged_time <= 0.0:
        return ExcessShares(above_2_percent=0.0, above_10_percent=0.0)
    return ExcessShares(
        above_2_percent=above_2_percent / engaged_time,
        above_10_percent=above_10_percent / engaged_time,
    )


def names_of(policies: Sequence[PolicySpec]) -> dict[str, str]:
    """Return the name under which each policy is ranked, by its label.

    Agents that differ only in training seed share a name. If agents of one name differ in more, or
    only some come with the project, the first keeps the name, those of the project before others.
    The names of the others end in their training seeds.
    """
    trainings_by_title: dict[str, dict[str, list[PolicySpec]]] = {}
    for policy in sorted(policies, key=is_external):
        # Agents whose trainings differ only in their seed have the same digest.
        training = policy.model_dump(include={"kind", "tuned_for", "parameters"})
        digest = digest_of([is_external(policy), training])
        trainings = trainings_by_title.setdefault(policy.title, {})
        trainings.setdefault(digest, []).append(policy)

    names: dict[str, str] = {}
    for title, trainings in trainings_by_title.items():
        for place, same_training in enumerate(trainings.values()):
            name = title
            if place > 0:
                seeds = [str(policy.training_seed) for policy in same_training]
                name = f"{title}-seed{','.join(seeds)}"
            for policy in same_training:
                names[policy.label] = name
    return names


def _description(policy: PolicySpec) -> str:
    """Return the description of a policy.

    That of a policy of the project follows from the present code, as results may hold older words.
    """
    if policy.name in RULES:
        return RULES[policy.name].description
    if policy.kind == "agent" and not is_external(policy) and policy.tuned_for is not None:
        steps = policy.parameters.get("total_timesteps")
        return description_of_training(policy.parameters, steps, policy.tuned_for.name)
    return policy.description


def _task_to_rank(
    folder: Path, task: Task | None, results_by_task: Mapping[str, Collection[str]]
) -> str:
    """Return the digest of the task that a folder ranks.

    It is the given task, else that of the manifest, else the one with the most results.
    """
    if task is not None:
        return task.digest
    manifest = read_if_usable(Manifest, folder / MANIFEST_FILE)
    if manifest is not None:
        return manifest.task.digest
    return max(results_by_task, key=lambda digest: (len(results_by_task[digest]), digest))


def read_leaderboards(
    results: Path,
    tasks: Mapping[Path, Task] | None = None,
    env_id: str | None = None,
    scenarios: Collection[str] = (),
    max_count: int | None = None,
) -> list[Leaderboard]:
    """Rank every environment on every scenario that ``results`` holds.

    A notice on stderr names each folder that cannot be used. Ids come in the order in which they
    are declared, and of an id first its own preset, then other scenarios by name.

    Args:
        results: the folder of all results.
        tasks: the task whose results are ranked in some of the folders; see ``read_leaderboard``.
        env_id: only this environment's; None: all.
        scenarios: only on the scenarios of these names, or all splits of these families; empty:
            all.
        max_count: only the first so many; None: all.

    Raises:
        ResultError: there are no results that can be used.
    """
    leaderboards: list[Leaderboard] = []
    folders = sorted(results.glob(f"{env_id or '*'}/*"), key=_place)
    for folder in folders:
        if len(leaderboards) == max_count:
            break
        if not _is_of(folder, scenarios) or not result_files(folder):
            continue
        try:
            leaderboards.append(read_leaderboard(folder, (tasks or {}).get(folder)))
        except ResultError as error:
            notify_once(f"skipped: {error}")
    if not leaderboards:
        names = [env_id, *scenarios] if env_id else scenarios
        wanted = "".join(f" of {name}" for name in names)
        present = ", ".join(sorted(folder.name for folder in folders))
        only = f", only {present}" if present else ""
        command = "python -m leaderboard run"
        if env_id is not None:
            command += f" --env {env_id}"
        raise ResultError(f"{results} holds no results{wanted} yet{only}: {command}")
    return leaderboards


def _is_of(folder: Path, scenarios: Collection[str]) -> bool:
    """Return whether a folder is of one of these scenarios, or of a split of one of these families.

    Without scenarios, all folders are.
    """
    family = folder.name.rpartition("-")[0]
    return not scenarios or folder.name in scenarios or family in scenarios


class _Place(NamedTuple):
    """The place of a leaderboard among others."""

    id_place: int
    env_id: str
    is_other_scenario: bool  # not the id's own preset
    scenario: str


def _place(folder: Path) -> _Place:
    """Return the place of a leaderboard's folder, as a key to sort by."""
    env_id = folder.parent.name
    return _Place(
        id_place=ALL_IDS.index(env_id) if env_id in ALL_IDS else len(ALL_IDS),
        env_id=env_id,
        is_other_scenario=folder.name != IDS.get(env_id),
        scenario=folder.name,
    )


def _trajectories(folder: Path, results: list[Result]) -> Trajectories | None:
    """Read the recorded trajectories that still belong to the results; None if there are none."""
    recorded = read_if_usable(Trajectories, folder / TRAJECTORIES_FILE)
    if recorded is None or recorded.task != results[0].task.digest:
        return None
    identities = [result.policy.identity for result in results]
    episodes = [episode for episode in recorded.episodes if episode.policy.identity in identities]
    return recorded.model_copy(update={"episodes": episodes}) if episodes else None


def read_if_usable(kind: type[PartType], path: Path) -> PartType | None:
    """Read a file that a run writes again.

    Return None if there is no file, or, with a notice on stderr, if it cannot be used.
    """
    if not path.exists():
        return None
    try:
        return read_part(kind, path)
    except ResultError as error:
        notify_once(f"skipped: {error}: the next python -m leaderboard run writes it anew")
        return None
