"""Play policies on a task and write their results, each as it finishes."""

import traceback
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

from tqdm import tqdm

from leaderboard.notices import notify_once
from leaderboard.policies import is_code, is_of_another, reason_of
from leaderboard.ranking import read_if_usable, read_leaderboard
from leaderboard.result import (
    TRAJECTORIES_FILE,
    Result,
    ResultError,
    Task,
    read_results,
    write_manifest,
    write_part,
    write_result,
    write_whole,
)
from leaderboard.standings import comparators
from leaderboard.trajectories import MAX_RECORDED, RECORDED_SEEDS, Trajectories, Trajectory, record
from turning_env import Scenario
from turning_env.console import printable
from turning_env.files import folder_lock
from turning_env.scoring.play import Episodes, play
from turning_env.scoring.policy import PolicySpec
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.workers import Workers, spread

Attempt = Episodes | ResultError
MIN_KEY = (
    16  # least number of characters of a private key: who sees results must not find it by trying
)


def attempt(
    piece: tuple[PolicySpec, Scenario, Sequence[int]],
    on_step: Callable[[int], None] = lambda ended: None,
) -> Attempt:
    """Play a policy's episodes on some seeds of a scenario, or return why it cannot, so that others go on."""
    spec, scenario, seeds = piece
    try:
        if spec.compute is not None:
            return dict(spec.compute(scenario, seeds, on_step))
        return play(spec.make, scenario, seeds, on_step, tell=spec.kind == "oracle")
    except Exception as error:
        return _failure(spec, "cannot play", error)


def _failure(spec: PolicySpec, what: str, error: Exception) -> ResultError:
    """Return why a policy has failed. Raise the error if it is a fault of the project: of a rule, other than a ValueError."""
    if isinstance(error, ValueError):
        return ResultError(f"{spec.label} {what}: {printable(str(error))}")
    if spec.kind != "agent":
        raise error
    # An agent, or a policy of one's own code, may raise anything, and must not stop the others.
    place = traceback.extract_tb(error.__traceback__)[-1]
    return ResultError(
        f"{spec.label} {what}: {reason_of(error)} ({place.filename}, line {place.lineno})"
    )


@dataclass(frozen=True)
class TaskRun:
    """The policies that play a task, and the folder of their results."""

    task: Task
    policies: Sequence[PolicySpec]
    folder: Path
    private: Sequence[int] | None = None  # the seeds, if the task hides them

    @property
    def seeds(self) -> Sequence[int]:
        """Return the seeds that are played."""
        return self.task.seeds if self.private is None else self.private


def private_seeds(key: str, count: int) -> list[int]:
    """Return the first ``count`` seeds that a key of at least 16 characters determines; its owner knows them."""
    if len(key) < MIN_KEY:
        raise ResultError(
            f"--private-key: the private key has {len(key)} characters, but must have at least {MIN_KEY}"
        )
    first = 1_000_000 + (int.from_bytes(sha256(f"seeds {key}".encode()).digest()[:8]) >> 1)
    return [first + seed for seed in held_out_seeds(count)]


class PoliciesFailed(ResultError):
    """Some policies could not play; the others have."""

    def __init__(self, reasons: Sequence[ResultError]) -> None:
        super().__init__("\n".join(map(str, reasons)))
        self.reasons = reasons


def play_all(
    runs: Sequence[TaskRun], fresh: bool, over: Workers | None = None, *, replace: bool = False
) -> None:
    """Have all policies of all runs play, and write each result as it is finished.

    Results in a run's folder of the same task and policy stand, unless ``fresh``; those of own code do not. Then the
    trajectories of the policies on the first seeds of each run are recorded, and the folder's manifest is written.

    Args:
        runs: policies and their tasks.
        fresh: whether to play again if a result exists.
        over: processes or a cluster, each playing one policy on one task at a time; None: this process. Results are the same.
        replace: whether the result of another file, or of other code, of the same name makes way. If not, it stands, and the
            policy is refused.

    Raises:
        PoliciesFailed: some policies cannot play, or are refused; says which and why. All others have played.
        WorkersError: the workers have gone, or do not run this version.
        OSError: a folder cannot be written to.
    """
    with ExitStack() as held:
        for each in runs:
            held.enter_context(folder_lock(each.folder, shared=True))
        _play_all(runs, fresh, over, replace)


def _play_all(
    asked: Sequence[TaskRun], fresh: bool, over: Workers | None, replace_others: bool
) -> None:
    runs, complaints = [], list[ResultError]()
    for each in asked:
        admitted, refused = _admitted(each, replace_others)
        runs.append(admitted)
        complaints += refused
    pieces: list[tuple[tuple[TaskRun, PolicySpec], tuple[PolicySpec, Scenario, Sequence[int]]]] = []
    for each in runs:  # check all folders before anything is played
        finished = _finished(each)
        for spec in each.policies:
            if fresh or spec.label not in finished:
                pieces.append(((each, spec), (spec, each.task.scenario, each.seeds)))
    total = sum(len(each.policies) * len(each.seeds) for each in runs)
    done = total - sum(len(piece[2]) for _, piece in pieces)
    # miniters=0 redraws the bar while no episode ends; disable=None keeps it quiet without a terminal.
    with tqdm(
        total=total, initial=done, unit="episode", miniters=0, dynamic_ncols=True, disable=None
    ) as bar:

        def play_here(piece: tuple[PolicySpec, Scenario, Sequence[int]]) -> Attempt:
            def on_step(ended: int) -> None:
                bar.update(done + ended - bar.n)

            bar.set_description(piece[0].label)
            return attempt(piece, on_step)

        failed: dict[tuple[Path, str], ResultError] = {}
        for (each, spec), played in spread(over, attempt if over else play_here, pieces):
            result = played if isinstance(played, ResultError) else _result(each.task, spec, played)
            if isinstance(result, ResultError):
                failed[each.folder, spec.label] = result
            else:
                write_result(result, each.folder)
            done += len(each.seeds)
            bar.update(done - bar.n)
    complaints += failed.values()
    for each in runs:
        able = [spec for spec in each.policies if (each.folder, spec.label) not in failed]
        if (
            able and each.private is None and not each.task.of_family
        ):  # a trajectory would reveal private bars
            complaints += _record_trajectories(replace(each, policies=able), fresh, over)
        if able:
            with folder_lock(each.folder.parent, wait=True):
                write_manifest(each.folder, each.task)
    if complaints:
        raise PoliciesFailed(complaints)


