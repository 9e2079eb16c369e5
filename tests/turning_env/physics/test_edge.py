"""Edges by hand: prices in seconds, times in minutes."""

import math

import pytest

from tests.turning_env.physics.one_env import ENV, Records, put, put_law, records_of, values_of
from turning_env.numerics.keyed_random import (
    CHIPPING_CHANNEL,
    EDGE_CHANNEL,
    exponential,
    standard_normals,
)
from turning_env.physics.edge import break_edge, change_edge, charge, fit_edge, stop_machine

LEFT_BEHIND = ("cutting_time", "nominal_used_life", "thrust_force", "power")
LAGGED = ("lagged_thrust_force", "lagged_power")


def made(**parameters: object) -> Records:
    """Return records in which an edge has cut, with wear W = 0.4 D^0.5."""
    records = records_of(**parameters)
    put_law(records.p.wear_law, 1.0, time=0.5)
    put(records.p, log_wear_criterion=math.log(0.4), initial_used_life=0.125)
    put(records.state, seed=5, episode=2, edge=6, used_life=0.25)
    put(records.state, **dict.fromkeys((*LEFT_BEHIND, *LAGGED), 7.0))
    return records


def test_an_edge_is_fitted_with_wear_and_strength_of_its_own() -> None:
    records = made(log_wear_mismatch=0.3, wear_factor_spread=0.1, edge_strength=2000.0)
    put(records.p, edge_strength_spread=0.2)
    put(records.state, chipping_margin=9.0)
    wear, strength = standard_normals(records.state, ENV, channel=EDGE_CHANNEL, bar=0, index=6)
    fit_edge(records.state, ENV, records.p)
    assert records.state.log_wear_factor[ENV] == pytest.approx(0.3 + 0.1 * wear)
    assert records.state.edge_strength[ENV] == pytest.approx(2000.0 * math.exp(0.2 * strength))
    assert records.state.used_life[ENV] == 0.125
    assert values_of(records.state, *LEFT_BEHIND, *LAGGED) == [0.0] * 6
    # Edges that do not chip have no margin.
    assert records.state.chipping_margin[ENV] == 9.0


def test_an_edge_that_chips_is_fitted_with_a_margin() -> None:
    records = made(edges_chip=True)
    margin = exponential(records.state, ENV, channel=CHIPPING_CHANNEL, bar=0, index=6)
    fit_edge(records.state, ENV, records.p)
    assert records.state.chipping_margin[ENV] == margin > 0.0


def test_life_is_charged_at_the_price_of_an_edge() -> None:
    records = made(edge_price=360.0)
    put(records.report, edges_used=2.0, reward_edge=-10.0)
    charge(records.report, ENV, records.p, share=0.25)
    # 360 s * 0.25 = 90 s.
    assert values_of(records.report, "edges_used", "reward_edge") == [2.25, -100.0]


@pytest.mark.parametrize(
    ("used_life", "lost", "paid"),
    [
        pytest.param(0.25, 0.75, 0.75 * 360.0 + 40.0, id="three quarters lost"),
        pytest.param(1.0, 0.0, 40.0, id="used up"),
        pytest.param(1.3, 0.0, 40.0, id="used more than up"),
    ],
)
def test_a_broken_edge_costs_what_is_left_of_it_and_its_downtime(
    used_life: float, lost: float, paid: float
) -> None:
    records = made(edge_price=360.0, breakage_price=40.0)
    put(records.state, used_life=used_life)
    put(records.report, edges_used=2.0, edges_broken=1.0, reward_breakage=-5.0)
    break_edge(records.state, records.report, ENV, records.p)
    expected = [2.0 + lost, 2.0, -5.0 - paid]
    assert values_of(records.report, "edges_used", "edges_broken", "reward_breakage") == expected


@pytest.mark.parametrize(
    ("inspects", "used_life", "wear"),
    [
        pytest.param(True, 0.25, 0.2, id="0.4 * 0.25^0.5"),
        pytest.param(True, 1e-9, 0.4 * 1e-9**0.5, id="hardly cut"),
        pytest.param(True, 0.0, 0.0, id="has not cut"),
        pytest.param(False, 0.25, 0.05, id="not inspected"),
    ],
)
def test_a_changed_edge_is_inspected_and_takes_its_time(
    inspects: bool, used_life: float, wear: float
) -> None:
    records = made(inspects_edges=inspects, edge_change_time=2.0, clock_limit=math.inf)
    put(records.state, used_life=used_life, clock=10.0, removed_wear=0.05)
    next_edge = made()
    put(next_edge.state, edge=7)
    fit_edge(next_edge.state, ENV, next_edge.p)
    change_edge(records.state, records.report, ENV, records.p, stop=0.5)
    assert records.state.removed_wear[ENV] == pytest.approx(wear, rel=1e-9, abs=0.0)
    assert records.state.edge[ENV] == 7
    assert records.state.edge_strength[ENV] == next_edge.state.edge_strength[ENV]
    assert records.state.cutting_time[ENV] == 0.0
    assert records.state.clock[ENV] == 12.5
    assert values_of(records.report, "time", "stopped_time") == [150.0, 150.0]


@pytest.mark.parametrize(
    ("clock", "passed"),
    [
        pytest.param(10.0, 3.0, id="before the limit"),
        pytest.param(58.0, 2.0, id="up to the limit"),
        pytest.param(60.0, 0.0, id="at the limit"),
        pytest.param(61.0, 0.0, id="beyond the limit"),
    ],
)
def test_the_machine_stops_until_the_clock_runs_out(clock: float, passed: float) -> None:
    records = made(clock_limit=60.0, thermal_time_constant=4.0)
    put(records.state, clock=clock, spindle_heat=0.8)
    put(records.report, time=100.0, stopped_time=10.0)
    stop_machine(records.state, records.report, ENV, records.p, minutes=3.0)
    assert records.state.clock[ENV] == clock + passed
    expected = [100.0 + 60.0 * passed, 10.0 + 60.0 * passed]
    assert values_of(records.report, "time", "stopped_time") == expected
    assert records.state.spindle_heat[ENV] == pytest.approx(0.8 * math.exp(-passed / 4.0))
