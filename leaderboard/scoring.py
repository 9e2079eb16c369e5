"""Score a policy in one line: play it on the held-out seeds and rank it among shipped results.

While you develop, score on the validation seeds, which few shipped policies have played.
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

from baselines.policy_spec import PolicySpec
from leaderboard.adapt import as_factory
from leaderboard.agents.sandbox import LIMITS, ProcessLimits
from leaderboard.play import Episodes, play, play_family
from leaderboard.result import ExcessShares
from leaderboard.seeds import MAX_SEEDS, held_out_seeds, tuning_seeds
from leaderboard.standings import Overload, Played, Standing, rank_together
from leaderboard.statistics import VERDICTS_IN_WORDS, Estimate
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

SHIPPED_FIELDS = {
    "return": "returns",
    "severe_overload_time": "severe",
    "engaged_time": "engaged",
}
"""Fields of episodes that ship, with their keys in the files."""
THIS_POLICY = ""
"""Name of the scored policy among those that ship; of two that are equal, it comes first."""

Split = Literal["held_out", "validation"]
"""Held-out seeds are for a final score, validation seeds for choices. Those of an id are the tuning
seeds, those of a family the jobs of its split "validation"."""


@cache
def shipped(board: str, seeds: int | None = None) -> tuple[Played, ...]:
    """Return the episodes of every policy on a leaderboard.

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
def shipped_validation(board: str, seeds: int) -> tuple[Played, ...]:
    """Return the episodes of the score's ends and the best rule on the first validation seeds.

    Return none for a task that does not ship, or if there are more than ``VALIDATION_SEEDS`` seeds.
    """
    path = VALIDATION_FOLDER / f"{board}.json.xz"
    if seeds > VALIDATION_SEEDS or not path.is_file():
        return ()
    return _read(path, seeds)


