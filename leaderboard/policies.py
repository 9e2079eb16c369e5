"""The policies that play a task: controllers and oracles by name, agents' files, one's own code.

How agents play a family's jobs belongs to ``leaderboard.family``, and what names submitted agents
have to ``leaderboard.submissions``.
"""

import hashlib
import os
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from baselines import catalogue, tuned
from baselines.comparators import CAUSAL, NOMINAL_OPTIMUM, NOMINAL_SHARE
from baselines.oracles import clairvoyant, perfect_blanks, perfect_load, perfect_state
from baselines.policy_spec import Knowledge, PolicySpec, ScenarioId
from leaderboard import family
from leaderboard.adapt import as_factory
from leaderboard.agents import network, onnx_policy
from leaderboard.agents.agent_file import ONNX_SUFFIX, check_fits, informed
from leaderboard.agents.sandbox import LIMITS
from leaderboard.notices import notify_once
from leaderboard.play import EPISODE_FIELDS, Episodes, play
from leaderboard.result import ResultError, Task
from leaderboard.submissions import FileName, Submission, clashing_names, renamed, with_folder
from turning_env import Scenario
from turning_env.batch.driver import observation_space
from turning_env.console import printable
from turning_env.files import read_regular
from turning_env.policy import Policy
from turning_env.scenario.section import names_instead

CLAIRVOYANT = "clairvoyant"  # name of the bound
AGENTS = Path(__file__).parents[1] / "agents"
"""Agents that come with the project: one's own stand beside them under names of their own."""
SUMS = "SHA256SUMS"
"""File in the folder of agents that lists those of all training seeds.

Only one seed of each agent need be there.
"""
MAX_SUMS = 10_000_000  # bytes of that file
_LISTED = re.compile(r"(?P<digest>[0-9a-f]{64}) +\*?(?P<place>[\w.-]+/[\w.-]+/[\w.-]+\.onnx)")
"""A line of that file, as ``sha256sum`` writes it."""


def agent_files(folder: Path, complain: Callable[[str], None] = notify_once) -> dict[str, Path]:
    """Return the agents' files in a folder and those below it, by their SHA-256.

    Files that ``SUMS`` lists are among them, even if they are not there. ``complain`` receives the
    faults of files that are left out.
    """
    files = _listed_files(folder, complain)
    for path in sorted(folder.rglob(f"*{ONNX_SUFFIX}")):
        try:
            content = read_regular(path, network.MAX_BYTES)
        except OSError as error:
            complain(f"{path}: is left out, as it {error.strerror}")
        else:
            files[hashlib.sha256(content).hexdigest()] = path
    return files


def _listed_files(folder: Path, complain: Callable[[str], None]) -> dict[str, Path]:
    """Return the files that ``SUMS`` lists, by their SHA-256."""
    sums = folder / SUMS
    if not sums.exists():
        return {}
    try:
        lines = read_regular(sums, MAX_SUMS).decode().splitlines()
    except OSError as error:
        complain(f"{sums}: is left out, as it {error.strerror}")
        return {}
    except UnicodeDecodeError as error:
        complain(f"{sums}: is left out: {error}")
        return {}
    files = {}
    for number, line in enumerate(lines, start=1):
        listed = _LISTED.fullmatch(line)
        if listed is None or ".." in listed["place"].split("/"):
            complain(
                f"{sums}: line {number} is left out, as it is no SHA-256 and "
                f"ID/SCENARIO/NAME{ONNX_SUFFIX}"
            )
            continue
        files[listed["digest"]] = folder / listed["place"]
    return files


@cache
def shipped_agents() -> dict[str, str]:
    """Return the name of each agent that comes with the project, by its file's SHA-256."""
    return {
        digest: path.stem.rpartition("-seed")[0] for digest, path in agent_files(AGENTS).items()
    }


def is_external(policy: PolicySpec) -> bool:
    """Return whether a policy is an agent or code that does not come with the project."""
    return policy.kind == "agent" and policy.sha256 not in shipped_agents()


def is_code(policy: PolicySpec) -> bool:
    """Return whether it is a policy of one's own code, which may have changed since it played."""
    return policy.kind == "agent" and policy.sha256 is None


def oracles(scenario: Scenario) -> list[PolicySpec]:
    """Return the clairvoyant bound and the causal oracle of a scenario, as far as they cover it."""
    known = []
    for oracle_of in ORACLES.values():
        oracle = oracle_of(scenario)
        if oracle is not None:
            known.append(oracle)
    return known


