"""The tests at fixed speed and feed with which the grid search is compared."""

import numpy as np
import pytest

from research.papers.verification import (
    MEASURED,
    VerificationTest,
    implied_wear_factor,
    played,
)
from turning_env import Scenario


@pytest.mark.parametrize("test", MEASURED, ids=lambda test: test.name)
def test_an_edge_that_wears_as_implied_lasts_as_measured(test: VerificationTest) -> None:
    assert test.life is not None
    factor = implied_wear_factor(test, test.life)
    assert 1.15 < factor < 1.34
    assert played([test], factor)[0].life == pytest.approx(test.life, abs=0.02)


def test_the_preset_of_measured_wear_has_the_mean_and_the_scatter_of_the_tests() -> None:
    factors = []
    for test in MEASURED:
        assert test.life is not None
        factors.append(implied_wear_factor(test, test.life))
    log_factors = np.log(factors)
    preset = Scenario.load("measured_wear")
    assert preset.mismatch.wear_factor == pytest.approx(np.exp(log_factors.mean()), abs=0.005)
    assert preset.tool.wear_factor_spread == pytest.approx(log_factors.std(ddof=1), abs=0.005)
    assert preset.nominal().mismatch.wear_factor == 1.0
