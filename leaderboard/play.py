"""Play one episode per seed with a policy, and sum up every episode."""

from collections.abc import Callable, Sequence

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from turning_env.family_env import Context, FamilyVectorEnv
from turning_env.policy import PolicyFactory
from turning_env.scenario import Scenario
from turning_env.scenario.family import Family
from turning_env.vector_env import RoughTurningVectorEnv, info_at_end_of_step

EXCESS_TIMES = ("overload_2_percent_time", "overload_10_percent_time")
"""Times above a limit by more than 2 % and 10 % [s]."""
SUMS = (
    "reward_metal",  # [s], as the other terms of the reward
    "reward_time",
    "reward_edge",
    "reward_overload",
    "reward_breakage",
    "reward_roughness",
    "time",  # [s]
    "engaged_time",  # [s]
    "stopped_time",  # [s]
    "removed",  # [cm3]
    "passes",
    "edges_used",
    "edges_broken",
    "roughness_deviation",  # [s]
    "overload_time",  # [s]
    "severe_overload_time",  # [s]
    *EXCESS_TIMES,
)
"""Values of ``info`` that are summed up over an episode."""
LAST = ("used_life", "wear", "finished")
"""Values of ``info`` that count when the episode ends: [-], [mm], [-]."""
EPISODE_FIELDS = ("return", "steps", *SUMS, "excess", *LAST, "truncated")
"""The fields of an episode: return [s], steps, sums and last values of ``info``.

``excess`` is the integral of ``info["excess"]`` [s].
"""

Episodes = dict[str, NDArray[np.float64]]


def play(
    make_policy: PolicyFactory,
    scenario: Scenario | RoughTurningVectorEnv,
    seeds: Sequence[int],
    on_step: Callable[[int], None] = lambda ended: None,
    *,
    tell: bool = False,
) -> Episodes:
    """Play one episode per seed, all in one batch.

    Return an array of shape (len(seeds),) for each of ``EPISODE_FIELDS``.

    Args:
        make_policy: makes the policy for ``len(seeds)`` environments.
        scenario: scenario to play, or a batch of ``len(seeds)`` environments with SAME_STEP.
        seeds: seeds of the episodes.
        on_step: called after each step with the number of episodes that have ended.
        tell: whether to call ``tell(infos)`` before every ``act``; for oracles only.

    Raises:
        ValueError: if actions of the policy are malformed.
    """
    num_envs = len(seeds)
    if isinstance(scenario, Scenario):
        env = RoughTurningVectorEnv(num_envs, scenario, AutoresetMode.SAME_STEP)
    else:
        env = scenario
    observations, infos = env.reset(seed=list(seeds))
    policy = make_policy(num_envs)
    episodes: Episodes = {name: np.zeros(num_envs) for name in EPISODE_FIELDS}
    running = np.ones(num_envs, np.bool_)
    policy.reset(running)
    while running.any():
        if tell:
            policy.tell(infos)  # type: ignore[attr-defined]
        observations, rewards, terminated, truncated, infos = env.step(policy.act(observations))
        ended = terminated | truncated
        # Environments go on with further episodes, which do not count.
        counted = running.astype(np.float64)
        episodes["return"] += counted * rewards
        episodes["steps"] += counted
        for name in SUMS:
            episodes[name] += counted * info_at_end_of_step(infos, name)
        mean_excess = info_at_end_of_step(infos, "excess")
        episodes["excess"] += counted * mean_excess * info_at_end_of_step(infos, "time")
        ending = running & ended
        for name in LAST:
            episodes[name][ending] = info_at_end_of_step(infos, name)[ending]
        episodes["truncated"] += running & truncated
        running = running & ~ended
        if ended.any():
            policy.reset(ended)
        on_step(num_envs - int(running.sum()))
    return episodes


def play_family(
    family: Family,
    split: str,
    seeds: Sequence[int],
    make_policy: PolicyFactory,
    context: Context = "told",
    on_step: Callable[[int], None] = lambda ended: None,
    *,
    tell: bool = False,
) -> Episodes:
    """Play one episode per seed of a family's split; see ``play``.

    A controller that was built for the jobs needs the context "hidden".
    """
    env = FamilyVectorEnv(len(seeds), family, split, context, AutoresetMode.SAME_STEP)
    return play(make_policy, env, seeds, on_step, tell=tell)
