"""Collapse, chipping and notches of edges."""

import math
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tests.turning_env.physics.one_env import AFTER, ENV, Records, put, put_law, records_of
from tests.turning_env.playing import UNDISTURBED, Record, changed, play
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.physics.failure import break_at_notch, break_failing_edges, chip, collapse

EXPONENTS = {"cutting_speed": 1.0, "feed": 2.0, "depth_of_cut": 3.0, "wear": 0.5, "hardness": -1.0}
# 100 * 2 * 0.5^2 * 2^3 * 0.25^0.5 / 4
TEMPERATURE = 50.0


def cutting(**parameters: Any) -> Records:
    """Return records of an edge that cuts for 0.1 min in the sub-step."""
    records = records_of(**parameters)
    put_law(records.p.temperature_law, 100.0, **EXPONENTS)
    put(
        records.work,
        log_cutting_speed=math.log(2.0),
        log_feed=math.log(0.5),
        log_depth=math.log(2.0),
        log_wear=math.log(0.25),
        engaged=0.1,
    )
    put(records.state, log_hardness=math.log(4.0), thrust_force=500.0, edge_strength=1000.0)
    put(records.p, log_wear_criterion=math.log(0.5))
    return records


@pytest.mark.parametrize(
    ("bears", "engaged", "broken_before", "broken"),
    [
        pytest.param(49.9, 0.1, 0, 1, id="too hot"),
        pytest.param(50.1, 0.1, 0, 0, id="not too hot"),
        pytest.param(49.9, 0.0, 0, 0, id="in air"),
        pytest.param(50.1, 0.1, 1, 1, id="broken already"),
    ],
)
def test_an_edge_collapses_while_it_cuts_too_hot(
    bears: float, engaged: float, broken_before: int, broken: int
) -> None:
    records = cutting(log_collapse_temperature=math.log(bears))
    put(records.work, engaged=engaged, broken=broken_before)
    collapse(records.state, records.work, ENV, records.p)
    assert records.work.broken[ENV] == broken


@pytest.mark.parametrize(
    ("margin", "engaged", "broken_before", "left", "broken"),
    [
        # 10 / min * 0.1 min * (500 / 1000)^2 * (0.25 / 0.5)^3 = 1 / 32.
        pytest.param(1.0, 0.1, 0, 31.0 / 32.0, 0, id="margin left"),
        pytest.param(1.0, 0.1, 1, 31.0 / 32.0, 1, id="broken already"),
        pytest.param(0.01, 0.1, 0, 0.01 - 1.0 / 32.0, 1, id="margin used up"),
        pytest.param(-0.1, 0.0, 0, -0.1, 0, id="in air"),
    ],
)
def test_the_hazard_of_chipping_uses_up_its_margin(
    margin: float, engaged: float, broken_before: int, left: float, broken: int
) -> None:
    records = cutting(chipping_rate=10.0, chipping_load_exponent=2.0, chipping_wear_exponent=3.0)
    put(records.work, engaged=engaged, broken=broken_before)
    put(records.state, chipping_margin=margin)
    chip(records.state, records.work, ENV, records.p)
    assert records.state.chipping_margin[ENV] == pytest.approx(left, rel=1e-9)
    assert records.work.broken[ENV] == broken


def test_a_margin_of_exactly_0_is_used_up() -> None:
    records = cutting(chipping_rate=0.0)
    chip(records.state, records.work, ENV, records.p)
    assert records.work.broken[ENV] == 1


def test_the_hazard_is_finite_at_absurd_forces() -> None:
    records = cutting(chipping_rate=10.0, chipping_load_exponent=400.0)
    put(records.state, thrust_force=1e10)
    chip(records.state, records.work, ENV, records.p)
    # The logarithm of the hazard, 400 * log(1e7), is bounded to 300.
    assert -records.state.chipping_margin[ENV] == pytest.approx(math.exp(300.0))


@pytest.mark.parametrize(
    ("strength", "engaged", "broken_before", "broken"),
    [
        # g D = 1.5 * 0.5 = 0.75 of the median strength, 2000 N.
        pytest.param(1499.0, 0.1, 0, 1, id="weaker"),
        pytest.param(1500.0, 0.1, 0, 0, id="as strong"),
        pytest.param(1499.0, 0.0, 0, 0, id="in air"),
        pytest.param(1501.0, 0.1, 1, 1, id="broken already"),
    ],
)
def test_an_edge_breaks_where_its_notch_exceeds_its_relative_strength(
    strength: float, engaged: float, broken_before: int, broken: int
) -> None:
    records = cutting(notch_growth=1.5, edge_strength=2000.0)
    put(records.state, used_life=0.5, edge_strength=strength)
    put(records.work, engaged=engaged, broken=broken_before)
    break_at_notch(records.state, records.work, ENV, records.p)
    assert records.work.broken[ENV] == broken


@pytest.mark.parametrize("kind", ["collapses", "edges_chip", "notches"])
def test_only_the_failures_of_the_scenario_break_edges(kind: str) -> None:
    """Each kind alone would break the edge."""
    for on in (False, True):
        records = cutting(collapses=False, edges_chip=False, notches=False)
        put(records.p, chipping_rate=10.0, notch_growth=9.0, edge_strength=1000.0)
        put(records.p, log_collapse_temperature=math.log(1.0))
        put(records.state, used_life=0.5, chipping_margin=0.0)
        records.p[kind] = on
        put(records.work, engaged=0.0)
        records.work.engaged[:AFTER] = 0.1
        records.state.thrust_force[:] = 500.0
        records.state.edge_strength[:] = 1000.0
        break_failing_edges(records.state, records.work, AFTER, records.p)
        assert records.work.broken[ENV] == on
        assert not records.work.broken[AFTER:].any()


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


@pytest.mark.compiled
def test_an_edge_collapses_where_its_temperature_exceeds_the_limit() -> None:
    """A worn edge bears less speed."""
    assert wear_at_collapse(action=0.2) > wear_at_collapse(action=0.6)


@pytest.mark.compiled
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


@pytest.mark.compiled
def test_a_notch_breaks_an_edge_of_usual_strength_at_one_over_its_growth() -> None:
    growth = 1.6
    scenario = changed(UNDISTURBED, edge_failure={"notch_growth": growth}, control={"interval": 1})
    record, end = play_one_edge(scenario, 0.5)
    relative_wear = record["wear"] / scenario.tool.wear_criterion
    used_life = relative_wear ** (1 / scenario.material.wear.time)
    assert record["broken"][end]
    assert used_life[end - 1] < 1 / growth <= used_life[end]


def test_an_edge_bears_exactly_its_temperature() -> None:
    records = cutting(log_collapse_temperature=math.log(1000.0))
    put_law(records.p.temperature_law, 1000.0)
    collapse(records.state, records.work, ENV, records.p)
    assert records.work.broken[ENV] == 0
