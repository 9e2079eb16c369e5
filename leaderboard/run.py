"""Play policies on tasks and write their results, each as it finishes.

Which policies play is the matter of ``leaderboard.policies``. How pieces of work are spread over
processes or a cluster belongs to ``leaderboard.workers``.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from baselines.comparators import CAUSAL, comparators
from baselines.policy_spec import PolicySpec
from leaderboard.notices import notify_once
from leaderboard.pieces import Attempt, Piece, attempt, failure, record_piece
from leaderboard.play import Episodes
from leaderboard.policies import is_code, is_of_another
from leaderboard.ranking import Leaderboard, read_if_usable, read_leaderboard
from leaderboard.result import (
    TRAJECTORIES_FILE,
    Result,
    ResultError,
    Task,
    read_results,
    write_manifest,
    write_part,
    write_result,
)
from leaderboard.seeds import held_out_seeds
from leaderboard.trajectories import MAX_RECORDED, RECORDED_SEEDS, Trajectories, Trajectory
from leaderboard.workers import Workers, spread
from turning_env.files import folder_lock, write_file
from turning_env.progress import Counter, progress

MIN_KEY = 16  # characters of a private key: who sees results must not find it by trying
MIN_DISTANCE = 1_000_000  # of private seeds from public ones: no key gives public seeds


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
    """Return the first ``count`` seeds that a key determines.

    Raise ResultError if the key has fewer than ``MIN_KEY`` characters.
    """
    if len(key) < MIN_KEY:
        raise ResultError(
            f"--private-key: the private key has {len(key)} characters, but must have at least "
            f"{MIN_KEY}"
        )
    digest = sha256(f"seeds {key}".encode()).digest()
    # 63 bits, so that a seed fits into 64 after the sum.
    distance = MIN_DISTANCE + (int.from_bytes(digest[:8]) >> 1)
    return [distance + seed for seed in held_out_seeds(count)]


class PoliciesFailedError(ResultError):
    """Some policies could not play; the others have."""

    def __init__(self, reasons: Sequence[ResultError]) -> None:
        super().__init__("\n".join(map(str, reasons)))
        self.reasons = reasons


def play_all(
    runs: Sequence[TaskRun], fresh: bool, over: Workers | None = None, *, replace: bool = False
) -> None:
    """Have all policies of all runs play, and write each result as it is finished.

    A policy that has a result on the task in the run's folder does not play again, unless ``fresh``
    or if the policy is the user's code, which may have changed. Then the trajectories of the
    policies on the first seeds of each run are recorded, and the folder's manifest is written.

    Args:
        runs: policies and their tasks.
        fresh: whether to play again if a result exists.
        over: processes or a cluster, each playing one policy on one task at a time; None: this
            process. Results are the same.
        replace: whether a policy may replace a result of the same name that another file, or other
            code, has. If not, the policy is refused.

    Raises:
        PoliciesFailedError: some policies cannot play, or are refused; the message says which and
            why. All others have played.
        WorkersError: the workers have gone, or do not run this version.
        OSError: a folder cannot be written to.
    """
    admitted_runs = []
    complaints: list[ResultError] = []
    for run in runs:
        admitted, refused = _admitted(run, replace)
        admitted_runs.append(admitted)
        complaints += refused

    failed = _play_missing(admitted_runs, fresh, over)
    complaints += failed.values()

    for run in admitted_runs:
        able = [policy for policy in run.policies if _Place(run.folder, policy.label) not in failed]
        if not able:
            continue
        # A trajectory would reveal private bars.
        if run.private is None:
            able_run = dataclasses.replace(run, policies=able)
            complaints += _record_trajectories(able_run, fresh, over)
        with folder_lock(run.folder, wait=True):
            write_manifest(run.folder, run.task)
    if complaints:
        raise PoliciesFailedError(complaints)


class _Place(NamedTuple):
    """The place of a policy's result."""

    folder: Path
    label: str


