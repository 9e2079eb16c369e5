"""Random actions, and policies that must lose."""

import numpy as np
import pytest

from baselines.catalogue import spec
from leaderboard.play import Episodes, play
from leaderboard.seeds import tuning_seeds
from turning_env import RoughTurningVectorEnv, Scenario


@pytest.mark.parametrize("preset", ["rough_turning", "batch_casting"])
def test_random_actions_fill_the_action_space_evenly(preset: str) -> None:
    env = RoughTurningVectorEnv(256, preset)
    policy = spec("random", Scenario.load(preset)).make(256)
    low = env.single_observation_space.low
    high = env.single_observation_space.high
    random = np.random.default_rng(0)
    actions = []
    for _ in range(16):
        observations = random.uniform(low, high, (256, len(low))).astype(np.float32)
        actions.append(policy.act(observations))
        assert actions[-1].shape == env.action_space.shape
    # 16 times 256 actions in four quarters of the range.
    expected_counts = np.full(4, 1024.0)
    for values in np.concatenate(actions).T:
        counts, _ = np.histogram(values, bins=4, range=(-1.0, 1.0))
        assert counts == pytest.approx(expected_counts, rel=0.15)


def episodes(name: str, scenario: Scenario) -> Episodes:
    """Return two episodes of a rule."""
    make_policy = spec(name, scenario).make
    return play(make_policy, scenario, seeds=tuning_seeds(2))


@pytest.mark.slow
def test_an_idle_feed_servo_removes_nothing() -> None:
    removed = episodes("idle", Scenario.load("surface"))["removed"]
    assert removed.tolist() == [0.0, 0.0]


@pytest.mark.slow
def test_degenerate_policies_do_what_their_names_say() -> None:
    shift = Scenario.load("shift")
    never_cut = episodes("never_cut", shift)
    idle = episodes("idle", shift)
    handbook = episodes("fixed_handbook", shift)
    assert never_cut["removed"].max() < 0.02 * idle["removed"].max()
    assert idle["removed"].max() < handbook["removed"].max()

    change_every_step = episodes("change_every_step", shift)
    for changing in (never_cut, change_every_step):
        np.testing.assert_allclose(changing["edges_used"], changing["steps"], atol=0.01)

    fastest = episodes("fastest", shift)
    assert fastest["edges_broken"].min() > 0.0
