"""Compile everything that environments, batches, rules and oracles call.

    python -m baselines.warm_up

It prints where the machine code is kept. Run it when you build a container image, or before you
start many processes that cannot write to the folder: the package's own, or the user's cache folder
if the package's is read-only. Set NUMBA_CACHE_DIR to use another folder, then and later.
"""

import sys
from pathlib import Path

import gymnasium
import numpy as np

from baselines.grid_search import GridSearch
from baselines.oracles.perfect_state import PerfectState
from baselines.predictive import Predictive
from turning_env import ALL_IDS
from turning_env.action import commanded
from turning_env.batch import driver
from turning_env.console import Parser, UserError, described, exits
from turning_env.numerics import functions
from turning_env.numerics.compilation import machine_code_folder
from turning_env.rendering import fields
from turning_env.scenario import Scenario
from turning_env.vector_env import RoughTurningVectorEnv


def warm_up_environments() -> None:
    """Compile what single environments, batches, windows and readings of arrays call."""
    for env_id in ALL_IDS:
        for mode in ("sync", "vector_entry_point"):
            envs = gymnasium.make_vec(env_id, 2, vectorization_mode=mode)
            envs.reset(seed=0)
            envs.step(envs.action_space.sample())
            envs.close()
    fields.warm_up()
    for function in (functions.exp, functions.expm1, functions.log):
        function(np.ones(1))


def warm_up_rules() -> None:
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


@exits()
def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    Parser(prog="python -m baselines.warm_up", **described(__doc__)).parse_args(arguments)
    warm_up_environments()
    warm_up_rules()
    files = (driver.__file__, fields.__file__, functions.__file__)
    sources = [Path(str(file)).parent for file in files]
    folders = [folder for folder in map(machine_code_folder, sources) if folder]
    for folder in folders:
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        print(f"{size / 1e6:.1f} MB of machine code in {folder}")
    if not folders:
        raise UserError(
            "no machine code could be kept on disk: "
            "set NUMBA_CACHE_DIR to a folder that you can write"
        )
    print("set NUMBA_CACHE_DIR to use another folder")
    return 0


if __name__ == "__main__":
    sys.exit(main())
