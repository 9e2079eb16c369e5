"""The policies that play a task: controllers and oracles by name, agents' files, and one's own code."""

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path

import numpy as np

from baselines import catalogue, tuned
from baselines.oracles import clairvoyant, perfect_state
from leaderboard import family
from leaderboard.family import CAUSAL, NOMINAL_OPTIMUM
from leaderboard.result import ResultError, Task, tell_once
from train.agents import onnx_policy
from train.agents.agent_file import ONNX_SUFFIX, check_fits, informed
from train.agents.onnx_policy import LIMITS, TooSlow
from turning_env import Scenario
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.play import EPISODE_FIELDS, Episodes
from turning_env.scoring.policy import PolicySpec, ScenarioId

CLAIRVOYANT = "clairvoyant"  # name of the bound
AGENTS = Path(__file__).parents[1] / "agents"
"""Agents that come with the project: one's own stand beside them under names of their own."""
SUMS = "SHA256SUMS"
"""File in the folder of agents that lists those of all training seeds; only one seed of each need be there."""


def agent_files(folder: Path) -> dict[str, Path]:
    """Return the agents' files in a folder and those below it, by their SHA-256; also those of ``SUMS`` that are not there."""
    sums = folder / SUMS
    listed = (line.split(maxsplit=1) for line in (sums.read_text("utf-8").splitlines() if sums.exists() else ()))
    found = {hashlib.sha256(path.read_bytes()).hexdigest(): path for path in sorted(folder.rglob(f"*{ONNX_SUFFIX}"))}
    return {digest: folder / place for digest, place in listed} | found


@cache
def shipped_agents() -> dict[str, str]:
    """Return the name of each agent that comes with the project, by its file's SHA-256."""
    return {digest: path.stem.rpartition("-seed")[0] for digest, path in agent_files(AGENTS).items()}


def is_own(policy: PolicySpec) -> bool:
    """Return whether a policy is an agent or code that does not come with the project."""
    return policy.kind == "agent" and policy.sha256 not in shipped_agents()


def is_code(policy: PolicySpec) -> bool:
    """Return whether it is a policy of one's own code, which may have changed since it played."""
    return policy.kind == "agent" and policy.sha256 is None


