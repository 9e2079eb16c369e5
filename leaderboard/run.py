"""Plays policies on a task and writes their results, each as it finishes."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Never

from tqdm import tqdm

from baselines.play import play
from baselines.policy import PolicyFactory
from leaderboard.board import read_board
from leaderboard.results import (
    TRAJECTORIES_FILE,
    PolicyRecord,
    Result,
    ResultError,
    Task,
    current_digests,
    digest_of,
    read_part,
    read_result,
    result_files,
    result_path,
    write_part,
    write_whole,
)
from leaderboard.standings import References, Standing, check_alike, references
from leaderboard.trajectories import Trajectories, Trajectory, record
from turning_env import Scenario
from turning_env.files import digest_of_files

MOST_TRAJECTORIES = 3


@dataclass(frozen=True)
class Contestant:
    """A policy that can play."""

    policy: PolicyRecord
    make: PolicyFactory


def rules(names: Sequence[str] | None, scenario: Scenario) -> list[Contestant]:
    """The named rule-based controllers as tuned to the scenario, or without names all that there are.

    Raises:
        ResultError: there is no controller of that name (says which there are), or it is not tuned for the scenario.
    """
    from baselines import catalogue  # reads the rules' tuned values, which only playing needs

    known = catalogue.names(scenario)
    if unknown := sorted(set(names or ()) - set(known)):
        raise ResultError(f"no policy is called {', '.join(unknown)}; there are {', '.join(known)}")
    contestants = []
    for name in known if names is None else dict.fromkeys(names):
        try:
            entry = catalogue.entry(name, scenario)
        except ValueError as error:
            raise ResultError(f"{name} cannot play: {error}") from error
        policy = PolicyRecord(
            name=entry.name,
            kind="rule",
            description=entry.description,
            parameters=dict(entry.parameters),
            digest=digest_of(entry.parameters),
            training_seed=None,
            command=None,
        )
        contestants.append(Contestant(policy, entry.make))
    return contestants


def agents(folders: Sequence[Path]) -> list[Contestant]:
    """The trained agents of training runs' folders.

    Raises:
        ResultError: a folder holds no agent, or two hold the same algorithm with the same training seed.
    """
    if not folders:
        return []
    from train import agent  # imports torch, which takes seconds

    contestants: dict[str, Contestant] = {}
    for folder in folders:
        try:
            trained = agent.load(folder)
        except (OSError, ValueError) as error:
            raise ResultError(f"no agent can be loaded from {folder}: {error}") from error
        policy = PolicyRecord(
            name=trained.name,
            kind="agent",
            description=f"trained for {trained.trained_intervals} intervals on scenario {trained.scenario.name}",
            parameters=trained.parameters,
            digest=digest_of_files(folder, "*"),
            training_seed=trained.seed,
            command=trained.command,
        )
        if policy.label in contestants:
            raise ResultError(f"{folder} holds {policy.label}, which another of the given folders holds too")
        contestants[policy.label] = Contestant(policy, trained.make)
    return list(contestants.values())


def play_all(task: Task, contestants: Sequence[Contestant], folder: Path, fresh: bool) -> None:
    """Have every contestant play the task, and write each result as it finishes.

    Results in ``folder`` of the same task, code and policy stand, unless ``fresh``. Then a few trajectories are recorded.

    Raises:
        ResultError: the folder cannot be written to; it holds something unreadable, something that belongs in another, or
            agents that are not alike but for the training seed.
    """
    finished = _finished(task, contestants, folder)
    # Without miniters=0 the bar would stand still while episodes run and none ends; disable=None: quiet without a terminal.
    with tqdm(total=len(contestants) * len(task.draws), unit="episode", miniters=0, dynamic_ncols=True, disable=None) as bar:
        for contestant in contestants:
            bar.set_description(contestant.policy.label)
            path = result_path(folder, contestant.policy)
            if path in finished and not fresh:
                bar.update(len(task.draws))
            else:
                write_part(_play(task, contestant, bar), path)
    _record_trajectories(task, contestants, folder, fresh)


def _finished(task: Task, contestants: Sequence[Contestant], folder: Path) -> set[Path]:
    """The results that stand. What would make the ranking fail is found here, before anything is played."""
    probe = folder / "writable"
    write_whole(probe, "")
    probe.unlink()
    digest = current_digests(task).task
    wanted = {result_path(folder, contestant.policy): contestant.policy for contestant in contestants}
    ranked = dict(wanted)
    finished = set()
    for path in result_files(folder):
        try:
            result = read_result(path)
        except ResultError as error:
            if path not in wanted:
                raise
            print(f"leaderboard: played again: {error}", file=sys.stderr)
            continue
        if result.digests.task == digest:
            ranked.setdefault(path, result.policy)
            if result.policy == wanted.get(path):
                finished.add(path)
    check_alike(list(ranked.values()))
    return finished


def _play(task: Task, contestant: Contestant, bar: "tqdm[Never]") -> Result:
    start = bar.n

    def on_interval(ended: int) -> None:
        bar.update(start + ended - bar.n)

    return Result.of(task, contestant.policy, play(contestant.make, task.scenario, task.draws, on_interval))


def _record_trajectories(task: Task, contestants: Sequence[Contestant], folder: Path, fresh: bool) -> None:
    digest = current_digests(task).task
    path = folder / TRAJECTORIES_FILE
    if fresh or not _is_readable(path):
        path.unlink(missing_ok=True)
    board = read_board(folder, digest)
    recorded = {episode.policy.name: episode for episode in board.trajectories.episodes} if board.trajectories else {}
    # One training seed stands for an agent: the first given.
    able = {contestant.policy.name: contestant for contestant in reversed(contestants)}
    episodes: list[Trajectory] = []
    for name in _shown(board.standings, references(task.scenario)):
        if name in recorded:
            episodes.append(recorded[name])
        elif name in able:
            episodes.append(record(able[name].policy, able[name].make, task.scenario, task.draws[0]))
    write_part(Trajectories(task=digest, draw=task.draws[0], episodes=episodes), path)


def _is_readable(path: Path) -> bool:
    try:
        read_part(Trajectories, path)
    except ResultError:
        return False
    return True


def _shown(standings: Sequence[Standing], refer: References) -> list[str]:
    """The policies whose trajectories are shown, in the order of rank: the first, and the two that all are compared with."""
    names = [standing.name for standing in standings]
    chosen = dict.fromkeys([names[0], *(name for name in (refer.published, refer.fixed) if name in names), *names])
    return sorted(list(chosen)[:MOST_TRAJECTORIES], key=names.index)
