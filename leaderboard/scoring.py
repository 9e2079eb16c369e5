"""Score a policy in one line: play it on the held-out seeds and rank it among shipped results.

While you develop, score on the validation seeds, which have a score but no ranking.
"""

import json
import lzma
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import gymnasium
import numpy as np

from baselines.comparators import CAUSAL, comparators
from baselines.policy_spec import PolicySpec
from leaderboard.adapt import as_factory
from leaderboard.agents.sandbox import LIMITS, Limits
from leaderboard.play import Episodes, play, play_family
from leaderboard.seeds import MAX_SEEDS, held_out_seeds, tuning_seeds
from leaderboard.statistics import (
    Bootstrap,
    Estimate,
    Feasibility,
    Floats,
    Mean,
    RankKey,
    feasibility,
    rank_key,
    reason_not_to_rank,
    score_of,
    severe_share,
)
from turning_env import ALL_IDS, FAMILY_ID
from turning_env.batch.driver import observation_space
from turning_env.scenario import Scenario
from turning_env.scenario.arguments import id_instead
from turning_env.scenario.family import Family, families

FOLDER = Path(__file__).parent / "shipped_results"
"""Times of every shipped policy's episodes, made by ``leaderboard pack``.

There is a file per id or family: JSON compressed with xz.
"""

VALIDATION_FOLDER = Path(__file__).parent / "validation_results"
"""The same of the ends of the score and the best rule on the first validation seeds, made by
``leaderboard pack --validation``."""

DEFAULT_FAMILY = "shop"
SPLIT = "unseen_jobs"  # split whose first jobs score a policy on a family
VALIDATION_SEEDS = 256  # number of validation seeds without another, and of those that ship

Split = Literal["held_out", "validation"]
"""Held-out seeds are for a final score, validation seeds for choices. Those of an id are the tuning
seeds, those of a family the jobs of its split "validation"."""


@dataclass(frozen=True)
class PolicyResult:
    """A policy's episodes on the held-out seeds.

    Arrays have the shape (training seeds, seeds), with one row for a rule.
    """

    name: str
    kind: str  # ``rule``, ``agent`` or ``oracle``
    returns: Floats  # [s of machine time]
    severe: Floats  # time with an excess above the tolerance [s]
    engaged: Floats  # cutting time [s]


@cache
def shipped(board: str, seeds: int | None = None) -> tuple[PolicyResult, ...]:
    """Return the results of every policy on a leaderboard.

    Args:
        board: an id, or ``FAMILY_ID-NAME``.
        seeds: number of held-out seeds, the first of all; None: all.

    Raises:
        ValueError: no results of this leaderboard ship.
    """
    path = FOLDER / f"{board}.json.xz"
    if not path.is_file():
        boards = sorted(file.name.removesuffix(".json.xz") for file in FOLDER.glob("*.json.xz"))
        raise ValueError(f"{board!r} has no results to compare with; {id_instead(board, boards)}")
    return _read(path, seeds)


@cache
def shipped_validation(board: str, seeds: int) -> tuple[PolicyResult, ...]:
    """Return the results of the score's ends and the best rule on the first validation seeds.

    Return none for a task that does not ship, or if there are more than ``VALIDATION_SEEDS`` seeds.
    """
    path = VALIDATION_FOLDER / f"{board}.json.xz"
    if seeds > VALIDATION_SEEDS or not path.is_file():
        return ()
    return _read(path, seeds)


def _read(path: Path, seeds: int | None) -> tuple[PolicyResult, ...]:
    """Return the results in a file, on the first ``seeds`` seeds."""
    results = []
    for policy in json.loads(lzma.decompress(path.read_bytes()))["policies"]:
        results.append(
            PolicyResult(
                name=policy["name"],
                kind=policy["kind"],
                returns=np.array(policy["returns"])[:, :seeds],
                severe=np.array(policy["severe"])[:, :seeds],
                engaged=np.array(policy["engaged"])[:, :seeds],
            )
        )
    return tuple(results)