class _Tag(NamedTuple):
    """The run that a piece belongs to, and its policy."""

    run: TaskRun
    policy: PolicySpec


def _play_missing(
    runs: Sequence[TaskRun], fresh: bool, over: Workers | None
) -> dict[_Place, ResultError]:
    """Play what has no result yet and write the results; return why policies could not play."""
    pieces = _pieces(runs, fresh)
    total = sum(len(run.policies) * len(run.seeds) for run in runs)
    done = total - sum(len(piece.seeds) for _, piece in pieces)
    failed: dict[_Place, ResultError] = {}
    # miniters=0 redraws the bar while no episode ends.
    with progress(total=total, initial=done, unit="episode", miniters=0, dynamic_ncols=True) as bar:
        for tag, played in _attempts(pieces, over, bar):
            run, policy = tag
            result: Result | ResultError
            if isinstance(played, ResultError):
                result = played
            else:
                result = _result(run.task, policy, played)
            if isinstance(result, ResultError):
                failed[_Place(run.folder, policy.label)] = result
            else:
                # Another run may write into the folder, too.
                with folder_lock(run.folder, wait=True):
                    write_result(result, run.folder)
            done += len(run.seeds)
            bar.update(done - bar.n)
    return failed


def _attempts(
    pieces: Sequence[tuple[_Tag, Piece]], over: Workers | None, bar: "tqdm[Any]"
) -> Iterator[tuple[_Tag, Attempt]]:
    """Yield what each piece gives as it ends. In this process, the bar shows every episode."""
    if over is not None:
        yield from spread(over, attempt, pieces)
        return
    for tag, piece in pieces:
        bar.set_description_str(piece.policy.label)
        yield tag, attempt(piece, on_step=Counter(bar))


def _pieces(runs: Sequence[TaskRun], fresh: bool) -> list[tuple[_Tag, Piece]]:
    """Return what has no result yet, after a check of all folders: nothing is played in vain."""
    pieces = []
    for run in runs:
        finished = _finished(run)
        for policy in run.policies:
            if fresh or policy.label not in finished:
                piece = Piece(policy, run.task.scenario, run.seeds)
                pieces.append((_Tag(run, policy), piece))
    return pieces


def _result(task: Task, policy: PolicySpec, episodes: Episodes) -> Result | ResultError:
    """Return the result of episodes, or why they are none.

    A policy may drive the simulation to numbers that are not finite.
    """
    try:
        return Result.of(task, policy, episodes)
    except ValueError as error:
        return failure(policy, "has played, but its episodes are no result", error)


def _admitted(run: TaskRun, replace_others: bool) -> tuple[TaskRun, list[ResultError]]:
    """Return a run without the policies that are refused, and the reasons.

    A policy is refused if its result would take the place of another's.
    """
    present = read_results(run.folder)
    policies = []
    refused = []
    for policy in run.policies:
        result = present.get(policy.label)
        if result is None or not is_of_another(result.policy, policy):
            policies.append(policy)
            continue
        conflict = f"{policy.label} in {run.folder} is the result of another agent"
        if replace_others:
            notify_once(f"{conflict} and is replaced")
            policies.append(policy)
        else:
            advice = "--replace replaces it; --name, or another name of the file, keeps both"
            refused.append(ResultError(f"{conflict}: {advice}"))
    return dataclasses.replace(run, policies=policies), refused


def _finished(run: TaskRun) -> set[str]:
    """Return the labels of the run's policies that need not play: their results are up to date.

    Raises:
        OSError: the folder cannot be written to, so a result could not be stored.
        ResultError: the folder holds public results and the seeds are private, or the reverse.
    """
    with folder_lock(run.folder, wait=True):
        write_file(run.folder / "writable", "")
        (run.folder / "writable").unlink(missing_ok=True)
    policies = {policy.label: policy for policy in run.policies}
    finished = set()
    for label, result in read_results(run.folder).items():
        if label not in policies:
            continue
        if (result.task.private is None) != (run.task.private is None):
            present_seeds = "public" if run.private else "private"
            raise ResultError(
                f"{run.folder} holds {label} on {present_seeds} seeds: change --results"
            )
        # Code of one's own may have changed, so it plays again.
        if result.is_of(run.task, policies[label]) and not is_code(policies[label]):
            finished.add(label)
    return finished


