"""Compile what rules and oracles call, for ``python -m turning_env warm-up``."""

import numpy as np

from baselines.grid_search import GridSearch
from baselines.oracles.perfect_state import PerfectState
from baselines.predictive import Predictive
from turning_env.action import commanded
from turning_env.scenario import Scenario
from turning_env.vector_env import RoughTurningVectorEnv


def warm_up() -> None:
    """Compile the searches of the rules: play one step of each.

    They are played with one environment, for which other functions are compiled, and with two. The
    rules call them with all types of arguments: grid search at nominal and at scaled loads, the
    optimiser with estimated loads and their spread, and the oracle at the true state.
    """
    scenario = Scenario()
    for num_envs in (1, 2):
        rules = (
            GridSearch(scenario, num_envs),
            GridSearch(scenario, num_envs, margin=1.0, smoothing=0.5),
            Predictive(scenario, num_envs, severity=1.0, caution=1.0),
        )
        envs = RoughTurningVectorEnv(num_envs, scenario)
        observations, infos = envs.reset(seed=0)
        for rule in rules:
            rule.act(observations)
        oracle = PerfectState(scenario, num_envs)
        oracle.tell(infos)
        envs.step(oracle.act(observations))
        envs.close()
    # For pictures of a policy, and for policies that read their own action.
    ones = np.ones(1)
    commanded(np.zeros((1, 2), np.float32), cutting_speed=ones, feed=ones, scenario=scenario)