def _read(path: Path, seeds: int | None) -> tuple[Played, ...]:
    """Return the episodes in a file, on the first ``seeds`` seeds."""
    policies = []
    for values in json.loads(lzma.decompress(path.read_bytes()))["policies"]:
        episodes = {}
        for field_name, key in SHIPPED_FIELDS.items():
            episodes[field_name] = np.array(values[key])[:, :seeds]
        policies.append(Played(name=values["name"], kind=values["kind"], episodes=episodes))
    return tuple(policies)


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
    standing: Standing
    """The policy among those in ``others``."""
    others: tuple[Standing, ...]
    """Every policy that ships, best first, oracles last. On validation seeds, the best fixed speed
    and feed, the best rule and the oracle."""
    episodes: Episodes = field(repr=False)
    """``leaderboard.play.EPISODE_FIELDS`` of every episode, shape (seeds,)."""

    @property
    def seeds(self) -> int:
        """Number of seeds."""
        return len(self.standing.returns[0])

    @property
    def rank(self) -> int | None:
        """Rank among this policy and the ranked ones that ship; None if there is none.

        Feasible policies are first, then those of higher mean return, as in ``leaderboard run``.
        There is none if ``warning`` says why, or on validation seeds, which few policies have
        played: see ``validation_rank``.
        """
        if self.split == "validation" or not self._ranked_others():
            return None
        return self.standing.rank

    @property
    def validation_rank(self) -> int | None:
        """Rank on validation seeds among the few policies that have played them.

        None on held-out seeds, or if there is no rank.
        """
        if self.split == "held_out" or not self._ranked_others():
            return None
        return self.standing.rank

    @property
    def ranked(self) -> int:
        """Number of ranked policies on these seeds, including this one if it has a rank."""
        has_rank = self.rank is not None or self.validation_rank is not None
        return len(self._ranked_others()) + has_rank

    @property
    def mean_return(self) -> Estimate:
        """Mean return [s of machine time]."""
        return self.standing.mean_return.estimate

    @property
    def score(self) -> Estimate | None:
        """Score from the best fixed speed and feed, 0, to the oracle of the state, 100.

        None if these have no results to compare with.
        """
        return None if self.standing.score is None else self.standing.score.estimate

    @property
    def feasible(self) -> bool:
        """Whether the upper confidence limit of severe overload is within the allowance."""
        return self.standing.feasible

    @property
    def overload(self) -> Overload:
        """Shares of cutting time over a limit [-], and the verdict on feasibility."""
        return self.standing.overload

    @property
    def warning(self) -> str | None:
        """Why the policy has no rank among those that ship; None if it has one."""
        unranked = self.standing.unranked
        return f"the leaderboard ranks rules only: {unranked}" if unranked else None

    def _ranked_others(self) -> list[Standing]:
        return [other for other in self.others if other.unranked is None]

    def table(self) -> str:
        """Return a table with a line per policy that ships.

        Columns are rank, name, return [s], and this policy's return less that [s].
        """
        lines = [_Line("rank", "policy", "return", "difference of this policy", "")]
        better = self._count_better()
        for other in self.others[:better]:
            lines.append(self._line_of(other))
        lines.append(self._line_of_this_policy())
        for other in self.others[better:]:
            lines.append(self._line_of(other))

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
        ranked = self._ranked_others()
        if self.standing.rank is None:
            # Without a rank, this policy follows on those that have one.
            return len(ranked)
        return min(self.standing.rank - 1, len(ranked))

    def _line_of(self, other: Standing) -> _Line:
        """Return the line of another policy."""
        verdict = _note(other)
        if other.kind == "oracle":
            notes = ["oracle"]
        elif other.unranked:
            notes = [verdict, "not ranked"]
        else:
            notes = [verdict]
        has_rank = other.rank is not None and self.split == "held_out"
        return _Line(
            rank=str(other.rank) if has_rank else "",
            policy=other.name,
            mean_return=_interval(other.mean_return.estimate),
            ahead=_interval(self.standing.ahead_of(other), sign="+"),
            note=", ".join(note for note in notes if note),
        )

    def _line_of_this_policy(self) -> _Line:
        return _Line(
            rank="" if self.rank is None else str(self.rank),
            policy="-> this policy",
            mean_return=_interval(self.mean_return),
            ahead="",
            note=_note(self.standing),
        )

    def __str__(self) -> str:
        """Return rank, return, score, difference from the next-ranked policy, and feasibility."""
        parts = [f"return {_interval(self.mean_return)}"]
        if self.score is not None:
            parts.append(f"score {_interval(self.score, unit='')}")
        if self.rank is not None:
            parts.insert(0, f"rank {self.rank} of {self.ranked}")
        rival = self.rival()
        if rival is not None:
            ahead = _interval(self.standing.ahead_of(rival), sign="+")
            parts.append(f"{ahead} against {rival.name}")
        verdict = VERDICTS_IN_WORDS[self.overload.feasibility]
        if not self.feasible:
            verdict += f": {self.overload.severe_share:.1%} of cutting time in severe overload"
        parts.append(verdict)
        lines = [", ".join(parts)]
        if self.warning:
            lines.append(f"no rank: {self.warning}")
        if self.split == "held_out":
            lines.append(HELD_OUT_NOTICE)
        else:
            lines.append(self._validation_notice())
        return "\n".join(lines)

    def _validation_notice(self) -> str:
        """Return the rank on validation seeds, or that there is none."""
        if not self.others:
            return f"{VALIDATION_NOTICE}; no rank: no policy that ships has played them all"
        if self.validation_rank is None:
            return VALIDATION_NOTICE
        others = " and ".join(other.name for other in self._ranked_others())
        place = f"rank {self.validation_rank} of {self.ranked} on them, with {others}"
        return f"{VALIDATION_NOTICE}; {place}; the leaderboard ranks on held-out seeds"

    def rival(self) -> Standing | None:
        """Return the policy with which the line of a score compares.

        It is the one on the next rank, for the last policy the one before it; on validation seeds
        the best rule.
        """
        ranked = self._ranked_others()
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
            "above a limit": self.overload.overload_share,
            "above it by more than 2 %": self.overload.share_above_2_percent,
            "in severe overload": self.overload.severe_share,
            "above it by more than 10 %": self.overload.share_above_10_percent,
        }
        # Episodes that were recorded in other ways may lack some of the times.
        parts = [f"{name}: {share:.2%}" for name, share in shares.items() if share is not None]
        return "share of cutting time " + ", ".join(parts)

    def numbers(self) -> dict[str, Any]:
        """Return all numbers by name, but not the episodes, for JSON."""
        comparisons = [self._comparison(other) for other in self.others]
        return {
            "env_id": self.env_id,
            "split": self.split,
            "seeds": self.seeds,
            "rank": self.rank,
            "validation_rank": self.validation_rank,
            "ranked": self.ranked,
            "mean_return": self.mean_return,
            "score": self.score,
            "feasible": self.feasible,
            "feasibility": self.overload.feasibility,
            "severe_share": self.overload.severe_share,
            "overload_share": self.overload.overload_share,
            "share_above_2_percent": self.overload.share_above_2_percent,
            "share_above_10_percent": self.overload.share_above_10_percent,
            "warning": self.warning,
            "comparisons": comparisons,
        }

    def _comparison(self, other: Standing) -> dict[str, Any]:
        return {
            "name": other.name,
            "kind": other.kind,
            "feasible": other.feasible,
            "feasibility": other.overload.feasibility,
            "unranked": other.unranked,
            "mean_return": other.mean_return.estimate,
            "ahead": self.standing.ahead_of(other),
        }


