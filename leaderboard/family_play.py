"""Play a policy on jobs of a family."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.catalogue import RULES, spec
from baselines.oracles.perfect_state import PerfectState
from leaderboard.family_result import FIELDS, FamilyResult, FamilyTask, Rows
from leaderboard.run import agent_spec, named
from leaderboard.standings import CAUSAL
from turning_env.scenario import Scenario
from turning_env.scenario.family import CONTEXT_LIMIT, Family, Job
from turning_env.scoring.family import Forgetful, HeldOptimum, play_family, play_jobs, truthful
from turning_env.scoring.play import Episodes
from turning_env.scoring.policy import Actions, Observations, Policy, PolicyFactory, PolicySpec

TRUTH, WEAR, FORGETFUL = ", told the truth", ", told the wear", ", forgetful"
TOLD = {TRUTH: "", WEAR: "material.wear."}
"""How the names of the fields begin that a controller is truly told, by the end of its name."""
ANCHOR = "held optimum"
TOGETHER, APART = 256, 4
"""Numbers of jobs that a worker plays at a time: in one batch, or one by one."""
FILLED = 16
"""Agents play a multiple of so many jobs, each at the place of its number: its last bits depend on where it stands in a batch."""


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
    """Some episodes for one policy: a controller's name, an anchor's, or the path of an agent."""

    family: Family
    split: str
    seeds: Sequence[int]
    policy: str | Path
    forgetful: bool
    tuned_on: Scenario | None

    @classmethod
    def again(cls, result: FamilyResult, player: PolicySpec | Path, tuned_on: Scenario | None, seeds: Sequence[int]) -> "Piece":
        """Return the piece that plays some seeds of a result again; ``player``: see ``verify.player_of``."""
        name, forgetful = _told_apart(result.policy.name)
        policy = player if isinstance(player, Path) else name
        return cls(Family.load(result.task.family.name), result.task.split, seeds, policy, forgetful, tuned_on)


def _told_apart(name: str) -> tuple[str, bool]:
    """Return a policy's name without what says that it is forgetful, and whether it is."""
    return name.removesuffix(FORGETFUL), name.endswith(FORGETFUL)


def _rule_and_truth(policy: str) -> tuple[str, str | None]:
    """Return a controller's name without what says that it is told more, and the value of ``TOLD`` for that, if any."""
    for words, right in TOLD.items():
        if policy.endswith(words):
            return policy.removesuffix(words), right
    return policy, None


def spec_of(policy: str | Path, forgetful: bool, family: Family, tuned_on: Scenario | None) -> PolicySpec:
    """Return the identity of a policy that plays a piece.

    Raises:
        OSError, ValueError: there is none, it cannot play the family, or is not tuned.
    """
    if isinstance(policy, Path):
        found = agent_spec(policy)
    elif policy == ANCHOR:
        found = PolicySpec(name=ANCHOR)
    else:
        rule, right = _rule_and_truth(policy)
        (found,) = named([rule], family.job(0).scenario, tuned_on)
        if right is not None:
            found = found.model_copy(update={"name": policy, "kind": "oracle"})
    return found.model_copy(update={"name": found.name + FORGETFUL * forgetful})


def present_spec(name: str, family: Family, tuned_on: Scenario | None) -> PolicySpec:
    """Return the controller or the anchor of a result's name as it is now; raises as ``spec_of``."""
    return spec_of(*_told_apart(name), family, tuned_on)


def jobs_at_once(policy: str | Path) -> int:
    """Return the number of jobs of a policy's pieces: few if every job has a policy of its own."""
    rule = RULES.get(_rule_and_truth(str(policy))[0])
    return APART if rule and not rule.together else TOGETHER


def played(piece: Piece) -> Rows:
    """Return the episodes of a piece by seed."""
    jobs = FamilyTask.of(piece.family, piece.split).jobs
    numbers = sorted({seed % jobs for seed in piece.seeds})
    found = _played(piece, numbers, 1 + max(piece.seeds) // jobs)
    values = np.stack([found[name] for name in FIELDS], axis=-1)
    return {seed: values[numbers.index(seed % jobs), seed // jobs].tolist() for seed in piece.seeds}


def _filled(jobs: Sequence[Job]) -> tuple[list[Job], list[int]]:
    """Return a batch in which every job stands at the place of its number, modulo ``FILLED``, and the jobs' places in it."""
    filled: list[Job] = []
    places = []
    for job in jobs:
        filled += [job] * ((job.number - len(filled)) % FILLED)
        places.append(len(filled))
        filled.append(job)
    return filled + filled[-1:] * (-len(filled) % FILLED), places


def _played(piece: Piece, numbers: Sequence[int], episodes: int) -> Episodes:
    """Return episodes of jobs: fields of shape (jobs, episodes)."""
    policy = piece.policy
    name, right = ("", "") if policy == CAUSAL else _rule_and_truth(str(policy))
    family = piece.family if right is None else truthful(piece.family, right)
    jobs = [family.job(number, piece.split) for number in numbers]
    each = [job for job in jobs for _ in range(episodes)]  # of each environment
    scenarios = [job.scenario for job in each]

    def remembering(make: PolicyFactory) -> PolicyFactory:
        return (lambda num_envs: Forgetful(make(num_envs))) if piece.forgetful else make

    if isinstance(policy, Path):
        agent = agent_spec(policy)
        told = agent.parameters.get("context")
        filled, places = _filled(jobs)
        found = play_family(family, filled, remembering(lambda num_envs: Retold(agent.make(num_envs), family, told)), episodes)
        return {name: values[places] for name, values in found.items()}
    if policy == ANCHOR:
        return play_family(family, jobs, lambda _: HeldOptimum(each), episodes, "hidden")
    if policy == CAUSAL:
        return play_family(family, jobs, lambda num_envs: PerfectState(scenarios, num_envs), episodes, "hidden", tell=True)
    if RULES[name].together:
        return play_family(family, jobs, remembering(spec(name, scenarios, piece.tuned_on).make), episodes, "hidden")
    return play_jobs(family, jobs, lambda job: remembering(spec(name, job.scenario, piece.tuned_on).make), episodes)
