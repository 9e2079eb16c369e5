"""Collapse, chipping and notches of edges."""

import math

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tests.turning_env.playing import UNDISTURBED, changed, play
from turning_env import RoughTurningEnv, RoughTurningVectorEnv


def test_an_edge_collapses_where_its_temperature_exceeds_the_limit() -> None:
    """A worn edge bears less speed: the wear at which it collapses follows from the law."""
    law = UNDISTURBED.edge_failure.temperature
    wear = []
    for action in (0.2, 0.6):
        scenario = changed(
            UNDISTURBED, edge_failure={"collapse_temperature": 700.0}, control={"interval": 1}
        )
        record = play(RoughTurningEnv(scenario), 0, np.full((600, 2), action, np.float32))
        end = int(np.flatnonzero(record["terminated"])[0])
        assert record["broken"][end]
        assert record["edges_broken"][: end + 1].sum() == 1
        speed, feed = record["cutting_speed"][end], record["feed"][end]
        assert (
            law(speed, feed, 2.5, wear=record["wear"][end - 1])
            < 700
            <= law(speed, feed, 2.5, wear=record["wear"][end])
        )
        wear.append(record["wear"][end])
    assert wear[0] > wear[1]


def test_edges_chip_at_a_constant_hazard_rate() -> None:
    """Compare the share of 2000 edges that have chipped with 1 - exp(-rate * time); its standard error is 1.1 %."""
    num_envs, minutes = 2000, 2
    chipping = {"chipping_rate": 0.5, "chipping_load_exponent": 0.0, "chipping_wear_exponent": 0.0}
    env = RoughTurningVectorEnv(
        num_envs, changed(UNDISTURBED, edge_failure=chipping), AutoresetMode.DISABLED
    )
    env.reset(seed=0)
    chipped = np.zeros(num_envs, bool)
    for _ in range(minutes):
        chipped |= env.step(np.zeros((num_envs, 2), np.float32))[4]["broken"]
        env.reset(options={"reset_mask": chipped}) if chipped.any() else None
    assert chipped.mean() == pytest.approx(1.0 - math.exp(-0.5 * minutes), abs=0.035)


def test_a_notch_breaks_an_edge_of_usual_strength_at_one_over_its_growth() -> None:
    scenario = changed(UNDISTURBED, edge_failure={"notch_growth": 1.6}, control={"interval": 1})
    record = play(RoughTurningEnv(scenario), 0, np.full((600, 2), 0.5, np.float32))
    end = int(np.flatnonzero(record["terminated"])[0])
    used = (record["wear"] / scenario.tool.wear_criterion) ** (1 / scenario.material.wear.time)
    assert record["broken"][end]
    assert used[end - 1] < 1 / 1.6 <= used[end]
