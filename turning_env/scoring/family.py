"""Play policies on the jobs of a family, and compare them with two anchors per job.

A controller is built for each job from its nominal model (``play_jobs``). An agent that plays all jobs is one policy for the
family's batch (``play_family``), and so is a controller that is built for many jobs together. Seeds are those of the family's
environments, so all meet the same bars.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from turning_env.action import towards
from turning_env.family_env import Context, FamilyVectorEnv
from turning_env.observation import read
from turning_env.physics.quantities import OBS
from turning_env.scenario.family import CHUNK, Draw, Family, Job
from turning_env.scenario.plan import columns_of, features, plan_of
from turning_env.scoring.play import Episodes, play
from turning_env.scoring.policy import Actions, Observations, Policy, PolicyFactory
from turning_env.scoring.statistics import Floats

CHANGE_WEAR = 0.95
"""Nominal wear over the criterion at which the anchor changes the edge."""


class HeldOptimum(Policy):
    """The lower anchor: the nominal model's best set point on a half-worn edge, held fixed; edges are changed by nominal wear.

    Args:
        jobs: the job of each environment.
    """

    def __init__(self, jobs: Sequence[Job]) -> None:
        self._scenarios: Any = columns_of([job.scenario for job in jobs])
        self._speeds, self._feeds = np.array([[job.cutting_speed, job.feed] for job in jobs]).T

    def act(self, observations: Observations) -> Actions:
        """Return the actions, shape (num_envs, 3), for observations, shape (num_envs, entries)."""
        reading = read(observations, self._scenarios)
        change = reading.nominal_wear >= CHANGE_WEAR * self._scenarios.tool.wear_criterion
        return towards(reading, self._scenarios, self._speeds, self._feeds, change)


class Forgetful(Policy):
    """A policy that forgets everything at each change of the edge: the lathe, the lot, and where the tool is."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._wear: Observations = np.zeros(0, np.float32)

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Forget what was seen of the environments in the mask, shape (num_envs,)."""
        self._policy.reset(mask)

    def act(self, observations: Observations) -> Actions:
        """Return the policy's actions, shape (num_envs, 3)."""
        wear = observations[:, OBS.nominal_wear]
        if self._wear.size:
            self._policy.reset(wear < self._wear)
        self._wear = wear.copy()
        return self._policy.act(observations)


def job_seeds(family: Family, job: Job, episodes: int) -> list[int]:
    """Return seeds with which a family's environment plays a job, each with other bars and edges."""
    jobs = family.jobs if job.split == "train" else family.held_out_jobs
    return [job.number + jobs * k for k in range(episodes)]


def play_jobs(
    family: Family,
    jobs: Sequence[Job],
    make: Callable[[Job], PolicyFactory],
    episodes: int,
    on_job: Callable[[int], None] = lambda played: None,
    *,
    tell: bool = False,
) -> Episodes:
    """Play episodes of every job with a policy that is made for it; ``tell``: see ``play``.

    Returns:
        An array of shape (jobs, episodes) for each of ``play.EPISODE_FIELDS``.
    """
    played = []
    for job in jobs:
        played.append(play(make(job), job.scenario, job_seeds(family, job, episodes), tell=tell))
        on_job(len(played))
    return {name: np.stack([each[name] for each in played]) for name in played[0]}


class Truthful(Family):
    """A family whose nominal models are right, or nearly: policies are told the true laws, and observations compare with them."""

    right: str = ""
    """How the names of the fields begin that are right."""
    errors: tuple[float, ...] = (0.0,)
    """Shares of these fields' errors that remain, each for a chunk of jobs in turn."""

    def __reduce__(self) -> Any:
        """Pickle the family without its jobs."""
        return Truthful.model_validate, (self.model_dump(),)

    def error(self, numbers: NDArray[np.int64]) -> Floats:
        """Return the share of errors that remains in jobs by number."""
        return np.array(self.errors)[numbers // CHUNK % len(self.errors)]

    def _drawn(self, split: str, numbers: NDArray[np.uint64]) -> Draw:
        draw, share = super()._drawn(split, numbers), self.error(numbers.astype(np.int64))
        nominal, true = draw.fields
        told = {
            name: _between(true[name], value, share) if name.startswith(self.right) else value for name, value in nominal.items()
        }
        columns = self.columns(told)
        plan = plan_of(columns, len(numbers))
        return replace(draw, true=self.columns(true, columns), plan=plan, fields=(told, true), features=features(columns, plan))


def _between(true: Any, nominal: Any, share: Floats) -> Any:
    """Return values with a share of the error of nominal ones; what is no array is the same in all jobs."""
    if not isinstance(nominal, np.ndarray):
        return true
    return np.where(share < 1.0, true + share * (nominal - true), nominal)


def truthful(family: Family, right: str = "", errors: Sequence[float] = (0.0,)) -> Truthful:
    """Return the family with nominal models that are right in the fields whose dotted names begin so; see ``Truthful``.

    Its jobs are otherwise the same.

    Raises:
        ValueError: there are no ``errors``, or some are not from 0 to 1.
    """
    if not errors or not all(0.0 <= error <= 1.0 for error in errors):
        raise ValueError(f"errors is {list(errors)}, but must be one or more numbers from 0 to 1")
    return Truthful.model_validate(family.model_dump() | {"right": right, "errors": tuple(errors)})


def play_family(
    family: Family,
    jobs: Sequence[Job],
    make_policy: PolicyFactory,
    episodes: int,
    context: Context = "told",
    *,
    tell: bool = False,
) -> Episodes:
    """Play episodes of every job, all in one batch, with a policy that plays all jobs; see ``play_jobs``.

    The environments of a job follow one another. A controller that is built for the jobs needs the ``context`` "hidden".
    """
    (split,) = {job.split for job in jobs}
    seeds = [seed for job in jobs for seed in job_seeds(family, job, episodes)]
    env = FamilyVectorEnv(len(seeds), family, split, context, AutoresetMode.SAME_STEP)
    return {name: values.reshape(len(jobs), episodes) for name, values in play(make_policy, env, seeds, tell=tell).items()}


def relative(returns: Floats, low: Floats, high: Floats) -> Floats:
    """Return the share of the gap between two anchors' mean returns of each job that returns close; shapes (jobs, episodes)."""
    low, high = low.mean(axis=1, keepdims=True), high.mean(axis=1, keepdims=True)
    share: Floats = (returns - low) / (high - low)
    return share
