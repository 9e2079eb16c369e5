"""Score a policy in one line: play it on the held-out seeds and rank it among the results that ship."""

import dataclasses
import json
import lzma
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from turning_env import FAMILY_ID
from turning_env.scenario import Scenario
from turning_env.scenario.family import Family
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.family import play_family
from turning_env.scoring.play import Episodes, play
from turning_env.scoring.seeds import held_out_seeds
from turning_env.scoring.statistics import Bootstrap, Estimate, Floats, rank_key, severe_share

FOLDER = Path(__file__).parent / "shipped_results"
"""Times of every shipped policy's episodes: a file per id, JSON compressed with xz, made by ``python -m leaderboard pack``."""

FAMILY = ("shop", "unseen_jobs")  # family and split whose first jobs score a policy on ``RoughTurning-Family-v0``


@dataclass(frozen=True)
class Played:
    """A policy's episodes on the held-out seeds: arrays of shape (training seeds, seeds); one row for a rule."""

    name: str
    kind: str  # ``rule``, ``agent`` or ``oracle``
    returns: Floats  # [s of machine time]
    severe: Floats  # time with an excess above the tolerance [s]
    engaged: Floats  # cutting time [s]

    def first(self, count: int) -> "Played":
        """Return the first ``count`` seeds alone."""
        return Played(self.name, self.kind, self.returns[:, :count], self.severe[:, :count], self.engaged[:, :count])


@cache
def shipped(env_id: str) -> tuple[Played, ...]:
    """Return the results of every policy on an id's leaderboard, on the first held-out seeds; ValueError if it has none."""
    path = FOLDER / f"{env_id}.json.xz"
    if not path.is_file():
        known = sorted(each.name.removesuffix(".json.xz") for each in FOLDER.glob("*.json.xz"))
        raise ValueError(f"{env_id!r} has no results to compare with; ids with results: {', '.join(known)}")
    content = json.loads(unpacked(path))
    return tuple(
        Played(each["name"], each["kind"], *(np.array(each[name]) for name in ("returns", "severe", "engaged")))
        for each in content["policies"]
    )


def unpacked(path: Path) -> str:
    """Return the text of a file."""
    return lzma.decompress(path.read_bytes()).decode()


@dataclass(frozen=True)
class Comparison:
    """Comparison with another policy on the same seeds."""

    name: str
    kind: str
    """``rule``, ``agent`` or ``oracle``."""
    feasible: bool
    mean_return: Estimate
    """[s of machine time]"""
    ahead: Estimate
    """Return of the scored policy less the other's [s], paired by seed."""


@dataclass(frozen=True)
class Score:
    """A policy's score on the held-out seeds. Intervals are 95 % confidence intervals by bootstrap over seeds."""

    env_id: str
    seeds: int
    rank: int
    """Rank among this policy and those that ship: feasible ones first, then by mean return. Oracles have no rank."""
    ranked: int
    """Number of ranked policies, including this one."""
    mean_return: Estimate
    """[s of machine time]"""
    feasible: bool
    """Whether the upper confidence limit of ``severe_share`` is within the scenario's allowance."""
    severe_share: float
    """Share of cutting time with an excess above the tolerance [-]."""
    comparisons: tuple[Comparison, ...]
    """Comparisons with every policy that ships, best first; oracles last."""
    episodes: Episodes = dataclasses.field(repr=False)
    """The fields ``turning_env.scoring.play.EPISODE_FIELDS`` of every episode, shape (seeds,)."""

    def table(self) -> str:
        """Return a table with a line per policy that ships: rank, name, return [s], and this policy's return less that [s]."""
        rows = []
        for each in self.comparisons:
            note = "oracle" if each.kind == "oracle" else "" if each.feasible else "not feasible"
            rows.append((each.name, _interval(each.mean_return), _interval(each.ahead, "+"), note))
        rows.insert(self.rank - 1, ("-> this policy", _interval(self.mean_return), "", "" if self.feasible else "not feasible"))
        places = [*map(str, range(1, self.ranked + 1)), *[""] * (len(rows) - self.ranked)]
        head = ("policy", "return", "difference of this policy", "")
        name, mean, ahead, _ = (max(map(len, column)) for column in zip(head, *rows, strict=True))
        lines = (
            f"{place:>4}  {row[0]:<{name}}  {row[1]:>{mean}}  {row[2]:>{ahead}}  {row[3]}"
            for place, row in zip(["rank", *places], [head, *rows], strict=True)
        )
        return "\n".join(line.rstrip() for line in lines)

    def __str__(self) -> str:
        """Return rank, return, difference from the next-ranked policy, and feasibility, for people."""
        ranked = [each for each in self.comparisons if each.kind != "oracle"]
        parts = [f"rank {self.rank} of {self.ranked}", f"return {_interval(self.mean_return)}"]
        for each in ranked[self.rank - 1 : self.rank] or ranked[-1:]:
            parts.append(f"{_interval(each.ahead, '+')} against {each.name}")
        parts.append("feasible" if self.feasible else f"not feasible: {self.severe_share:.1%} of cutting time in overload")
        return ", ".join(parts)


