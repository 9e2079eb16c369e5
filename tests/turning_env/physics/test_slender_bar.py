"""Bars that bend away from the tool."""

import math

import numpy as np
import pytest

from tests.turning_env.physics.one_env import ENV, put, records_of
from tests.turning_env.playing import UNDISTURBED, changed, play
from turning_env import RoughTurningEnv, Scenario
from turning_env.physics.slender_bar import (
    CHUCK,
    SUPPORTS,
    bend_bar,
    chatter,
    compliance,
    note_stiffness,
    rod_flexibility,
)

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
    flexibility = rod_flexibility(DIAMETER, MODULUS)
    deflection = compliance(SUPPORTS[support], along, LENGTH, flexibility)
    assert deflection == pytest.approx(expected, rel=1e-12, abs=1e-18)


def test_the_depth_of_cut_lacks_the_deflection() -> None:
    """The deflection is compliance times radial force, to the first order of a sub-step."""
    scenario = bar("chuck")
    actions = np.zeros((20, 2), np.float32)
    record = play(RoughTurningEnv(scenario), seed=0, actions=actions)
    cut = record["cutting"] & (record["path"] > 5.0)
    flexibility = rod_flexibility(DIAMETER, scenario.workpiece.elastic_modulus)
    compliances = compliance(CHUCK, record["path"][cut], LENGTH, flexibility)
    radial_force = scenario.workpiece.radial_share * record["thrust_force"][cut]
    deflection = compliances * radial_force
    assert deflection.max() > 0.05
    assert record["depth_of_cut"][cut] == pytest.approx(2.5 - deflection, abs=0.005)


@pytest.mark.parametrize(
    ("depth", "force", "stiffness"),
    [
        pytest.param(2.0, 900.0, 450.0, id="cuts"),
        pytest.param(0.0, 900.0, 0.0, id="no depth"),
        pytest.param(2.0, 0.0, 0.0, id="no force"),
        pytest.param(0.5, 0.25, 0.5, id="hardly any force"),
    ],
)
def test_the_stiffness_of_a_cut_is_force_over_depth(
    depth: float, force: float, stiffness: float
) -> None:
    records = records_of()
    put(records.state, depth_of_cut=depth, thrust_force=force)
    note_stiffness(records.state, records.work, ENV)
    assert records.work.cut_stiffness[ENV] == stiffness


@pytest.mark.parametrize(("engaged", "depth"), [(0.1, 3.0 / 1.5), (0.0, 3.0)])
def test_a_bar_bends_until_force_and_deflection_agree(engaged: float, depth: float) -> None:
    """With q = 0.5, a depth of 3 mm becomes 2 mm: the bar yields 0.5 * 2 mm."""
    records = records_of(bar("chuck"))
    free_end = LENGTH**3 / (3.0 * STIFFNESS)
    put(records.p, radial_share=0.4)
    put(records.work, cut_stiffness=0.5 / (0.4 * free_end), engaged=engaged, along=0.0)
    put(records.state, depth_of_cut=3.0)
    bend_bar(records.state, records.work, ENV, records.p)
    assert records.state.depth_of_cut[ENV] == pytest.approx(depth)


@pytest.mark.parametrize(
    ("speed", "depth", "ratio"),
    [
        # At the worst speed 0.4 * 3 / 2; a width beside it, 1 / e of that.
        pytest.param(120.0, 3.0, 0.6, id="worst speed"),
        pytest.param(120.0, 1.0, 0.2, id="shallow"),
        pytest.param(120.0 * math.exp(0.1), 3.0, 0.6 / math.e, id="faster"),
        pytest.param(120.0 * math.exp(-0.2), 3.0, 0.6 * math.exp(-4.0), id="slower"),
    ],
)
def test_chatter_is_a_bell_over_the_logarithm_of_speed(
    speed: float, depth: float, ratio: float
) -> None:
    records = records_of(log_chatter_cutting_speed=math.log(120.0), chatter_width=0.1, chatter=0.4)
    put(records.p, depth_of_cut=2.0)
    put(records.work, log_cutting_speed=math.log(speed))
    put(records.state, depth_of_cut=depth)
    chatter(records.state, records.work, ENV, records.p)
    assert records.work.chatter[ENV] == pytest.approx(ratio)