class _Recording(NamedTuple):
    """The trajectory of a policy, by the name of its standing, on a seed."""

    name: str
    seed: int


@dataclass(frozen=True)
class _Recordings:
    """The trajectories that a folder should hold, in order, and those that it holds."""

    names: dict[str, str]  # names of standings by the policies' labels
    wanted: list[_Recording]
    present: dict[_Recording, Trajectory]


def _record_trajectories(run: TaskRun, fresh: bool, over: Workers | None) -> list[ResultError]:
    """Record missing trajectories of policies on the first seeds.

    Return the errors of those that cannot play.
    """
    recordings = _recordings(run)
    # The first training seed represents an agent: it comes last, and replaces the others.
    able = {recordings.names[policy.label]: policy for policy in reversed(run.policies)}
    pieces = []
    for recording in recordings.wanted:
        policy = able.get(recording.name)
        if policy is None:
            continue
        if fresh or recording not in recordings.present or is_code(policy):
            pieces.append((recording, Piece(policy, run.task.scenario, [recording.seed])))

    complaints = []
    trajectories = recordings.present
    try:
        with progress(total=len(pieces), unit="recording", dynamic_ncols=True) as bar:
            for recording, recorded in spread(over, record_piece, pieces):
                if isinstance(recorded, ResultError):
                    complaints.append(recorded)
                else:
                    trajectories[recording] = recorded
                bar.update()
    finally:
        # Keep what is finished, even if the rest fails.
        _write_trajectories(run, trajectories)
    return complaints


def _write_trajectories(run: TaskRun, trajectories: dict[_Recording, Trajectory]) -> None:
    """Write trajectories beside those that another run has recorded meanwhile."""
    path = run.folder / TRAJECTORIES_FILE
    with folder_lock(run.folder, wait=True):
        recordings = _recordings(run)
        merged = recordings.present | trajectories
        episodes = [merged[recording] for recording in recordings.wanted if recording in merged]
        file = Trajectories(task=run.task.digest, episodes=episodes)
        if read_if_usable(Trajectories, path) != file:
            write_part(file, path)


def _recordings(run: TaskRun) -> _Recordings:
    """Return the trajectories of a run's folder, by its present results."""
    leaderboard = read_leaderboard(run.folder, run.task)
    names = leaderboard.names
    wanted = []
    for name in _recorded_names(leaderboard):
        wanted += [_Recording(name, seed) for seed in run.task.seeds[:RECORDED_SEEDS]]
    present = {}
    if leaderboard.trajectories is not None:
        for trajectory in leaderboard.trajectories.episodes:
            name = names[trajectory.policy.label]
            present[_Recording(name, trajectory.seed)] = trajectory
    return _Recordings(names, wanted, present)


def _recorded_names(leaderboard: Leaderboard) -> list[str]:
    """Return the names of the standings whose trajectories a folder should hold, in order.

    On a family they include the oracle, whose trajectory shows how far the best rule could go.
    """
    task = leaderboard.task
    on_family = task.of_family is not None
    compared = comparators(task.scenario, on_family=on_family)
    always = {compared.fixed, compared.published}
    if on_family:
        always.add(CAUSAL)
    standings = leaderboard.standings
    ranked = [standing for standing in standings if standing.kind != "oracle"]
    if on_family:
        best = {standing.name for standing in ranked if standing.class_rank == 1}
    else:
        best = {standing.name for standing in ranked[:MAX_RECORDED]}
    recorded = best | always | {standing.name for standing in standings if standing.about.own}
    return [standing.name for standing in standings if standing.name in recorded]
