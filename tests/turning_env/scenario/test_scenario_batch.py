"""Scenarios side by side: the same numbers as one by one."""

import numpy as np
import pytest

from turning_env import Scenario
from turning_env.physics.quantities import WIDTH
from turning_env.physics.records import numbers_of, parameter_records
from turning_env.scenario import ScenarioBatch

PRESETS = ["rough_turning", "small_diameter", "harder_lot", "ck45"]


@pytest.fixture
def scenarios() -> list[Scenario]:
    return [Scenario.load(preset) for preset in PRESETS]


@pytest.fixture
def batch(scenarios: list[Scenario]) -> ScenarioBatch:
    return ScenarioBatch.of(scenarios)


def test_a_field_is_an_array_unless_all_scenarios_share_its_value(batch: ScenarioBatch) -> None:
    assert batch.num_scenarios == len(PRESETS)
    assert batch.workpiece.diameter.tolist() == [100.0, 60.0, 100.0, 100.0]
    assert batch.tool.wear_rule == "equivalent_time"


@pytest.mark.parametrize("name", ["cutting_speed_max", "base_cutting_speed"])
def test_derived_quantities_are_those_of_each_scenario(
    name: str, scenarios: list[Scenario], batch: ScenarioBatch
) -> None:
    expected = [getattr(scenario, name) for scenario in scenarios]
    np.testing.assert_array_equal(getattr(batch, name), expected)


def test_the_range_of_feed_is_that_of_each_scenario(
    scenarios: list[Scenario], batch: ScenarioBatch
) -> None:
    low, high = batch.feed_range
    np.testing.assert_array_equal(low, [scenario.feed_range[0] for scenario in scenarios])
    np.testing.assert_array_equal(high, [scenario.feed_range[1] for scenario in scenarios])


def test_parameters_are_those_of_each_scenario() -> None:
    powers = np.linspace(6.0, 9.0, WIDTH)
    scenarios = [Scenario.load({"limits": {"power": power}}) for power in powers.tolist()]
    batch = ScenarioBatch.of(scenarios)
    records = parameter_records(batch, count=len(scenarios), nominal=batch)
    numbers = numbers_of(records).swapaxes(1, 2).reshape(len(scenarios), -1)
    for row, scenario in zip(numbers, scenarios, strict=True):
        expected = numbers_of(parameter_records(scenario, len(scenarios)))[0, :, 0]
        np.testing.assert_array_equal(row, expected)
