"""The report by hand: sums, the reward and its terms, and the true state."""

import math

import numpy as np
import pytest

from tests.turning_env.physics.one_env import (
    AFTER,
    ENV,
    Records,
    put,
    put_law,
    records_of,
    values_of,
)
from turning_env.physics.quantities import AT_END, KEPT, OUTCOME, OVER_STEP
from turning_env.physics.report import (
    clear_sums,
    copy_kept,
    finish_step,
    report_cut,
    report_spindle,
    set_end,
    set_reward,
    write_state,
)

TERMS = ("metal", "time", "edge", "overload", "breakage", "roughness")


def test_sums_are_cleared_and_values_at_the_end_are_kept() -> None:
    report = records_of().report
    report.table[:] = 7.0
    clear_sums(report, ENV, AFTER)
    for quantity in AT_END:
        assert report[quantity.name][ENV] == 7.0, quantity.name
    for quantity in (*OVER_STEP, *OUTCOME):
        assert report[quantity.name][ENV] == 0.0, quantity.name
        # The environments beside it keep theirs.
        assert report[quantity.name][ENV - 1] == report[quantity.name][AFTER] == 7.0


def test_the_reward_is_the_sum_of_its_terms() -> None:
    records = records_of(reference_removal_rate=120.0, overload_price=5.0, roughness_price=3.0)
    put(
        records.report,
        removed=240.0,  # [cm3], worth 2 min
        time=75.0,  # [s]
        reward_edge=-11.0,
        excess_force=0.25,  # [min]
        excess_power=0.5,
        reward_breakage=-17.0,
        roughness_deviation=4.0,  # [s]
    )
    set_reward(records.report, ENV, records.p)
    terms = values_of(records.report, *[f"reward_{term}" for term in TERMS])
    # The overload costs 60 * 5 * (0.25 + 0.5) = 225 s, the roughness 3 * 4 s.
    assert terms == pytest.approx([120.0, -75.0, -11.0, -225.0, -17.0, -12.0])
    assert records.report.reward[ENV] == pytest.approx(-220.0)


ENDS = pytest.mark.parametrize(
    ("state", "edge_failed", "ends_with_edge", "terminated", "truncated", "finished"),
    [
        pytest.param({}, 0, True, 0, 0, 0, id="goes on"),
        pytest.param({"path": 900.0}, 0, True, 1, 0, 1, id="job done"),
        pytest.param({"path": 900.0 - 5e-7}, 0, True, 1, 0, 1, id="job done but for rounding"),
        pytest.param({"path": 900.0 - 2e-6}, 0, True, 0, 0, 0, id="job not done"),
        pytest.param({}, 1, True, 1, 0, 0, id="edge failed and ends it"),
        pytest.param({}, 1, False, 0, 0, 0, id="edge failed and is changed"),
        pytest.param({"step_count": 50}, 0, True, 0, 1, 0, id="out of steps"),
        pytest.param({"step_count": 49}, 0, True, 0, 0, 0, id="one step left"),
        pytest.param({"step_count": 50}, 1, True, 1, 0, 0, id="failed in the last step"),
        pytest.param({"step_count": 50}, 0, False, 0, 0, 0, id="steps do not count"),
        pytest.param({"clock": 30.0}, 0, False, 0, 1, 0, id="out of minutes"),
        pytest.param({"clock": 29.96}, 0, False, 0, 1, 0, id="out of minutes but for rounding"),
        pytest.param({"clock": 29.94}, 0, False, 0, 0, 0, id="a minute's rest left"),
        pytest.param({"clock": 30.0}, 0, True, 0, 0, 0, id="minutes do not count"),
    ],
)


@ENDS
def test_an_episode_ends_by_its_job_its_edge_or_its_time(
    state: dict[str, float],
    edge_failed: int,
    ends_with_edge: bool,
    terminated: int,
    truncated: int,
    finished: int,
) -> None:
    records = records_of(path_end=900.0, step_limit=50, time_limit=30.0, sub_step=0.1)
    put(records.state, path=500.0, step_count=10, clock=20.0)
    put(records.state, **state)
    put(records.work, edge_failed=edge_failed)
    set_end(records.state, records.work, records.report, ENV, records.p, ends_with_edge)
    outcome = values_of(records.report, "terminated", "truncated", "finished")
    assert outcome == [terminated, truncated, finished]
    assert records.state.ended[ENV] == max(terminated, truncated)


@pytest.mark.parametrize(
    ("by_step", "engaged_time", "means"),
    [
        pytest.param(True, 20.0, [300.0, 1.5], id="over the time in metal"),
        pytest.param(True, 0.5, [12000.0, 60.0], id="over half a second"),
        pytest.param(True, 0.0, [6000.0, 30.0], id="no metal"),
        pytest.param(False, 20.0, [6000.0, 30.0], id="set by the last pass"),
    ],
)
def test_a_step_finishes_with_means(by_step: bool, engaged_time: float, means: list[float]) -> None:
    records = records_of(path_end=900.0, step_limit=50, overload_price=2.0)
    put(records.p, overload_allowance=0.05, overload_tolerance=0.1)
    put(records.work, minutes=0.5, edge_failed=1)
    put(
        records.report,
        engaged_time=engaged_time,
        mean_thrust_force=6000.0,
        mean_power=30.0,
        excess_force=0.1,
        excess_power=0.2,
        severe_overload_time=3.0,
    )
    finish_step(records.state, records.work, records.report, ENV, records.p, True, by_step)
    report = records.report
    assert values_of(report, "mean_thrust_force", "mean_power") == means
    # Excess integrated over 0.5 min: 0.1 min and 0.2 min.
    excess = values_of(report, "excess_force", "excess_power", "excess")
    assert excess == pytest.approx([0.2, 0.4, 0.6])
    # Of the time in metal, 5 % may be severe overload.
    assert report.cost[ENV] == pytest.approx(3.0 - 0.05 * engaged_time)
    # The reward takes the integrals: 60 * 2 * 0.3 min.
    assert report.reward[ENV] == pytest.approx(-36.0)
    assert report.terminated[ENV] == 1.0
    assert report.broken[ENV] == 0.0


