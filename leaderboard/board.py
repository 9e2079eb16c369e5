"""The ranking of one environment on one scenario, as read from its folder."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from leaderboard.result import TRAJECTORIES_FILE, Result, ResultError, Task, read_part, read_result, result_files
from leaderboard.standings import Standing, rank
from leaderboard.trajectories import Trajectories
from turning_env import IDS


@dataclass(frozen=True)
class Board:
    """Results on one and the same task, ranked."""

    task: Task
    results: list[Result]
    standings: list[Standing]
    trajectories: Trajectories | None
    left_out: list[Path]
    """Files of results on other tasks."""


def read_board(folder: Path, task_digest: str | None = None) -> Board:
    """Rank the results of one environment on one scenario.

    Args:
        folder: where they are; must hold some.
        task_digest: rank those on this task and leave out others; without it, those on the task played last.

    Raises:
        ResultError: a file cannot be used, or none is on the task.
    """
    by_task: dict[str, dict[Path, Result]] = {}
    for path in result_files(folder):
        result = read_result(path)
        by_task.setdefault(result.digests.task, {})[path] = result
    if not by_task:
        raise ResultError(f"{folder} holds no results")
    chosen = task_digest or max(by_task, key=lambda digest: max(path.stat().st_mtime_ns for path in by_task[digest]))
    if chosen not in by_task:
        raise ResultError(f"{folder} holds no results on task {chosen[:12]}")
    results = list(by_task[chosen].values())
    return Board(
        task=results[0].task,
        results=results,
        standings=rank(results),
        trajectories=_trajectories(folder, results),
        left_out=[path for digest, others in by_task.items() if digest != chosen for path in others],
    )


def read_boards(results: Path, task_digests: Mapping[Path, str]) -> list[Board]:
    """Rank every environment on every scenario that ``results`` holds.

    Ids come in the order in which they are declared, and of an id first its own preset, then other scenarios by name.

    Args:
        results: the folder of all results.
        task_digests: of some of the folders in it, the task whose results are ranked there; see ``read_board``.

    Raises:
        ResultError: as for ``read_board``, or there are no results at all.
    """
    folders = sorted((folder for folder in results.glob("*/*") if result_files(folder)), key=_place)
    if not folders:
        raise ResultError(f"{results} holds no results yet; python -m leaderboard run makes some")
    return [read_board(folder, task_digests.get(folder)) for folder in folders]


def _place(folder: Path) -> tuple[int, str, bool, str]:
    """What a board's folder is sorted by."""
    env_id, scenario, ids = folder.parent.name, folder.name, list(IDS)
    return ids.index(env_id) if env_id in ids else len(ids), env_id, scenario != IDS.get(env_id), scenario


def _trajectories(folder: Path, results: list[Result]) -> Trajectories | None:
    """The recorded trajectories that still belong to the results."""
    path = folder / TRAJECTORIES_FILE
    if not path.exists():
        return None
    recorded = read_part(Trajectories, path)
    return recorded.of_policies(results[0].digests.task, [result.policy for result in results])
