"""Play controllers and agents on unseen jobs of a family, and compare them.

Every controller is built for each job from its nominal model, with the parameters tuned for ``--tuned-on``. "predictive, told
the truth" is built from the true scenario, whose predictions it also observes. An agent plays all jobs; files or run folders of
one name with several training seeds are one policy. A forgetful policy forgets everything at each change of the edge.

    python -m leaderboard.family --jobs 16 --episodes 4
    python -m leaderboard.family --split unseen_materials --policies rescaled_grid_search predictive
    python -m leaderboard.family --agent agents/family_gradient-seed0.onnx --jobs 256 --workers 16 --keep played

A job's score is 0 for the "held optimum" and 1 for the oracle "causal", which is told the true laws and the present depth,
hardness and wear. The table has its interquartile mean over jobs. Leads are over the best controller that is told the nominal
model, job by job; the share of the gap closed is of that from it to the same controller told the truth. Intervals of 95 % are
bootstrapped over jobs. A policy is feasible on a job if its share of cutting time in severe overload is within the scenario's
allowance.
"""

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from baselines.catalogue import RULES, spec
from baselines.oracles.perfect_state import PerfectState
from leaderboard.run import agent_spec
from leaderboard.standings import CAUSAL
from leaderboard.table import aligned
from turning_env import MODEL_VERSION
from turning_env.console import described, exits, print_json
from turning_env.files import replace_file
from turning_env.scenario import Scenario, ScenarioError
from turning_env.scenario.family import CONTEXT_LIMIT, Family
from turning_env.scenario.section import names_instead
from turning_env.scoring.family import Forgetful, HeldOptimum, play_family, play_jobs, relative, truthful
from turning_env.scoring.overload import KEY, RESAMPLES, ratio
from turning_env.scoring.play import Episodes
from turning_env.scoring.policy import Actions, Observations, Policy, PolicyFactory
from turning_env.scoring.statistics import Estimate, Floats, interquartile_mean
from turning_env.scoring.workers import spread, workers

TRUTH, FORGETFUL = ", told the truth", ", forgetful"
ANCHOR = "held optimum"
TOGETHER, APART = 256, 4
"""Numbers of jobs that a worker plays at a time: in one batch, or one by one."""


class Retold(Policy):
    """An agent that may have been trained on another family: the context is standardised as that family's is.

    Args:
        policy: the agent.
        family: family whose jobs it plays.
        told: ``mean`` and ``spread`` of the context in its training; None: as in ``family``.
    """

    def __init__(self, policy: Policy, family: Family, told: Any = None) -> None:
        mean, spread = family.context_scale
        trained = (np.array(told["mean"]), np.array(told["spread"])) if told else (mean, spread)
        self._policy, self._entries = policy, len(mean)
        self._factor, self._offset = spread / trained[1], (mean - trained[0]) / trained[1]

    def reset(self, mask: NDArray[np.bool_]) -> None:
        self._policy.reset(mask)

    def act(self, observations: Observations) -> Actions:
        retold = observations.copy()
        context = retold[:, -self._entries :] * self._factor + self._offset
        retold[:, -self._entries :] = np.clip(context, -CONTEXT_LIMIT, CONTEXT_LIMIT)
        return self._policy.act(retold)


@dataclass(frozen=True)
class Piece:
    """Some jobs for one policy: a controller's name, an anchor's, or the path of an agent."""

    family: Family
    split: str
    numbers: range
    policy: str | Path
    forgetful: bool
    episodes: int
    tuned_on: Scenario
    identity: str
    """Text that differs between policies: version and parameters, or the file's digest."""

    def file(self, folder: Path) -> Path:
        """Return the path at which its episodes are kept."""
        policy = self.identity + FORGETFUL * self.forgetful
        about = [self.family.model_dump(mode="json"), policy, self.episodes, self.tuned_on.digest(), MODEL_VERSION]
        digest = hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:12]
        return folder / f"{self.split}-{self.numbers.start}-{self.numbers.stop}-{digest}.npz"


def keep(path: Path, episodes: Episodes) -> None:
    """Write episodes, whole or not at all."""

    def write(partial: Path) -> None:
        with partial.open("wb") as file:
            np.savez(file, **episodes)  # type: ignore[arg-type]

    replace_file(path, write)


def jobs_at_once(policy: str | Path) -> int:
    """Return the number of jobs of a policy's pieces: few if every job has a policy of its own."""
    rule = RULES.get(str(policy).removesuffix(TRUTH))
    return APART if rule and not rule.together else TOGETHER


