"""Collapse, chipping and notches of edges."""

import math

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tests.turning_env.playing import UNDISTURBED, Record, changed, play
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario


def play_one_edge(scenario: Scenario, action: float) -> tuple[Record, int]:
    """Play one action until the edge fails; return the record and the row of its failure."""
    actions = np.full((600, 2), action, np.float32)
    record = play(RoughTurningEnv(scenario), seed=0, actions=actions)
    end = int(np.flatnonzero(record["terminated"])[0])
    return record, end


def wear_at_collapse(action: float) -> float:
    """Check the edge's temperature by its law just before and at collapse; return its wear."""
    law = UNDISTURBED.edge_failure.temperature
    scenario = changed(
        UNDISTURBED, edge_failure={"collapse_temperature": 700.0}, control={"interval": 1}
    )
    record, end = play_one_edge(scenario, action)
    speed = record["cutting_speed"][end]
    feed = record["feed"][end]
    wear_before = record["wear"][end - 1]
    wear = record["wear"][end]
    assert record["broken"][end]
    assert record["edges_broken"][: end + 1].sum() == 1
    assert law(speed, feed, depth_of_cut=2.5, wear=wear_before) < 700
    assert law(speed, feed, depth_of_cut=2.5, wear=wear) >= 700
    return float(wear)


def test_an_edge_collapses_where_its_temperature_exceeds_the_limit() -> None:
    """A worn edge bears less speed."""
    assert wear_at_collapse(action=0.2) > wear_at_collapse(action=0.6)


def test_edges_chip_at_a_constant_hazard_rate() -> None:
    """Compare the share of chipped edges with 1 - exp(-rate t); its standard error is 1.1 %."""
    num_envs = 2000
    minutes = 2
    chipping = {"chipping_rate": 0.5, "chipping_load_exponent": 0.0, "chipping_wear_exponent": 0.0}
    scenario = changed(UNDISTURBED, edge_failure=chipping)
    env = RoughTurningVectorEnv(num_envs, scenario, AutoresetMode.DISABLED)
    env.reset(seed=0)
    chipped = np.zeros(num_envs, bool)
    actions = np.zeros((num_envs, 2), np.float32)
    for _ in range(minutes):
        *_, infos = env.step(actions)
        chipped |= infos["broken"]
        if chipped.any():
            env.reset(options={"reset_mask": chipped})
    expected_share = 1.0 - math.exp(-0.5 * minutes)
    assert chipped.mean() == pytest.approx(expected_share, abs=0.035)


def test_a_notch_breaks_an_edge_of_usual_strength_at_one_over_its_growth() -> None:
    growth = 1.6
    scenario = changed(UNDISTURBED, edge_failure={"notch_growth": growth}, control={"interval": 1})
    record, end = play_one_edge(scenario, 0.5)
    relative_wear = record["wear"] / scenario.tool.wear_criterion
    used_life = relative_wear ** (1 / scenario.material.wear.time)
    assert record["broken"][end]
    assert used_life[end - 1] < 1 / growth <= used_life[end]
