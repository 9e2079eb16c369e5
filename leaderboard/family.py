"""Tasks on families: each seed plays another job. Controllers are built from its nominal model; an agent plays all jobs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines import tuned
from baselines.catalogue import RULES, spec
from baselines.models.schedule import FORMS
from baselines.oracles.perfect_state import VERSION, PerfectState
from baselines.rule import Parameters
from leaderboard.result import FamilySplit, ResultError, Task
from train.agents.agent_file import informed
from turning_env import FAMILY_ID, Scenario
from turning_env.action import towards
from turning_env.family_env import Context
from turning_env.observation import read
from turning_env.physics.quantities import OBS
from turning_env.scenario.family import DrawnJobs, Family, Job
from turning_env.scenario.plan import features, plan_of
from turning_env.scenario.scenario_batch import ScenarioBatch
from turning_env.scoring.play import EPISODE_FIELDS, Episodes, play, play_family
from turning_env.scoring.policy import (
    Actions,
    Observations,
    Policy,
    PolicyFactory,
    PolicySpec,
    ScenarioId,
)

NOMINAL_OPTIMUM, CAUSAL = "fixed_nominal_optimum", "causal"
"""Names of the policies that score 0 and 1 on a family; the latter is the oracle, on all tasks."""
VARIED = ("rescaled_grid_search", "predictive", "self_tuning")
"""The policies that play if none are named, if they are told more than usual or forget."""
POLICIES = (NOMINAL_OPTIMUM, *VARIED, CAUSAL)  # the policies that play if none are named
BATCH = 64  # jobs that are played together
CHANGE_WEAR = 0.95  # nominal wear over the criterion at which FixedNominalOptimum changes the edge
_RIGHT = {"nominal": None, "true_wear": "material.wear.", "true_forms": FORMS, "true_laws": ""}
"""Prefixes of the fields whose true values are known, by ``PolicySpec.knows``."""


def family_task(source: str | Path | Family, split: str | None, count: int) -> Task:
    """Return the task on the first jobs of a split, by default ``unseen_jobs``, else ``train``; ResultError if it has fewer."""
    family = Family.load(source)
    split = split or ("unseen_jobs" if "unseen_jobs" in family.splits else "train")
    if split not in family.splits:
        raise ResultError(
            f"family {family.name!r} has no split {split!r}; it has {', '.join(family.splits)}"
        )
    jobs = family.jobs if split == "train" else family.held_out_jobs
    if count > jobs:
        raise ResultError(
            f"{count} seeds asked for, but the split {split!r} of family {family.name!r} has {jobs} jobs"
        )
    limits = {"overload_allowance": family.job(0).scenario.limits.overload_allowance}
    identity = ScenarioId(name=family.name, digest=family.digest())
    return Task(
        env_id=FAMILY_ID,
        scenario=Scenario.load(
            {"base": family.base, "name": f"{family.name}-{split}", "limits": limits}
        ),
        seeds=list(range(count)),
        of_family=FamilySplit(family=identity, split=split, loaded=family),
    )


def family_of(task: Task) -> Family:
    """Return a task's family; ResultError if the task was read from a file, and the present family has other values."""
    part = task.of_family
    assert part is not None
    if part.loaded is not None:
        return part.loaded
    try:
        family = Family.load(part.family.name)
        if family_task(family, part.split, len(task.seeds)).digest == task.digest:
            return family
    except ValueError as error:
        raise ResultError(f"cannot be played again: {error}") from error
    raise ResultError(f"is not of the present family {part.family.name!r}: values differ")


def rule(name: str, task: Task, knows: str = "nominal", forgets: bool = False) -> PolicySpec:
    """Return a controller, tuned on the family or its base, or the oracle, as it plays a family; ValueError if it cannot."""
    family = family_of(task)
    first, own = family.job(0).scenario, tuned.on_family(family, name)
    if (knows != "nominal" or forgets) and name in (NOMINAL_OPTIMUM, CAUSAL):
        raise ValueError(f"{name} has no variants")
    if name == NOMINAL_OPTIMUM:
        found = PolicySpec(name=NOMINAL_OPTIMUM)
    elif name == CAUSAL:
        found = PolicySpec(name=CAUSAL, version=VERSION, kind="oracle")
    else:
        found = spec(name, first, Scenario.load(family.base), own, [family.job(0).numbers])
    right = "" if name == CAUSAL else _RIGHT[knows]
    plays = FamilyPlay(
        family if right is None else Truthful.of(family, right), _split(task), name, forgets, own
    )
    kind = found.kind if knows == "nominal" else "oracle"
    return found.model_copy(
        update={"knows": knows, "forgets": forgets, "kind": kind, "compute": plays}
    )


def agent(found: PolicySpec, task: Task, forgets: bool = False) -> PolicySpec:
    """Return an agent, or a policy of one's own code, as it plays a family's task."""
    plays = FamilyPlay(family_of(task), _split(task), found, forgets)
    return found.model_copy(update={"forgets": forgets, "compute": plays})


def _split(task: Task) -> str:
    assert task.of_family is not None
    return task.of_family.split