def oracles(scenario: Scenario) -> list[PolicySpec]:
    """Return the clairvoyant bound and the causal oracle of a scenario, as far as they cover it."""

    def bound(scenario: Scenario, seeds: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
        """Return the bound on each return; all other fields are 0, as no lathe can play it."""
        played = count(1)
        returns = clairvoyant.bounds(scenario, seeds, on_seed=lambda: on_step(next(played)))
        return {name: np.zeros(len(seeds)) for name in EPISODE_FIELDS} | {"return": returns}

    known = []
    if clairvoyant.covers(scenario):
        known.append(
            PolicySpec(
                name=CLAIRVOYANT,
                kind="oracle",
                description="bound: every bar known beforehand, nothing lags or breaks",
                parameters={name: float(value) for name, value in clairvoyant.GRID._asdict().items()},
                compute=bound,
            )
        )
    if perfect_state.covers(scenario):
        nominal = scenario.nominal()  # of the mismatch it knows what every policy knows: nothing
        known.append(
            PolicySpec(
                name=CAUSAL,
                version=perfect_state.VERSION,
                kind="oracle",
                description="the optimiser with foresight, told the true depth, hardness and wear after every step",
                make=lambda num_envs: perfect_state.PerfectState(nominal, num_envs),
            )
        )
    return known


def named(
    names: Sequence[str] | None,
    task: Task,
    tuned_on: Scenario | None = None,
    skip: bool = False,
    knows: str = "nominal",
    forgets: bool = False,
) -> list[PolicySpec]:
    """Return controllers and oracles that play a task by name.

    Args:
        names: their names; None: all, of a family ``leaderboard.family.POLICIES``.
        task: what they play.
        tuned_on: the scenario that the controllers are tuned for; None: the one that they play. A family's are tuned on its base.
        skip: whether to leave out controllers that are not tuned, with a word on standard error.
        knows: see ``PolicySpec``; of families only.
        forgets: likewise.

    Raises:
        ResultError: there is none of that name (says which there are), or it is not tuned for the scenario.
    """
    if task.of_family:
        known = [*catalogue.names(family.family_of(task).job(0).scenario), NOMINAL_OPTIMUM, CAUSAL]
        default: Sequence[str] = family.VARIED if forgets or knows != "nominal" else family.POLICIES
    else:
        default = known = [*catalogue.names(task.scenario), *(each.name for each in oracles(task.scenario))]
    if unknown := sorted(set(names or ()) - set(known)):
        raise ResultError(f"no policy is called {', '.join(unknown)}; there are {', '.join(known)}")
    specs, untuned, home = [], [], tuned_on or task.scenario
    for name in dict.fromkeys(default if names is None else names):
        try:
            specs.append(one_named(name, task, tuned_on, knows, forgets))
        except ResultError as error:
            if not (skip and isinstance(error.__cause__, tuned.NotTuned)):
                raise
            untuned.append(name)
    if untuned:
        tell_once(f"skipped, as not tuned for scenario {home.name!r}: {', '.join(untuned)}; `{tuned.command(home)}` tunes them")
    return specs


def one_named(
    name: str, task: Task, tuned_on: Scenario | None = None, knows: str = "nominal", forgets: bool = False
) -> PolicySpec:
    """Return a controller or an oracle, see ``named``; ResultError if it cannot play or is not tuned (from ``NotTuned``)."""
    try:
        if task.of_family:
            return family.rule(name, task, knows, forgets)
        known = {oracle.name: oracle for oracle in oracles(task.scenario)}
        return known[name] if name in known else catalogue.spec(name, task.scenario, tuned_on)
    except (KeyError, ValueError) as error:
        raise ResultError(f"{name} cannot play: {error.args[0]}") from error


def agents(
    paths: Sequence[Path],
    task: Task,
    name: str | None = None,
    keep: bool = True,
    seconds: int | None = None,
    too_slow: dict[Path, ResultError] | None = None,
    forgets: bool = False,
) -> list[PolicySpec]:
    """Return the trained agents of ONNX files, which may come from anywhere, and of one's own training runs' folders.

    Args:
        paths: files and folders.
        task: what they play.
        name: the name of those that do not come with the project; None: what their files say.
        keep: whether they may have the name of an agent that comes with the project; else ``my_`` is put before it.
        seconds: processor time that the agent of a file may use for all episodes [s]; None: ``train.agents.onnx_policy.LIMITS``.
        too_slow: files that give no actions in time, which are left out; those that are found are added. None: raise.
        forgets: see ``PolicySpec``; of families only.

    Raises:
        ResultError: a path holds no agent, or one that cannot play the task; two have the same name and training seed; the name
            is that of another policy.
    """
    specs: dict[str, PolicySpec] = {}
    for path in (each for each in paths if each not in (too_slow or {})):
        try:
            spec = fitted(agent(path, seconds), task, forgets)
        except (OSError, ValueError) as error:
            if isinstance(error, TooSlow) and too_slow is not None:
                too_slow[path] = ResultError(f"skipped: {error}")
                continue
            raise ResultError(f"no agent can be loaded from {path}: {error}") from error
        if is_own(spec) and not keep:
            spec = PolicySpec.model_validate(dict(spec) | {"name": _own_name(path, spec.name, name)})
        if spec.label in specs:
            raise ResultError(
                f"{path} holds {spec.label}, which another of the given agents is too: play one after the other, each with a "
                "--name of its own, or export it again by python -m train.export --name"
            )
        specs[spec.label] = spec
    return list(specs.values())


def agent(path: Path, seconds: int | None = None) -> PolicySpec:
    """Return the agent of an ONNX file or of a run's folder, or raise ValueError (``TooSlow`` if it gives no actions in time)."""
    if path.suffix == ONNX_SUFFIX or (any(path.glob(f"*{ONNX_SUFFIX}")) and not (path / "run.json").exists()):
        return onnx_policy.load(path, replace(LIMITS, computing=seconds or LIMITS.computing))
    from train.training import load_agent  # imports torch, which takes seconds

    return load_agent(path)


def fitted(spec: PolicySpec, task: Task, forgets: bool = False) -> PolicySpec:
    """Return an agent, or a policy of one's own code, as it plays a task. Raise ValueError if it cannot play it."""
    if task.of_family:
        return family.agent(spec, task, forgets)
    check_fits(spec, task.scenario)
    return spec.model_copy(update={"make": informed(spec, task.scenario)})


def own_policy(source: str, task: Task, name: str | None = None) -> PolicySpec:
    """Return a policy of one's own code, ``module:object``: see ``turning_env.scoring.adapt.as_factory``.

    It ranks among the agents, without a digest, as versions of the code cannot be distinguished. Without a ``name`` it has the
    object's. Raise ResultError if there is no such policy, or another has its name.
    """
    try:
        as_factory(source)
        spec = PolicySpec(
            name=_own_name(source, re.split("[:.]", source)[-1], name),
            kind="agent",
            description="a policy of your own",
            training_seed=0,
            command=source,
            tuned_for=ScenarioId.of(task.scenario),
            make=lambda num_envs: as_factory(source)(num_envs),  # a class is instantiated for every play
        )
        return fitted(spec, task)
    except (OSError, TypeError, ValueError) as error:
        raise ResultError(f"{source} cannot play: {error}") from error


def _own_name(source: object, found: str, given: str | None) -> str:
    """Return the name of one's own policy: the given one, else its own, after ``my_`` if a shipped agent has that."""
    taken = shipped_agents().values()
    name = given or (f"my_{found}" if found in taken else found)
    if name in (*taken, *catalogue.RULES, CLAIRVOYANT, CAUSAL):
        raise ResultError(f"{source} cannot be called {name}, as another policy is: choose another --name")
    if given is None and name != found:
        tell_once(f"{source} plays as {name}, as {found} comes with the project; --name gives it another name")
    return name