def score(
    policy: Any, env_id: str = "RoughTurning-v0", seeds: int | None = None, on_step: Callable[[int], None] = lambda ended: None
) -> Score:
    """Play a policy on the held-out seeds of an id and compare it, paired by seed, with every policy that ships.

        print(turning_env.score(lambda observations: my_network(observations)))

    Args:
        policy: one of the following; it sees observations and nothing else:

            * a function from observations, float32 of shape (num_envs, entries), to actions in -1..1, (num_envs, actions);
            * an object with ``reset(mask)`` and ``act(observations)``, see ``turning_env.scoring.policy.Policy``;
            * a model of Stable-Baselines3, which acts deterministically;
            * a module of PyTorch, from observations to actions;
            * the path of an ONNX file with the input ``observation`` and the output ``action``; with a memory also ``memory`` and
              ``next_memory``. This needs onnxruntime.
        env_id: id of the environment and of its leaderboard. On the family, seeds are numbers of unseen jobs, and observations
            hold the nominal model's numbers.
        seeds: number of held-out seeds; None: all that the leaderboard has, 256 for RoughTurning-v0.
        on_step: called after each step with the number of episodes that have ended.

    TypeError if the policy is none of these; ValueError if it cannot play, or the id has no leaderboard or fewer seeds.
    """
    others = shipped(env_id)
    available = others[0].returns.shape[1]
    count = available if seeds is None else seeds
    if not 2 <= count <= available:
        raise ValueError(f"seeds is {count}, but must be 2 to {available}")
    if env_id == FAMILY_ID:
        family = Family.load(FAMILY[0])
        scenario = family.job(0).scenario
        episodes = play_family(family, FAMILY[1], range(count), as_factory(policy), on_step=on_step)
    else:
        scenario = Scenario.load(gymnasium.spec(env_id).kwargs["scenario"])
        episodes = play(as_factory(policy), scenario, held_out_seeds(count), on_step)
    return compare(env_id, episodes, scenario, [each.first(count) for each in others])


def compare(env_id: str, episodes: Episodes, scenario: Scenario, others: Sequence[Played]) -> Score:
    """Rank one policy's episodes, fields of shape (seeds,), among other policies' episodes on the same seeds."""
    mine = Played("", "agent", *(episodes[name][None] for name in ("return", "severe_overload_time", "engaged_time")))
    bootstrap = Bootstrap(mine.returns.shape[1])
    my_means = bootstrap.means(mine.returns, mine.name)

    def feasible(played: Played) -> bool:
        return bootstrap.severe_limit(played.severe, played.engaged, played.name) <= scenario.limits.overload_allowance

    comparisons = []
    for each in others:
        means, mean = bootstrap.means(each.returns, each.name), float(np.mean(each.returns))
        ahead = Estimate.of(float(np.mean(mine.returns)) - mean, my_means - means)
        comparisons.append(Comparison(each.name, each.kind, feasible(each), Estimate.of(mean, means), ahead))
    comparisons.sort(key=lambda each: (rank_key(each.kind, each.feasible, each.mean_return.value), each.name))
    ranked = [each for each in comparisons if each.kind != "oracle"]
    mine_feasible, my_return = feasible(mine), Estimate.of(float(np.mean(mine.returns)), my_means)
    my_key = rank_key(mine.kind, mine_feasible, my_return.value)
    better = sum(rank_key(each.kind, each.feasible, each.mean_return.value) < my_key for each in ranked)
    share, count = severe_share(mine.severe.ravel(), mine.engaged.ravel()), mine.returns.shape[1]
    rank = better + 1, len(ranked) + 1
    return Score(env_id, count, *rank, my_return, mine_feasible, share, tuple(comparisons), episodes)


def _interval(estimate: Estimate, sign: str = "") -> str:
    return f"{estimate.value:{sign}.0f} s ({estimate.low:.0f} to {estimate.high:.0f})"