@pytest.mark.parametrize(("edges_broken", "broken"), [(0.0, 0.0), (1.0, 1.0), (3.0, 1.0)])
def test_a_step_says_whether_an_edge_broke(edges_broken: float, broken: float) -> None:
    records = records_of()
    put(records.work, minutes=0.5)
    put(records.report, edges_broken=edges_broken)
    finish_step(records.state, records.work, records.report, ENV, records.p, True, True)
    assert records.report.broken[ENV] == broken


@pytest.mark.parametrize(
    ("reads_torque", "load"),
    [
        # 12 kW of 10 kW, and of the 8 kW that are available at 200 m/min.
        pytest.param(False, 1.2, id="of power"),
        pytest.param(True, 1.5, id="of torque"),
    ],
)
def test_the_spindle_by_hand(reads_torque: bool, load: float) -> None:
    records = records_of(
        revolutions_per_metre=5.0,
        idle_power_per_speed=0.01,
        capacity_per_speed=0.004,
        rated_power=10.0,
        reads_torque=reads_torque,
    )
    put(records.state, cutting_speed=200.0, feed=0.3, power=10.0)
    report_spindle(records.state, records.report, ENV, records.p)
    names = ("spindle_speed", "feed_velocity", "power", "spindle_load", "torque")
    # At n = 1000 rev/min, 12 kW are 12000 W / (2 pi 1000 / 60 s) = 360 / pi N m.
    expected = [1000.0, 300.0, 12.0, load, 360.0 / math.pi]
    assert values_of(records.report, *names) == pytest.approx(expected)


def cutting(in_metal: int, used_life: float) -> Records:
    records = records_of(bars_per_path=1.0 / 320.0, log_wear_criterion=math.log(0.4))
    put_law(records.p.wear_law, 1.0, time=0.5)
    put(
        records.state,
        path=2.9 * 320.0,
        cutting=in_metal,
        depth_of_cut=2.0,
        log_hardness=math.log(1.25),
        log_wear_factor=math.log(0.8),
        used_life=used_life,
        thrust_force=500.0,
    )
    return records


@pytest.mark.parametrize(
    ("in_metal", "used_life", "expected"),
    [
        pytest.param(1, 0.25, [2.0, 1.0, 2.0, 1.25, 0.8, 0.2], id="in metal"),
        pytest.param(0, 1e-6, [2.0, 0.0, 0.0, 0.0, 0.8, 0.0004], id="in air, hardly used"),
        pytest.param(0, 0.0, [2.0, 0.0, 0.0, 0.0, 0.8, 0.0], id="in air, unused"),
    ],
)
def test_the_cut_by_hand(in_metal: int, used_life: float, expected: list[float]) -> None:
    records = cutting(in_metal, used_life)
    report_cut(records.state, records.report, ENV, records.p)
    names = ("bar", "cutting", "depth_of_cut", "hardness", "wear_factor", "wear")
    # Zeros are exact.
    assert values_of(records.report, *names) == pytest.approx(expected, rel=1e-6, abs=0.0)


def test_shared_quantities_are_copied() -> None:
    records = records_of()
    for number, name in enumerate(KEPT):
        put(records.state, **{name: number + 1.0})
    copy_kept(records.state, records.report, ENV, AFTER)
    assert values_of(records.report, *KEPT) == list(np.arange(1.0, len(KEPT) + 1.0))


@pytest.mark.parametrize(
    ("holds", "in_metal", "roughness"),
    [
        # 0.5 exp(0.002 * 500).
        pytest.param(True, 1, 0.5 * math.e, id="in metal"),
        pytest.param(True, 0, 0.0, id="in air"),
        pytest.param(False, 1, 0.0, id="no reference"),
    ],
)
def test_the_true_state_is_written_whole(holds: bool, in_metal: int, roughness: float) -> None:
    records = cutting(in_metal, used_life=0.25)
    put(records.p, holds_roughness=holds, roughness_at_no_force=0.5, roughness_rate=0.002)
    put(records.state, cutting_speed=150.0)
    records.state.cutting_speed[:] = 150.0
    records.report.table[:] = 7.0
    write_state(records.state, records.report, ENV, AFTER, records.p)
    assert records.report.roughness[ENV] == pytest.approx(roughness)
    assert records.report.cutting_speed[ENV] == 150.0
    assert records.report.wear[ENV] == pytest.approx(0.2)
    speed = 150.0 * records.p.revolutions_per_metre[ENV]
    assert records.report.spindle_speed[ENV] == pytest.approx(speed)
    assert records.report.spindle_speed[AFTER] == 7.0