@dataclass(frozen=True)
class Comparison:
    """Comparison with another policy on the same seeds."""

    name: str
    kind: str  # ``rule``, ``agent`` or ``oracle``
    feasible: bool
    feasibility: Feasibility
    """"not shown" if the allowance lies between the confidence limits of the severe share."""
    unranked: str | None  # why it has no rank; None if it has one
    mean_return: Estimate  # [s of machine time]
    ahead: Estimate  # return of the scored policy less the other's [s], paired by seed


class _Line(NamedTuple):
    """A line of the table of a score."""

    rank: str
    policy: str
    mean_return: str
    ahead: str
    note: str


@dataclass(frozen=True)
class Score:
    """A policy's score on the held-out or the validation seeds.

    Intervals are 95 % confidence intervals by bootstrap over seeds.
    """

    env_id: str
    split: Split
    seeds: int
    rank: int | None
    """Rank among this policy and the ranked ones that ship: feasible ones first, then by mean
    return. It is the rank that ``leaderboard run`` gives. None if there is none: see ``warning``.
    None on validation seeds, which only the ends of ``score`` and the best rule have played."""
    ranked: int  # number of ranked policies, including this one if it has a rank
    mean_return: Estimate  # [s of machine time]
    score: Estimate | None
    """Score on the scale from the best fixed speed and feed, 0, to the oracle of the state, 100;
    None if these have no results to compare with."""
    feasible: bool
    """Whether the upper confidence limit of ``severe_share`` is within the scenario's
    allowance."""
    feasibility: Feasibility
    """"not shown" if the allowance lies between the confidence limits of ``severe_share``."""
    severe_share: float  # share of cutting time with an excess above the tolerance [-]
    overload_share: float  # share of cutting time above a limit [-]
    share_above_2_percent: float  # share of cutting time above a limit by more than 2 % [-]
    share_above_10_percent: float  # share of cutting time above a limit by more than 10 % [-]
    warning: str | None
    """Why the policy has no rank among those that ship; None if it has one."""
    comparisons: tuple[Comparison, ...]
    """With every policy that ships, best first, oracles last. On validation seeds, with the best
    fixed speed and feed, the best rule and the oracle."""
    episodes: Episodes = field(repr=False)
    """``leaderboard.play.EPISODE_FIELDS`` of every episode, shape (seeds,)."""

    def table(self) -> str:
        """Return a table with a line per policy that ships.

        Columns are rank, name, return [s], and this policy's return less that [s].
        """
        lines = [_Line("rank", "policy", "return", "difference of this policy", "")]
        better = self._count_better()
        for comparison in self.comparisons[:better]:
            lines.append(self._line_of(comparison, rank=len(lines)))
        lines.append(self._line_of_this_policy())
        for comparison in self.comparisons[better:]:
            lines.append(self._line_of(comparison, rank=len(lines)))

        policy_width = max(len(line.policy) for line in lines)
        return_width = max(len(line.mean_return) for line in lines)
        ahead_width = max(len(line.ahead) for line in lines)
        texts = []
        for line in lines:
            text = (
                f"{line.rank:>4}  {line.policy:<{policy_width}}  "
                f"{line.mean_return:>{return_width}}  {line.ahead:>{ahead_width}}  {line.note}"
            )
            texts.append(text.rstrip())
        return "\n".join(texts)

    def _count_better(self) -> int:
        """Return the number of policies above this one in the table."""
        ranked = [policy for policy in self.comparisons if policy.unranked is None]
        if self.warning is not None:
            # Without a rank, this policy follows on those that have one.
            return len(ranked)
        key = rank_key("agent", self.feasible, merit=self.mean_return.value)
        return sum(_key(policy) < key for policy in ranked)

    def _line_of(self, comparison: Comparison, rank: int) -> _Line:
        """Return the line of another policy."""
        if comparison.kind == "oracle":
            notes = ["oracle"]
        elif comparison.unranked:
            notes = [_NOTES[comparison.feasibility], "not ranked"]
        else:
            notes = [_NOTES[comparison.feasibility]]
        has_rank = comparison.unranked is None and self.split == "held_out"
        return _Line(
            rank=str(rank) if has_rank else "",
            policy=comparison.name,
            mean_return=_interval(comparison.mean_return),
            ahead=_interval(comparison.ahead, sign="+"),
            note=", ".join(note for note in notes if note),
        )

    def _line_of_this_policy(self) -> _Line:
        return _Line(
            rank="" if self.rank is None else str(self.rank),
            policy="-> this policy",
            mean_return=_interval(self.mean_return),
            ahead="",
            note=_NOTES[self.feasibility],
        )

    def __str__(self) -> str:
        """Return rank, return, score, difference from the next-ranked policy, and feasibility."""
        parts = [f"return {_interval(self.mean_return)}"]
        if self.score is not None:
            parts.append(f"score {_interval(self.score, unit='')}")
        if self.rank is not None:
            parts.insert(0, f"rank {self.rank} of {self.ranked}")
        rival = self._rival()
        if rival is not None:
            parts.append(f"{_interval(rival.ahead, sign='+')} against {rival.name}")
        if self.feasible:
            parts.append("feasible")
        else:
            share = f"{self.severe_share:.1%} of cutting time in severe overload"
            parts.append(f"{_NOTES[self.feasibility]}: {share}")
        lines = [", ".join(parts)]
        if self.warning:
            lines.append(f"no rank: {self.warning}")
        if self.split == "held_out":
            lines.append(HELD_OUT_NOTICE)
        elif self.comparisons:
            lines.append(VALIDATION_NOTICE)
        else:
            lines.append(UNCOMPARED_NOTICE)
        return "\n".join(lines)

    def _rival(self) -> Comparison | None:
        """Return the policy with which the line of a score compares.

        It is the one on the next rank, for the last policy the one before it; on validation seeds
        the best rule.
        """
        ranked = [policy for policy in self.comparisons if policy.unranked is None]
        if self.split == "validation":
            nearest = ranked[:1]
        elif self.rank is None:
            nearest = []
        else:
            nearest = ranked[self.rank - 1 : self.rank] or ranked[-1:]
        return nearest[0] if nearest else None

    def load(self) -> str:
        """Return the shares of cutting time above a limit, and above it by how much."""
        shares = {
            "above a limit": self.overload_share,
            "above it by more than 2 %": self.share_above_2_percent,
            "in severe overload": self.severe_share,
            "above it by more than 10 %": self.share_above_10_percent,
        }
        parts = [f"{name}: {share:.2%}" for name, share in shares.items()]
        return "share of cutting time " + ", ".join(parts)


