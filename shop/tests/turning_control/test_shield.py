"""The shield in simulation: limits held, wrong answers refused, right ones left alone."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from turning_control.adversary import Adversaries, Budget, attack, badness, switching, table
from turning_control.measure import UniformRandom, play_guarded, rows
from turning_control.shield import PATIENCE, Settings, Shield

from turning_env import Scenario, read
from turning_env.action import commanded
from turning_env.physics.quantities import action_size
from turning_env.scoring.play import play
from turning_env.scoring.policy import Actions, Observations, Policy
from turning_env.scoring.seeds import tuning_seeds
from turning_env.vector_env import RoughTurningVectorEnv


class Constant(Policy):
    def __init__(self, answer: Any) -> None:
        self.answer = answer

    def act(self, observations: Observations) -> Actions:
        return self.answer  # type: ignore[no-any-return]


def first(scenario: Scenario, num_envs: int) -> Observations:
    observations, _ = RoughTurningVectorEnv(num_envs, scenario).reset(seed=0)
    return observations


@pytest.mark.parametrize("preset", ["rough_turning", "override", "paper", "shift"])
def test_actions_far_from_the_limits_pass_unchanged(preset: str) -> None:
    scenario = Scenario.load(preset)
    action = np.full((2, action_size(scenario)), -0.9, np.float32)
    shield = Shield(Constant(action), scenario, 2)
    np.testing.assert_array_equal(shield.act(first(scenario, 2)), action)
    assert shield.reasons == ["passed"] * 2


@pytest.mark.parametrize(
    "answer", [np.full((2, 2), np.nan), np.zeros((2, 3)), [["a", "b"]] * 2, None]
)
def test_wrong_answers_command_the_safe_feed_and_then_the_operator(answer: Any) -> None:
    scenario = Scenario.load("rough_turning")
    shield = Shield(Constant(answer), scenario, 2)
    observations = first(scenario, 2)
    expected = np.log(0.5) / scenario.control.feed_step  # towards half the programmed feed
    for _ in range(PATIENCE):
        actions = shield.act(observations)
        assert np.isfinite(actions).all()
        np.testing.assert_allclose(actions[:, 1], max(expected, -1.0))
    assert shield.takeover.all()
    shield.reset(np.array([True, False]))
    assert shield.takeover.tolist() == [False, True]


def test_a_wrong_row_leaves_the_others_alone_and_a_late_answer_none() -> None:
    scenario = Scenario.load("rough_turning")
    policy = Constant(np.array([[-0.5, -0.5], [np.nan, 0.0]], np.float32))
    shield, impatient = (
        Shield(policy, scenario, 2),
        Shield(policy, scenario, 2, Settings(deadline=-1.0)),
    )
    actions = shield.act(first(scenario, 2))
    np.testing.assert_array_equal(actions[0], np.float32([-0.5, -0.5]))
    assert shield.reasons == ["passed", "not finite"]
    impatient.act(first(scenario, 2))
    assert impatient.reasons == ["late"] * 2


@pytest.mark.slow
def test_an_override_of_the_highest_feed_is_brought_below_the_limit() -> None:
    scenario = Scenario.load("override")
    high = play(lambda n: Constant(np.ones((n, 1), np.float32)), scenario, [0, 1])
    held = play(
        lambda n: Shield(Constant(np.ones((n, 1), np.float32)), scenario, n), scenario, [0, 1]
    )
    share = [
        each["severe_overload_time"].sum() / each["engaged_time"].sum() for each in (high, held)
    ]
    assert share[0] > 0.3
    assert share[1] < 0.01


def test_the_shield_never_asks_for_more_removal_than_the_policy() -> None:
    scenario, random = Scenario.load("rough_turning"), np.random.default_rng(0)
    env, policy = RoughTurningVectorEnv(8, scenario), Constant(None)
    shield = Shield(policy, scenario, 8)
    observations, _ = env.reset(seed=0)
    shield.reset(np.ones(8, np.bool_))
    changed = 0
    for _ in range(60):
        policy.answer = random.uniform(-0.5, 1.0, (8, 2)).astype(np.float32)
        reading = read(observations, scenario)
        actions = shield.act(observations)
        before = reading.commanded_cutting_speed, reading.commanded_feed
        asked, (speed, feed) = (
            commanded(each, *before, scenario) for each in (policy.answer, actions)
        )
        assert (
            speed * feed
            <= np.maximum(np.prod(asked, axis=0), scenario.machine.feed_min * speed) * (1 + 1e-5)
        ).all()
        changed += sum(reason != "passed" for reason in shield.reasons)
        observations, *_ = env.step(actions)
    assert changed > 20


@pytest.mark.slow
def test_random_actions_break_no_edge() -> None:
    scenario = Scenario.load("rough_turning")
    free = play(lambda n: UniformRandom(2), scenario, range(2))
    held = play(lambda n: Shield(UniformRandom(2), scenario, n), scenario, range(2))
    assert free["edges_broken"].sum() > 0
    assert held["edges_broken"].sum() == 0


def quickly_worn() -> Scenario:
    """Return the scenario of RoughTurning-v0 with edges that last a quarter as long, so that a test sees their end."""
    scenario = Scenario.load("rough_turning")
    wear = scenario.material.wear
    faster = wear.model_copy(update={"coefficient": 1.4 * wear.coefficient})
    return scenario.model_copy(
        update={"material": scenario.material.model_copy(update={"wear": faster})}
    )


@pytest.mark.slow
def test_adversaries_stay_within_the_limits_and_break_no_edge() -> None:
    scenario, seeds = quickly_worn(), tuning_seeds(8)[4:]
    tried = [switching(50), switching(10)]
    played = play_guarded(
        scenario,
        Adversaries(tried, len(seeds), scenario),
        seeds * len(tried),
        Settings(),
        "adversaries",
    )
    for k in range(len(tried)):
        figures = played.total(slice(k * len(seeds), (k + 1) * len(seeds)))
        assert figures.severe <= 0.001
        assert figures.edges_broken == 0


@pytest.mark.slow
def test_a_search_reports_the_worst_adversaries_of_its_seeds() -> None:
    brief = Scenario.load("rough_turning")
    brief = brief.model_copy(
        update={"control": brief.control.model_copy(update={"time_limit": 1.0})}
    )
    budget = Budget(candidates=10, generations=2, episodes=1, worst=3, held_out=2)
    attacks = list(attack("RoughTurning-v0", brief, budget, Settings()))
    assert [(each.seeds, each.figures.episodes) for each in attacks] == [("tuning", 1)] * 3 + [
        ("held-out", 2)
    ] * 3
    assert [each.adversary for each in attacks[:3]] == [each.adversary for each in attacks[3:]]
    assert sorted(map(badness, attacks[:3]), reverse=True) == list(map(badness, attacks[:3]))
    assert table(attacks).count("RoughTurning-v0") == 6


@pytest.mark.slow
def test_the_measurement_plays_with_and_without_the_shield(tmp_path: Path) -> None:
    measured = list(rows(["RoughTurning-Surface-v1"], 1, tmp_path, Settings()))
    assert [row.shielded for row in measured] == [False, True]


def test_whole_parts_are_refused() -> None:
    with pytest.raises(ValueError, match="'batch_casting' commands whole parts"):
        Shield(Constant(None), Scenario.load("batch_casting"), 1)
