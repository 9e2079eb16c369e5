"""Bars that bend away from the tool."""

import math

import numpy as np
import pytest

from tests.turning_env.playing import UNDISTURBED, changed, play
from turning_env import RoughTurningEnv, Scenario
from turning_env.physics.records import parameter_records
from turning_env.physics.slender_bar import compliance

LENGTH = 200.0  # [mm]
DIAMETER = 30.0  # [mm]
MODULUS = 210_000.0  # Young's modulus E [N/mm2]
STIFFNESS = MODULUS * math.pi * DIAMETER**4 / 64.0  # E I [N mm2]


def bar(support: str) -> Scenario:
    return changed(
        UNDISTURBED,
        workpiece={"bar_length": LENGTH, "diameter": DIAMETER, "support": support},
        control={"interval": 1.0, "sub_steps": 20},
    )


@pytest.mark.parametrize(
    ("support", "along", "expected"),
    [
        pytest.param("chuck", 0.0, LENGTH**3 / (3.0 * STIFFNESS), id="chuck, free end"),
        pytest.param("chuck", 0.5 * LENGTH, LENGTH**3 / (24.0 * STIFFNESS), id="chuck, middle"),
        pytest.param("chuck", LENGTH, 0.0, id="chuck, clamped end"),
        pytest.param("tailstock", 0.0, 0.0, id="tailstock, centre"),
        pytest.param(
            "tailstock",
            0.5 * LENGTH,
            7.0 * LENGTH**3 / (768.0 * STIFFNESS),
            id="tailstock, middle",
        ),
        pytest.param("tailstock", LENGTH, 0.0, id="tailstock, clamped end"),
    ],
)
def test_deflections_are_those_of_the_handbook(support: str, along: float, expected: float) -> None:
    p = parameter_records(bar(support))[0]
    assert compliance(p, 0, along) == pytest.approx(expected, rel=1e-12, abs=1e-18)


def test_the_depth_of_cut_lacks_the_deflection() -> None:
    """The deflection is compliance times radial force, to the first order of a sub-step."""
    scenario = bar("chuck")
    p = parameter_records(scenario)[0]
    actions = np.zeros((20, 2), np.float32)
    record = play(RoughTurningEnv(scenario), seed=0, actions=actions)
    cut = record["cutting"] & (record["path"] > 5.0)
    compliances = np.array([compliance(p, 0, along) for along in record["path"][cut]])
    radial_force = scenario.workpiece.radial_share * record["thrust_force"][cut]
    deflection = compliances * radial_force
    assert deflection.max() > 0.05
    assert record["depth_of_cut"][cut] == pytest.approx(2.5 - deflection, abs=0.005)
