"""Play policies on a task and write their results, each as it finishes."""

import re
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from tqdm import tqdm

from leaderboard import shipped
from leaderboard.oracles import oracles
from leaderboard.ranking import read_if_usable, read_leaderboard, read_trainings
from leaderboard.result import (
    TRAJECTORIES_FILE,
    Result,
    ResultError,
    Task,
    read_results,
    tell_once,
    write_manifest,
    write_part,
    write_result,
    write_whole,
)
from leaderboard.standings import CAUSAL, CLAIRVOYANT
from leaderboard.trajectories import RECORDED_SEEDS, Trajectories, Trajectory, record
from train.agents import onnx_policy
from train.agents.agent_file import ONNX_SUFFIX, check_fits
from train.agents.onnx_policy import LIMITS, TooSlow
from train.learning_curves import FILE, Training, Trainings
from train.run import Run
from turning_env import Scenario
from turning_env.files import digest_of_files, exclusive_lock, shared_lock
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.play import Episodes, play_spec
from turning_env.scoring.policy import PolicySpec, ScenarioId
from turning_env.scoring.workers import Workers, spread


def named(
    names: Sequence[str] | None,
    scenario: Scenario,
    tuned_on: Scenario | None = None,
    skip: bool = False,
) -> list[PolicySpec]:
    """Return controllers and oracles of a scenario by name, all of them if ``names`` is None.

    Args:
        names: their names.
        scenario: the scenario that they play.
        tuned_on: the scenario that the controllers are tuned for; None: the one that they play.
        skip: whether to leave out controllers that are not tuned, with a word on standard error.

    Raises:
        ResultError: there is none of that name (says which there are), or it is not tuned for the scenario.
    """
    from baselines import catalogue, tuned  # only playing needs them

    known_oracles = {oracle.name: oracle for oracle in oracles(scenario)}
    known = [*catalogue.names(scenario), *known_oracles]
    if unknown := sorted(set(names or ()) - set(known)):
        raise ResultError(f"no policy is called {', '.join(unknown)}; there are {', '.join(known)}")
    specs, untuned = [], []
    for name in dict.fromkeys(known if names is None else names):
        try:
            specs.append(known_oracles[name] if name in known_oracles else rule(name, scenario, tuned_on))
        except NotTunedError:
            if not skip:
                raise
            untuned.append(name)
    if untuned:
        home = tuned_on or scenario
        tell_once(f"skipped, as not tuned for scenario {home.name!r}: {', '.join(untuned)}; `{tuned.command(home)}` tunes them")
    return specs


class NotTunedError(ResultError):
    """A controller is not tuned for the scenario."""


def rule(name: str, scenario: Scenario, tuned_on: Scenario | None = None) -> PolicySpec:
    """Return a controller: see ``named``.

    Raises:
        NotTunedError: it is not tuned for the scenario.
        ResultError: there is none of that name, or it cannot play the scenario.
    """
    from baselines import catalogue, tuned

    try:
        return catalogue.spec(name, scenario, tuned_on)
    except tuned.NotTuned as error:
        raise NotTunedError(f"{name} cannot play: {error}") from error
    except (KeyError, ValueError) as error:
        raise ResultError(f"{name} cannot play: {error.args[0]}") from error


def agents(
    paths: Sequence[Path],
    scenario: Scenario,
    name: str | None = None,
    keep: bool = True,
    seconds: int | None = None,
    too_slow: dict[Path, ResultError] | None = None,
) -> list[PolicySpec]:
    """Return the trained agents of ONNX files, which may come from anywhere, and of one's own training runs' folders.

    Args:
        paths: files and folders.
        scenario: what they play.
        name: the name of those that do not come with the project; None: what their files say.
        keep: whether they may have the name of an agent that comes with the project; else ``my_`` is put before it.
        seconds: processor time that the agent of a file may use for all episodes [s]; None: ``train.agents.onnx_policy.LIMITS``.
        too_slow: files that give no actions in time, which are left out; those that are found are added. None: raise.

    Raises:
        AgentTooSlow: a file gives no actions in time.
        ResultError: a path holds no agent, or one that cannot play the scenario; two have the same name and training seed; the
            name is that of another policy.
    """
    specs: dict[str, PolicySpec] = {}
    for path in (each for each in paths if each not in (too_slow or {})):
        try:
            spec = agent(path, scenario, seconds)
        except AgentTooSlow as error:
            if too_slow is None:
                raise
            too_slow[path] = error
            continue
        if shipped.is_own(spec) and not keep:
            spec = PolicySpec.model_validate(dict(spec) | {"name": _own_name(path, spec.name, name)})
        if spec.label in specs:
            raise ResultError(
                f"{path} holds {spec.label}, which another of the given agents is too: play one after the other, each with a "
                "--name of its own, or export it again by python -m train.export --name"
            )
        specs[spec.label] = spec
    return list(specs.values())