def _clairvoyant(scenario: Scenario) -> PolicySpec | None:
    """Return the clairvoyant bound of a scenario; None if it does not cover the scenario."""
    if not clairvoyant.covers(scenario):
        return None
    grid = clairvoyant.GRID._asdict()
    return PolicySpec(
        name=CLAIRVOYANT,
        kind="oracle",
        description="bound: every bar known beforehand, nothing lags or breaks",
        parameters={name: float(value) for name, value in grid.items()},
        compute=_bound,
    )


def _causal(scenario: Scenario) -> PolicySpec | None:
    """Return the causal oracle of a scenario; None if there is none.

    It knows the state, but of the model mismatch no more than every policy.
    """
    nominal = scenario.nominal()
    if perfect_state.covers(scenario):
        return PolicySpec(
            name=CAUSAL,
            version=perfect_state.VERSION,
            kind="oracle",
            description="the optimiser with foresight, told the true depth, hardness and wear "
            "after every step",
            make=lambda num_envs: perfect_state.PerfectState(nominal, num_envs),
        )
    if perfect_load.covers(scenario):
        return PolicySpec(
            name=CAUSAL,
            version=perfect_load.VERSION,
            kind="oracle",
            description="the quickest feed that does not overshoot, told the true load, depth, "
            "hardness and wear after every step",
            make=lambda num_envs: perfect_load.PerfectLoad(nominal, num_envs),
        )
    if perfect_blanks.covers(scenario):
        return PolicySpec(
            name=CAUSAL,
            version=perfect_blanks.VERSION,
            kind="oracle",
            description="the cheapest plan of every part, told the true depth and hardness all "
            "along the blank, and the edge's wear and strength",
            compute=_play_blanks,
        )
    return None


ORACLES: dict[str, Callable[[Scenario], PolicySpec | None]] = {
    CLAIRVOYANT: _clairvoyant,
    CAUSAL: _causal,
}
"""What returns the oracle of a scenario, by the oracle's name."""


def _play_blanks(
    scenario: Scenario, seeds: Sequence[int], on_step: Callable[[int], None]
) -> Episodes:
    """Play one episode per seed with the oracle of whole parts, which is built from its seeds."""
    return play(
        lambda num_envs: perfect_blanks.PerfectBlanks(scenario, seeds),
        scenario,
        seeds,
        on_step,
        tell=True,
    )


