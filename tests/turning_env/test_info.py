"""Info: a plain dict of every quantity of ``quantities.INFO``."""

import gymnasium
import numpy as np

from turning_env import RoughTurningEnv
from turning_env.info import INFO_KEYS


def test_gymnasium_s_wrappers_find_what_they_expect():
    env = gymnasium.wrappers.RecordEpisodeStatistics(gymnasium.make("RoughTurning-v0", max_episode_steps=3))
    env.reset(seed=0)
    *_, info = [env.step(np.zeros(2, np.float32))[4] for _ in range(3)]
    assert info.keys() - {"TimeLimit.truncated"} == {*INFO_KEYS, "episode"}  # which some libraries have the limit add
    envs = gymnasium.vector.SyncVectorEnv([RoughTurningEnv, RoughTurningEnv])
    envs.reset(seed=0)
    assert envs.step(np.zeros((2, 2), np.float32))[4].keys() == {name for field in INFO_KEYS for name in (field, "_" + field)}
