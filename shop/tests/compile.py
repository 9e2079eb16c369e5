"""Compile what the tests of the benchmark and of the shop play: ``python -m shop.tests.compile``.

One process does both, as loading Numba takes seconds.
"""

import numpy as np
from turning_control.core import Controller
from turning_control.plant import Plant
from turning_control.readings import Readings

from baselines.trivial import ConstantActions
from tests.compile import compile_benchmark
from turning_env import Scenario


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
    compile_benchmark()
    compile_control()
