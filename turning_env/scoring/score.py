"""Score a policy in one line: play it on the held-out seeds and rank it among the results that ship."""

import json
import lzma
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from turning_env import FAMILY_ID
from turning_env.batch.driver import observation_space
from turning_env.scenario import Scenario
from turning_env.scenario.family import Family
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.play import Episodes, play, play_family
from turning_env.scoring.sandbox import LIMITS, Limits
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.statistics import (
    Bootstrap,
    Estimate,
    Feasibility,
    Floats,
    RankKey,
    feasibility,
    rank_key,
    reason_not_to_rank,
    severe_share,
)

FOLDER = Path(__file__).parent / "shipped_results"
"""Times of every shipped policy's episodes: a file per id or family, JSON compressed with xz, made by ``leaderboard pack``."""

SPLIT = "unseen_jobs"  # split whose first jobs score a policy on a family


@dataclass(frozen=True)
class Played:
    """A policy's episodes on the held-out seeds: arrays of shape (training seeds, seeds); one row for a rule."""

    name: str
    kind: str  # ``rule``, ``agent`` or ``oracle``
    returns: Floats  # [s of machine time]
    severe: Floats  # time with an excess above the tolerance [s]
    engaged: Floats  # cutting time [s]


@cache
def shipped(board: str, seeds: int | None = None) -> tuple[Played, ...]:
    """Return the results of every policy on the board of an id, or ``FAMILY_ID-NAME``, on the first held-out seeds or all."""
    path = FOLDER / f"{board}.json.xz"
    if not path.is_file():
        known = sorted(each.name.removesuffix(".json.xz") for each in FOLDER.glob("*.json.xz"))
        raise ValueError(
            f"{board!r} has no results to compare with; there are those of {', '.join(known)}"
        )
    return tuple(
        Played(
            each["name"],
            each["kind"],
            *(np.array(each[name])[:, :seeds] for name in ("returns", "severe", "engaged")),
        )
        for each in json.loads(lzma.decompress(path.read_bytes()))["policies"]
    )


@dataclass(frozen=True)
class Comparison:
    """Comparison with another policy on the same seeds."""

    name: str
    kind: str  # ``rule``, ``agent`` or ``oracle``
    feasible: bool
    feasibility: Feasibility  # "not shown" if the allowance lies between the confidence limits of the severe share
    unranked: str | None  # why it has no rank; None if it has one
    mean_return: Estimate  # [s of machine time]
    ahead: Estimate  # return of the scored policy less the other's [s], paired by seed


@dataclass(frozen=True)
class Score:
    """A policy's score on the held-out seeds. Intervals are 95 % confidence intervals by bootstrap over seeds."""

    env_id: str
    seeds: int
    rank: int  # among this policy and those ranked that ship: feasible ones first, then by mean return; see ``warning``
    ranked: int  # number of ranked policies, including this one
    mean_return: Estimate  # [s of machine time]
    feasible: bool  # whether the upper confidence limit of ``severe_share`` is within the scenario's allowance
    feasibility: Feasibility  # "not shown" if the allowance lies between the confidence limits of ``severe_share``
    severe_share: float  # share of cutting time with an excess above the tolerance [-]
    overload_share: float  # share of cutting time above a limit [-]
    share_above_2_percent: float  # share of cutting time above a limit by more than 2 % [-]
    share_above_10_percent: float  # share of cutting time above a limit by more than 10 % [-]
    warning: str | None  # why the rank says little; on the leaderboard, such a policy has none
    comparisons: tuple[Comparison, ...]  # with every policy that ships, best first; oracles last
    episodes: Episodes = field(
        repr=False
    )  # ``turning_env.scoring.play.EPISODE_FIELDS`` of every episode, shape (seeds,)

    def table(self) -> str:
        """Return a table with a line per policy that ships: rank, name, return [s], and this policy's return less that [s]."""
        rows = []
        for each in self.comparisons:
            note = "oracle" if each.kind == "oracle" else _NOTES[each.feasibility]
            if each.unranked and each.kind != "oracle":
                note = f"{note}, not ranked".removeprefix(", ")
            rows.append((each.name, _interval(each.mean_return), _interval(each.ahead, "+"), note))
        rows.insert(
            self.rank - 1,
            ("-> this policy", _interval(self.mean_return), "", _NOTES[self.feasibility]),
        )
        rows.insert(0, ("policy", "return", "difference of this policy", ""))
        name, mean, ahead, _ = (max(map(len, column)) for column in zip(*rows, strict=True))
        places = ["rank", *range(1, self.ranked + 1), *[""] * (len(rows) - self.ranked - 1)]
        lines = zip(places, rows, strict=True)
        return "\n".join(
            f"{at:>4}  {a:<{name}}  {b:>{mean}}  {c:>{ahead}}  {d}".rstrip()
            for at, (a, b, c, d) in lines
        )

    def __str__(self) -> str:
        """Return rank, return, difference from the next-ranked policy, and feasibility, for people."""
        ranked = [each for each in self.comparisons if each.unranked is None]
        parts = [f"rank {self.rank} of {self.ranked}", f"return {_interval(self.mean_return)}"]
        parts += [
            f"{_interval(one.ahead, '+')} against {one.name}"
            for one in ranked[self.rank - 1 : self.rank] or ranked[-1:]
        ]
        if self.feasible:
            parts.append("feasible")
        else:
            parts.append(
                f"{_NOTES[self.feasibility]}: {self.severe_share:.1%} of cutting time in severe overload"
            )
        warning = f"\nwarning: {self.warning}" if self.warning else ""
        return ", ".join(parts) + warning

    def load(self) -> str:
        """Return the shares of cutting time above a limit, in all and by more than 2 %, severely, and by more than 10 %."""
        shares = {
            "above a limit": self.overload_share,
            "by more than 2 %": self.share_above_2_percent,
            "severely": self.severe_share,
            "by more than 10 %": self.share_above_10_percent,
        }
        return "share of cutting time " + ", ".join(
            f"{name}: {share:.2%}" for name, share in shares.items()
        )


