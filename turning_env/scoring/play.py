"""Play one episode per seed with a policy, and sum up every episode."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from turning_env.scenario import Scenario
from turning_env.scoring.policy import Actions, PolicyFactory, PolicySpec
from turning_env.vector_env import RoughTurningVectorEnv

SUMS = (
    "reward_metal",  # [s]
    "reward_time",  # [s]
    "reward_edge",  # [s]
    "reward_overload",  # [s]
    "reward_breakage",  # [s]
    "reward_roughness",  # [s]
    "time",  # [s]
    "engaged_time",  # [s]
    "stopped_time",  # [s]
    "removed",  # [cm3]
    "passes",  # [-]
    "edges_used",  # [-]
    "edges_broken",  # [-]
    "roughness_deviation",  # [s]
    "overload_time",  # [s]
    "severe_overload_time",  # [s]
)
LAST = ("used_life", "wear", "finished")  # [-], [mm], [-]: their values when the episode ends
EPISODE_FIELDS = ("return", "steps", *SUMS, "excess", *LAST, "truncated")
"""The fields of an episode: return [s], steps, sums and last values of ``info``; ``excess`` is the integral of ``cost`` [s]."""

Episodes = dict[str, NDArray[np.float64]]


def play_spec(
    spec: PolicySpec, scenario: Scenario, seeds: Sequence[int], on_step: Callable[[int], None] = lambda ended: None
) -> Episodes:
    """Play a policy's episodes, or compute those of a bound: see ``play``.

    Raises:
        ValueError: the spec was read from a file and cannot play; or ``play`` raises it.
    """
    if spec.compute is not None:
        computed: Episodes = spec.compute(scenario, seeds, on_step)
        return computed
    return play(spec.make, scenario, seeds, on_step, tell=spec.kind == "oracle")


def play(
    make_policy: PolicyFactory,
    scenario: Scenario | RoughTurningVectorEnv,
    seeds: Sequence[int],
    on_step: Callable[[int], None] = lambda ended: None,
    *,
    tell: bool = False,
) -> Episodes:
    """Play one episode per seed, all in one batch.

    Args:
        make_policy: makes the policy for ``len(seeds)`` environments.
        scenario: scenario to play, or a batch of ``len(seeds)`` environments with SAME_STEP.
        seeds: seeds of the episodes.
        on_step: called after each step with the number of episodes that have ended.
        tell: whether to call ``tell(infos)`` before every ``act``; for oracles only.

    Returns:
        An array of shape (len(seeds),) for each of ``EPISODE_FIELDS``.

    Raises:
        ValueError: the policy's actions have the wrong shape or are not finite.
    """
    playing = _Playing(scenario, seeds)
    policy = make_policy(len(seeds))
    policy.reset(np.ones(len(seeds), np.bool_))
    while playing.running.any():
        if tell:
            policy.tell(playing.infos)  # type: ignore[attr-defined]
        playing.step(policy.act(playing.observations))
        if playing.ended.any():
            policy.reset(playing.ended)
        on_step(len(seeds) - int(playing.running.sum()))
    return playing.episodes


def play_together(
    policies: Sequence[PolicyFactory], tasks: Sequence[tuple[Scenario, Sequence[Sequence[int]]]]
) -> list[list[Episodes]]:
    """Play several policies on several tasks: one batch per task for all policies, and one batch per policy for all tasks.

    Args:
        policies: policies that see the same observations and choose the same actions on all tasks.
        tasks: scenarios, each with the seeds of every policy.

    Returns:
        The episodes of every policy on every task, as ``play`` returns them.

    Raises:
        ValueError: as ``play``.
    """
    playing = [_Playing(scenario, [seed for own in seeds for seed in own]) for scenario, seeds in tasks]
    counts = [[len(own) for own in seeds] for _, seeds in tasks]
    players = [make(sum(own)) for make, own in zip(policies, zip(*counts, strict=True), strict=True)]
    by_policy, by_task = ([_slices(each) for each in rows] for rows in (counts, zip(*counts, strict=True)))

    def transposed(parts: Sequence[NDArray[Any]], rows: Sequence[Sequence[slice]]) -> list[NDArray[Any]]:
        """Return arrays by policy from arrays by task, whose parts are ``rows``, or the other way round."""
        pieces = ([part[own] for own in of_part] for part, of_part in zip(parts, rows, strict=True))
        return [np.concatenate(own) for own in zip(*pieces, strict=True)]

    ended = transposed([each.running for each in playing], by_policy)  # all begin
    while any(each.running.any() for each in playing):
        for policy, mask in zip(players, ended, strict=True):
            if mask.any():
                policy.reset(mask)
        seen = transposed([each.observations for each in playing], by_policy)
        actions = [policy.act(observations) for policy, observations in zip(players, seen, strict=True)]
        for each, chosen in zip(playing, transposed(actions, by_task), strict=True):
            if each.running.any():
                each.step(chosen)
            else:  # stays as it is
                each.ended[:] = False
        ended = transposed([each.ended for each in playing], by_policy)
    return [
        [{name: values[rows[k]] for name, values in each.episodes.items()} for each, rows in zip(playing, by_policy, strict=True)]
        for k in range(len(policies))
    ]


def _slices(counts: Sequence[int]) -> list[slice]:
    """Return slices of so many rows, one after the other."""
    ends = np.cumsum(counts).tolist()
    return [slice(end - count, end) for count, end in zip(counts, ends, strict=True)]


class _Playing:
    """One episode per seed under way in a batch: the policies' next observations, and what the episodes sum up to."""

    def __init__(self, scenario: Scenario | RoughTurningVectorEnv, seeds: Sequence[int]) -> None:
        num_envs = len(seeds)
        if isinstance(scenario, RoughTurningVectorEnv):
            self._env = scenario
        else:
            self._env = RoughTurningVectorEnv(num_envs, scenario, AutoresetMode.SAME_STEP)
        self.observations, self.infos = self._env.reset(seed=list(seeds))
        self.episodes: Episodes = {name: np.zeros(num_envs) for name in EPISODE_FIELDS}
        self.running = np.ones(num_envs, np.bool_)
        self.ended = ~self.running

    def step(self, actions: Actions) -> None:
        """Run one step in every environment; where an episode ends, the next begins and counts no more."""
        episodes, running = self.episodes, self.running
        self.observations, rewards, terminated, truncated, infos = self._env.step(actions)
        self.ended = ended = terminated | truncated
        self.infos = last = infos
        if ended.any():
            final = infos["final_info"]
            last = {name: np.where(ended, final[name], infos[name]) for name in (*SUMS, *LAST, "cost")}
            ending = running & ended
            for name in LAST:
                episodes[name][ending] = last[name][ending]
            episodes["truncated"] += running & truncated
        counted = running.astype(np.float64)
        episodes["return"] += counted * rewards
        episodes["steps"] += counted
        for name in SUMS:
            episodes[name] += counted * last[name]
        episodes["excess"] += counted * last["cost"] * last["time"]
        self.running = running & ~ended
