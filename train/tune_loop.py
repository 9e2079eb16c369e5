"""Find the numbers of ``load_loop_jobs`` by CMA-ES on training jobs of a family.

    python -m train.tune loop --family shop

An evolution strategy searches the numbers: it plays a loop with each candidate, and keeps the mean
and covariance of those that return most (Hansen 2016, "The CMA evolution strategy: a tutorial",
arXiv 1604.00772; library: cmaes). ``train/tune_rules.py`` tunes rules for one scenario; here every
environment plays another job. All candidates of a generation play the same jobs, and the next
generation plays the next ones. The result, the mean of the last generation, is printed; the rule's
numbers are kept in ``baselines/load_loop.py``.
"""

import argparse
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from cmaes import CMA
from numpy.typing import NDArray

from baselines.load_loop import JOB_SCALE, JOB_START, JobLoop, JobNumbers
from turning_env import Family, FamilyVectorEnv
from turning_env.console import described, exits, positive
from turning_env.progress import progress

Array = NDArray[np.float64]

SIGMA = 0.6  # initial standard deviation, over the numbers' scales (assumption)


class Budget(NamedTuple):
    """The size of a search."""

    generations: int
    candidates: int  # of a generation
    jobs: int  # that each candidate plays
    episode_steps: int  # of an episode that count; the rest is cut off


BUDGET = Budget(generations=32, candidates=12, jobs=64, episode_steps=2500)


def numbers_of(place: Array) -> JobNumbers:
    """Return the numbers at a place of the search, where 0 is the start and 1 a scale's length.

    The last axis is that of the numbers; others come first in the numbers' arrays.
    """
    values = np.array(JOB_START) + place * np.array(JOB_SCALE)
    return JobNumbers(*np.moveaxis(values, -1, 0))


def mean_returns(
    env: FamilyVectorEnv, places: Sequence[Array], first_job: int, budget: Budget
) -> Array:
    """Return the mean return of each candidate [s], shape (candidates,).

    Args:
        env: an environment for each job of each candidate.
        places: their places in the search.
        first_job: number of the first training job.
        budget: number of jobs and steps.
    """
    jobs = [first_job + index for index in range(budget.jobs)]
    models = [env.family.job(job).scenario.nominal() for job in jobs]
    of_each_env = np.repeat(np.array(places), budget.jobs, axis=0)
    policy = JobLoop(models * len(places), env.num_envs, numbers_of(of_each_env))

    observations, _ = env.reset(seed=jobs * len(places))
    policy.reset(np.ones(env.num_envs, np.bool_))
    returns = np.zeros(env.num_envs)
    going_on = np.ones(env.num_envs, np.bool_)
    for _ in range(budget.episode_steps):
        observations, rewards, terminated, truncated, _ = env.step(policy.act(observations))
        # Environments go on with another job at the end of an episode. Only the first counts.
        returns += np.where(going_on, rewards, 0.0)
        going_on &= ~(terminated | truncated)
        if not going_on.any():
            break
    return np.asarray(returns.reshape(len(places), budget.jobs).mean(axis=1))


def search(family: Family, budget: Budget, seed: int = 0) -> JobNumbers:
    """Return the best numbers on training jobs of a family, found within a budget.

    ``seed`` determines the candidates.
    """
    size = len(JobNumbers._fields)
    strategy = CMA(mean=np.zeros(size), sigma=SIGMA, population_size=budget.candidates, seed=seed)
    env = FamilyVectorEnv(
        budget.candidates * budget.jobs, family, context="hidden", autoreset_mode="SameStep"
    )
    generations = range(budget.generations)
    for generation in progress(generations, "searching", total=budget.generations, unit="gen"):
        places = [strategy.ask() for _ in range(budget.candidates)]
        first_job = generation * budget.jobs
        returns = mean_returns(env, places, first_job, budget)
        strategy.tell([(place, -mean) for place, mean in zip(places, returns, strict=True)])
        print(f"generation {generation}: mean {returns.mean():.0f} s, best {returns.max():.0f} s")
    return numbers_of(np.array(strategy.mean))


def add_to(commands: Any) -> None:
    """Add the command ``loop`` to the subparsers of a command line."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "loop", help="find the numbers of load_loop_jobs on a family", **described(__doc__)
    )
    parser.set_defaults(command=tune_loop)
    parser.add_argument(
        "--family", default="shop", metavar="NAME", help="family (default: %(default)s)"
    )
    parser.add_argument("--seed", type=int, default=0, help="training seed (default: %(default)s)")
    for name, value in BUDGET._asdict().items():
        parser.add_argument(
            f"--{name.replace('_', '-')}",
            type=positive,
            default=value,
            metavar="N",
            help="(default: %(default)s)",
        )


@exits(ValueError)
def tune_loop(parsed: argparse.Namespace) -> int:
    """Search the numbers as a command line asks, and print them; return the exit status."""
    family = Family.load(parsed.family)
    budget = Budget(**{name: getattr(parsed, name) for name in Budget._fields})
    found = search(family, budget, parsed.seed)
    for name, number in found._asdict().items():
        print(f"{name}={float(number):.4g},")
    return 0
