"""Tasks on families of jobs: each seed plays another job.

Controllers are built from each job's nominal model; an agent plays all jobs. How a family draws its
jobs belongs to ``turning_env.scenario.family``.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from baselines.catalogue import RULES, spec
from baselines.comparators import CAUSAL, NOMINAL_OPTIMUM, NOMINAL_SHARE
from baselines.forgetful import Forgetful
from baselines.models.schedule import FORMS
from baselines.nominal_optimum import FixedNominalOptimum, feasible_shares
from baselines.oracles import known_forms, perfect_state
from baselines.oracles.truthful import Truthful
from baselines.policy_spec import Knowledge, PolicySpec, ScenarioId
from leaderboard.agents.agent_file import informed
from leaderboard.play import EPISODE_FIELDS, Episodes, play, play_family
from leaderboard.result import FamilySplit, ResultError, Task
from turning_env import FAMILY_ID, Scenario
from turning_env.env import RoughTurningEnv
from turning_env.family_env import Context, FamilyEnv
from turning_env.policy import Policy, PolicyFactory
from turning_env.scenario.family import Family, Job, families

VARIED = ("rescaled_grid_search", "predictive", "self_tuning")
"""The policies that play if none are named, if they know more than usual or forget."""
POLICIES = (NOMINAL_OPTIMUM, NOMINAL_SHARE, *VARIED, CAUSAL)
"""The policies that play if none are named."""
KNOWN_FORMS = "known_forms"
"""The oracle of the forms, on families that hide some (``baselines/oracles/known_forms.py``)."""
BATCH = 64  # jobs that are played together


def family_task(source: str | Path | Family, split: str | None, count: int) -> Task:
    """Return the task on the first ``count`` jobs of a split.

    Without a split it is ``unseen_jobs``, or ``train`` if the family has no such split. Raise
    ResultError if the family has no split of this name, or the split has fewer jobs.
    """
    family = Family.load(source)
    if not split:
        split = "unseen_jobs" if "unseen_jobs" in family.splits else "train"
    if split not in family.splits:
        raise ResultError(
            f"family {family.name!r} has no split {split!r}; it has {', '.join(family.splits)}"
        )
    num_jobs = family.jobs if split == "train" else family.held_out_jobs
    if count > num_jobs:
        raise ResultError(
            f"{count} seeds asked for, but the split {split!r} of family {family.name!r} has "
            f"{num_jobs} jobs"
        )
    # One allowance decides on feasibility, and a family's may differ from that of its base.
    limits = {"overload_allowance": family.job(0).scenario.limits.overload_allowance}
    shared_values = {"base": family.base, "name": f"{family.name}-{split}", "limits": limits}
    identity = ScenarioId(name=family.name, digest=family.digest())
    return Task(
        env_id=FAMILY_ID,
        scenario=Scenario.load(shared_values),
        seeds=list(range(count)),
        of_family=FamilySplit(family=identity, split=split, loaded=family),
    )


def family_of(task: Task) -> Family:
    """Return a task's family.

    Raise ResultError if the task was read from a file, and the present family has other values.
    """
    part = _part_of(task)
    if part.loaded is not None:
        return part.loaded
    try:
        family = Family.load(part.family.name)
        if part.family.name in families():
            present = _digest_of_task(part.family.name, part.split, len(task.seeds))
        else:
            present = family_task(family, part.split, len(task.seeds)).digest
    except ValueError as error:
        raise ResultError(f"cannot be played again: {error}") from error
    if present != task.digest:
        raise ResultError(f"is not of the present family {part.family.name!r}: values differ")
    return family


# A folder has a result per policy on the same few tasks.
@cache
def _digest_of_task(family_name: str, split: str, count: int) -> str:
    """Return the digest of a task on a family that ships."""
    return family_task(family_name, split, count).digest


def _part_of(task: Task) -> FamilySplit:
    """Return the family and the split of a task on a family."""
    assert task.of_family is not None
    return task.of_family


def extra_names(family: Family) -> list[str]:
    """Return the names of the policies that play a family, but are not in the catalogue."""
    names = [NOMINAL_OPTIMUM, NOMINAL_SHARE, CAUSAL]
    if family.hidden:
        names.append(KNOWN_FORMS)
    return names


def rule_on_family(
    name: str, task: Task, knows: Knowledge = "nominal", forgets: bool = False
) -> PolicySpec:
    """Return a controller, tuned on the family or its base, or the oracle, as it plays a family.

    ``knows`` and ``forgets`` name a variant: see ``PolicySpec``. Raise ValueError if the policy
    cannot play, or does not come in this variant.
    """
    family = family_of(task)
    job = family.job(0)
    if (knows != "nominal" or forgets) and name in extra_names(family):
        raise ValueError(f"{name} has no variants")
    if name == NOMINAL_OPTIMUM:
        policy = PolicySpec(name=NOMINAL_OPTIMUM)
    elif name == NOMINAL_SHARE:
        shares = feasible_shares(family)
        policy = PolicySpec(
            name=NOMINAL_SHARE,
            description="a share of the nominal optimum's cutting speed and feed, tuned on "
            "training jobs to be feasible",
            parameters=shares._asdict(),
        )
    elif name == CAUSAL:
        policy = PolicySpec(name=CAUSAL, version=perfect_state.VERSION, kind="oracle")
    elif name == KNOWN_FORMS:
        policy = PolicySpec(
            name=KNOWN_FORMS,
            version=known_forms.VERSION,
            kind="oracle",
            description="self_tuning that knows the forms of the lathe",
            parameters=dict(RULES["self_tuning"].fixed),
        )
    else:
        policy = spec(
            name,
            job.scenario,
            tuned_on=Scenario.load(family.base),
        )
    known_family = family
    if name == CAUSAL or knows == "true_laws":
        known_family = Truthful.of(family)
    elif name == KNOWN_FORMS:
        known_family = Truthful.of(family, FORMS)
    plays = FamilyPlay(
        known_family,
        _part_of(task).split,
        policy=name,
        forgets=forgets,
    )
    # A controller that knows more than others is no policy to compare with.
    kind = policy.kind if knows == "nominal" else "oracle"
    changes = {"knows": knows, "forgets": forgets, "kind": kind, "compute": plays}
    return policy.model_copy(update=changes)


def agent_on_family(policy: PolicySpec, task: Task, forgets: bool = False) -> PolicySpec:
    """Return an agent, or a policy of one's own code, as it plays a family's task."""
    plays = FamilyPlay(family_of(task), _part_of(task).split, policy=policy, forgets=forgets)
    return policy.model_copy(update={"forgets": forgets, "compute": plays})


@dataclass(frozen=True)
class FamilyPlay:
    """Plays episodes of a family: the ``compute`` of a ``PolicySpec``."""

    family: Family  # the family, with the nominal models that the policy knows
    split: str
    policy: str | PolicySpec  # a controller's name, or an agent that plays all jobs
    forgets: bool

    @property
    def context(self) -> Context:
        """Return the context of the observations.

        Controllers are built from the nominal models, so only agents need the context.
        """
        return "hidden" if isinstance(self.policy, str) else "told"

    def make(self, jobs: Sequence[Job]) -> PolicyFactory:
        """Return the factory of the policy that plays these jobs, one in each environment.

        Most controllers play one job at a time.
        """
        make = self._make(jobs)
        if not self.forgets:
            return make
        return lambda num_envs: Forgetful(make(num_envs))

    def _make(self, jobs: Sequence[Job]) -> PolicyFactory:
        """Return the factory of the policy without ``forgets``."""
        scenarios = [job.scenario for job in jobs]
        if isinstance(self.policy, PolicySpec):
            return informed(self.policy, scenarios)
        if self.policy == NOMINAL_OPTIMUM:
            return lambda num_envs: FixedNominalOptimum(jobs)
        if self.policy == NOMINAL_SHARE:
            shares = feasible_shares(self.family)
            return lambda num_envs: FixedNominalOptimum(jobs, shares)
        if self.policy == CAUSAL:
            return lambda num_envs: perfect_state.PerfectState(scenarios, num_envs)
        if self.policy == KNOWN_FORMS:
            models = [scenario.nominal() for scenario in scenarios]
            fixed: Any = RULES["self_tuning"].fixed
            return lambda num_envs: known_forms.KnownForms(models, num_envs, **fixed)
        controller = spec(
            self.policy,
            scenarios if RULES[self.policy].together else scenarios[0],
            tuned_on=Scenario.load(self.family.base),
        )
        return controller.make

    def __call__(
        self, scenario: Scenario, seeds: Sequence[int], on_step: Callable[[int], None]
    ) -> Episodes:
        """Play one episode per seed, and return what ``leaderboard.play.play`` does."""
        rule = RULES.get(self.policy) if isinstance(self.policy, str) else None
        if rule is not None and not rule.together:
            return self._play_alone(seeds, on_step)
        return self._play_together(seeds, on_step)

    def _play_alone(self, seeds: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
        """Play one job after the other."""
        played = []
        for seed in seeds:
            job = self.family.job(seed, self.split)
            played.append(play(self.make([job]), job.scenario, [seed]))
            on_step(len(played))
        return {name: np.concatenate([episodes[name] for episodes in played]) for name in played[0]}

    def _play_together(self, seeds: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
        """Play episodes in batches of jobs."""
        jobs = [self.family.job(seed, self.split) for seed in seeds]
        episodes = {name: np.empty(len(seeds)) for name in EPISODE_FIELDS}
        # The jobs of a batch last about as long, so that none waits for much longer ones.
        by_length = np.argsort([job.scenario.control.time_limit for job in jobs], kind="stable")
        for start in range(0, len(seeds), BATCH):
            batch = by_length[start : start + BATCH].tolist()
            played = play_family(
                self.family,
                self.split,
                seeds=[seeds[index] for index in batch],
                make_policy=self.make([jobs[index] for index in batch]),
                context=self.context,
                on_step=_after(start, on_step),
                tell=self.policy == CAUSAL,
            )
            for name in EPISODE_FIELDS:
                episodes[name][batch] = played[name]
        return episodes


class Episode(NamedTuple):
    """One episode of one policy, before its first step."""

    policy: Policy  # of one environment
    scenario: Scenario  # of a family, the job's
    arguments: dict[str, Any]  # of the environment's class


def episode_of(spec: PolicySpec, scenario: Scenario, seed: int) -> Episode:
    """Return the episode that a policy plays of a seed.

    Args:
        spec: the policy; on a family, it knows the family.
        scenario: the scenario of its task, unless that is a family.
        seed: seed, or number of the job.
    """
    play = spec.compute
    if not isinstance(play, FamilyPlay):
        return Episode(spec.make(1), scenario, arguments={"scenario": scenario})
    job = play.family.job(seed, play.split)
    arguments = {"family": play.family, "split": play.split, "context": play.context}
    return Episode(play.make([job])(1), job.scenario, arguments)


def environment_of(episode: Episode) -> RoughTurningEnv:
    """Return the environment of an episode, without rendering."""
    make = FamilyEnv if "family" in episode.arguments else RoughTurningEnv
    return make(**episode.arguments)


def _after(played_before: int, on_step: Callable[[int], None]) -> Callable[[int], None]:
    """Return a callback that reports the episodes of a batch on top of those played before."""

    def on_step_of_batch(ended: int) -> None:
        on_step(played_before + ended)

    return on_step_of_batch
