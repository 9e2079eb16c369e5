"""Shift splits: how each differs from its base, and what its nominal model is."""

import pytest

from turning_env import SPLITS, Scenario
from turning_env.scenario.sections import Mismatch

BASE = Scenario.load("rough_turning")
DIFFERENT = {
    "harder_lot": {"mismatch": {"hardness_factor"}},
    "forging_skin": {"mismatch": {"skin_thickness", "skin_hardness", "skin_wear"}},
    "worn_lot": {"mismatch": {"wear_factor", "initial_wear"}},
    "sensor_bias": {"mismatch": {"power_bias", "force_bias"}},
    "small_diameter": {"workpiece": {"diameter"}},
    "ck45": {"material": {"wear", "thrust_force", "power"}},
}


@pytest.mark.parametrize("split", SPLITS)
def test_split_differs_as_stated_and_its_nominal_model_lacks_the_mismatch(split: str) -> None:
    found: dict[str, set[str]] = {}
    for section, values in dict(Scenario.load(split)).items():
        base = getattr(BASE, section)
        if section != "name" and values != base:
            found[section] = {name for name, value in dict(values).items() if value != getattr(base, name)}
    assert found == DIFFERENT[split]
    scenario = Scenario.load(split)
    nominal = scenario.nominal()
    assert nominal == scenario.model_copy(update={"mismatch": Mismatch()})
    mismatched = DIFFERENT[split].keys() == {"mismatch"}
    assert (nominal.digest() == BASE.digest()) == mismatched
    assert (nominal == scenario) != mismatched