def _own_name(source: object, found: str, given: str | None) -> str:
    """Return the name of one's own policy: the given one, else its own, after ``my_`` if a shipped agent has that."""
    from baselines import catalogue

    taken = shipped.agents().values()
    name = given or (f"my_{found}" if found in taken else found)
    if name in (*taken, *catalogue.RULES, CLAIRVOYANT, CAUSAL):
        raise ResultError(f"{source} cannot be called {name}, as another policy is: choose another --name")
    if given is None and name != found:
        tell_once(f"{source} plays as {name}, as {found} comes with the project; --name gives it another name")
    return name


def own_policy(source: str, tuned_for: Scenario, name: str | None = None) -> PolicySpec:
    """Return a policy of one's own code, ``module:object``: see ``turning_env.scoring.adapt.as_factory``.

    It stands among the agents, without a digest, as nothing tells one version of the code from the next.

    Args:
        source: the module and the object.
        tuned_for: the scenario that it is made for.
        name: its name; None: that of the object.

    Raises:
        ResultError: there is no such object, it is no policy, or another policy has its name.
    """
    try:
        as_factory(source)
        return PolicySpec(
            name=_own_name(source, re.split("[:.]", source)[-1], name),
            kind="agent",
            description="a policy of your own",
            training_seed=0,
            command=source,
            tuned_for=ScenarioId.of(tuned_for),
            make=lambda num_envs: as_factory(source)(num_envs),  # a class is instantiated for every play
        )
    except (OSError, TypeError, ValueError) as error:
        raise ResultError(f"{source} cannot play: {error}") from error


def _is_code(spec: PolicySpec) -> bool:
    """Return whether it is a policy of one's own code, which may have changed since it played."""
    return spec.kind == "agent" and spec.sha256 is None


class AgentTooSlow(ResultError):
    """An agent's file gives no actions in time."""


def agent(path: Path, scenario: Scenario, seconds: int | None = None) -> PolicySpec:
    """Return the agent of an ONNX file or of a training run's folder: see ``agents``.

    Raises:
        AgentTooSlow: it gives no actions in time.
        ResultError: there is none, or it cannot play the scenario.
    """
    try:
        spec = agent_spec(path, seconds)
        check_fits(spec, scenario)
    except TooSlow as error:
        raise AgentTooSlow(f"skipped: {error}") from error
    except (OSError, ValueError) as error:
        raise ResultError(f"no agent can be loaded from {path}: {error}") from error
    return spec


def agent_spec(path: Path, seconds: int | None = None) -> PolicySpec:
    """Return the agent of an ONNX file or of a training run's folder, whatever it can play: see ``agents``.

    Raises:
        OSError, ValueError: there is none, or it gives no actions in time.
    """
    if path.suffix == ONNX_SUFFIX or (any(path.glob(f"*{ONNX_SUFFIX}")) and not (path / "run.json").exists()):
        return onnx_policy.load(path, replace(LIMITS, computing=seconds or LIMITS.computing))
    from train.training import load_agent  # imports torch, which takes seconds

    return load_agent(path)


Attempt = Episodes | ResultError


