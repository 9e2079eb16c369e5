"""The filter finds what it cannot see, and forgets what has been replaced."""

import numpy as np
import pytest

from baselines.models.kalman_steps import INSERT, LOT
from baselines.models.load_filter import LawErrors, LoadFilter
from tests.turning_env.playing import changed
from turning_env import Reading, RoughTurningVectorEnv, Scenario, read

NOMINAL = Scenario()
STILL = {
    f"{field}_{kind}_spread": 0.0 for field in ("hardness", "depth") for kind in ("bar", "along")
}
WEAR = np.diag([1.0, *[0.0] * 10])
QUIET = changed(NOMINAL, workpiece=STILL, tool={"wear_factor_spread": 0.0, "edge_strength": 1e6})


def heavier(factor: float) -> Scenario:
    """Bars that all take so many times the nominal force and power."""
    laws = {name: getattr(QUIET.material, name).model_dump() for name in ("thrust_force", "power")}
    return changed(
        QUIET,
        material={
            name: law | {"coefficient": factor * law["coefficient"]} for name, law in laws.items()
        },
    )


def followed(
    played: Scenario, known: Scenario, steps: int, num_envs: int = 4
) -> tuple[LoadFilter, Reading]:
    """A filter that knows one scenario while another is played at constant speed and feed: what it read last."""
    env, estimate = RoughTurningVectorEnv(num_envs, played), LoadFilter([known], num_envs)
    seen, _ = env.reset(seed=0)
    estimate.reset(np.ones(num_envs, np.bool_))
    for _ in range(steps):
        reading = read(seen, known)
        estimate.observe(reading)
        seen = env.step(np.zeros((num_envs, 2)))[0]
    return estimate, reading


@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_it_finds_by_how_much_the_loads_differ(factor: float) -> None:
    estimate, reading = followed(heavier(factor), NOMINAL, 60)
    assert reading.cutting.all()
    outlook = estimate.outlook(np.zeros((4, 1)), np.zeros((4, 1), np.bool_))
    assert outlook.log_force == pytest.approx(np.full((4, 1), np.log(factor)), abs=0.04)
    assert outlook.log_power == pytest.approx(np.full((4, 1), np.log(factor)), abs=0.03)


def test_it_learns_the_lot_from_the_wear_of_removed_edges() -> None:
    nominal = changed(
        QUIET, sensors={"inspects_edges": True}, control={"edge_changes": "commanded"}
    )
    played = changed(nominal, mismatch={"wear_factor": 1.3})
    env, estimate = (
        RoughTurningVectorEnv(4, played),
        LoadFilter([nominal], 4, LawErrors(np.array([0.2, *[0.0] * 10]), WEAR)),
    )
    observations, _ = env.reset(seed=0)
    estimate.reset(np.ones(4, np.bool_))
    start = estimate.mean[0, LOT]
    assert start == pytest.approx(0.2 * nominal.material.wear.time)
    for step in range(61):
        estimate.observe(read(observations, nominal))
        observations, *_ = env.step(np.array([[0.0, 0.0, 1.0 if step % 30 == 29 else -1.0]] * 4))
    assert estimate.mean[:, LOT] == pytest.approx(np.log(1.3), abs=0.05)
    assert estimate.mean[:, INSERT] == pytest.approx(0.0, abs=0.05)
    estimate.reset(np.ones(4, np.bool_))
    assert (estimate.mean[:, LOT] == start).all()
