"""Plays policies on a task and writes their results, each as it finishes."""

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Never

from tqdm import tqdm

from leaderboard.board import read_board
from leaderboard.contestants import Contestant, Player, Turn
from leaderboard.oracles import references as known_references
from leaderboard.private_seeds import PrivateDraws
from leaderboard.result import (
    TRAJECTORIES_FILE,
    MadeFor,
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
from leaderboard.standings import check_alike
from leaderboard.trajectories import RECORDED_DRAWS, Trajectories, Trajectory, record
from train.agents.trained import ONNX_SUFFIX
from turning_env import Scenario
from turning_env.files import exclusive_lock, shared_lock
from turning_env.score.play import Episodes
from turning_env.score.workers import Workers, spread


def named(names: Sequence[str] | None, scenario: Scenario, tuned_on: Scenario | None = None) -> list[Player]:
    """The named rule-based controllers and references of a scenario, or without names all that there are.

    Args:
        names: which.
        scenario: what they play.
        tuned_on: the scenario to which the rules are tuned; without, that which they play.

    Raises:
        ResultError: there is none of that name (says which there are), or it is not tuned for the scenario.
    """
    from baselines import catalogue  # reads the rules' tuned values, which only playing needs

    bounds = {reference.policy.name: reference for reference in known_references(scenario)}
    known = [*catalogue.names(scenario), *bounds]
    if unknown := sorted(set(names or ()) - set(known)):
        raise ResultError(f"no policy is called {', '.join(unknown)}; there are {', '.join(known)}")
    return [
        bounds[name] if name in bounds else rule(name, scenario, tuned_on)
        for name in dict.fromkeys(known if names is None else names)
    ]


def rule(name: str, scenario: Scenario, tuned_on: Scenario | None = None) -> Contestant:
    """A rule-based controller: see ``named``.

    Raises:
        ResultError: there is none of that name, or it is not tuned for the scenario.
    """
    from baselines import catalogue

    try:
        entry = catalogue.entry(name, scenario, tuned_on)
    except (KeyError, ValueError) as error:
        raise ResultError(f"{name} cannot play: {error.args[0]}") from error
    policy = PolicyRecord(
        name=entry.name,
        kind="rule",
        description=entry.description,
        parameters=dict(entry.parameters),
        digest=digest_of(entry.parameters),
        training_seed=None,
        command=None,
        made_for=None if tuned_on is None else MadeFor.of(tuned_on),
    )
    return Contestant(policy, entry.make)


def agents(paths: Sequence[Path], scenario: Scenario) -> list[Contestant]:
    """The trained agents of ONNX files, which may come from anywhere, and of one's own training runs' folders.

    Raises:
        ResultError: a path holds no agent, or one that cannot play the scenario, or two hold the same algorithm with the same
            training seed.
    """
    contestants: dict[str, Contestant] = {}
    for path in paths:
        contestant = agent(path, scenario)
        if contestant.policy.label in contestants:
            raise ResultError(f"{path} holds {contestant.policy.label}, which another of the given agents is too")
        contestants[contestant.policy.label] = contestant
    return list(contestants.values())


def agent(path: Path, scenario: Scenario) -> Contestant:
    """The agent of an ONNX file or of a training run's folder: see ``agents``.

    Raises:
        ResultError: there is none, or it cannot play the scenario.
    """
    try:
        if path.suffix == ONNX_SUFFIX:
            from train.agents import onnx_policy

            trained = onnx_policy.load(path)
        else:
            from train.agents import run_folder as agent  # imports torch, which takes seconds

            trained = agent.load(path)
        trained.check_fits(scenario)
    except (OSError, ValueError) as error:
        raise ResultError(f"no agent can be loaded from {path}: {error}") from error
    policy = PolicyRecord(
        name=trained.name,
        kind="agent",
        description=f"trained for {trained.trained_steps} intervals on scenario {trained.scenario.name}",
        parameters=trained.parameters,
        digest=trained.digest,
        training_seed=trained.seed,
        command=trained.command,
        made_for=MadeFor.of(trained.scenario),
    )
    return Contestant(policy, trained.make)


@dataclass(frozen=True)
class Round:
    """Who plays a task, and the folder of its results."""

    task: Task
    contestants: Sequence[Player]
    folder: Path
    private: PrivateDraws | None = None
    """The seeds, if the task does not tell them."""

    @property
    def seeds(self) -> Sequence[int]:
        """What is played."""
        return self.task.draws if self.private is None else self.private.seeds


class PlayersFailed(ResultError):
    """Some policies could not play; the others have."""


def play_all(rounds: Sequence[Round], fresh: bool, over: Workers | None = None) -> None:
    """Have all contestants of all rounds play, and write each result as it is finished.

    Results in a round's folder of the same task, code and policy stand, unless ``fresh``. Then the policies'
    trajectories on the first draws of each round are recorded.

    Args:
        rounds: who plays what.
        fresh: whether to play again what has been played.
        over: who does it, each turn a piece of work; without, this process, one turn after another. Results are the same.

    Raises:
        PlayersFailed: some policies cannot play; says which and why. All others have played.
        ResultError: a folder cannot be written to; it holds something unreadable, something that belongs in another, or
            agents that are not alike but for the training seed.
        WorkersError: the workers have gone, or do not run this code.
    """
    with ExitStack() as held:
        for each in rounds:
            try:
                held.enter_context(shared_lock(each.folder))
            except OSError as error:
                raise ResultError(f"{each.folder} cannot be written: {error.strerror}") from error
        _play_all(rounds, fresh, over)


def _play_all(rounds: Sequence[Round], fresh: bool, over: Workers | None) -> None:
    tasks: dict[Path, Task] = {}
    turns: dict[Path, Turn] = {}
    for each in rounds:  # all of them first: what is wrong is found before anything is played
        finished = _finished(each.task, each.contestants, each.folder)
        for contestant in each.contestants:
            path = result_path(each.folder, contestant.policy)
            if fresh or path not in finished:
                tasks[path], turns[path] = each.task, Turn(contestant, each.task.scenario, each.seeds)
    total = sum(len(each.contestants) * len(each.task.draws) for each in rounds)
    done = total - sum(len(turn.draws) for turn in turns.values())
    # Without miniters=0 the bar would stand still while episodes run and none ends; disable=None: quiet without a terminal.
    with tqdm(total=total, initial=done, unit="episode", miniters=0, dynamic_ncols=True, disable=None) as bar:

        def play_here(turn: Turn) -> Episodes | ResultError:
            bar.set_description(turn.player.policy.label)
            return turn.attempt(lambda ended: _move(bar, done + ended))

        failed: dict[Path, ResultError] = {}
        for path, played in spread(over, Turn.attempt if over else play_here, turns.items()):
            if isinstance(played, ResultError):
                failed[path] = played
            else:
                write_part(Result.of(tasks[path], turns[path].player.policy, played), path)
            done += len(turns[path].draws)
            _move(bar, done)
    complaints = list(failed.values())
    for each in rounds:
        able = [player for player in each.contestants if result_path(each.folder, player.policy) not in failed]
        if able and each.private is None:  # who sees a course could recognise its bars
            complaints += _record_trajectories(replace(each, contestants=able), fresh, over)
    if complaints:
        raise PlayersFailed("; ".join(map(str, complaints)))


def _move(bar: "tqdm[Never]", to: int) -> None:
    bar.update(to - bar.n)


def _finished(task: Task, contestants: Sequence[Player], folder: Path) -> set[Path]:
    """The results that stand. What would make the ranking fail is found here, before anything is played."""
    probe = folder / "writable"
    write_whole(probe, "")
    probe.unlink(missing_ok=True)
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
            print(f"played again: {error}", file=sys.stderr)
            continue
        if result.digests.task == digest:
            ranked.setdefault(path, result.policy)
            if result.policy == wanted.get(path):
                finished.add(path)
    check_alike(list(ranked.values()))
    return finished


def _record_trajectories(each: Round, fresh: bool, over: Workers | None) -> list[ResultError]:
    """Record what each policy does on the first draws, where that is not recorded yet; returns why some could not."""
    complaints = []
    task, digest, path = each.task, current_digests(each.task).task, each.folder / TRAJECTORIES_FILE
    if fresh or not _is_readable(path):
        path.unlink(missing_ok=True)
    wanted, courses = _recorded(each, digest)
    # One training seed stands for an agent: the first given.
    able = {player.policy.name: player for player in reversed(each.contestants) if isinstance(player, Contestant)}
    missing = [place for place in wanted if place not in courses and place[0] in able]
    pieces = [((name, draw), (able[name], task.scenario, draw)) for name, draw in missing]
    try:
        with tqdm(total=len(pieces), unit="trajectory", dynamic_ncols=True, disable=None) as bar:
            for place, course in spread(over, _course, pieces):
                if isinstance(course, ResultError):
                    complaints.append(course)
                else:
                    courses[place] = course
                bar.update()
    finally:  # what is finished is kept, also what another run has played and recorded in the meantime
        with exclusive_lock(each.folder.parent, wait=True):
            wanted, recorded = _recorded(each, digest)
            courses = recorded | courses
            episodes = [courses[place] for place in wanted if place in courses]
            write_part(Trajectories(task=digest, episodes=episodes), path)
    return complaints


def _recorded(each: Round, digest: str) -> tuple[list[tuple[str, int]], dict[tuple[str, int], Trajectory]]:
    """(Policy and draw of each trajectory that a round's folder should hold, in their order; those that it holds.)"""
    board = read_board(each.folder, digest)
    episodes = board.trajectories.episodes if board.trajectories else []
    wanted = [(standing.name, draw) for standing in board.standings for draw in each.task.draws[:RECORDED_DRAWS]]
    return wanted, {(episode.policy.name, episode.draw): episode for episode in episodes}


def _course(piece: tuple[Contestant, Scenario, int]) -> Trajectory | ResultError:
    player, scenario, draw = piece
    try:
        return record(player.policy, player.make, scenario, draw)
    except ValueError as error:
        return ResultError(f"{player.policy.label} cannot play draw {draw}: {error}")


def _is_readable(path: Path) -> bool:
    try:
        read_part(Trajectories, path)
    except ResultError:
        return False
    return True
