"""The leaderboard of one environment on one scenario, as read from its folder."""

from dataclasses import dataclass
from pathlib import Path

from leaderboard.result import (
    MANIFEST_FILE,
    TRAJECTORIES_FILE,
    Manifest,
    Result,
    ResultError,
    Task,
    read_part,
    read_result,
    result_files,
)
from leaderboard.standings import Standing, rank
from leaderboard.trajectories import Trajectories
from turning_env import IDS


@dataclass(frozen=True)
class Leaderboard:
    """Results on one and the same task, ranked."""

    task: Task
    results: list[Result]
    standings: list[Standing]
    trajectories: Trajectories | None
    left_out: list[Path]
    """Files of results on other tasks."""


def read_leaderboard(folder: Path, task: Task | None = None) -> Leaderboard:
    """Rank the results of one environment on one scenario.

    Args:
        folder: where they are; must hold some.
        task: rank the results on this task and leave out others; None: on the manifest's, or without a manifest on the task of
            most results.

    Raises:
        ResultError: a file cannot be used, or none is on the task.
    """
    by_task: dict[str, dict[Path, Result]] = {}
    for path in result_files(folder):
        result = read_result(path)
        by_task.setdefault(result.task.digest, {})[path] = result
    if not by_task:
        raise ResultError(f"{folder} holds no results")
    manifest = folder / MANIFEST_FILE
    if task is not None:
        chosen = task.digest
    elif manifest.is_file():
        chosen = read_part(Manifest, manifest).task.digest
    else:
        chosen = max(by_task, key=lambda digest: (len(by_task[digest]), digest))
    if chosen not in by_task:
        raise ResultError(f"{folder} holds no results on task {chosen[:12]}")
    results = list(by_task[chosen].values())
    return Leaderboard(
        task=results[0].task,
        results=results,
        standings=rank(results),
        trajectories=_trajectories(folder, results),
        left_out=[path for digest, others in by_task.items() if digest != chosen for path in others],
    )


def read_leaderboards(results: Path, tasks: dict[Path, Task] | None = None) -> list[Leaderboard]:
    """Rank every environment on every scenario that ``results`` holds.

    Ids come in the order in which they are declared, and of an id first its own preset, then other scenarios by name.

    Args:
        results: the folder of all results.
        tasks: of some of the folders in it, the task whose results are ranked there; see ``read_leaderboard``.

    Raises:
        ResultError: as for ``read_leaderboard``, or there are no results at all.
    """
    folders = sorted((folder for folder in results.glob("*/*") if result_files(folder)), key=_place)
    if not folders:
        raise ResultError(f"{results} holds no results yet; python -m leaderboard run makes some")
    return [read_leaderboard(folder, (tasks or {}).get(folder)) for folder in folders]


def _place(folder: Path) -> tuple[int, str, bool, str]:
    """Sort key of a leaderboard's folder."""
    env_id, scenario, ids = folder.parent.name, folder.name, list(IDS)
    return ids.index(env_id) if env_id in ids else len(ids), env_id, scenario != IDS.get(env_id), scenario


def _trajectories(folder: Path, results: list[Result]) -> Trajectories | None:
    """Read the recorded trajectories that still belong to the results; None if there are none."""
    path = folder / TRAJECTORIES_FILE
    if not path.exists():
        return None
    recorded, identities = read_part(Trajectories, path), [result.policy.identity for result in results]
    if recorded.task != results[0].task.digest:
        return None
    episodes = [each for each in recorded.episodes if each.policy.identity in identities]
    return recorded.model_copy(update={"episodes": episodes}) if episodes else None