def _result(task: Task, spec: PolicySpec, episodes: Episodes) -> Result | ResultError:
    """Return the result of episodes, or why they are none: a policy may drive the simulation to numbers that are not finite."""
    try:
        return Result.of(task, spec, episodes)
    except ValueError as error:
        return _failure(spec, "has played, but its episodes are no result", error)


def _admitted(run: TaskRun, replace_others: bool) -> tuple[TaskRun, list[ResultError]]:
    """Return a run without the policies whose result would take the place of another's, and the reasons."""
    present = read_results(run.folder)
    policies, refused = [], []
    for spec in run.policies:
        other = present.get(spec.label)
        if other is None or not is_of_another(other.policy, spec):
            policies.append(spec)
        elif replace_others:
            notify_once(
                f"{spec.label} in {run.folder} is the result of another agent, which makes way"
            )
            policies.append(spec)
        else:
            reason = f"{spec.label} in {run.folder} is the result of another agent, which stands: --replace lets this one take "
            refused.append(
                ResultError(f"{reason}its place; --name, or another name of the file, keeps both")
            )
    return replace(run, policies=policies), refused


def _finished(run: TaskRun) -> set[str]:
    """Return the labels of the results that stand; a folder that cannot be written to is an error before anything is played."""
    write_whole(run.folder / "writable", "")
    (run.folder / "writable").unlink(missing_ok=True)
    wanted, finished = {spec.label: spec for spec in run.policies}, set()
    for result in read_results(run.folder).values():
        spec = wanted.get(result.policy.label)
        if spec is None:
            continue
        if (result.task.private is None) != (run.task.private is None):
            whose = "public" if run.private else "private"
            raise ResultError(f"{run.folder} holds {spec.label} on {whose} seeds: change --results")
        if result.task.digest != run.task.digest:
            continue
        if result.is_of(run.task, spec):
            finished |= {spec.label} if not is_code(spec) else set()
    return finished


def _record_trajectories(run: TaskRun, fresh: bool, over: Workers | None) -> list[ResultError]:
    """Record missing trajectories of policies on the first seeds; return the errors of those that cannot play."""
    complaints = []
    names, wanted, trajectories = _recorded(run)
    # The first training seed represents an agent.
    able = {names[spec.label]: spec for spec in reversed(run.policies) if spec.kind != "oracle"}
    missing = [
        place
        for place in wanted
        if place[0] in able and (fresh or place not in trajectories or is_code(able[place[0]]))
    ]
    pieces = [(place, (able[place[0]], run.task.scenario, place[1])) for place in missing]
    try:
        with tqdm(total=len(missing), unit="trajectory", dynamic_ncols=True, disable=None) as bar:
            for place, recorded in spread(over, _trajectory, pieces):
                if isinstance(recorded, ResultError):
                    complaints.append(recorded)
                else:
                    trajectories[place] = recorded
                bar.update()
    finally:  # keep what is finished, and what another run has recorded meanwhile
        with folder_lock(run.folder.parent, wait=True):
            _, wanted, recorded_before = _recorded(run)
            trajectories = recorded_before | trajectories
            episodes = [trajectories[place] for place in wanted if place in trajectories]
            after = Trajectories(task=run.task.digest, episodes=episodes)
            if read_if_usable(Trajectories, run.folder / TRAJECTORIES_FILE) != after:
                write_part(after, run.folder / TRAJECTORIES_FILE)
    return complaints


def _recorded(
    run: TaskRun,
) -> tuple[dict[str, str], list[tuple[str, int]], dict[tuple[str, int], Trajectory]]:
    """Return (names of standings; policy and seed of each trajectory that the folder should hold; those that it holds)."""
    leaderboard = read_leaderboard(run.folder, run.task)
    names, episodes = (
        leaderboard.names,
        leaderboard.trajectories.episodes if leaderboard.trajectories else [],
    )
    compared, ranked = (
        comparators(run.task.scenario),
        [each for each in leaderboard.standings if each.kind != "oracle"],
    )
    always = {each.name for each in ranked if each.own} | {compared.fixed, compared.published}
    chosen = [
        each.name
        for place, each in enumerate(ranked)
        if place < MAX_RECORDED or each.name in always
    ]
    wanted = [(name, seed) for name in chosen for seed in run.task.seeds[:RECORDED_SEEDS]]
    return (
        names,
        wanted,
        {(names[episode.policy.label], episode.seed): episode for episode in episodes},
    )


def _trajectory(piece: tuple[PolicySpec, Scenario, int]) -> Trajectory | ResultError:
    """Record one episode, or return why the policy cannot play it."""
    spec, scenario, seed = piece
    try:
        return record(spec, scenario, seed)
    except Exception as error:
        return _failure(spec, f"cannot play seed {seed}", error)
