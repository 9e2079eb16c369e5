import numpy as np
import pytest

from baselines.catalogue import spec
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.scoring.play import play


@pytest.mark.parametrize("preset", ["rough_turning", "batch_casting"])
def test_random_actions_fill_the_action_space_evenly(preset: str) -> None:
    env, policy = RoughTurningVectorEnv(256, preset), spec("random", Scenario.load(preset)).make(256)
    low, high = env.single_observation_space.low, env.single_observation_space.high
    random = np.random.default_rng(0)
    actions = np.array([policy.act(random.uniform(low, high, (256, len(low))).astype(np.float32)) for _ in range(16)])
    assert actions.shape[1:] == env.action_space.shape
    for column in actions.reshape(-1, actions.shape[2]).T:
        assert np.histogram(column, bins=4, range=(-1.0, 1.0))[0] == pytest.approx(np.full(4, 1024.0), rel=0.15)


def test_random_actions_of_a_seed_are_the_same_in_any_batch() -> None:
    scenario = Scenario.model_validate({"control": {"time_limit": 0.5}})
    make = spec("random", scenario).make
    together = play(make, scenario, [3, 4, 5])["return"]
    assert [play(make, scenario, [seed])["return"][0] for seed in (3, 4, 5)] == together.tolist()
    assert len(set(together)) == 3


def test_no_action_keeps_the_commands_where_actions_are_increments() -> None:
    env, policy = RoughTurningVectorEnv(2), spec("zero_action", Scenario()).make(2)
    observations, infos = env.reset(seed=0)
    for _ in range(20):
        observations, _, _, _, after = env.step(policy.act(observations))
    for name in ("commanded_cutting_speed", "commanded_feed"):
        np.testing.assert_allclose(after[name], infos[name], rtol=1e-6)
