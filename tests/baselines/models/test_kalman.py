"""The filter finds what it cannot see, and forgets what has been replaced."""

import numpy as np
import pytest

from baselines.models.kalman import LoadFilter
from tests.turning_env.playing import changed
from turning_env import Reading, RoughTurningVectorEnv, Scenario, read

NOMINAL = Scenario()
STILL = {f"{field}_{kind}_spread": 0.0 for field in ("hardness", "depth") for kind in ("bar", "along")}
QUIET = changed(NOMINAL, workpiece=STILL, tool={"wear_factor_spread": 0.0, "edge_strength": 1e6})


def heavier(factor: float) -> Scenario:
    """Bars that all take so many times the nominal force and power."""
    material = QUIET.material
    laws = {
        name: getattr(material, name).model_copy(update={"coefficient": factor * getattr(material, name).coefficient})
        for name in ("thrust_force", "power")
    }
    return QUIET.model_copy(update={"material": material.model_copy(update=laws)})


def followed(played: Scenario, known: Scenario, steps: int, num_envs: int = 4) -> tuple[LoadFilter, list[Reading], list[float]]:
    """A filter that knows one scenario while another is played at constant speed and feed: what it reads, and its force."""
    env, estimate = RoughTurningVectorEnv(num_envs, played), LoadFilter(known, num_envs)
    seen, _ = env.reset(seed=0)
    estimate.reset(np.ones(num_envs, np.bool_))
    readings, forces = [], []
    for _ in range(steps):
        readings.append(read(seen, known))
        estimate.observe(readings[-1])
        forces.append(float(estimate.ahead(np.zeros((num_envs, 1))).log_force.mean()))
        seen = env.step(np.zeros((num_envs, 2)))[0]
    return estimate, readings, forces


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_it_finds_by_how_much_the_loads_differ(factor: float) -> None:
    estimate, readings, _ = followed(heavier(factor), NOMINAL, 60)
    assert readings[-1].cutting.all()
    outlook = estimate.ahead(np.zeros((4, 1)))
    assert outlook.log_force == pytest.approx(np.full((4, 1), np.log(factor)), abs=0.04)
    assert outlook.log_power == pytest.approx(np.full((4, 1), np.log(factor)), abs=0.03)


def test_it_doubts_more_what_is_farther_ahead_and_most_a_bar_that_it_does_not_know() -> None:
    estimate, _, _ = followed(heavier(1.0), NOMINAL, 40)
    spreads = estimate.ahead(np.array([[0.0, 5.0, 20.0, 200.0]] * 4)).force_spread
    assert (np.diff(spreads, axis=1) > 0).all()
    assert (spreads[:, -1] <= estimate.next_bar().force_spread[:, 0] + 1e-9).all()


def test_in_air_it_learns_nothing() -> None:
    known = changed(NOMINAL, workpiece={"approach": 400.0})
    estimate, readings, forces = followed(changed(heavier(1.3), workpiece={"approach": 400.0}), known, 20)
    assert not np.any([reading.cutting for reading in readings])
    assert forces == [0.0] * 20
    assert not estimate.measured.any()


def test_its_travelled_distance_follows_the_row_of_bars() -> None:
    played = changed(heavier(1.0), workpiece={"bar_length": 60.0})
    estimate, _, _ = followed(played, changed(NOMINAL, workpiece={"bar_length": 60.0}), 150)
    env = RoughTurningVectorEnv(4, played)
    env.reset(seed=0)
    for _ in range(149):
        _, _, _, _, infos = env.step(np.zeros((4, 2)))
    assert infos["path"][0] > 3 * 63.0
    assert estimate.along == pytest.approx(infos["path"] % 63.0, abs=1.0)


def test_a_fresh_edge_forgets_the_wear_and_a_reset_everything_in_its_environment_alone() -> None:
    estimate, readings, _ = followed(heavier(1.15), NOMINAL, 60)
    assert (np.abs(estimate.log_wear_factor) > 0).all()
    fresh = np.array([True, False, False, False])
    time = np.where(fresh, 1.0 / 60.0, readings[-1].cutting_time + 1.0 / 60.0)
    doubt = estimate.wear_doubt.copy()
    estimate.observe(readings[-1]._replace(cutting_time=time))
    assert estimate.wear_doubt[0] > doubt[0]
    assert estimate.wear_doubt[1:] == pytest.approx(doubt[1:], rel=0.2)
    estimate.reset(np.array([False, True, False, False]))
    assert estimate.log_wear_factor[1] == 0.0
    assert estimate.along[1] == 0.0
    assert estimate.along[2] > 0.0