def played(piece: Piece) -> Episodes:
    """Return the episodes of a piece, fields of shape (jobs, episodes)."""
    policy, episodes = piece.policy, piece.episodes
    family = truthful(piece.family) if policy == CAUSAL or str(policy).endswith(TRUTH) else piece.family
    jobs = [family.job(number, piece.split) for number in piece.numbers]
    each = [job for job in jobs for _ in range(episodes)]  # of each environment
    scenarios = [job.scenario for job in each]

    def remembering(make: PolicyFactory) -> PolicyFactory:
        return (lambda num_envs: Forgetful(make(num_envs))) if piece.forgetful else make

    if isinstance(policy, Path):
        agent = agent_spec(policy)
        told = agent.parameters.get("context")
        return play_family(family, jobs, remembering(lambda num_envs: Retold(agent.make(num_envs), family, told)), episodes)
    if policy == ANCHOR:
        return play_family(family, jobs, lambda _: HeldOptimum(each), episodes, "hidden")
    if policy == CAUSAL:
        return play_family(family, jobs, lambda num_envs: PerfectState(scenarios, num_envs), episodes, "hidden", tell=True)
    name = policy.removesuffix(TRUTH)
    if RULES[name].together:
        return play_family(family, jobs, remembering(spec(name, scenarios, piece.tuned_on).make), episodes, "hidden")
    return play_jobs(family, jobs, lambda job: remembering(spec(name, job.scenario, piece.tuned_on).make), episodes)


@dataclass(frozen=True)
class Comparison:
    """A policy on the jobs of a split."""

    name: str
    value: Estimate
    """Mean return over jobs [s]."""
    worst: float
    """Lowest return of a job [s]."""
    score: Estimate
    """Interquartile mean over jobs of the return between the two anchors, 0 and 1; NaN if the oracle did not play."""
    lead: Estimate
    """Mean lead over the best controller that is told the nominal model [s]."""
    median: float
    """Median lead [s]."""
    wins: float
    """Share of jobs with a higher return than that controller's."""
    gap_closed: Estimate
    """Mean lead over that of the same controller told the truth; NaN if that did not play or is no better."""
    feasible: float
    """Share of jobs on which it is feasible."""
    overload: float
    """Mean share of cutting time in severe overload."""


def compare(rows: dict[str, Episodes], rules: Sequence[str], allowance: float) -> list[Comparison]:
    """Compare policies on the same jobs.

    Args:
        rows: episodes by policy, fields of shape (jobs, episodes).
        rules: names of the controllers that are told the nominal model; leads are over the best of them.
        allowance: highest share of cutting time in severe overload of a feasible policy.
    """
    returns = {name: each["return"].mean(axis=1) for name, each in rows.items()}
    best = max(rules, key=lambda name: float(returns[name].mean()))
    jobs = len(returns[best])
    resamples = np.random.default_rng(KEY).integers(jobs, size=(RESAMPLES, jobs))

    def scores(values: Floats) -> Estimate:
        if CAUSAL not in returns:
            return Estimate.of(np.nan, np.full(RESAMPLES, np.nan))
        shares = relative(values[:, None], returns[ANCHOR][:, None], returns[CAUSAL][:, None])[:, 0]
        return Estimate.of(float(interquartile_mean(shares)), interquartile_mean(shares[resamples]))

    def means(values: Floats) -> Floats:
        averages: Floats = values[resamples].mean(axis=1)
        return averages

    gap = returns.get(best + TRUTH, returns[best]) - returns[best]
    if gap.mean() <= 0.0:
        gap = np.full(jobs, np.nan)
    found = []
    for name, each in rows.items():
        lead = returns[name] - returns[best]
        shares = ratio(each["severe_overload_time"].sum(axis=1), each["engaged_time"].sum(axis=1))
        found.append(
            Comparison(
                name,
                Estimate.of(returns[name].mean(), means(returns[name])),
                float(returns[name].min()),
                scores(returns[name]),
                Estimate.of(lead.mean(), means(lead)),
                float(np.median(lead)),
                float((lead > 0.0).mean()),
                Estimate.of(lead.mean() / gap.mean(), means(lead) / means(gap)),
                float((shares <= allowance).mean()),
                float(shares.mean()),
            )
        )
    return found


_HEADINGS = (
    ("policy", "return", "95 %", "worst job", "score", "95 %", "lead", "95 %", "median", "better", "gap closed", "95 %",
     "feasible", "overload"),
    ("", "[s]", "[s]", "[s]", "[%]", "[%]", "[s]", "[s]", "[s]", "[% of jobs]", "[%]", "[%]", "[% of jobs]", "[% of time]"),
)  # fmt: skip


def table(comparisons: Sequence[Comparison]) -> str:
    """Return comparisons as text."""

    def cells(estimate: Estimate, factor: float = 1.0) -> Iterator[str]:
        known = np.isfinite(estimate.value)
        yield f"{factor * estimate.value:.0f}" if known else ""
        yield f"{factor * estimate.low:.0f} to {factor * estimate.high:.0f}" if known else ""

    rows: list[Sequence[str]] = list(_HEADINGS)
    for each in comparisons:
        shares = f"{100.0 * each.feasible:.0f}", f"{100.0 * each.overload:.1f}"
        rows.append(
            [each.name, *cells(each.value), f"{each.worst:.0f}", *cells(each.score, 100.0), *cells(each.lead),
             f"{each.median:.1f}", f"{100.0 * each.wins:.0f}", *cells(each.gap_closed, 100.0), *shares]
        )  # fmt: skip
    return aligned(rows)


