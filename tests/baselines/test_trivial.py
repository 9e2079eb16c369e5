import numpy as np
import pytest

from baselines.catalogue import spec
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.scoring.play import Episodes, play
from turning_env.scoring.seeds import tuning_seeds


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
    for values in np.concatenate(actions).T:
        counts, _ = np.histogram(values, bins=4, range=(-1.0, 1.0))
        assert counts == pytest.approx(np.full(4, 1024.0), rel=0.15)


def episodes(name: str, scenario: Scenario) -> Episodes:
    """Return two episodes of a rule."""
    return play(spec(name, scenario).make, scenario, tuning_seeds(2))


@pytest.mark.slow
def test_degenerate_policies_do_what_their_names_say() -> None:
    assert not episodes("idle", Scenario.load("surface"))["removed"].any()
    names = ("never_cut", "idle", "fixed_handbook", "change_every_step", "fastest")
    played = {name: episodes(name, Scenario.load("shift")) for name in names}
    removed = {}
    for name, results in played.items():
        removed[name] = float(results["removed"].max())
    assert removed["never_cut"] < 0.02 * removed["idle"] < 0.02 * removed["fixed_handbook"]
    for name in ("never_cut", "change_every_step"):
        np.testing.assert_allclose(played[name]["edges_used"], played[name]["steps"], atol=0.01)
    assert (played["fastest"]["edges_broken"] > 0.0).all()