class Truthful(Family):
    """A family whose nominal models are right in some fields; its jobs are otherwise the same."""

    right: str | tuple[str, ...] = (
        ""  # how the dotted names of these fields begin, or one of several beginnings
    )

    @classmethod
    def of(cls, family: Family, right: str | tuple[str, ...] = "") -> "Truthful":
        """Return a family with nominal models that are right in the fields whose dotted names begin so, or one of these ways."""
        return cls.model_validate(family.model_dump() | {"right": right})

    def __reduce__(self) -> Any:
        """Pickle the family without its jobs."""
        return Truthful.model_validate, (self.model_dump(),)

    def draw_numbers(self, split: str, numbers: NDArray[np.uint64]) -> DrawnJobs:
        jobs = super().draw_numbers(split, numbers)
        fields = {}
        for name, value in jobs.nominal_fields.items():
            fields[name] = jobs.true_fields[name] if name.startswith(self.right) else value
        nominal = self.batch_of(fields, len(numbers))
        plan = plan_of(nominal)
        shown = {name: jobs.features[name] for name in self.shown}
        return replace(
            jobs,
            nominal=nominal,
            plan=plan,
            nominal_fields=fields,
            features=features(nominal, plan) | shown,
        )


@dataclass(frozen=True)
class FamilyPlay:
    """Plays episodes of a family: the ``compute`` of a ``PolicySpec``."""

    family: Family  # the family, with the nominal models that the policy knows
    split: str
    policy: str | PolicySpec  # a controller's name, or an agent that plays all jobs
    forgets: bool
    own: Parameters = field(
        default_factory=dict
    )  # parameters that a controller has on this family alone

    @property
    def context(self) -> Context:
        """Return the context of the observations: controllers are built from the nominal models, agents are told them."""
        return "hidden" if isinstance(self.policy, str) else "told"

    def make(self, jobs: Sequence[Job]) -> PolicyFactory:
        """Return what makes the policy that plays these jobs, one in each environment; most controllers play one."""
        scenarios = [job.scenario for job in jobs]
        make: PolicyFactory
        if not isinstance(self.policy, str):
            make = informed(self.policy, scenarios)
        elif self.policy == NOMINAL_OPTIMUM:
            make = lambda num_envs: FixedNominalOptimum(jobs)  # noqa: E731
        elif self.policy == CAUSAL:
            make = lambda num_envs: PerfectState(scenarios, num_envs)  # noqa: E731
        else:
            base = Scenario.load(self.family.base)
            played = scenarios if RULES[self.policy].together else scenarios[0]
            make = spec(self.policy, played, base, self.own, [job.numbers for job in jobs]).make
        return (lambda num_envs: Forgetful(make(num_envs))) if self.forgets else make

    def __call__(
        self, scenario: Scenario, seeds: Sequence[int], on_step: Callable[[int], None]
    ) -> Episodes:
        if (
            isinstance(self.policy, str)
            and self.policy in RULES
            and not RULES[self.policy].together
        ):
            played = []
            for seed in seeds:
                job = self.family.job(seed, self.split)
                played.append(play(self.make([job]), job.scenario, [seed]))
                on_step(len(played))
            return {name: np.concatenate([each[name] for each in played]) for name in played[0]}
        return self._play_together(seeds, on_step)

    def _play_together(self, seeds: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
        """Play episodes in batches of jobs that last about as long, so that none waits for much longer ones."""
        jobs = [self.family.job(seed, self.split) for seed in seeds]
        order = np.argsort([job.scenario.control.time_limit for job in jobs], kind="stable")
        episodes = {name: np.empty(len(seeds)) for name in EPISODE_FIELDS}
        for first in range(0, len(seeds), BATCH):
            places = order[first : first + BATCH].tolist()
            played = play_family(
                self.family,
                self.split,
                [seeds[place] for place in places],
                self.make([jobs[place] for place in places]),
                self.context,
                lambda ended, before=first: on_step(before + ended),  # type: ignore[misc]
                tell=self.policy == CAUSAL,
            )
            for name in EPISODE_FIELDS:
                episodes[name][places] = played[name]
        return episodes


class FixedNominalOptimum(Policy):
    """The nominal model's best set point of each job on a half-worn edge; edges are changed by nominal wear."""

    def __init__(self, jobs: Sequence[Job]) -> None:
        self._scenarios: Any = ScenarioBatch.of([job.scenario for job in jobs])
        self._speeds, self._feeds = np.array([[job.cutting_speed, job.feed] for job in jobs]).T

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, 3), for observations, shape (num_envs, entries)."""
        reading = read(observations, self._scenarios)
        change = reading.nominal_wear >= CHANGE_WEAR * self._scenarios.tool.wear_criterion
        return towards(reading, self._scenarios, self._speeds, self._feeds, change)


class Forgetful(Policy):
    """A policy that forgets everything at each change of the edge: lathe, material and position."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._wear: Observations = np.zeros(0, np.float32)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Clear the memory of the environments in the mask, shape (num_envs,)."""
        self._policy.reset(mask)

    def act(self, observations: Observations) -> Actions:
        """Return the policy's actions, shape (num_envs, 3)."""
        wear = observations[:, OBS.nominal_wear]
        if self._wear.size:
            self._policy.reset(wear < self._wear)
        self._wear = wear.copy()
        return self._policy.act(observations)
