"""Shift splits: what the nominal model of each knows of its change."""

import pytest

from turning_env import SPLITS, Scenario
from turning_env.scenario.sections import Mismatch

BASE = Scenario.load("rough_turning")
KNOWN = {"small_diameter", "ck45"}
"""Splits that change what the control knows; the others change the process alone."""


@pytest.mark.parametrize("split", SPLITS)
def test_the_nominal_model_lacks_the_mismatch_of_a_split(split: str) -> None:
    scenario = Scenario.load(split)
    assert scenario.digest() != BASE.digest()
    assert scenario.nominal() == scenario.model_copy(update={"mismatch": Mismatch()})
    assert (scenario.nominal() == scenario) == (split in KNOWN)
    assert (scenario.nominal().digest() == BASE.digest()) == (split not in KNOWN)