def _bound(scenario: Scenario, seeds: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
    """Return the bound on each return; all other fields are 0, as no lathe can play it."""
    computed = count(1)
    returns = clairvoyant.bounds(scenario, seeds, on_seed=lambda: on_step(next(computed)))
    episodes = {name: np.zeros(len(seeds)) for name in EPISODE_FIELDS}
    return episodes | {"return": returns}


def named(
    names: Sequence[str] | None,
    task: Task,
    tuned_on: Scenario | None = None,
    skip: bool = False,
    knows: Knowledge = "nominal",
    forgets: bool = False,
) -> list[PolicySpec]:
    """Return controllers and oracles that play a task by name.

    Args:
        names: their names. None: all; on a family, ``leaderboard.family.POLICIES``.
        task: the task that they play.
        tuned_on: the scenario that the controllers are tuned for; None: the one that they play. A
            family's are tuned on its base.
        skip: whether to leave out controllers that are not tuned, with a notice on stderr.
        knows: what the controllers of a family are told beyond the nominal model.
        forgets: whether policies of a family forget everything at each change of the edge.

    Raises:
        ResultError: there is none of that name (the message lists the names), or it is not tuned
            for the scenario.
    """
    unknown = sorted(name for name in set(names or ()) if not _can_play(name, task))
    if unknown:
        known = _known_names(task)
        instead = names_instead(unknown[0], known, max_listed=len(known))
        raise ResultError(f"no policy is called {', '.join(unknown)}; {instead}")
    if names is None and task.of_family:
        is_variant = forgets or knows != "nominal"
        names = family.VARIED if is_variant else family.POLICIES
    elif names is None:
        names = _known_names(task)

    specs = []
    untuned = []
    for name in dict.fromkeys(names):
        try:
            specs.append(one_named(name, task, tuned_on, knows=knows, forgets=forgets))
        except ResultError as error:
            if not skip or not isinstance(error.__cause__, tuned.NotTuned):
                raise
            untuned.append(name)
    if untuned:
        home = tuned_on or task.scenario
        notify_once(
            f"skipped, as not tuned for scenario {home.name!r}: {', '.join(untuned)}; "
            f"`{tuned.command_of(untuned, home)}` tunes them"
        )
    return specs


def _can_play(name: str, task: Task) -> bool:
    """Return whether a controller or an oracle of this name can play a task."""
    scenario = task.scenario
    if task.of_family:
        jobs = family.family_of(task)
        if name in family.extra_names(jobs):
            return True
        scenario = jobs.job(0).scenario
    elif name in ORACLES:
        return ORACLES[name](scenario) is not None
    return name in catalogue.RULES and catalogue.RULES[name].plays(scenario)


def _known_names(task: Task) -> list[str]:
    """Return the names of all controllers and oracles that can play a task."""
    if task.of_family:
        jobs = family.family_of(task)
        return [*catalogue.names(jobs.job(0).scenario), *family.extra_names(jobs)]
    names = catalogue.names(task.scenario)
    return names + [oracle.name for oracle in oracles(task.scenario)]


def one_named(
    name: str,
    task: Task,
    tuned_on: Scenario | None = None,
    knows: Knowledge = "nominal",
    forgets: bool = False,
) -> PolicySpec:
    """Return the controller or the oracle of a name.

    Args:
        name: its name.
        task: the task that it plays.
        tuned_on: the scenario that a controller is tuned for; None: the task's.
        knows: what the controllers of a family are told beyond the nominal model.
        forgets: whether policies of a family forget everything at each change of the edge.

    Raises:
        ResultError: it cannot play. The cause is ``NotTuned`` if it is not tuned.
    """
    try:
        if task.of_family:
            return family.rule_on_family(name, task, knows=knows, forgets=forgets)
        if name in ORACLES:
            oracle = ORACLES[name](task.scenario)
            if oracle is not None:
                return oracle
        return catalogue.spec(name, task.scenario, tuned_on)
    except (KeyError, ValueError) as error:
        raise ResultError(f"{name} cannot play: {error.args[0]}") from error


Refusals = dict[Path, ResultError]
"""Paths of agents that do not play, and the reasons."""


def agents(
    paths: Sequence[Path],
    task: Task,
    name: str | None = None,
    keep: bool = True,
    seconds: int | None = None,
    refused: Refusals | None = None,
    forgets: bool = False,
) -> list[PolicySpec]:
    """Return the trained agents of ONNX files.

    Files may come from anywhere. Those that do not come with the project are named after their
    files: see ``leaderboard.submissions``.

    Args:
        paths: files, and folders with one file each.
        task: the task that they play.
        name: the name of those that do not come with the project; None: that of their files.
        keep: whether they may have the name of an agent that comes with the project; else
            ``my_`` is put before it.
        seconds: processor time that the agent of a file may use for all episodes [s]; None:
            ``leaderboard.agents.sandbox.LIMITS``.
        refused: agents that are left out; those that cannot play, for whatever reason, are added.
            None: raise the first reason.
        forgets: whether policies of a family forget everything at each change of the edge.

    Raises:
        ResultError: a path holds no agent, or one that cannot play the task; two have the same
            name and training seed; the name is that of another policy.
    """
    loaded = []
    for path in {os.path.abspath(path): path for path in paths}.values():
        if refused is not None and path in refused:
            continue
        try:
            spec = fitted(agent(path, seconds), task, forgets)
            policy = _under_ranked_name(spec, path, given=name, keep=keep)
            loaded.append(Submission(path=path, policy=policy))
        except ModuleNotFoundError:
            raise  # a package is not installed, which is the fault of no agent
        except Exception as error:
            # A stranger's file may lead to any error, and must not stop the others.
            if refused is None and not isinstance(error, OSError | ValueError):
                raise
            reason = f"no agent can be loaded from {printable(str(path))}: {reason_of(error)}"
            _refuse(path, reason, refused, error=error)
    return _distinct(loaded, name, refused)


def _under_ranked_name(spec: PolicySpec, path: Path, given: str | None, keep: bool) -> PolicySpec:
    """Return an agent under its name on the leaderboard.

    One that comes with the project keeps its name.

    Args:
        spec: the agent.
        path: its file or its folder.
        given: name that the user gives; None: that of the file or the training.
        keep: whether it may have the name of an agent that comes with the project.

    Raises:
        ValueError: it cannot have this name.
    """
    if not is_external(spec):
        return spec
    file = FileName.of(path, given)
    name = file.name
    if not keep:
        name = _free_name(path, name, given)
    elif given:
        name = given
    return renamed(spec, name, file.seed)


def _distinct(
    loaded: Sequence[Submission], name: str | None, refused: Refusals | None
) -> list[PolicySpec]:
    """Return the agents that have labels of their own; refuse the others.

    If agents share a name and ``name`` is None, the folder's name is put before it. If agents still
    share a label, all but the first are refused, see ``agents``.
    """
    clashing = clashing_names(loaded) if name is None else set()
    by_label: dict[str, Submission] = {}
    for submission in loaded:
        try:
            if submission.policy.name in clashing and is_external(submission.policy):
                submission = with_folder(submission)
            policy = submission.policy
            first = by_label.setdefault(policy.label, submission)
            # The same file of the project may be given twice.
            is_other = is_external(policy) or first.policy.sha256 != policy.sha256
            if first is not submission and is_other:
                raise ValueError(
                    f"{printable(str(first.path))} is {policy.label} too: rename one, or play each "
                    "with a --name"
                )
        except ValueError as error:
            reason = f"{printable(str(submission.path))} is refused: {error}"
            _refuse(submission.path, reason, refused, error=error)
    return [submission.policy for submission in by_label.values()]


def _refuse(path: Path, reason: str, refused: Refusals | None, error: Exception) -> None:
    """Add an agent to those that are refused, with a notice on stderr.

    Raise ResultError if they are not collected.
    """
    complaint = ResultError(reason)
    if refused is None:
        raise complaint from error
    refused[path] = complaint
    notify_once(f"refused: {complaint}")


def reason_of(error: Exception) -> str:
    """Return an error's message for a list of refusals, in one line.

    It includes the error's type unless the message explains itself.
    """
    if isinstance(error, OSError) and error.filename is not None:
        message = str(error.strerror)
    elif isinstance(error, OSError | ValueError):
        message = str(error)
    else:
        message = f"{type(error).__name__}: {error}"
    return printable(message)


def is_of_another(present: PolicySpec, new: PolicySpec) -> bool:
    """Return whether a result of the same label is that of another file or other code.

    A new result must not replace it.
    """
    if present.kind != "agent" and new.kind != "agent":
        return False  # versions of one rule
    if is_code(present) and is_code(new):
        return present.command != new.command
    return present.sha256 != new.sha256


def agent(path: Path, seconds: int | None = None) -> PolicySpec:
    """Return the agent of an ONNX file, or of a folder with one.

    Raise ValueError if there is none (``AgentTimeoutError`` if it gives no actions in time).
    """
    return onnx_policy.load(path, replace(LIMITS, computing=seconds or LIMITS.computing))


def fitted(spec: PolicySpec, task: Task, forgets: bool = False) -> PolicySpec:
    """Return an agent, or a policy of one's own code, as it plays a task.

    Raise ValueError if it cannot play it.
    """
    if task.of_family:
        return family.agent_on_family(spec, task, forgets)
    check_fits(spec, task.scenario)
    return spec.model_copy(update={"make": informed(spec, task.scenario)})


def policy_of_code(source: str, task: Task, name: str | None = None) -> PolicySpec:
    """Return the policy of a user's code, ``module:object``.

    See ``leaderboard.adapt.as_factory``. It ranks among the agents, without a digest, as
    versions of the code cannot be distinguished. Without a ``name``, it has the object's. Raise
    ResultError if there is no such policy, or another policy has its name.
    """
    context_size = len(family.family_of(task).context_names) if task.of_family else 0
    space: Any = observation_space(task.scenario, context_size)

    def make(num_envs: int) -> Policy:
        # A class is instantiated for every play.
        return as_factory(source, space=space)(num_envs)

    try:
        as_factory(source, space=space)  # refuses now what could not be played later
        spec = PolicySpec(
            name=_free_name(source, re.split("[:.]", source)[-1], name),
            kind="agent",
            description="a policy of your own",
            training_seed=0,  # every agent has one; that of this code is unknown
            command=source,
            tuned_for=ScenarioId.of(task.scenario),
            make=make,
        )
        return fitted(spec, task)
    except (OSError, TypeError, ValueError) as error:
        raise ResultError(f"{source} cannot play: {error}") from error


def _free_name(source: object, name: str, given: str | None) -> str:
    """Return a name for a policy of the user's that no policy of the project has.

    Args:
        source: the policy's file or code, for messages.
        name: its name, which gets the prefix ``my_`` if a policy of the project has it.
        given: the name that the user gives; None: ``name``.

    Raises:
        ResultError: a policy of the project has the given name.
    """
    project_names = {*shipped_agents().values(), *catalogue.RULES}
    project_names |= {CLAIRVOYANT, CAUSAL, NOMINAL_OPTIMUM, NOMINAL_SHARE, family.KNOWN_FORMS}
    free_name = given or (f"my_{name}" if name in project_names else name)
    if free_name in project_names:
        raise ResultError(
            f"{source} cannot be called {free_name}, as another policy is: choose another --name"
        )
    if given is None and free_name != name:
        notify_once(
            f"{source} plays as {free_name}, as {name} comes with the project; --name gives it "
            "another name"
        )
    return free_name
