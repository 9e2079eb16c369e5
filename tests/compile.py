"""Compile what the tests play: ``python -m tests.compile``.

Run it before the tests start in several processes, which would wait for one another's compilation.
The machine code is kept on disk, so a second run takes a few seconds.
"""

import numpy as np

from baselines.oracles.clairvoyant import StateGrid, bounds
from baselines.oracles.perfect_blanks import PerfectBlanks
from baselines.oracles.perfect_load import PerfectLoad
from baselines.warm_up import warm_up_rules
from leaderboard.play import play
from leaderboard.seeds import tuning_seeds
from research.studies import belief_bound
from tests.turning_env.playing import changed
from turning_env import FamilyVectorEnv, RoughTurningEnv, Scenario
from turning_env.numerics.functions import exp, expm1, log


def compile_functions() -> None:
    """Call the functions that are compiled for arrays, too."""
    for function in (exp, expm1, log):
        function(np.ones(1))


def compile_families() -> None:
    """Play one step of a family."""
    envs = FamilyVectorEnv(2)
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())


def compile_pictures() -> None:
    """Draw a bar."""
    env = RoughTurningEnv(render_mode="rgb_array")
    env.reset(seed=0)
    env.render()


def compile_bounds() -> None:
    """Compute the bounds of the oracles on coarse grids."""
    bounds(Scenario(), tuning_seeds(1), StateGrid(cell=10.0, lives=60, speeds=8))
    belief_bound.bound(Scenario(), seed=0, stretch=50.0, lives=10)
    override = Scenario.load("override")
    brief = changed(override, workpiece={"bar_length": 1.0, "depth_profile": []})
    play(
        lambda num_envs: PerfectLoad(brief, num_envs),
        brief,
        tuning_seeds(1),
        tell=True,
    )
    one_part = changed(Scenario.load("batch_casting"), workpiece={"bars": 1})
    seeds = tuning_seeds(1)
    play(lambda num_envs: PerfectBlanks(one_part, seeds), one_part, seeds, tell=True)


def compile_benchmark() -> None:
    """Compile what the tests of the benchmark play."""
    compile_functions()
    warm_up_rules()
    compile_families()
    compile_pictures()
    compile_bounds()


if __name__ == "__main__":
    compile_benchmark()
