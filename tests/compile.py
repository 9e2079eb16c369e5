"""Compile what the tests play: ``python -m tests.compile``.

Run it before the tests start in several processes, which would all compile the same functions.
The machine code is kept on disk, so a second run takes two seconds.
"""

from baselines.grid_search import GridSearch
from baselines.oracles.clairvoyant import Grid, bounds
from baselines.predictive import Predictive
from turning_env import FamilyVectorEnv, RoughTurningVectorEnv, Scenario
from turning_env.scoring.seeds import tuning_seeds


def compile_rules(num_envs: int) -> None:
    """Play one step of each search: at given loads, with a margin and filter, and with doubt."""
    scenario = Scenario()
    rules = (
        GridSearch(scenario, num_envs),
        GridSearch(scenario, num_envs, margin=1.0, smoothing=0.5),
        Predictive(scenario, num_envs, severity=1.0, caution=1.0),
    )
    for rule in rules:
        envs = RoughTurningVectorEnv(num_envs)
        observations, _ = envs.reset(seed=0)
        envs.step(rule.act(observations))


def compile_families() -> None:
    """Play one step of a family."""
    envs = FamilyVectorEnv(2)
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())


if __name__ == "__main__":
    # One environment has functions of its own.
    compile_rules(num_envs=1)
    compile_rules(num_envs=2)
    compile_families()
    bounds(Scenario(), tuning_seeds(1), Grid(cell=10.0, lives=60, speeds=8))
