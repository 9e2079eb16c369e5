"""Show what the hidden forms of the family `unmodelled` are worth, and that they can be found.

    python -m research.studies.unmodelled_draw
    python -m research.studies.unmodelled_draw --part probe --jobs 64

Training jobs only. ``worth`` plays the strongest simple rules and a planner that knows the forms:
constants, a regression of the highest speed on all numbers of the context (each job by the others),
and ``baselines/oracles/known_forms.py``. ``probe`` predicts each form from the history of two edges
(``edge_probe.py``), and from the context alone.
"""

import argparse
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from baselines.comparators import CAUSAL
from baselines.models.schedule import FORMS
from baselines.oracles.known_forms import KnownForms, collapses
from baselines.oracles.truthful import Truthful
from baselines.reactive import START_SHARE
from baselines.self_tuning import RULES, SelfTuning
from leaderboard.family import FamilyPlay
from leaderboard.play import EPISODE_FIELDS, Episodes, play_family
from leaderboard.statistics import Bootstrap, Estimate, Floats
from leaderboard.table import markdown
from research.studies.edge_probe import (
    FOLDS,
    area_with_interval,
    chunks_of_similar_length,
    explored,
    left_out_scores,
)
from turning_env import Family
from turning_env.console import described, exits, positive
from turning_env.numerics.functions import exp
from turning_env.policy import Policy, PolicyFactory
from turning_env.scenario.family import Job

SPLIT = "train"
WORTH_JOBS = 96
PROBE_JOBS = 384
BATCH = 64  # jobs that are played together
LOG_SPEEDS = tuple(np.linspace(np.log(0.42), np.log(1.6), 6).round(3).tolist())
"""Log highest speeds over the start speed [-]: to the machine's highest speed."""
LIFE = 0.8  # used life at which edges are changed [-]
RIDGE = 30.0  # penalty over the squares of the slopes of returns over the context
PARTS = ("worth", "probe")
MIN_FORM = 1e-6  # size below which a form is none [-]


class PolicyRow(NamedTuple):
    """A policy's returns on the jobs [s], and its broken edges, if they are known."""

    policy: str
    returns: Floats
    edges_broken: Floats | None = None


def forms_of(job: Job) -> dict[str, bool]:
    """Return which forms a job has, by name."""
    scenario = job.scenario
    window = scenario.swarf.chip_feed_min
    return {
        "collapse": collapses(scenario),
        "built-up edge": scenario.edge_failure.built_up_edge > MIN_FORM,
        "notch": scenario.edge_failure.notch_growth > MIN_FORM,
        "chatter": scenario.machine.chatter > MIN_FORM,
        "chip window": window != scenario.nominal().swarf.chip_feed_min,
    }


def given(policy: Policy) -> PolicyFactory:
    """Return a factory of a policy that is made already."""
    return lambda num_envs: policy


def by_known_forms(family: Family, num_jobs: int) -> PolicyRow:
    """Return the row of ``KnownForms``, whose nominal models have the true forms."""
    truthful = Truthful.of(family, FORMS)
    jobs = [truthful.job(number, SPLIT) for number in range(num_jobs)]
    limits = [job.scenario.control.time_limit for job in jobs]
    parameters: Any = RULES["self_tuning"].fixed
    episodes: Episodes = {name: np.empty(num_jobs) for name in EPISODE_FIELDS}
    for chunk in chunks_of_similar_length(limits, BATCH):
        models = [jobs[number].scenario.nominal() for number in chunk]
        policy = KnownForms(models, len(chunk), **parameters)
        ended = play_family(truthful, SPLIT, chunk, make_policy=given(policy), context="hidden")
        for name in EPISODE_FIELDS:
            episodes[name][chunk] = ended[name]
    return PolicyRow("`self_tuning` with known forms", episodes["return"], episodes["edges_broken"])


def played(family: Family, policy: str, num_jobs: int) -> PolicyRow:
    """Return the row of a controller, or of the oracle."""
    truthful = Truthful.of(family) if policy == CAUSAL else family
    plays = FamilyPlay(truthful, SPLIT, policy, forgets=False)
    episodes = plays(family.job(0).scenario, range(num_jobs), lambda ended: None)
    return PolicyRow(f"`{policy}`", episodes["return"], episodes["edges_broken"])


def returns_of_speeds(family: Family, num_jobs: int) -> Floats:
    """Return the returns of ``self_tuning`` with each highest speed [s], shape (jobs, speeds)."""
    jobs = [family.job(number, SPLIT) for number in range(num_jobs)]
    limits = [job.scenario.control.time_limit for job in jobs]
    fixed: Any = RULES["self_tuning"].fixed
    returns = np.empty((num_jobs, len(LOG_SPEEDS)))
    for chunk in chunks_of_similar_length(limits, BATCH):
        models = [jobs[number].scenario.nominal() for number in chunk]
        for column, log_speed in enumerate(LOG_SPEEDS):
            top_speed = START_SHARE * float(exp(log_speed))
            policy = SelfTuning(models, len(chunk), top_speed=top_speed, change_at=LIFE, **fixed)
            ended = play_family(family, SPLIT, chunk, make_policy=given(policy), context="hidden")
            returns[chunk, column] = ended["return"]
    return returns