HELD_OUT_NOTICE = (
    'held-out seeds: score on them once, at the end; split="validation" is for choices'
)
VALIDATION_NOTICE = "validation seeds: for choices; ranks are on the held-out seeds"
UNCOMPARED_NOTICE = "validation seeds: for choices; no policy that ships has played them all"

_NOTES: dict[Feasibility, str] = {
    "feasible": "",
    "not shown": "feasibility not shown",
    "infeasible": "infeasible",
}


def score(
    policy: Any,
    env_id: str = "RoughTurning-v0",
    seeds: int | None = None,
    family: str | None = None,
    limits: Limits = LIMITS,
    split: Split = "held_out",
) -> Score:
    """Play a policy on seeds of an id, and compare it with every policy that ships.

        print(leaderboard.score(my_network, split="validation"))
        print(leaderboard.score(my_network))

    By default, it plays the held-out seeds, on which leaderboards rank: whoever chooses by them
    overestimates the choice. While you develop, pass ``split="validation"``. Two policies of your
    own are paired by seed: compare ``episodes["return"]``.

    Args:
        policy: one of the following; it sees observations and nothing else:

            * a function from observations, float32 of shape (num_envs, entries), to actions in
              -1..1, (num_envs, actions);
            * an object with ``reset(mask)`` and ``act(observations)``, see
              ``turning_env.policy.Policy``;
            * a rule for one scenario, from ``baselines.catalogue.spec``;
            * a model of Stable-Baselines3, which acts deterministically; the ``VecNormalize`` of
              its environment, if it has one, normalises the observations;
            * a module of PyTorch, from observations to actions, or with an attribute
              ``memory_size`` from observations and memory to actions and the next memory
              (``leaderboard.torch_module``);
            * the path of an ONNX file with the input ``observation`` and the output ``action``;
              with a memory also ``memory`` and ``next_memory``. All weights must be inside. This
              needs onnxruntime. The file may come from anywhere: it plays in a process of its own
              (``leaderboard.agents.sandbox``). All else runs in this process.
        env_id: id of the environment and of its leaderboard. On the family, seeds are numbers of
            unseen jobs, and observations hold the nominal model's numbers.
        seeds: number of seeds; None: all that the leaderboard has, 256 for RoughTurning-v0, or
            256 validation seeds.
        family: preset of a family, if ``env_id`` is the family's; None: ``DEFAULT_FAMILY``.
        limits: limits of time and memory of an ONNX file's process.
        split: "held_out", or "validation" for seeds that only the best fixed speed and feed, the
            best rule and the oracle have played: there is a score, and no rank.

    Raises:
        TypeError: if the policy is none of these.
        ValueError: if the policy cannot play, there is no such id or split, a family is named with
            another id, or the id has no leaderboard or fewer seeds.
        AgentFileError: a ValueError, if an ONNX file is refused or exceeds a limit.
    """
    family = _family_of(env_id, family)
    is_rule = isinstance(policy, PolicySpec) and policy.kind != "agent"
    if family is not None and is_rule:
        raise TypeError(
            f"the rule {policy.name} plays one scenario, but each job of a family is another: "
            f"in a clone, python -m leaderboard run --env {FAMILY_ID} --policies {policy.name} "
            "builds it for each job"
        )
    if split not in get_args(Split):
        message = f'split is {split!r}, but must be "held_out" or "validation"'
        if family is not None:
            message += ": in a clone, python -m leaderboard run --split plays the other jobs"
        raise ValueError(message)
    validates = split == "validation"
    board = env_id if family is None else f"{FAMILY_ID}-{family}"
    jobs = None if family is None else Family.load(family)
    if not validates:
        available = shipped(board)[0].returns.shape[1]
        count = available if seeds is None else seeds
    else:
        available = MAX_SEEDS if jobs is None else jobs.held_out_jobs
        count = min(VALIDATION_SEEDS, available) if seeds is None else seeds
    if not isinstance(count, int | np.integer) or not 2 <= count <= available:
        raise ValueError(f"seeds is {count!r}, but must be a whole number, 2 to {available}")
    count = int(count)

    if jobs is not None:
        scenario = jobs.job(0).scenario
        space = observation_space(scenario, len(jobs.context_names))
        episodes = play_family(
            jobs,
            "validation" if validates else SPLIT,
            seeds=range(count),
            make_policy=as_factory(policy, limits, space=space),
        )
    else:
        scenario = Scenario.load(gymnasium.registry[env_id].kwargs["scenario"])
        episodes = play(
            as_factory(policy, limits, space=observation_space(scenario)),
            scenario,
            seeds=tuning_seeds(count) if validates else held_out_seeds(count),
        )
    others = shipped_validation(board, count) if validates else shipped(board, count)
    return compare(env_id, episodes, scenario=scenario, others=others, split=split)


