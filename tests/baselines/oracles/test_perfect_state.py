import numpy as np

from baselines.models.kalman_steps import DEPTH, HARDNESS
from baselines.oracles.perfect_state import PerfectState, covers
from turning_env import IDS, RoughTurningVectorEnv, Scenario
from turning_env.physics.quantities import OBS
from turning_env.scoring.seeds import tuning_seeds

BASE = Scenario.load("rough_turning")


def test_it_knows_depth_hardness_and_wear() -> None:
    env, policy = RoughTurningVectorEnv(4, BASE), PerfectState(BASE, 4)
    observations, infos = env.reset(seed=tuning_seeds(4))
    policy.reset(np.ones(4, np.bool_))
    for _ in range(40):
        policy.tell(infos)
        actions = policy.act(observations)
        if infos["cutting"].all():
            mean = policy._filter.mean
            np.testing.assert_allclose(1.0 + mean[:, DEPTH], infos["depth_of_cut"] / BASE.workpiece.depth_of_cut, atol=0.01)
            np.testing.assert_allclose(mean[:, HARDNESS], np.log(infos["hardness"]), atol=0.01)
            nominal = observations[:, OBS.nominal_wear] * BASE.tool.wear_criterion
            np.testing.assert_allclose(policy._filter.log_wear_factor, np.log(infos["wear"] / nominal), atol=0.01)
        observations, _, _, _, infos = env.step(actions)
    assert infos["cutting"].any()


def test_it_plays_where_speed_and_feed_are_set() -> None:
    assert {env_id for env_id, preset in IDS.items() if covers(Scenario.load(preset))} == {
        "RoughTurning-v0",
        "RoughTurning-Paper-v0",
        "RoughTurning-Shift-v0",
    }
