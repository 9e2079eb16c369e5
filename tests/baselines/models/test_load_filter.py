"""The filter finds what it cannot see, and forgets what has been replaced."""

import numpy as np
import pytest

from baselines.models.kalman import LoadFilter as ExtendedKalmanFilter
from baselines.models.load_filter import LoadFilter
from turning_env import RoughTurningVectorEnv, Scenario, read

EVERY = np.ones(4, np.bool_)


@pytest.mark.parametrize("preset", ["rough_turning", "shift"])
def test_without_doubt_it_is_the_extended_kalman_filter(preset: str) -> None:
    scenario, random = Scenario.load(preset), np.random.default_rng(0)
    env = RoughTurningVectorEnv(4, scenario)
    observations, _ = env.reset(seed=0)
    filters = ExtendedKalmanFilter(scenario, 4), LoadFilter([scenario], 4)
    for each in filters:
        each.reset(EVERY)
    distance = np.array([[0.0, 3.0, 50.0]] * 4)
    for _ in range(200):
        reading = read(observations, scenario)
        for each in filters:
            each.observe(reading)
        pairs = zip(filters[0].ahead(distance), filters[1].outlook(distance, distance < 0.0), strict=True)
        assert all(np.abs(old - new).max() < 1e-9 for old, new in pairs)
        pairs = zip(filters[0].next_bar(), filters[1].outlook(distance, distance >= 0.0), strict=True)
        assert all(np.abs(old - new).max() < 1e-9 for old, new in pairs)
        observations, *_ = env.step(random.uniform(-1.0, 1.0, env.action_space.shape))
