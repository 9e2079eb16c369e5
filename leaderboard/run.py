"""Play policies on a task and write their results, each as it finishes."""

import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from pathlib import Path

from tqdm import tqdm

from leaderboard.oracles import oracles
from leaderboard.ranking import read_leaderboard
from leaderboard.result import (
    TRAJECTORIES_FILE,
    Result,
    ResultError,
    Task,
    read_part,
    read_result,
    result_files,
    result_path,
    write_manifest,
    write_part,
    write_result,
    write_whole,
)
from leaderboard.standings import check_names
from leaderboard.trajectories import RECORDED_SEEDS, Trajectories, Trajectory, record
from train.agents.agent_file import ONNX_SUFFIX, check_fits
from turning_env import Scenario
from turning_env.files import exclusive_lock, shared_lock
from turning_env.score.play import Episodes, play_spec
from turning_env.score.policy import PolicySpec
from turning_env.score.workers import Workers, spread


def named(names: Sequence[str] | None, scenario: Scenario, tuned_on: Scenario | None = None) -> list[PolicySpec]:
    """Return controllers and oracles of a scenario by name, all of them if ``names`` is None.

    Args:
        names: their names.
        scenario: the scenario that they play.
        tuned_on: the scenario that the controllers are tuned for; None: the one that they play.

    Raises:
        ResultError: there is none of that name (says which there are), or it is not tuned for the scenario.
    """
    from baselines import catalogue  # reads the tuned values, which only playing needs

    known_oracles = {oracle.name: oracle for oracle in oracles(scenario)}
    known = [*catalogue.names(scenario), *known_oracles]
    if unknown := sorted(set(names or ()) - set(known)):
        raise ResultError(f"no policy is called {', '.join(unknown)}; there are {', '.join(known)}")
    chosen = dict.fromkeys(known if names is None else names)
    return [known_oracles[name] if name in known_oracles else rule(name, scenario, tuned_on) for name in chosen]


def rule(name: str, scenario: Scenario, tuned_on: Scenario | None = None) -> PolicySpec:
    """Return a controller: see ``named``.

    Raises:
        ResultError: there is none of that name, or it is not tuned for the scenario.
    """
    from baselines import catalogue

    try:
        return catalogue.spec(name, scenario, tuned_on)
    except (KeyError, ValueError) as error:
        raise ResultError(f"{name} cannot play: {error.args[0]}") from error


def agents(paths: Sequence[Path], scenario: Scenario) -> list[PolicySpec]:
    """Return the trained agents of ONNX files, which may come from anywhere, and of one's own training runs' folders.

    Raises:
        ResultError: a path holds no agent, or one that cannot play the scenario, or two hold the same algorithm with the same
            training seed.
    """
    specs: dict[str, PolicySpec] = {}
    for path in paths:
        spec = agent(path, scenario)
        if spec.label in specs:
            raise ResultError(f"{path} holds {spec.label}, which another of the given agents is too")
        specs[spec.label] = spec
    return list(specs.values())


def agent(path: Path, scenario: Scenario) -> PolicySpec:
    """Return the agent of an ONNX file or of a training run's folder: see ``agents``.

    Raises:
        ResultError: there is none, or it cannot play the scenario.
    """
    try:
        if path.suffix == ONNX_SUFFIX or (any(path.glob(f"*{ONNX_SUFFIX}")) and not (path / "run.json").exists()):
            from train.agents import onnx_policy

            spec = onnx_policy.load(path)
        else:
            from train.agents import run_folder  # imports torch, which takes seconds

            spec = run_folder.load(path)
        check_fits(spec, scenario)
    except (OSError, ValueError) as error:
        raise ResultError(f"no agent can be loaded from {path}: {error}") from error
    return spec


Attempt = Episodes | ResultError


def attempt(piece: tuple[PolicySpec, Scenario, Sequence[int]], on_step: Callable[[int], None] = lambda ended: None) -> Attempt:
    """Play a policy's episodes on some seeds of a scenario, or return why it cannot, so that others go on."""
    spec, scenario, seeds = piece
    try:
        return play_spec(spec, scenario, seeds, on_step)
    except ValueError as error:
        return ResultError(f"{spec.label} cannot play: {error}")


@dataclass(frozen=True)
class TaskRun:
    """The policies that play a task, and the folder of their results."""

    task: Task
    policies: Sequence[PolicySpec]
    folder: Path
    private: Sequence[int] | None = None
    """The seeds, if the task hides them."""

    @property
    def seeds(self) -> Sequence[int]:
        """Return the seeds that are played."""
        return self.task.seeds if self.private is None else self.private


class PoliciesFailed(ResultError):
    """Some policies could not play; the others have."""


def play_all(runs: Sequence[TaskRun], fresh: bool, over: Workers | None = None) -> None:
    """Have all policies of all runs play, and write each result as it is finished.

    Results in a run's folder of the same task and policy stand, unless ``fresh``. Then the trajectories of the policies on the
    first seeds of each run are recorded, and the folder's manifest is written.

    Args:
        runs: policies and their tasks.
        fresh: whether to play again if a result exists.
        over: processes or a cluster, each playing one policy on one task at a time; None: this process. Results are the same.

    Raises:
        PoliciesFailed: some policies cannot play; says which and why. All others have played.
        ResultError: a folder cannot be written to; it holds something unreadable, something that belongs in another, or
            agents of one name that differ in more than the training seed.
        WorkersError: the workers have gone, or do not run this version.
    """
    with ExitStack() as held:
        for each in runs:
            try:
                held.enter_context(shared_lock(each.folder))
            except OSError as error:
                raise ResultError(f"{each.folder} cannot be written: {error.strerror}") from error
        _play_all(runs, fresh, over)