HELD_OUT_NOTICE = (
    'held-out seeds: score on them once, at the end; split="validation" is for choices'
)
VALIDATION_NOTICE = "validation seeds: for choices"


def _note(standing: Standing) -> str:
    """Return the verdict on feasibility, unless it is favourable."""
    return "" if standing.feasible else VERDICTS_IN_WORDS[standing.overload.feasibility]


def score(
    policy: Any,
    env_id: str = "RoughTurning-v0",
    seeds: int | None = None,
    family: str | None = None,
    limits: ProcessLimits = LIMITS,
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
            unseen jobs, and observations hold the nominal model's numbers. These tell the job, and
            the jobs are published, so a file could hold an answer for each: a claim of the
            challenge counts on private jobs only (``leaderboard run --private-key``).
        seeds: number of seeds; None: all that the leaderboard has, 256 for RoughTurning-v0, or
            256 validation seeds.
        family: preset of a family, if ``env_id`` is the family's; None: ``DEFAULT_FAMILY``.
        limits: limits of time and memory of an ONNX file's process.
        split: "held_out", or "validation" for seeds that only the best fixed speed and feed, the
            best rule and the oracle have played: there is a score, and a rank among these.

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
    others: Sequence[Played],
    split: Split = "held_out",
) -> Score:
    """Rank one policy's episodes among other policies' episodes on the same seeds.

    Args:
        env_id: id of the environment.
        episodes: fields of shape (seeds,).
        scenario: scenario of the episodes, with the allowance of severe overload.
        others: episodes of the other policies; without any, the policy has no rank.
        split: the seeds of the episodes.
    """
    excess = ExcessShares.of(episodes)
    this_policy = Played(
        name=THIS_POLICY,
        kind="agent",
        episodes={name: values[np.newaxis] for name, values in episodes.items()},
        share_above_2_percent=None if excess is None else excess.above_2_percent,
        share_above_10_percent=None if excess is None else excess.above_10_percent,
    )
    standings = rank_together([this_policy, *others], scenario, on_family=env_id == FAMILY_ID)
    (standing,) = (standing for standing in standings if standing.name == THIS_POLICY)
    return Score(
        env_id=env_id,
        split=split,
        standing=standing,
        others=tuple(other for other in standings if other is not standing),
        episodes=episodes,
    )


def _interval(estimate: Estimate, sign: str = "", unit: str = " s") -> str:
    """Return an estimate with its interval, in as many decimals as it is known to."""
    decimals = estimate.decimals()
    value = f"{estimate.value:{sign}.{decimals}f}{unit}"
    return f"{value} ({estimate.low:.{decimals}f} to {estimate.high:.{decimals}f})"
