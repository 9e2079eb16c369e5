"""Compile what the tests play: ``python -m tests.compile``, before they begin in several processes that would all compile it.

The machine code is kept on disk, so a second time this takes two seconds.
"""

from itertools import product

from baselines.grid_search import GridSearch
from baselines.oracles.clairvoyant import Grid, bounds
from baselines.predictive import Predictive
from turning_env import FamilyVectorEnv, RoughTurningVectorEnv, Scenario
from turning_env.scoring.seeds import tuning_seeds

if __name__ == "__main__":
    rules = (
        GridSearch,
        lambda *task: GridSearch(*task, margin=1.0, smoothing=0.5),
        lambda *task: Predictive(*task, severity=1.0, caution=1.0),
    )
    for num_envs, rule in product((1, 2), rules):
        envs = RoughTurningVectorEnv(num_envs)
        envs.step(rule(Scenario(), num_envs).act(envs.reset(seed=0)[0]))
    families = FamilyVectorEnv(2)
    families.reset(seed=0)
    families.step(families.action_space.sample())
    bounds(Scenario(), tuning_seeds(1), Grid(10.0, 60, 8))
