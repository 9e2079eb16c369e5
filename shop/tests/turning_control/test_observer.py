"""The shield's load observer: which readings it takes into its estimates."""

import numpy as np
import pytest
from turning_control.observer import Observer

from turning_env import Scenario, read
from turning_env.vector_env import RoughTurningVectorEnv

SPEED = np.array([125.0])  # [m/min]


@pytest.mark.parametrize("load", ["power", "thrust_force"])
def test_a_load_of_air_that_is_said_to_be_of_a_cut_leaves_the_allowed_feed(load: str) -> None:
    scenario = Scenario.load("rough_turning")
    env = RoughTurningVectorEnv(1, scenario)
    observer = Observer(scenario, 1)
    observations, _ = env.reset(seed=[0])
    observer.reset(np.ones(1, np.bool_))

    def allowed_feed() -> float:
        observer.expect(1.02, SPEED, asked_feed=np.array([0.3]))
        return float(observer.feeds(SPEED).lower()[0])

    for _ in range(12):
        observations, *_ = env.step(np.zeros((1, 2), np.float32))
        reading = read(observations, scenario)
        observer.follow(reading, None)
    assert reading.cutting[0]
    before = allowed_feed()
    later = reading.cutting_time + 1.0 / 60.0
    no_load = reading._replace(cutting_time=later, **{load: np.zeros(1)})
    observer.follow(no_load, None)
    assert allowed_feed() < 1.1 * before