def joined(episodes: Sequence[Episodes], axis: int) -> Episodes:
    """Join episodes along an axis of their fields."""
    return {name: np.concatenate([each[name] for each in episodes], axis=axis) for name in episodes[0]}


@exits(ScenarioError, ValueError, interrupted="interrupted: with --keep, the same command goes on")
def main(arguments: Sequence[str] | None = None) -> int:
    """Play and print; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m leaderboard.family", **described(__doc__))
    parser.add_argument("--family", default="shop", help="family, or its TOML file (default: %(default)s)")
    parser.add_argument("--split", nargs="+", default=["unseen_jobs"], help="splits (default: unseen_jobs)")
    parser.add_argument("--jobs", type=int, default=16, help="jobs of each split (default: %(default)s)")
    parser.add_argument("--episodes", type=int, default=4, help="episodes of each job (default: %(default)s)")
    parser.add_argument("--policies", nargs="+", default=["rescaled_grid_search", "predictive", f"predictive{TRUTH}", CAUSAL],
                        help="controllers and the oracle (default: rescaled_grid_search; predictive and causal)")  # fmt: skip
    parser.add_argument("--forgetful", action="store_true", help="also play them, and agents, forgetful")
    parser.add_argument("--agent", nargs="+", type=Path, default=[], metavar="AGENT", help="agents: ONNX files or run folders")
    parser.add_argument("--tuned-on", default="shift", help="scenario of their tuned parameters (default: %(default)s)")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes that play (default: %(default)s)")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="folder that keeps what has been played, to go on with")
    parser.add_argument("--json", action="store_true", help="print every episode's return as JSON")
    options = parser.parse_args(arguments)
    if min(options.jobs, options.episodes, options.workers) < 1:
        parser.error("--jobs, --episodes and --workers must be at least 1")
    for name in options.policies:
        if name != CAUSAL and name.removesuffix(TRUTH) not in RULES:
            parser.error(f"there is no controller {name!r}; {names_instead(name, RULES, 'docs/controllers.md')}")
    family, tuned_on = Family.load(options.family), Scenario.load(options.tuned_on)
    for split in options.split:
        family.draw(split, 0)
    agents = {path: agent_spec(path) for path in options.agent}
    policies: list[tuple[str | Path, bool]] = [(each, False) for each in (ANCHOR, *options.policies, *options.agent)]
    if options.forgetful:
        rules_told = [name for name in options.policies if name != CAUSAL and not name.endswith(TRUTH)]
        policies += [(each, True) for each in (*rules_told, *options.agent)]
    known: dict[str | Path, str] = {path: str(agent.sha256) for path, agent in agents.items()}
    rules = {
        name: spec(name.removesuffix(TRUTH), family.job(0).scenario, tuned_on) for name in options.policies if name != CAUSAL
    }
    known |= {ANCHOR: ANCHOR, CAUSAL: f"{CAUSAL} 4"} | {
        name: f"{name} {rule.version} {rule.parameters}" for name, rule in rules.items()
    }
    # Slow policies first, so that no worker is left with a long piece at the end.
    tags = [
        (split, policy, start)
        for policy in reversed(policies)
        for split in options.split
        for start in range(0, options.jobs, jobs_at_once(policy[0]))
    ]
    pieces = {}
    ended: dict[tuple[str, tuple[str | Path, bool], int], Episodes] = {}
    for tag in tags:
        split, policy, start = tag
        numbers = range(start, min(start + jobs_at_once(policy[0]), options.jobs))
        piece = Piece(family, split, numbers, *policy, options.episodes, tuned_on, known[policy[0]])
        if options.keep and piece.file(options.keep).exists():
            with np.load(piece.file(options.keep)) as kept:
                ended[tag] = dict(kept)
        else:
            pieces[tag] = piece
    with workers(options.workers, None) as over:
        for tag, episodes in tqdm(spread(over, played, pieces.items()), total=len(pieces), unit="piece", disable=None):
            ended[tag] = episodes
            if options.keep:
                keep(pieces[tag].file(options.keep), episodes)
    results: dict[str, dict[str, Episodes]] = {}
    for split in options.split:
        rows = results[split] = {}
        for policy in policies:
            of_policy = joined([ended[tag] for tag in tags if tag[:2] == (split, policy)], 0)
            which, forgetful = policy
            name = (agents[which].name if isinstance(which, Path) else which) + FORGETFUL * forgetful
            rows[name] = joined([rows[name], of_policy], 1) if name in rows else of_policy
    if options.json:
        print_json({split: {name: each["return"].tolist() for name, each in rows.items()} for split, rows in results.items()})
        return 0
    allowance = family.job(0).scenario.limits.overload_allowance
    told = [name for name in options.policies if name != CAUSAL and not name.endswith(TRUTH)] or [ANCHOR]
    for split, rows in results.items():
        print(f"{family.name}, {split}, {options.jobs} jobs of {options.episodes} episodes", end="\n\n")
        print(table(compare(rows, told, allowance)), end="\n\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