def _family_of(env_id: str, family: str | None) -> str | None:
    """Return the preset of the family that is scored; None for an id of one scenario.

    ValueError if there is no such id, or if it is not the family's but a family is named.
    """
    if env_id == FAMILY_ID:
        return DEFAULT_FAMILY if family is None else family
    if env_id in families():
        raise ValueError(
            f"{env_id} is a family, not an id: pass {FAMILY_ID!r} and family={env_id!r}"
        )
    registered = gymnasium.registry.get(env_id)
    if registered is None or "scenario" not in registered.kwargs:
        advice = id_instead(str(env_id), ALL_IDS)
        raise ValueError(f"{env_id!r} is no id that can be scored; {advice}")
    if family is not None:
        raise ValueError(
            f"family is {family!r}, but {env_id} has no families: pass {FAMILY_ID!r} as the id"
        )
    return None


def compare(
    env_id: str,
    episodes: Episodes,
    scenario: Scenario,
    others: Sequence[PolicyResult],
    split: Split = "held_out",
) -> Score:
    """Rank one policy's episodes among other policies' episodes on the same seeds.

    Args:
        env_id: id of the environment.
        episodes: fields of shape (seeds,).
        scenario: scenario of the episodes, with the allowance of severe overload.
        others: results of the other policies; without any, the policy has no rank.
        split: the seeds of the episodes.
    """
    result = PolicyResult(
        name="",
        kind="agent",
        returns=episodes["return"][np.newaxis],
        severe=episodes["severe_overload_time"][np.newaxis],
        engaged=episodes["engaged_time"][np.newaxis],
    )
    compared = comparators(scenario, on_family=env_id == FAMILY_ID)
    ranking = _Ranking(result, scenario)
    scored = ranking.comparison(result)
    comparisons = [ranking.comparison(policy) for policy in others]
    comparisons.sort(key=lambda policy: (_key(policy), policy.name))
    ranked = [policy for policy in comparisons if policy.unranked is None]
    rank = None
    if ranked and scored.unranked is None and split == "held_out":
        better = [policy for policy in ranked if _key(policy) < _key(scored)]
        rank = 1 + len(better)
    engaged = episodes["engaged_time"]

    def share(field: str) -> float:
        # Episodes that were recorded in other ways may lack some of the times.
        times = episodes.get(field, np.zeros(len(engaged)))
        return severe_share(np.asarray(times), engaged)

    return Score(
        env_id=env_id,
        split=split,
        seeds=len(engaged),
        rank=rank,
        ranked=len(ranked) + (rank is not None),
        mean_return=scored.mean_return,
        score=ranking.score(others, fixed=compared.fixed),
        feasible=scored.feasible,
        feasibility=scored.feasibility,
        severe_share=share("severe_overload_time"),
        overload_share=share("overload_time"),
        share_above_2_percent=share("overload_2_percent_time"),
        share_above_10_percent=share("overload_10_percent_time"),
        warning=f"the leaderboard ranks rules only: {scored.unranked}" if scored.unranked else None,
        comparisons=tuple(comparisons),
        episodes=episodes,
    )


