"""Fit constant speeds and feeds to the context of a family's jobs, and compare with one constant.

    python -m research.studies.family_regression shop
    python -m research.studies.family_regression shop --jobs 64

Every job is played with a grid of shares of the nominal optimum's speed and feed. A law gives the
logarithms of both shares, linear in the numbers that the family shows of the nominal model:

    (log speed share, log feed share) = constants + weights^T context

It maximises the mean return, interpolated in the grid, less a penalty on the squared weights. Each
quarter of the jobs is scored by a law fitted to the other three, and compared with the pair of
shares that is best on these three. Only training jobs are played.
"""

import argparse
import sys
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch

from baselines.nominal_optimum import FixedNominalOptimum, SetPointShares
from leaderboard.play import play_family
from leaderboard.statistics import Bootstrap, Estimate, Floats
from leaderboard.table import markdown
from turning_env import Family
from turning_env.console import described, exits, positive
from turning_env.scenario.family import CHUNK, Job

SPEEDS = (0.75, 0.92, 1.1)
FEEDS = (0.52, 0.62, 0.75)
PENALTIES = (0.1, 0.3, 1.0, 3.0, 10.0)
FOLDS = 4
ITERATIONS = 250
LEARNING_RATE = 0.02
RETURN_SCALE = 1000.0  # [s]
MAX_CONTEXT = 3.0
"""Highest absolute value of a number of the context: few jobs are far out."""

Tensor = torch.Tensor


class ShareLaw(NamedTuple):
    """A linear law of the log shares of speed and feed."""

    weights: Tensor  # shape (numbers, 2)
    constants: Tensor  # shape (2,)

    def log_shares(self, context: Tensor) -> Tensor:
        """Return log speed share and log feed share of each job, shape (jobs, 2)."""
        return self.constants + context @ self.weights


def returns_of(family: Family, num_jobs: int) -> Floats:
    """Return the returns [s] of the first training jobs, shape (jobs, speeds, feeds)."""
    jobs = [family.job(number) for number in range(num_jobs)]
    returns = np.empty((num_jobs, len(SPEEDS), len(FEEDS)))
    for i, cutting_speed in enumerate(SPEEDS):
        for k, feed in enumerate(FEEDS):
            shares = SetPointShares(cutting_speed, feed)
            returns[:, i, k] = _returns_of_shares(family, jobs, shares)
    return returns


def _returns_of_shares(family: Family, jobs: Sequence[Job], shares: SetPointShares) -> Floats:
    """Return the returns [s] of the first training jobs with some shares, shape (jobs,)."""
    policy = FixedNominalOptimum(jobs, shares)
    episodes = play_family(
        family,
        "train",
        seeds=range(len(jobs)),
        make_policy=lambda num_envs: policy,
        context="hidden",
    )
    return episodes["return"]