def _play_all(runs: Sequence[TaskRun], fresh: bool, over: Workers | None) -> None:
    pieces: list[tuple[tuple[TaskRun, PolicySpec], tuple[PolicySpec, Scenario, Sequence[int]]]] = []
    for each in runs:  # check all folders before anything is played
        finished = _finished(each)
        for spec in each.policies:
            if fresh or spec.label not in finished:
                pieces.append(((each, spec), (spec, each.task.scenario, each.seeds)))
    total = sum(len(each.policies) * len(each.seeds) for each in runs)
    done = total - sum(len(piece[2]) for _, piece in pieces)
    # miniters=0 redraws the bar while no episode ends; disable=None keeps it quiet without a terminal.
    with tqdm(total=total, initial=done, unit="episode", miniters=0, dynamic_ncols=True, disable=None) as bar:

        def play_here(piece: tuple[PolicySpec, Scenario, Sequence[int]]) -> Attempt:
            def on_step(ended: int) -> None:
                bar.update(done + ended - bar.n)

            bar.set_description(piece[0].label)
            return attempt(piece, on_step)

        failed: dict[tuple[Path, str], ResultError] = {}
        for (each, spec), played in spread(over, attempt if over else play_here, pieces):
            if isinstance(played, ResultError):
                failed[each.folder, spec.label] = played
            else:
                write_result(Result.of(each.task, spec, played), each.folder)
            done += len(each.seeds)
            bar.update(done - bar.n)
    complaints = list(failed.values())
    for each in runs:
        able = [spec for spec in each.policies if (each.folder, spec.label) not in failed]
        if able and each.private is None:  # a trajectory would reveal its bars
            complaints += _record_trajectories(replace(each, policies=able), fresh, over)
        if able:
            with exclusive_lock(each.folder.parent, wait=True):
                write_manifest(each.folder, each.task)
    if complaints:
        raise PoliciesFailed("; ".join(map(str, complaints)))


def _finished(run: TaskRun) -> set[str]:
    """Return the labels of the results that stand; raise before anything is played if the ranking would fail."""
    probe = run.folder / "writable"
    write_whole(probe, "")
    probe.unlink(missing_ok=True)
    wanted = {result_path(run.folder, spec): spec for spec in run.policies}
    ranked = dict(wanted)
    finished = set()
    for path in result_files(run.folder):
        try:
            result = read_result(path)
        except ResultError as error:
            if path not in wanted:
                raise
            print(f"played again: {error}", file=sys.stderr)
            continue
        if result.task.digest == run.task.digest:
            ranked.setdefault(path, result.policy)
            if path in wanted and result.is_of(run.task, wanted[path]):
                finished.add(result.policy.label)
    check_names(list(ranked.values()))
    return finished


def _record_trajectories(run: TaskRun, fresh: bool, over: Workers | None) -> list[ResultError]:
    """Record missing trajectories of policies on the first seeds; return the errors of those that cannot play."""
    complaints = []
    path = run.folder / TRAJECTORIES_FILE
    before = None
    with suppress(ResultError):  # an unreadable file is recorded anew
        before = read_part(Trajectories, path)
    if fresh or before is None:
        path.unlink(missing_ok=True)
    wanted, trajectories = _recorded(run)
    # One training seed stands for an agent: the first given.
    able = {spec.name: spec for spec in reversed(run.policies) if spec.kind != "oracle"}
    missing = [place for place in wanted if place not in trajectories and place[0] in able]
    pieces = [((name, seed), (able[name], run.task.scenario, seed)) for name, seed in missing]
    try:
        with tqdm(total=len(pieces), unit="trajectory", dynamic_ncols=True, disable=None) as bar:
            for place, trajectory in spread(over, _trajectory, pieces):
                if isinstance(trajectory, ResultError):
                    complaints.append(trajectory)
                else:
                    trajectories[place] = trajectory
                bar.update()
    finally:  # keep what is finished, and what another run has recorded meanwhile
        with exclusive_lock(run.folder.parent, wait=True):
            wanted, recorded = _recorded(run)
            trajectories = recorded | trajectories
            episodes = [trajectories[place] for place in wanted if place in trajectories]
            after = Trajectories(task=run.task.digest, episodes=episodes)
            if not path.exists() or after != before:
                write_part(after, path)
    return complaints


def _recorded(run: TaskRun) -> tuple[list[tuple[str, int]], dict[tuple[str, int], Trajectory]]:
    """Return (policy and seed of each trajectory that the folder should hold, in their order; those that it holds)."""
    leaderboard = read_leaderboard(run.folder, run.task)
    episodes = leaderboard.trajectories.episodes if leaderboard.trajectories else []
    wanted = [(standing.name, seed) for standing in leaderboard.standings for seed in run.task.seeds[:RECORDED_SEEDS]]
    return wanted, {(episode.policy.name, episode.seed): episode for episode in episodes}


def _trajectory(piece: tuple[PolicySpec, Scenario, int]) -> Trajectory | ResultError:
    spec, scenario, seed = piece
    try:
        return record(spec, scenario, seed)
    except ValueError as error:
        return ResultError(f"{spec.label} cannot play seed {seed}: {error}")