class _Ranking:
    """Compares a policy's result with others on the same seeds."""

    def __init__(self, result: PolicyResult, scenario: Scenario) -> None:
        self._scenario = scenario
        self._bootstrap = Bootstrap(result.returns.shape[1])
        self._mean = self._mean_of(result)

    def _mean_of(self, policy: PolicyResult) -> Mean:
        replicates = self._bootstrap.means(policy.returns, policy.name)
        return Mean(float(np.mean(policy.returns)), replicates)

    def score(self, others: Sequence[PolicyResult], fixed: str) -> Estimate | None:
        """Return the score between the ends among others; ``fixed``: the name of the lower one."""
        means = {}
        for policy in others:
            if policy.name in (fixed, CAUSAL):
                means[policy.name] = self._mean_of(policy)
        if len(means) < 2:
            return None
        score = score_of(self._mean, fixed=means[fixed], oracle=means[CAUSAL])
        return None if score is None else score.estimate

    def comparison(self, policy: PolicyResult) -> Comparison:
        """Return the comparison with another policy."""
        limits = self._bootstrap.severe_limits(policy.severe, policy.engaged, policy=policy.name)
        verdict = feasibility(limits, self._scenario.limits.overload_allowance)
        mean = self._mean_of(policy)
        return Comparison(
            name=policy.name,
            kind=policy.kind,
            feasible=verdict == "feasible",
            feasibility=verdict,
            unranked=reason_not_to_rank(policy.kind, self._scenario),
            mean_return=mean.estimate,
            ahead=Estimate.of(
                self._mean.value - mean.value, self._mean.replicates - mean.replicates
            ),
        )


def _key(policy: Comparison) -> RankKey:
    return rank_key(
        policy.kind,
        policy.feasible,
        merit=policy.mean_return.value,
        unranked=policy.unranked,
    )


def _interval(estimate: Estimate, sign: str = "", unit: str = " s") -> str:
    """Return an estimate with its interval, in as many decimals as it is known to."""
    decimals = estimate.decimals()
    value = f"{estimate.value:{sign}.{decimals}f}{unit}"
    return f"{value} ({estimate.low:.{decimals}f} to {estimate.high:.{decimals}f})"
