"""Hardness and depth of cut as fields over the bar."""

import numpy as np
import pytest

from tests.turning_env.playing import changed
from turning_env import Scenario
from turning_env.rendering.fields import Fields

WORKPIECE = Scenario().workpiece


def fields(scenario: Scenario, cuts, seed: int = 0):
    """Return relative hardness [-] and depth of cut [mm] at cut coordinates [mm], shape (2, cuts)."""
    return np.array(Fields(scenario).along((seed, 0), 0, np.asarray(cuts)))


@pytest.mark.parametrize("along", [0.0, 137.3])
def test_spreads_are_those_of_the_scenario(along):
    """Over 4000 bars the standard error of a standard deviation is 1.1 %."""
    cuts = np.arange(4000) * WORKPIECE.bar_length + along
    still = {
        f"{field}_{kind}_spread": 0.0
        for field in ("hardness", "depth")
        for kind in ("bar", "along")
    }
    for kind in ("bar", "along"):
        spreads = {
            f"{field}_{kind}_spread": getattr(WORKPIECE, f"{field}_{kind}_spread")
            for field in ("hardness", "depth")
        }
        hardness, depth = fields(changed(Scenario(), workpiece=still | spreads), cuts)
        assert np.std(np.log(hardness)) == pytest.approx(
            spreads[f"hardness_{kind}_spread"], rel=0.05
        )
        assert np.std(depth) == pytest.approx(spreads[f"depth_{kind}_spread"], rel=0.05)
        assert np.mean(np.log(hardness)) == pytest.approx(
            0.0, abs=0.1 * spreads[f"hardness_{kind}_spread"]
        )
        assert np.mean(depth) == pytest.approx(
            WORKPIECE.depth_of_cut, abs=0.1 * spreads[f"depth_{kind}_spread"]
        )


def test_bars_are_harder_where_the_cut_is_deeper():
    cuts = np.linspace(0.0, 5 * WORKPIECE.bar_length, 200)
    (even, depth), (graded, _) = (
        fields(changed(Scenario(), mismatch={"hardness_gradient": each}), cuts)
        for each in (0.0, 0.3)
    )
    assert graded / even == pytest.approx(
        np.exp(0.15 * (depth / WORKPIECE.depth_of_cut - 1)), rel=1e-9
    )
