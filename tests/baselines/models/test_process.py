import math

import numpy as np
import pytest

from baselines.models.process import Limit, Process
from turning_env import PowerLaw, Scenario

STEEL = Process.of(Scenario())


def test_the_economic_life_is_the_cheapest_along_its_limit() -> None:
    feeds = np.log(np.geomspace(0.3, 10.0, 10_001))
    for limit in (STEEL.thrust_force, STEEL.torque):
        line = limit.line(2.5, 1.0, 0.2)
        speeds = (line.room - line.feed * feeds) / line.cutting_speed
        best = np.argmin(STEEL.log_cost(speeds, feeds, 2.5, 1.0))
        life = float(np.exp(STEEL.log_life(speeds[best], feeds[best], 2.5, 1.0)))
        assert STEEL.economic_life(limit) == pytest.approx(life, rel=2e-3)


def test_without_an_economic_life_the_cost_falls_all_along_a_limit() -> None:
    feeds = np.log(np.geomspace(0.01, 10.0, 50))  # along the limit of power more feed is more removal and more life
    costs = STEEL.log_cost(STEEL.power.line(2.5, 1.0, 0.2).highest_cutting_speed(feeds), feeds, 2.5, 1.0)
    assert np.all(np.diff(costs) < 0)
    assert STEEL.economic_life(STEEL.power) == math.inf
    same_rate = Limit(PowerLaw(coefficient=1.0, cutting_speed=0.7, feed=0.7), 1.0)
    assert STEEL.economic_life(same_rate) == math.inf
    assert STEEL.economic_life(Limit(PowerLaw(coefficient=1.0, cutting_speed=1.0), 200.0)) == 0.0  # nu below 1
    for limit in (STEEL.power, same_rate):
        assert np.all(np.isfinite(STEEL.life_limit(limit).line(2.5, 1.0, 0.2).room))
