"""Hardness and depth of cut as fields over the bar."""

import numpy as np
import pytest

from tests.turning_env.playing import NO_SPREAD, changed
from turning_env import Scenario
from turning_env.rendering.fields import Fields

WORKPIECE = Scenario().workpiece


def fields(scenario: Scenario, cuts):
    """Return relative hardness [-] and depth of cut [mm] at cut coordinates [mm]."""
    return Fields(scenario).along((0, 0), 0, np.asarray(cuts))


@pytest.mark.parametrize("along", [0.0, 137.3])
@pytest.mark.parametrize("kind", ["bar", "along"])
def test_spreads_are_those_of_the_scenario(along, kind):
    """Over 4000 bars the standard error of a standard deviation is 1.1 %."""
    cuts = np.arange(4000) * WORKPIECE.bar_length + along
    hardness_spread = getattr(WORKPIECE, f"hardness_{kind}_spread")
    depth_spread = getattr(WORKPIECE, f"depth_{kind}_spread")
    workpiece = NO_SPREAD | {
        f"hardness_{kind}_spread": hardness_spread,
        f"depth_{kind}_spread": depth_spread,
    }
    hardness, depth = fields(changed(Scenario(), workpiece=workpiece), cuts)
    log_hardness = np.log(hardness)
    assert log_hardness.std() == pytest.approx(hardness_spread, rel=0.05)
    assert depth.std() == pytest.approx(depth_spread, rel=0.05)
    assert log_hardness.mean() == pytest.approx(0.0, abs=0.1 * hardness_spread)
    assert depth.mean() == pytest.approx(WORKPIECE.depth_of_cut, abs=0.1 * depth_spread)


def test_bars_are_harder_where_the_cut_is_deeper():
    cuts = np.linspace(0.0, 5 * WORKPIECE.bar_length, 200)
    even, depth = fields(Scenario(), cuts)
    graded, _ = fields(changed(Scenario(), mismatch={"hardness_gradient": 0.3}), cuts)
    expected = np.exp(0.15 * (depth / WORKPIECE.depth_of_cut - 1))
    assert graded / even == pytest.approx(expected, rel=1e-9)
