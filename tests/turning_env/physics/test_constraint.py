"""The cost of a step, and the leaderboard's constraint on the sum of an episode's costs."""

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from leaderboard.play import play
from leaderboard.statistics import feasibility, severe_share
from tests.turning_env.playing import UNDISTURBED, changed, infos
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.vector_env import info_at_end_of_step

ACTION = [[0.0, 0.0]]
SHORT = changed("rough_turning", control={"time_limit": 2.0})
SEEDS = range(4)


@pytest.mark.parametrize(
    ("limits", "cost"),
    [
        # Every second of a minute in metal allows for 0.05 s.
        pytest.param({"power": 1e4, "thrust_force": 1e6}, -3.0, id="no overload"),
        pytest.param({"power": 0.01, "thrust_force": 1e6}, 57.0, id="all severe"),
        pytest.param({"power": 0.01, "overload_allowance": 0.2}, 48.0, id="another allowance"),
        pytest.param({"power": 5.0, "overload_tolerance": 1.0}, -3.0, id="within the tolerance"),
    ],
)
def test_a_step_costs_its_severe_overload_beyond_the_allowed_share(
    limits: dict[str, float], cost: float
) -> None:
    (info,) = infos(changed(UNDISTURBED, limits=limits), ACTION)
    assert info["engaged_time"] == pytest.approx(60.0)
    assert info["cost"] == pytest.approx(cost)


class Fixed:
    """A policy that holds speed and feed at the start's, times a factor of an increment."""

    def __init__(self, num_envs: int, increment: float) -> None:
        self._actions = np.full((num_envs, 2), increment, np.float32)

    def reset(self, mask: Any) -> None:
        pass

    def act(self, observations: Any) -> Any:
        return self._actions


def summed_cost(scenario: Scenario, increment: float) -> float:
    """Return the sum of the costs of the seeds' first episodes [s]."""
    envs = RoughTurningVectorEnv(len(SEEDS), scenario, AutoresetMode.SAME_STEP)
    policy = Fixed(len(SEEDS), increment)
    observations, _ = envs.reset(seed=list(SEEDS))
    running = np.ones(len(SEEDS), np.bool_)
    total = 0.0
    while running.any():
        observations, _, terminated, truncated, step_infos = envs.step(policy.act(observations))
        total += float(info_at_end_of_step(step_infos, "cost")[running].sum())
        running &= ~(terminated | truncated)
    return total


@pytest.mark.parametrize(("increment", "verdict"), [(-0.5, "feasible"), (1.0, "infeasible")])
def test_the_leaderboard_decides_by_the_same_constraint(increment: float, verdict: str) -> None:
    episodes = play(lambda num_envs: Fixed(num_envs, increment), SHORT, list(SEEDS))
    share = severe_share(episodes["severe_overload_time"], episodes["engaged_time"])
    cost = summed_cost(SHORT, increment)
    assert feasibility((share, share), SHORT.limits.overload_allowance) == verdict
    assert (cost <= 0.0) == (verdict == "feasible")
    cutting_time = episodes["engaged_time"].sum()
    assert cost == pytest.approx((share - SHORT.limits.overload_allowance) * cutting_time)
