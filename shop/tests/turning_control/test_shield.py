"""The shield in simulation: limits held, wrong answers refused, right ones left alone."""

from typing import Any

import numpy as np
import pytest
from turning_control.shield import PATIENCE, Shield, ShieldSettings

from leaderboard.play import Episodes, play
from leaderboard.seeds import tuning_seeds
from shop.tests.turning_control.guarded import Adversary, UniformRandom, play_guarded, switching
from turning_env import Scenario, read
from turning_env.action import commanded
from turning_env.physics.quantities import action_size
from turning_env.policy import Actions, Observations, Policy
from turning_env.vector_env import RoughTurningVectorEnv


class Constant(Policy):
    """Gives the same answer again and again."""

    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def act(self, observations: Observations) -> Actions:
        return self.answer  # type: ignore[no-any-return]


def first_observations(scenario: Scenario, num_envs: int) -> Observations:
    observations, _ = RoughTurningVectorEnv(num_envs, scenario).reset(seed=0)
    return observations


def limited(scenario: Scenario, minutes: float) -> Scenario:
    """Return a scenario whose episodes end after some minutes."""
    control = scenario.control.model_copy(update={"time_limit": minutes})
    return scenario.model_copy(update={"control": control})


def quickly_worn(wear_factor: float) -> Scenario:
    """Return the scenario of RoughTurning-v0 with faster wear, so that a test sees its end.

    With the factor 1.4 edges last a quarter as long, with 2.5 about two minutes.
    """
    scenario = Scenario.load("rough_turning")
    wear = scenario.material.wear
    faster = wear.model_copy(update={"coefficient": wear_factor * wear.coefficient})
    material = scenario.material.model_copy(update={"wear": faster})
    return scenario.model_copy(update={"material": material})


def severe_share(episodes: Episodes) -> float:
    """Return the share of cutting time in severe overload [-]."""
    return float(episodes["severe_overload_time"].sum() / episodes["engaged_time"].sum())


@pytest.mark.parametrize("preset", ["rough_turning", "override", "paper", "shift"])
def test_actions_far_from_the_limits_pass_unchanged(preset: str) -> None:
    scenario = Scenario.load(preset)
    action = np.full((2, action_size(scenario)), -0.9, np.float32)
    shield = Shield(Constant(action), scenario, 2)
    np.testing.assert_array_equal(shield.act(first_observations(scenario, 2)), action)
    assert shield.reasons == ["passed", "passed"]


@pytest.mark.parametrize(
    "answer",
    [
        pytest.param(np.full((2, 2), np.nan), id="not finite"),
        pytest.param(np.zeros((2, 3)), id="too many entries"),
        pytest.param([["a", "b"], ["a", "b"]], id="text"),
        pytest.param(None, id="nothing"),
    ],
)
def test_wrong_answers_command_the_safe_feed_and_then_the_operator(answer: Any) -> None:
    scenario = Scenario.load("rough_turning")
    shield = Shield(Constant(answer), scenario, 2)
    observations = first_observations(scenario, 2)
    towards_half_of_programmed = np.log(0.5) / scenario.control.feed_step
    for _ in range(PATIENCE):
        actions = shield.act(observations)
        assert np.isfinite(actions).all()
        np.testing.assert_allclose(actions[:, 1], max(towards_half_of_programmed, -1.0))
    assert shield.takeover.tolist() == [True, True]


def test_a_reset_ends_the_takeover_of_its_environments() -> None:
    scenario = Scenario.load("rough_turning")
    shield = Shield(Constant(None), scenario, 2)
    for _ in range(PATIENCE):
        shield.act(first_observations(scenario, 2))
    shield.reset(np.array([True, False]))
    assert shield.takeover.tolist() == [False, True]


def test_a_wrong_row_leaves_the_others_alone() -> None:
    scenario = Scenario.load("rough_turning")
    answer = np.array([[-0.5, -0.5], [np.nan, 0.0]], np.float32)
    shield = Shield(Constant(answer), scenario, 2)
    actions = shield.act(first_observations(scenario, 2))
    np.testing.assert_array_equal(actions[0], answer[0])
    assert shield.reasons == ["passed", "not finite"]


def test_a_late_answer_is_refused_whole() -> None:
    scenario = Scenario.load("rough_turning")
    answer = np.full((2, 2), -0.5, np.float32)
    shield = Shield(Constant(answer), scenario, 2, ShieldSettings(deadline=-1.0))
    shield.act(first_observations(scenario, 2))
    assert shield.reasons == ["late", "late"]


@pytest.mark.slow
def test_an_override_of_the_highest_feed_is_brought_below_the_limit() -> None:
    scenario = limited(Scenario.load("override"), minutes=0.1)

    def highest(num_envs: int) -> Policy:
        return Constant(np.ones((num_envs, 1), np.float32))

    free = play(highest, scenario, range(4))
    held = play(lambda n: Shield(highest(n), scenario, n), scenario, range(4))
    assert severe_share(free) > 0.3
    assert severe_share(held) < 0.01


def test_the_shield_never_asks_for_more_removal_than_the_policy() -> None:
    scenario = Scenario.load("rough_turning")
    random = np.random.default_rng(0)
    env = RoughTurningVectorEnv(8, scenario)
    policy = Constant(None)
    shield = Shield(policy, scenario, 8)
    observations, _ = env.reset(seed=0)
    shield.reset(np.ones(8, np.bool_))
    changed = 0
    for _ in range(60):
        policy.answer = random.uniform(-0.5, 1.0, (8, 2)).astype(np.float32)
        reading = read(observations, scenario)
        actions = shield.act(observations)
        speed_before = reading.commanded_cutting_speed
        feed_before = reading.commanded_feed
        asked_speed, asked_feed = commanded(
            policy.answer, speed_before, feed=feed_before, scenario=scenario
        )
        speed, feed = commanded(
            actions,
            speed_before,
            feed=feed_before,
            scenario=scenario,
        )
        # The feed cannot fall below the lowest, whatever the speed.
        allowed = np.maximum(asked_speed * asked_feed, scenario.machine.feed_min * speed)
        assert (speed * feed <= allowed * (1 + 1e-5)).all()
        changed += sum(reason != "passed" for reason in shield.reasons)
        observations, *_ = env.step(actions)
    assert changed > 20


@pytest.mark.slow
def test_random_actions_break_edges_without_the_shield_only() -> None:
    scenario = limited(quickly_worn(2.5), minutes=2.5)
    free = play(lambda n: UniformRandom(2), scenario, range(16))
    held = play(lambda n: Shield(UniformRandom(2), scenario, n), scenario, range(16))
    assert free["edges_broken"].sum() > 0
    assert held["edges_broken"].sum() == 0
    assert severe_share(free) > 0.1
    assert severe_share(held) <= 0.001


@pytest.mark.slow
@pytest.mark.parametrize("period", [10, 50])
def test_adversaries_stay_within_the_limits_and_break_no_edge(period: int) -> None:
    scenario = quickly_worn(1.4)
    seeds = tuning_seeds(8)[4:]
    wave = switching(period)
    adversary = Adversary(scenario, len(seeds), speed=wave, feed=wave)
    played = play_guarded(scenario, adversary, seeds)
    assert played.severe <= 0.001
    assert played.edges_broken == 0


def test_whole_parts_are_refused() -> None:
    with pytest.raises(ValueError, match="'batch_casting' commands whole parts"):
        Shield(Constant(None), Scenario.load("batch_casting"), 1)
