"""Compiles what the tests play: ``python -m tests.compile``, before they begin in several processes that would all compile it.

What has been compiled is kept on disk, so a second time this takes two seconds.
"""

import numpy as np

from baselines.oracles.clairvoyant import Grid, bounds
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.score.seeds import tuning_seeds

if __name__ == "__main__":
    lone, lanes = RoughTurningEnv(), RoughTurningVectorEnv(2)
    for env, actions in ((lone, np.zeros(2)), (lanes, np.zeros((2, 2)))):
        env.reset(seed=0)
        env.step(actions)
    bounds(Scenario(), tuning_seeds(1), Grid(10.0, 60, 8))
