"""Plays a policy on given draws, one episode each, and sums up every episode."""

from collections.abc import Callable, Sequence

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.score.policy import PolicyFactory

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
"""Of each episode: the return [s], its length, sums and last values of ``info``; ``excess`` is the integral of ``cost`` [s]."""

Episodes = dict[str, NDArray[np.float64]]


def play(
    make_policy: PolicyFactory,
    scenario: Scenario,
    seeds: Sequence[int],
    on_step: Callable[[int], None] = lambda ended: None,
    *,
    tell: bool = False,
) -> Episodes:
    """Play one episode per seed, all side by side.

    Args:
        make_policy: makes the policy for ``len(seeds)`` lanes.
        scenario: what to play.
        seeds: the draws.
        on_interval: called after each interval with the number of episodes that have ended.
        tell: only for references that no policy may match: whether to call ``tell(infos)`` before every ``act``.

    Returns:
        An array of shape (len(seeds),) for each of ``EPISODE_FIELDS``.

    Raises:
        ValueError: the policy's actions have the wrong shape or are not finite.
    """
    lanes = len(seeds)
    env = RoughTurningVectorEnv(lanes, scenario, AutoresetMode.SAME_STEP)
    policy = make_policy(lanes)
    observations, infos = env.reset(seed=list(seeds))
    policy.reset(np.ones(lanes, np.bool_))
    episodes: Episodes = {name: np.zeros(lanes) for name in EPISODE_FIELDS}
    running = np.ones(lanes, np.bool_)
    while running.any():
        if tell:
            policy.tell(infos)  # type: ignore[attr-defined]
        observations, rewards, terminated, truncated, infos = env.step(policy.act(observations))
        ended = terminated | truncated
        of_interval = infos
        if ended.any():
            final = infos["final_info"]
            of_interval = {name: np.where(ended, final[name], infos[name]) for name in (*SUMS, *LAST, "cost")}
            policy.reset(ended)
            ending = running & ended
            for name in LAST:
                episodes[name][ending] = of_interval[name][ending]
            episodes["truncated"] += running & truncated
        counted = running.astype(np.float64)
        episodes["return"] += counted * rewards
        episodes["steps"] += counted
        for name in SUMS:
            episodes[name] += counted * of_interval[name]
        episodes["excess"] += counted * of_interval["cost"] * of_interval["time"]
        running &= ~ended
        on_step(lanes - int(running.sum()))
    return episodes
