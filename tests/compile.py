"""Compile what the tests play: ``python -m tests.compile``.

Run it before the tests start in several processes, which would wait for one another's compilation.
The machine code is kept on disk, so a second run takes a few seconds.
"""

import numpy as np
from turning_control.core import Controller, Readings
from turning_control.plant import Plant

from baselines.oracles.clairvoyant import Grid, bounds
from baselines.oracles.perfect_blanks import play_blanks
from baselines.oracles.perfect_load import PerfectLoad
from baselines.trivial import ConstantActions
from baselines.warm_up import warm_up
from research.studies import belief_bound
from tests.turning_env.playing import changed
from turning_env import FamilyVectorEnv, RoughTurningEnv, Scenario
from turning_env.numerics.functions import exp, expm1, log
from turning_env.scoring.play import play
from turning_env.scoring.seeds import tuning_seeds


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
    bounds(Scenario(), tuning_seeds(1), Grid(cell=10.0, lives=60, speeds=8))
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
    play_blanks(one_part, tuning_seeds(1), lambda ended: None)


def compile_control() -> None:
    """Observe the readings of a control, and move the plant."""
    scenario = Scenario()
    controller = Controller(
        scenario, lambda num_envs: ConstantActions(np.zeros((num_envs, 2), np.float32))
    )
    readings = Readings(
        spindle_speed=400.0,
        feed_velocity=100.0,
        in_feed=True,
        cutting=True,
        engaged_time=1.0,
        power=4.0,
        thrust_force=700.0,
    )
    controller.decide(readings)
    Plant(scenario, seed=0).advance(
        0.012, along=0.05, spindle_speed=400.0, velocity=4.0, in_feed=True
    )


if __name__ == "__main__":
    compile_functions()
    warm_up()
    compile_families()
    compile_pictures()
    compile_bounds()
    compile_control()
