"""The filter finds what it cannot see, and forgets what has been replaced."""

import numpy as np
import pytest

from baselines.models.kalman_steps import INSERT, LOT
from baselines.models.load_filter import LawErrors, LoadFilter
from tests.turning_env.playing import NO_SPREAD, changed
from turning_env import Reading, RoughTurningVectorEnv, Scenario, read

NOMINAL = Scenario()
QUIET = changed(
    NOMINAL, workpiece=NO_SPREAD, tool={"wear_factor_spread": 0.0, "edge_strength": 1e6}
)
NUM_ENVS = 4
ALL = np.ones(NUM_ENVS, np.bool_)


def heavier(factor: float) -> Scenario:
    """Return a task whose bars all take so many times the nominal force and power."""
    material = {}
    for name in ("thrust_force", "power"):
        law = getattr(QUIET.material, name).model_dump()
        material[name] = law | {"coefficient": factor * law["coefficient"]}
    return changed(QUIET, material=material)


def follow(played: Scenario, nominal: Scenario, steps: int) -> tuple[LoadFilter, Reading]:
    """Return a filter after a play at constant speed and feed, and its last reading."""
    env = RoughTurningVectorEnv(NUM_ENVS, played)
    estimate = LoadFilter([nominal], NUM_ENVS)
    observations, _ = env.reset(seed=0)
    estimate.reset(ALL)
    for _ in range(steps):
        reading = read(observations, nominal)
        estimate.observe(reading)
        observations, *_ = env.step(np.zeros((NUM_ENVS, 2)))
    return estimate, reading


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_it_finds_by_how_much_the_loads_differ(factor: float) -> None:
    estimate, reading = follow(heavier(factor), NOMINAL, steps=60)
    assert reading.cutting.all()
    distance = np.zeros((NUM_ENVS, 1))
    outlook = estimate.outlook(distance, entering=np.zeros((NUM_ENVS, 1), np.bool_))
    expected = np.full((NUM_ENVS, 1), np.log(factor))
    assert outlook.log_force == pytest.approx(expected, abs=0.04)
    assert outlook.log_power == pytest.approx(expected, abs=0.03)


def test_it_finds_the_wear_of_an_edge_by_a_law_with_a_fresh_edges_share() -> None:
    """The nominal model is that of the lathe, but for the edge, which wears faster."""
    force = QUIET.material.thrust_force.model_dump()
    force |= {"coefficient": 17000.0, "wear": 1.0, "wear_growth": 6.0}
    nominal = changed(QUIET, material={"thrust_force": force}, tool={"wear_factor_spread": 0.3})
    played = changed(nominal, mismatch={"wear_factor": 1.4}, tool={"wear_factor_spread": 0.0})
    estimate, reading = follow(played, nominal, steps=60)
    assert (reading.nominal_wear > 0.05).all()
    assert estimate.log_wear_factor == pytest.approx(np.full(NUM_ENVS, np.log(1.4)), abs=0.08)


def test_it_learns_the_lot_from_the_wear_of_removed_edges() -> None:
    nominal = changed(
        QUIET,
        sensors={"inspects_edges": True},
        control={"edge_changes": "commanded"},
    )
    played = changed(nominal, mismatch={"wear_factor": 1.3})
    # Only the law of wear is in doubt: its error has the mean 0.2 and the variance 1.
    errors = LawErrors(mean=np.zeros(11), covariance=np.zeros((11, 11)))
    errors.mean[0] = 0.2
    errors.covariance[0, 0] = 1.0
    env = RoughTurningVectorEnv(NUM_ENVS, played)
    estimate = LoadFilter([nominal], NUM_ENVS, errors)
    observations, _ = env.reset(seed=0)
    estimate.reset(ALL)
    start = estimate.mean[0, LOT]
    assert start == pytest.approx(0.2 * nominal.material.wear.time)
    actions = np.zeros((NUM_ENVS, 3))
    for step in range(61):
        estimate.observe(read(observations, nominal))
        # An edge is changed every half minute.
        actions[:, 2] = 1.0 if step % 30 == 29 else -1.0
        observations, *_ = env.step(actions)
    assert estimate.mean[:, LOT] == pytest.approx(np.log(1.3), abs=0.05)
    assert estimate.mean[:, INSERT] == pytest.approx(0.0, abs=0.05)
    estimate.reset(ALL)
    assert (estimate.mean[:, LOT] == start).all()
