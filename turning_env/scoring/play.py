"""Play one episode per seed with a policy, and sum up every episode."""

from collections.abc import Callable, Sequence

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from turning_env.family_env import Context, FamilyVectorEnv
from turning_env.scenario import Scenario
from turning_env.scenario.family import Family
from turning_env.scoring.policy import PolicyFactory
from turning_env.vector_env import RoughTurningVectorEnv, info_at_end_of_step

EXCESS_TIMES = ("overload_2_percent_time", "overload_10_percent_time")  # [s]
SUMS = (
    *(
        f"reward_{term}" for term in ("metal", "time", "edge", "overload", "breakage", "roughness")
    ),  # [s]
    *(
        "time",
        "engaged_time",
        "stopped_time",
        "removed",
        "passes",
        "edges_used",
        "edges_broken",
    ),  # [s] x 3, [cm3], [-] x 3
    *("roughness_deviation", "overload_time", "severe_overload_time"),  # [s]
    *EXCESS_TIMES,
)
LAST = ("used_life", "wear", "finished")  # [-], [mm], [-]: their values when the episode ends
EPISODE_FIELDS = ("return", "steps", *SUMS, "excess", *LAST, "truncated")
"""The fields of an episode: return [s], steps, sums and last values of ``info``; ``excess`` is the integral of ``cost`` [s]."""

Episodes = dict[str, NDArray[np.float64]]


def play(
    make_policy: PolicyFactory,
    scenario: Scenario | RoughTurningVectorEnv,
    seeds: Sequence[int],
    on_step: Callable[[int], None] = lambda ended: None,
    *,
    tell: bool = False,
) -> Episodes:
    """Play one episode per seed, all in one batch; return an array of shape (len(seeds),) for each of ``EPISODE_FIELDS``.

    Args:
        make_policy: makes the policy for ``len(seeds)`` environments; ValueError if its actions are malformed.
        scenario: scenario to play, or a batch of ``len(seeds)`` environments with SAME_STEP.
        seeds: seeds of the episodes.
        on_step: called after each step with the number of episodes that have ended.
        tell: whether to call ``tell(infos)`` before every ``act``; for oracles only.
    """
    num_envs = len(seeds)
    env = (
        RoughTurningVectorEnv(num_envs, scenario, AutoresetMode.SAME_STEP)
        if isinstance(scenario, Scenario)
        else scenario
    )
    observations, infos = env.reset(seed=list(seeds))
    policy = make_policy(num_envs)
    episodes: Episodes = {name: np.zeros(num_envs) for name in EPISODE_FIELDS}
    running = np.ones(num_envs, np.bool_)
    policy.reset(running)
    while running.any():
        if tell:
            policy.tell(infos)  # type: ignore[attr-defined]
        observations, rewards, terminated, truncated, infos = env.step(policy.act(observations))
        last = {name: info_at_end_of_step(infos, name) for name in (*SUMS, *LAST, "cost")}
        ended, ending = terminated | truncated, running & (terminated | truncated)
        for name in LAST:
            episodes[name][ending] = last[name][ending]
        episodes["truncated"] += running & truncated
        counted = running.astype(np.float64)  # where an episode has ended, the next counts no more
        episodes["return"] += counted * rewards
        episodes["steps"] += counted
        for name in SUMS:
            episodes[name] += counted * last[name]
        episodes["excess"] += counted * last["cost"] * last["time"]
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
    """Play one episode per seed of a family's split; see ``play``. A controller built for the jobs needs the context "hidden"."""
    env = FamilyVectorEnv(len(seeds), family, split, context, AutoresetMode.SAME_STEP)
    return play(make_policy, env, seeds, on_step, tell=tell)
