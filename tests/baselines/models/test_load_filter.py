"""The filter finds what it cannot see, and forgets what has been replaced."""

import numpy as np
import pytest

from baselines.models.kalman import LoadFilter as ExtendedKalmanFilter
from baselines.models.kalman_steps import INSERT, LOT
from baselines.models.load_filter import Doubt, LoadFilter
from tests.baselines.models.test_kalman import NOMINAL, QUIET
from tests.turning_env.playing import changed
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


def test_it_learns_the_lot_from_the_wear_of_removed_edges() -> None:
    nominal = changed(QUIET, sensors={"inspects_edges": True}, control={"edge_changes": "commanded"})
    played = changed(nominal, mismatch={"wear_factor": 1.3})
    env, estimate = RoughTurningVectorEnv(4, played), LoadFilter([nominal], 4, Doubt(lot=1.0, lot_life=0.8))
    observations, _ = env.reset(seed=0)
    estimate.reset(EVERY)
    start = estimate.mean[0, LOT]
    assert start == pytest.approx(-nominal.material.wear.time * np.log(0.8))
    for step in range(61):
        estimate.observe(read(observations, nominal))
        observations, *_ = env.step(np.array([[0.0, 0.0, 1.0 if step % 30 == 29 else -1.0]] * 4))
    assert estimate.mean[:, LOT] == pytest.approx(np.log(1.3), abs=0.05)
    assert estimate.mean[:, INSERT] == pytest.approx(0.0, abs=0.05)
    estimate.reset(EVERY)
    assert (estimate.mean[:, LOT] == start).all()


def test_it_tells_the_bias_of_a_law_from_the_bar() -> None:
    material = QUIET.material
    force = material.thrust_force.model_copy(update={"coefficient": 1.3 * material.thrust_force.coefficient})
    played = QUIET.model_copy(update={"material": material.model_copy(update={"thrust_force": force})})
    env, estimate = RoughTurningVectorEnv(4, played), LoadFilter([QUIET], 4, Doubt(laws=1.0))
    observations, _ = env.reset(seed=0)
    estimate.reset(EVERY)
    for _ in range(100):
        reading = read(observations, NOMINAL)
        estimate.observe(reading)
        observations, *_ = env.step(np.zeros(env.action_space.shape))
    next_bar = estimate.outlook(np.zeros((4, 1)), np.ones((4, 1), np.bool_))
    place = np.log([reading.cutting_speed, reading.feed, reading.nominal_wear / NOMINAL.tool.wear_criterion])
    for law, found, ratio in zip(range(2), (next_bar.log_force, next_bar.log_power), (1.3, 1.0), strict=True):
        named = (material.thrust_force, material.power)[law]
        errors = estimate.exponents[:, law] - [named.cutting_speed, named.feed, named.wear]
        assert found[:, 0] + (errors * place.T).sum(axis=1) == pytest.approx(np.full(4, np.log(ratio)), abs=0.03)


def test_other_models_in_other_environments_do_not_matter() -> None:
    scenarios = [NOMINAL, changed(NOMINAL, workpiece={"diameter": 60.0, "bar_length": 80.0})]
    doubt, distance = Doubt(1.0, 0.4, 0.8), np.array([[0.0, 5.0]] * 2)
    env = RoughTurningVectorEnv(2, NOMINAL)
    observations, _ = env.reset(seed=0)
    together, alone = LoadFilter(scenarios, 2, doubt), [LoadFilter([scenario], 1, doubt) for scenario in scenarios]
    together.reset(EVERY[:2])
    for each in alone:
        each.reset(EVERY[:1])
    for _ in range(50):
        reading = read(observations, NOMINAL)
        together.observe(reading)
        both = together.outlook(distance, distance < 0.0)
        for i, each in enumerate(alone):
            each.observe(type(reading)(*(values[i : i + 1] for values in reading)))
            outlook = each.outlook(distance[:1], distance[:1] < 0.0)
            np.testing.assert_array_equal(each.mean[0], together.mean[i])
            for own, shared in zip(outlook, both, strict=True):
                np.testing.assert_array_equal(own[0], shared[i])
        observations, *_ = env.step(np.zeros(env.action_space.shape))
