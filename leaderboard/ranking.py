"""The leaderboard of one environment on one scenario, as read from its folder."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from leaderboard.notices import notify_once
from leaderboard.result import (
    MANIFEST_FILE,
    TRAJECTORIES_FILE,
    Manifest,
    PartType,
    Result,
    ResultError,
    Task,
    read_part,
    read_results,
    result_files,
)
from leaderboard.standings import Standing, names_of, rank
from leaderboard.trajectories import Trajectories
from turning_env import FAMILY_ID, IDS


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
        task: rank the results on this task and leave out others; None: on the manifest's, or without a manifest on the task of
            most results.

    Raises:
        ResultError: no result can be used, or none is on the task.
    """
    by_task: dict[str, dict[str, Result]] = {}
    for label, result in read_results(folder).items():
        by_task.setdefault(result.task.digest, {})[label] = result
    if not by_task:
        raise ResultError(f"{folder} holds no results")
    if task is not None:
        chosen = task.digest
    elif (manifest := read_if_usable(Manifest, folder / MANIFEST_FILE)) is not None:
        chosen = manifest.task.digest
    else:
        chosen = max(by_task, key=lambda digest: (len(by_task[digest]), digest))
    if chosen not in by_task:
        raise ResultError(f"{folder} holds no results on task {chosen[:12]}")
    results = list(by_task[chosen].values())
    task = results[0].task
    return Leaderboard(
        task=task,
        results=results,
        standings=rank(results),
        trajectories=_trajectories(folder, results),
        left_out=[
            str(folder / label)
            for digest, others in by_task.items()
            if digest != chosen
            for label in others
        ],
    )


def read_leaderboards(
    results: Path,
    tasks: dict[Path, Task] | None = None,
    env_id: str | None = None,
    scenarios: Collection[str] = (),
    most: int | None = None,
) -> list[Leaderboard]:
    """Rank every environment on every scenario that ``results`` holds. A folder that cannot be used is named on standard error.

    Ids come in the order in which they are declared, and of an id first its own preset, then other scenarios by name.

    Args:
        results: the folder of all results.
        tasks: of some of the folders in it, the task whose results are ranked there; see ``read_leaderboard``.
        env_id: only this environment's; None: all.
        scenarios: only on the scenarios of these names, or all splits of these families; empty: all.
        most: only the first so many; None: all.

    Raises:
        ResultError: there are no results that can be used.
    """
    leaderboards: list[Leaderboard] = []
    folders = sorted(results.glob(f"{env_id or '*'}/*"), key=_place)
    wanted = (
        each
        for each in folders
        if not scenarios or {each.name, each.name.rpartition("-")[0]} & {*scenarios}
    )
    for folder in filter(result_files, wanted):
        if len(leaderboards) == most:
            break
        try:
            leaderboards.append(read_leaderboard(folder, (tasks or {}).get(folder)))
        except ResultError as error:
            notify_once(f"skipped: {error}")
    if not leaderboards:
        asked = "".join(f" of {each}" for each in (env_id, *scenarios) if each)
        held = ", ".join(sorted(folder.name for folder in folders))
        raise ResultError(
            f"{results} holds no results{asked} yet{held and f', only {held}'}: python -m leaderboard run"
        )
    return leaderboards


def _place(folder: Path) -> tuple[int, str, bool, str]:
    """Sort key of a leaderboard's folder."""
    env_id, scenario, ids = folder.parent.name, folder.name, [*IDS, FAMILY_ID]
    return (
        ids.index(env_id) if env_id in ids else len(ids),
        env_id,
        scenario != IDS.get(env_id),
        scenario,
    )


def _trajectories(folder: Path, results: list[Result]) -> Trajectories | None:
    """Read the recorded trajectories that still belong to the results; None if there are none."""
    recorded = read_if_usable(Trajectories, folder / TRAJECTORIES_FILE)
    if recorded is None or recorded.task != results[0].task.digest:
        return None
    identities = [result.policy.identity for result in results]
    episodes = [each for each in recorded.episodes if each.policy.identity in identities]
    return recorded.model_copy(update={"episodes": episodes}) if episodes else None


def read_if_usable(kind: type[PartType], path: Path) -> PartType | None:
    """Read a file that a run makes anew; None, with a word on standard error, if it cannot be used."""
    try:
        return read_part(kind, path) if path.exists() else None
    except ResultError as error:
        notify_once(f"skipped: {error}: the next python -m leaderboard run writes it anew")
        return None
