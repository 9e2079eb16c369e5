"""Laws of force and power with a fresh edge's share: F = F_0 (1 + b W)."""

from typing import Any

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed, play
from turning_env import PowerLaw, RoughTurningEnv, RoughTurningVectorEnv, Scenario, ScenarioError
from turning_env.physics.quantities import layout
from turning_env.scenario.power_law import wear_exponent

FORCE = PowerLaw(
    coefficient=6000.0,
    cutting_speed=-0.3,
    feed=0.6,
    depth_of_cut=0.8,
).model_dump()
FORCE |= {"wear": 1.0, "wear_growth": 4.0}
MEASURED = changed(UNDISTURBED, material={"thrust_force": FORCE})
# The nominal model has another form than the lathe.
MISTAKEN = Scenario.model_validate(
    MEASURED.model_dump()
    | {"nominal_model": {"material": {"thrust_force": Scenario().material.thrust_force}}}
)
ACTIONS = np.zeros((8, 2), np.float32)


def test_a_fresh_edge_has_the_force_of_the_other_factors() -> None:
    law = MEASURED.material.thrust_force
    fresh = law(100.0, 0.2, 2.5, wear=0.0)
    assert fresh == pytest.approx(6000.0 * 100.0**-0.3 * 0.2**0.6)
    assert law(100.0, 0.2, 2.5, wear=0.25) == pytest.approx(2.0 * fresh)


def test_the_wear_exponent_is_the_slope_of_the_logarithms() -> None:
    # b W / (1 + b W) of the exponent 1; a power law has its own exponent at any wear.
    assert wear_exponent(MEASURED.material.thrust_force, np.log(0.25)) == pytest.approx(0.5)
    assert wear_exponent(Scenario().material.thrust_force, np.log(0.25)) == 1.1


def test_the_lathe_follows_the_law() -> None:
    record = play(RoughTurningEnv(MEASURED), 0, ACTIONS)
    # The first row is that of the reset, before the edge has cut.
    expected = MEASURED.material.thrust_force(
        record["cutting_speed"][1:],
        record["feed"][1:],
        depth_of_cut=2.5,
        wear=record["wear"][1:],
    )
    assert record["thrust_force"][1:] == pytest.approx(expected, rel=1e-9)
    assert record["wear"][0] < record["wear"][-1]


@pytest.mark.parametrize("scenario", [MEASURED, MISTAKEN], ids=["nominal", "another form"])
def test_single_and_batch_agree_bit_for_bit(scenario: Scenario) -> None:
    env = RoughTurningEnv(scenario)
    batch = RoughTurningVectorEnv(3, scenario)
    observation, _ = env.reset(seed=5)
    observations, _ = batch.reset(seed=[5, 6, 7])
    for action in ACTIONS:
        assert np.array_equal(observation, observations[0])
        observation, *_ = env.step(action)
        observations, *_ = batch.step(np.tile(action, (3, 1)))
    assert np.array_equal(observation, observations[0])


def test_the_observed_ratio_is_that_to_the_nominal_law() -> None:
    """A nominal power law expects less force of a sharp edge than it has."""
    entry = layout(MEASURED).index("force_ratio")

    def first_ratio(scenario: Scenario) -> float:
        env = RoughTurningEnv(scenario)
        env.reset(seed=0)
        observation, *_ = env.step(ACTIONS[0])
        return float(observation[entry])

    assert first_ratio(MEASURED) == pytest.approx(0.0, abs=1e-6)
    assert first_ratio(MISTAKEN) > 1.0


@pytest.mark.parametrize(
    ("law", "change", "named"),
    [
        pytest.param(
            "thrust_force",
            FORCE | {"wear": 0.0},
            "material.thrust_force.wear_growth",
            id="force that does not grow with wear",
        ),
        pytest.param(
            "wear",
            {"wear_growth": 1.0},
            "material.wear",
            id="wear",
        ),
        pytest.param(
            "power",
            {"wear_growth": -1.0},
            "wear_growth",
            id="below 0",
        ),
    ],
)
def test_a_growth_without_meaning_is_refused(law: str, change: dict[str, Any], named: str) -> None:
    values = Scenario().model_dump()
    values["material"][law] |= change
    with pytest.raises(ScenarioError, match=named):
        Scenario.load(values)