def by_regression(returns: Floats, context: Floats) -> PolicyRow:
    """Return the row of a highest speed by ridge regression on the context.

    The regression predicts the return at each speed of the grid. Each job takes the speed that is
    best by the regression on the jobs of the other folds.

    Args:
        returns: returns of the jobs at the speeds of the grid [s], shape (jobs, speeds).
        context: standardised numbers of the context, shape (jobs, numbers).
    """
    folds = np.arange(len(returns)) % FOLDS
    choices = np.empty(len(returns), np.int64)
    for fold in range(FOLDS):
        left_out = folds == fold
        known_returns = returns[~left_out]
        known_context = context[~left_out]
        mean_returns = known_returns.mean(axis=0)
        mean_context = known_context.mean(axis=0)
        centred = known_context - mean_context
        normal = centred.T @ centred + RIDGE * np.eye(context.shape[1])
        slopes = np.linalg.solve(normal, centred.T @ (known_returns - mean_returns))
        predicted = mean_returns + (context[left_out] - mean_context) @ slopes
        choices[left_out] = predicted.argmax(axis=1)
    chosen = returns[np.arange(len(returns)), choices]
    return PolicyRow("speed by regression on the context", chosen)


def worth(family: Family, num_jobs: int) -> list[dict[str, str]]:
    """Return the table of what knowing the forms is worth."""
    returns = returns_of_speeds(family, num_jobs)
    rows = []
    for column, log_speed in enumerate(LOG_SPEEDS):
        share = float(np.exp(log_speed))
        title = f"`self_tuning`, at most {share:.2f} start speeds"
        rows.append(PolicyRow(title, returns[:, column]))
    context = np.array([family.job(number, SPLIT).context for number in range(num_jobs)])
    rows.append(by_regression(returns, context))
    strongest = max(rows, key=lambda row: row.returns.mean())
    rows.append(by_known_forms(family, num_jobs))
    rows.append(played(family, CAUSAL, num_jobs))
    return [cells(row, strongest) for row in rows]


def cells(row: PolicyRow, strongest: PolicyRow) -> dict[str, str]:
    """Return the cells of a row, by heading."""
    bootstrap = Bootstrap(len(row.returns))

    def mean_text(numbers: Floats) -> str:
        """Return a mean over the jobs with its interval."""
        replicates = bootstrap.means(numbers[np.newaxis], row.policy)
        mean = Estimate.of(numbers.mean(), replicates)
        return f"{mean.value:.0f} ({mean.low:.0f} to {mean.high:.0f})"

    # The strongest rule is not compared with itself.
    over_strongest = ""
    median = ""
    if row.policy != strongest.policy:
        lead = row.returns - strongest.returns
        over_strongest = mean_text(lead)
        median = f"{np.median(lead):.0f}"
    broken = ""
    if row.edges_broken is not None:
        broken = f"{row.edges_broken.mean():.2f}"
    return {
        "Policy": row.policy,
        "Return [s]": mean_text(row.returns),
        "Over the strongest rule [s]": over_strongest,
        "Median [s]": median,
        "Edges broken per job": broken,
    }


def probe(family: Family, num_jobs: int) -> list[dict[str, str]]:
    """Return the table of how well the forms are predicted."""
    jobs = [family.job(number, SPLIT) for number in range(num_jobs)]
    context = np.array([job.context for job in jobs])
    present = [forms_of(job) for job in jobs]
    history = explored(family, SPLIT, num_jobs)
    rows = []
    for form in present[0]:
        has_form = np.array([forms[form] for forms in present])
        row = {"Form": form, "There [% of jobs]": f"{100.0 * has_form.mean():.0f}"}
        for title, numbers in (("history of two edges", history), ("context", context)):
            scores = left_out_scores(numbers, has_form)
            area, low, high = area_with_interval(scores, has_form)
            row[f"AUC, {title}"] = f"{area:.2f} ({low:.2f} to {high:.2f})"
        rows.append(row)
    return rows


@exits(ValueError)
def main(arguments: Sequence[str] | None = None) -> int:
    """Print the tables; return the exit status."""
    parser = argparse.ArgumentParser(
        prog="python -m research.studies.unmodelled_draw", **described(__doc__)
    )
    add = parser.add_argument
    add("family", nargs="?", default="unmodelled", help="family (default: %(default)s)")
    add("--part", choices=PARTS, help="the one table to print (default: both)")
    add(
        "--jobs",
        type=positive,
        help=f"training jobs (default: {WORTH_JOBS} for worth, {PROBE_JOBS} for probe)",
    )
    options = parser.parse_args(arguments)
    family = Family.load(options.family)
    if options.part != "probe":
        print(markdown(worth(family, options.jobs or WORTH_JOBS)), flush=True)
    if options.part != "worth":
        print()
        print(markdown(probe(family, options.jobs or PROBE_JOBS)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