_NOTES: dict[Feasibility, str] = {
    "feasible": "",
    "not shown": "feasibility not shown",
    "infeasible": "infeasible",
}


def score(
    policy: Any,
    env_id: str = "RoughTurning-v0",
    seeds: int | None = None,
    family: str = "shop",
    limits: Limits = LIMITS,
) -> Score:
    """Play a policy on the held-out seeds of an id and compare it, paired by seed, with every policy that ships.

        print(turning_env.score(lambda observations: my_network(observations)))

    Args:
        policy: one of the following; it sees observations and nothing else:

            * a function from observations, float32 of shape (num_envs, entries), to actions in -1..1, (num_envs, actions);
            * an object with ``reset(mask)`` and ``act(observations)``, see ``turning_env.scoring.policy.Policy``;
            * a model of Stable-Baselines3, which acts deterministically; the ``VecNormalize`` of its environment, if it has one,
              normalises the observations;
            * a module of PyTorch, from observations to actions;
            * the path of an ONNX file with the input ``observation`` and the output ``action``; with a memory also ``memory`` and
              ``next_memory``. All weights must be inside. This needs onnxruntime. The file may come from anywhere: it plays in a
              process of its own (``turning_env.scoring.sandbox``). All else runs in this process.
        env_id: id of the environment and of its leaderboard. On the family, seeds are numbers of unseen jobs, and observations
            hold the nominal model's numbers.
        seeds: number of held-out seeds; None: all that the leaderboard has, 256 for RoughTurning-v0.
        family: preset of a family, if ``env_id`` is a family's.
        limits: limits of time and memory of an ONNX file's process.

    TypeError if the policy is none of these; ValueError if it cannot play, or the id has no leaderboard or fewer seeds;
    its subclass ``AgentFileError`` if an ONNX file is refused or exceeds a limit.
    """
    board = f"{FAMILY_ID}-{family}" if env_id == FAMILY_ID else env_id
    available = shipped(board)[0].returns.shape[1]
    count = available if seeds is None else seeds
    if not 2 <= count <= available:
        raise ValueError(f"seeds is {count}, but must be 2 to {available}")
    if env_id == FAMILY_ID:
        jobs = Family.load(family)
        scenario = jobs.job(0).scenario
        space = observation_space(scenario, len(jobs.context_names))
        episodes = play_family(jobs, SPLIT, range(count), as_factory(policy, limits, space))
    else:
        scenario = Scenario.load(gymnasium.spec(env_id).kwargs["scenario"])
        episodes = play(
            as_factory(policy, limits, observation_space(scenario)), scenario, held_out_seeds(count)
        )
    return compare(env_id, episodes, scenario, shipped(board, count))


def compare(env_id: str, episodes: Episodes, scenario: Scenario, others: Sequence[Played]) -> Score:
    """Rank one policy's episodes, fields of shape (seeds,), among other policies' episodes on the same seeds."""
    mine = Played(
        "",
        "agent",
        *(episodes[name][None] for name in ("return", "severe_overload_time", "engaged_time")),
    )
    bootstrap = Bootstrap(mine.returns.shape[1])
    my_means, my_mean = bootstrap.means(mine.returns, mine.name), float(np.mean(mine.returns))

    def compared(each: Played) -> Comparison:
        limits = bootstrap.severe_limits(each.severe, each.engaged, each.name)
        verdict = feasibility(limits, scenario.limits.overload_allowance)
        means, mean = bootstrap.means(each.returns, each.name), float(np.mean(each.returns))
        mean_return, ahead = Estimate.of(mean, means), Estimate.of(my_mean - mean, my_means - means)
        return Comparison(
            name=each.name,
            kind=each.kind,
            feasible=verdict == "feasible",
            feasibility=verdict,
            unranked=reason_not_to_rank(each.kind, scenario),
            mean_return=mean_return,
            ahead=ahead,
        )

    def key(each: Comparison) -> RankKey:
        return rank_key(each.kind, each.feasible, each.mean_return.value, each.unranked)

    me = compared(mine)
    comparisons = tuple(sorted(map(compared, others), key=lambda each: (key(each), each.name)))
    ranked = [each for each in comparisons if each.unranked is None]
    # A policy without a rank is told its place among the ranked all the same, with a warning.
    place = rank_key(me.kind, me.feasible, me.mean_return.value)
    engaged = mine.engaged.ravel()

    def share(field: str) -> float:
        return severe_share(np.asarray(episodes.get(field, np.zeros(len(engaged)))), engaged)

    return Score(
        env_id=env_id,
        seeds=len(engaged),
        rank=1 + sum(key(each) < place for each in ranked),
        ranked=len(ranked) + 1,
        mean_return=me.mean_return,
        feasible=me.feasible,
        feasibility=me.feasibility,
        severe_share=share("severe_overload_time"),
        overload_share=share("overload_time"),
        share_above_2_percent=share("overload_2_percent_time"),
        share_above_10_percent=share("overload_10_percent_time"),
        warning=f"the leaderboard ranks rules only: {me.unranked}" if me.unranked else None,
        comparisons=comparisons,
        episodes=episodes,
    )


def _interval(estimate: Estimate, sign: str = "") -> str:
    decimals = estimate.decimals()
    return f"{estimate.value:{sign}.{decimals}f} s ({estimate.low:.{decimals}f} to {estimate.high:.{decimals}f})"