def attempt(piece: tuple[PolicySpec, Scenario, Sequence[int]], on_step: Callable[[int], None] = lambda ended: None) -> Attempt:
    """Play a policy's episodes on some seeds of a scenario, or return why it cannot, so that others go on."""
    spec, scenario, seeds = piece
    try:
        check_fits(spec, scenario)
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

    Results in a run's folder of the same task and policy stand, unless ``fresh``; those of own code do not. Then the
    trajectories of the policies on the first seeds of each run are recorded, and the folder's manifest is written.

    Args:
        runs: policies and their tasks.
        fresh: whether to play again if a result exists.
        over: processes or a cluster, each playing one policy on one task at a time; None: this process. Results are the same.

    Raises:
        PoliciesFailed: some policies cannot play; says which and why. All others have played.
        WorkersError: the workers have gone, or do not run this version.
        OSError: a folder cannot be written to.
    """
    with ExitStack() as held:
        for each in runs:
            held.enter_context(shared_lock(each.folder))
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
    """Return the labels of the results that stand; a folder that cannot be written to is an error before anything is played."""
    write_whole(run.folder / "writable", "")
    (run.folder / "writable").unlink(missing_ok=True)
    wanted, finished = {spec.label: spec for spec in run.policies}, set()
    for result in read_results(run.folder).values():
        spec = wanted.get(result.policy.label)
        if spec is None or result.task.digest != run.task.digest:
            continue
        if result.is_of(run.task, spec):
            finished |= {spec.label} if not _is_code(spec) else set()
        elif spec.kind == "agent":
            tell_once(f"{spec.label} in {run.folder} is the result of another agent, which makes way; --name keeps both")
    return finished


def write_learning_curves(run: TaskRun, paths: Sequence[Path]) -> None:
    """Write the learning curves of agents that were given as folders of training runs, if they were trained on the run's task."""
    played, learned = {spec.sha256: spec.label for spec in run.policies if spec.kind == "agent"}, dict[str, Training]()
    for training in (Run.read(path) for path in paths if (path / "run.json").exists()):
        label = played.get(digest_of_files(training.folder, training.folder.rglob("*")))
        if label and (training.env_id, training.scenario) == (run.task.env_id, run.task.scenario):
            try:
                learned[label] = Training.of(training)
            except ValueError as error:
                tell_once(f"no learning curve: {error}")
    with exclusive_lock(run.folder.parent, wait=True):
        before = read_trainings(run.folder, run.task)
        after = {label: each for label, each in before.items() if label not in played.values()} | learned
        if after != before:
            Trainings(env_id=run.task.env_id, scenario=ScenarioId.of(run.task.scenario), trainings=after).write(run.folder / FILE)


def _record_trajectories(run: TaskRun, fresh: bool, over: Workers | None) -> list[ResultError]:
    """Record missing trajectories of policies on the first seeds; return the errors of those that cannot play."""
    complaints = []
    names, wanted, trajectories = _recorded(run)
    # One training seed stands for an agent: the first given.
    able = {names[spec.label]: spec for spec in reversed(run.policies) if spec.kind != "oracle"}
    missing = [place for place in wanted if place[0] in able and (fresh or place not in trajectories or _is_code(able[place[0]]))]
    seeds: dict[str, list[int]] = {}
    for name, seed in missing:
        seeds.setdefault(name, []).append(seed)
    pieces = [(name, (able[name], run.task.scenario, its)) for name, its in seeds.items()]
    try:
        with tqdm(total=len(missing), unit="trajectory", dynamic_ncols=True, disable=None) as bar:
            for name, recorded in spread(over, _trajectories, pieces):
                trajectories |= {(name, each.seed): each for each in recorded if isinstance(each, Trajectory)}
                complaints += [each for each in recorded if isinstance(each, ResultError)]
                bar.update(len(seeds[name]))
    finally:  # keep what is finished, and what another run has recorded meanwhile
        with exclusive_lock(run.folder.parent, wait=True):
            _, wanted, recorded_before = _recorded(run)
            trajectories = recorded_before | trajectories
            episodes = [trajectories[place] for place in wanted if place in trajectories]
            after = Trajectories(task=run.task.digest, episodes=episodes)
            if read_if_usable(Trajectories, run.folder / TRAJECTORIES_FILE) != after:
                write_part(after, run.folder / TRAJECTORIES_FILE)
    return complaints


def _recorded(run: TaskRun) -> tuple[dict[str, str], list[tuple[str, int]], dict[tuple[str, int], Trajectory]]:
    """Return (names of standings; policy and seed of each trajectory that the folder should hold; those that it holds)."""
    leaderboard = read_leaderboard(run.folder, run.task)
    names, episodes = leaderboard.names, leaderboard.trajectories.episodes if leaderboard.trajectories else []
    wanted = [(standing.name, seed) for standing in leaderboard.standings for seed in run.task.seeds[:RECORDED_SEEDS]]
    return names, wanted, {(names[episode.policy.label], episode.seed): episode for episode in episodes}


def _trajectories(piece: tuple[PolicySpec, Scenario, Sequence[int]]) -> list[Trajectory | ResultError]:
    """Record one episode per seed, or why the policy cannot play it: no further one is tried."""
    spec, scenario, seeds = piece
    recorded = list[Trajectory | ResultError]()
    try:
        with onnx_policy.in_one_process(spec.make, len(seeds)) as make:
            for seed in seeds:
                recorded.append(record(spec, scenario, seed, make))
    except ValueError as error:
        recorded.append(ResultError(f"{spec.label} cannot play seed {seeds[len(recorded)]}: {error}"))
    return recorded
