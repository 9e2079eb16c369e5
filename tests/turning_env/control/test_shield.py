"""The shield in simulation: limits held, wrong answers refused, right ones left alone."""

from typing import Any

import gymnasium
import numpy as np
import pytest

from turning_env import Scenario
from turning_env.control.measure import UniformRandom, rows
from turning_env.control.shield import PATIENCE, Settings, Shield, shielded
from turning_env.physics.quantities import action_size
from turning_env.scoring.play import play
from turning_env.scoring.policy import Actions, Observations, Policy
from turning_env.vector_env import RoughTurningVectorEnv


class Constant(Policy):
    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def act(self, observations: Observations) -> Actions:
        return self.answer  # type: ignore[no-any-return]


def first(scenario: Scenario, num_envs: int) -> Observations:
    observations, _ = RoughTurningVectorEnv(num_envs, scenario).reset(seed=0)
    return observations


@pytest.mark.parametrize("preset", ["rough_turning", "override", "batch_casting", "paper", "shift"])
def test_actions_far_from_the_limits_pass_unchanged(preset: str) -> None:
    scenario = Scenario.load(preset)
    action = np.full((2, action_size(scenario)), -0.9, np.float32)
    shield = Shield(Constant(action), scenario, 2)
    np.testing.assert_array_equal(shield.act(first(scenario, 2)), action)
    assert shield.counts == {"passed": 2}


@pytest.mark.parametrize("answer", [np.full((2, 2), np.nan), np.zeros((2, 3)), np.zeros(2), [["a", "b"]] * 2, None])
def test_wrong_answers_command_the_safe_feed_and_then_the_operator(answer: Any) -> None:
    scenario = Scenario.load("rough_turning")
    shield = Shield(Constant(answer), scenario, 2)
    observations = first(scenario, 2)
    expected = np.log(0.5) / scenario.control.feed_step  # towards half the programmed feed
    for _ in range(PATIENCE):
        actions = shield.act(observations)
        assert np.isfinite(actions).all()
        np.testing.assert_allclose(actions[:, 1], max(expected, -1.0))
    assert shield.handed_over.all()
    shield.reset(np.array([True, False]))
    assert shield.handed_over.tolist() == [False, True]


def test_a_wrong_row_leaves_the_others_alone() -> None:
    scenario = Scenario.load("rough_turning")
    shield = Shield(Constant(np.array([[-0.5, -0.5], [np.nan, 0.0]], np.float32)), scenario, 2)
    actions = shield.act(first(scenario, 2))
    np.testing.assert_array_equal(actions[0], np.float32([-0.5, -0.5]))
    assert shield.reasons == ["passed", "not finite"]


def test_late_answers_are_refused() -> None:
    scenario = Scenario.load("rough_turning")
    shield = Shield(Constant(np.zeros((1, 2), np.float32)), scenario, 1, Settings(deadline=-1.0))
    shield.act(first(scenario, 1))
    assert shield.reasons == ["late"]


@pytest.mark.slow
def test_an_override_of_the_highest_feed_is_brought_below_the_limit() -> None:
    scenario = Scenario.load("override")
    high = play(lambda n: Constant(np.ones((n, 1), np.float32)), scenario, [0, 1])
    held = play(shielded(lambda n: Constant(np.ones((n, 1), np.float32)), scenario), scenario, [0, 1])
    share = [each["severe_overload_time"].sum() / each["engaged_time"].sum() for each in (high, held)]
    assert share[0] > 0.3
    assert share[1] < 0.03


@pytest.mark.slow
def test_random_actions_break_no_edge() -> None:
    scenario = Scenario.load("rough_turning")
    free = play(lambda n: UniformRandom(2), scenario, range(4))
    held = play(shielded(lambda n: UniformRandom(2), scenario), scenario, range(4))
    assert free["edges_broken"].sum() > 0
    assert held["edges_broken"].sum() == 0


@pytest.mark.slow
def test_the_measurement_plays_with_and_without_the_shield(tmp_path: Any) -> None:
    measured = list(rows(["RoughTurning-Surface-v0"], 1, tmp_path, Settings()))
    assert [row.shielded for row in measured] == [False, True]
    assert gymnasium.spec(measured[0].env_id).kwargs["scenario"] == "surface"
