import math

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from baselines.models.process import Limit, Process
from papers.reproduce.part_programming import handbook_process
from turning_env import PowerLaw, Scenario

STEEL = Process.of(Scenario())
HANDBOOK = handbook_process("PN")


def log_cost(process: Process, cutting_speed: float, feed: float, depth: float, hardness: float = 1.0) -> float:
    return float(process.log_cost(np.log(cutting_speed), np.log(feed), depth, hardness))


def test_the_cost_is_time_and_edges_per_metal() -> None:
    life = float(np.exp(STEEL.log_life(np.log(150.0), np.log(0.4), 3.0, 1.1)))
    assert math.exp(log_cost(STEEL, 150.0, 0.4, 3.0, 1.1)) == pytest.approx((1.0 + 5.0 / life) / (150.0 * 0.4 * 3.0))


@pytest.mark.parametrize(
    ("process", "limit"),
    [(STEEL, STEEL.thrust_force), (STEEL, STEEL.torque), (HANDBOOK, HANDBOOK.thrust_force)],
)
def test_the_economic_life_is_the_cheapest_along_its_limit(process: Process, limit: Limit) -> None:
    line = limit.line(2.5, 1.0, 0.2)

    def log_speed(log_feed: float) -> float:
        return float((line.room - line.feed * log_feed) / line.cutting_speed)

    if limit.law.cutting_speed == 0.0:  # the feed is fixed: the cutting speed varies
        log_feed = float(line.room / line.feed)
        best = minimize_scalar(lambda x: log_cost(process, math.exp(x), math.exp(log_feed), 2.5), bracket=(4.0, 6.0)).x
    else:
        log_feed = minimize_scalar(
            lambda x: log_cost(process, math.exp(log_speed(x)), math.exp(x), 2.5), bracket=(-2.0, 1.0), tol=1e-12
        ).x
        best = log_speed(log_feed)
    life = math.exp(float(process.log_life(np.asarray(best), np.asarray(log_feed), 2.5, 1.0)))
    assert process.economic_life(limit) == pytest.approx(life, rel=1e-4)


def test_without_an_economic_life_the_cost_falls_all_along_a_limit() -> None:
    line = STEEL.power.line(2.5, 1.0, 0.2)
    feeds = np.geomspace(0.01, 10.0, 50)  # along the limit of power more feed is more removal and more life
    costs = STEEL.log_cost(line.highest_cutting_speed(np.log(feeds)), np.log(feeds), 2.5, 1.0)
    assert np.all(np.diff(costs) < 0)
    assert STEEL.economic_life(STEEL.power) == math.inf
    same_rate = Limit(PowerLaw(coefficient=1.0, cutting_speed=0.7, feed=0.7), 1.0)
    assert STEEL.economic_life(same_rate) == math.inf
    assert STEEL.economic_life(Limit(PowerLaw(coefficient=1.0, cutting_speed=1.0), 200.0)) == 0.0  # nu below 1
    for limit in (STEEL.power, same_rate):
        assert np.all(np.isfinite(STEEL.life_limit(limit).line(2.5, 1.0, 0.2).room))