def context_of(family: Family, num_jobs: int) -> Tensor:
    """Return the context of the first training jobs, shape (jobs, numbers)."""
    chunks = []
    for chunk in range(-(-num_jobs // CHUNK)):
        chunks.append(family.context(family.draw("train", chunk).features))
    context = np.concatenate(chunks)[:num_jobs]
    return torch.from_numpy(np.clip(context, -MAX_CONTEXT, MAX_CONTEXT))


def interpolated(returns: Tensor, log_shares: Tensor) -> Tensor:
    """Return each job's return at its log shares, linear between the points of the grid.

    Beyond the ends of the grid, it is that of the end.
    """
    speed, speed_place = _place(log_shares[:, 0], SPEEDS)
    feed, feed_place = _place(log_shares[:, 1], FEEDS)
    job = torch.arange(len(returns))

    # The four corners of each job's cell of the grid.
    slow_low = returns[job, speed, feed]
    slow_high = returns[job, speed, feed + 1]
    fast_low = returns[job, speed + 1, feed]
    fast_high = returns[job, speed + 1, feed + 1]

    slow = slow_low + feed_place * (slow_high - slow_low)
    fast = fast_low + feed_place * (fast_high - fast_low)
    return slow + speed_place * (fast - slow)


def _place(log_share: Tensor, shares: Sequence[float]) -> tuple[Tensor, Tensor]:
    """Return the index of the grid's interval that holds each log share, and the place in it."""
    points = torch.log(torch.tensor(shares, dtype=torch.double))
    inside = log_share.clamp(points[0], points[-1])
    index = torch.searchsorted(points, inside.detach(), right=True) - 1
    index = index.clamp(0, len(points) - 2)
    low = points[index]
    high = points[index + 1]
    place = (inside - low) / (high - low)
    return index, place


def fitted(context: Tensor, returns: Tensor, penalty: float) -> ShareLaw:
    """Return the law with the highest mean return, less the penalty on its squared weights."""
    weights = torch.zeros(
        context.shape[1],
        2,
        dtype=torch.double,
        requires_grad=True,
    )
    middle_speed = np.log(np.median(SPEEDS))
    middle_feed = np.log(np.median(FEEDS))
    constants = torch.tensor(
        [middle_speed, middle_feed],
        dtype=torch.double,
        requires_grad=True,
    )
    law = ShareLaw(weights, constants)
    optimizer = torch.optim.Adam(law, lr=LEARNING_RATE)
    for _ in range(ITERATIONS):
        of_jobs = interpolated(returns, law.log_shares(context))
        value = of_jobs.mean() / RETURN_SCALE
        loss = penalty * weights.square().sum() - value
        optimizer.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    return ShareLaw(weights.detach(), constants.detach())


def cross_validated(context: Tensor, returns: Tensor, penalty: float) -> Floats:
    """Return each job's return by the law that was fitted to the other folds, shape (jobs,)."""
    jobs = len(returns)
    fold = torch.arange(jobs) % FOLDS
    earned = torch.empty(jobs, dtype=torch.double)
    for number in range(FOLDS):
        held_out = fold == number
        others = ~held_out
        law = fitted(context[others], returns[others], penalty)
        log_shares = law.log_shares(context[held_out])
        earned[held_out] = interpolated(returns[held_out], log_shares)
    return earned.numpy()


def best_constants(returns: Tensor) -> Floats:
    """Return each job's return at the pair of shares that is best on the other folds."""
    jobs = len(returns)
    of_pairs = returns.reshape(jobs, -1)
    fold = torch.arange(jobs) % FOLDS
    earned = torch.empty(jobs, dtype=torch.double)
    for number in range(FOLDS):
        held_out = fold == number
        means = of_pairs[~held_out].mean(dim=0)
        best = means.argmax()
        earned[held_out] = of_pairs[held_out, best]
    return earned.numpy()


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the returns of the laws by penalty as a table; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.studies.family_regression", **described(__doc__)
    )
    add = parser.add_argument
    add("family", help="the family's preset or TOML file")
    add("--jobs", type=positive, default=1024, help="training jobs (default: %(default)s)")
    options = parser.parse_args(arguments)
    if options.jobs < FOLDS:
        raise ValueError(f"--jobs is {options.jobs}, but must be {FOLDS} or more")
    torch.set_num_threads(1)
    family = Family.load(options.family)
    returns = torch.from_numpy(returns_of(family, options.jobs))
    context = context_of(family, options.jobs)
    constants = best_constants(returns)
    bootstrap = Bootstrap(options.jobs)
    rows = [{"Penalty": "one pair of shares", "Return [s]": f"{constants.mean():.0f}"}]
    for penalty in PENALTIES:
        earned = cross_validated(context, returns, penalty)
        leads = earned - constants
        lead = Estimate.of(leads.mean(), bootstrap.means(leads[np.newaxis], ""))
        rows.append(
            {
                "Penalty": f"{penalty:g}",
                "Return [s]": f"{earned.mean():.0f}",
                "Over one pair [s]": f"{lead.value:.0f} ({lead.low:.0f} to {lead.high:.0f})",
            }
        )
    print(markdown(rows))
    return 0


if __name__ == "__main__":
    sys.exit(main())
