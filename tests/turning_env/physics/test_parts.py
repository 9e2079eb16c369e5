"""Parts by hand: passes of an allowance, their set points, and what the control keeps of them."""

import math

import numpy as np
import pytest

from tests.turning_env.physics.one_env import ENV, Records, put, records_of, values_of
from turning_env.physics.parts import MIN_DEPTH, end_pass, start_part, start_pass

PITCH = 320.0  # [mm]


def made(path: float = 3.0 * PITCH) -> Records:
    """Return records of a machine that cuts 100..300 m/min and 0.1..0.5 mm/rev."""
    records = records_of()
    put(
        records.p,
        passes_max=4,
        depth_of_cut=2.5,
        bar_pitch=PITCH,
        bars_per_path=1.0 / PITCH,
        cutting_speed_min=100.0,
        cutting_speed_max=300.0,
        reachable_cutting_speed=280.0,
        feed_min=0.1,
        feed_max=0.5,
        revolutions_per_metre=4.0,
        sub_steps=10,
    )
    put(records.state, path=path)
    return records


@pytest.mark.parametrize(
    ("action", "passes"),
    [
        pytest.param(-9.0, 1, id="clipped"),
        pytest.param(-1.0, 1, id="lowest"),
        pytest.param(-0.51, 1, id="end of the first quarter"),
        pytest.param(-0.49, 2, id="second quarter"),
        pytest.param(0.0, 3, id="third quarter"),
        pytest.param(0.51, 4, id="last quarter"),
        pytest.param(1.0, 4, id="highest"),
        pytest.param(9.0, 4, id="clipped to the highest"),
    ],
)
def test_the_range_of_an_action_is_divided_evenly_among_the_passes(
    action: float, passes: int
) -> None:
    records = made()
    start_part(records.state, records.work, ENV, records.p, np.array([action, 0.2]))
    assert records.work.passes[ENV] == passes
    # The allowance is 2.5 * (1 + 0.2) = 3 mm.
    assert records.work.pass_depth[ENV] == pytest.approx(3.0 / passes)


@pytest.mark.parametrize(("action", "allowance"), [(-2.0, 0.0), (-0.5, 1.25), (1.5, 5.0)])
def test_the_allowance_is_up_to_twice_the_nominal_one(action: float, allowance: float) -> None:
    records = made()
    start_part(records.state, records.work, ENV, records.p, np.array([-1.0, action]))
    assert records.work.pass_depth[ENV] == pytest.approx(allowance)


@pytest.mark.parametrize("rounding", [-1e-9, 1e-9])
def test_a_part_starts_at_the_end_of_the_one_before(rounding: float) -> None:
    records = made(path=3.0 * PITCH + rounding)
    start_part(records.state, records.work, ENV, records.p, np.zeros(10))
    assert records.work.part_start[ENV] == 3.0 * PITCH


ACTION = np.array([0.0, 0.0, 0.0, 0.5, 1.0, -0.5, -1.0, 1.0, -3.0, -3.0])


@pytest.mark.parametrize(
    ("number", "speed", "feed", "floor", "ceiling"),
    [
        # Three passes of 0.8 mm; 0 is the middle of a range, 0.5 three quarters of it.
        pytest.param(0, 200.0, 0.4, 1.6, math.inf, id="first"),
        pytest.param(1, 280.0, 0.2, 0.8, 1.6, id="second, at the reachable speed"),
        pytest.param(2, 100.0, 0.5, 0.0, 0.8, id="last"),
    ],
)
def test_a_pass_cuts_a_layer_at_its_set_point(
    number: int, speed: float, feed: float, floor: float, ceiling: float
) -> None:
    records = made()
    put(records.work, passes=3, pass_depth=0.8, part_start=2.0 * PITCH)
    put(records.report, passes=5.0, engaged_time=7.0, mean_thrust_force=9.0, mean_power=9.0)
    start_pass(records.state, records.work, records.report, ENV, records.p, ACTION, number)
    names = ("commanded_cutting_speed", "commanded_feed", "path", "pass_floor", "pass_ceiling")
    expected = [speed, feed, 2.0 * PITCH, floor, ceiling]
    assert values_of(records.state, *names) == pytest.approx(expected)
    assert records.state.log_nominal_depth[ENV] == pytest.approx(math.log(0.8))
    assert values_of(records.report, "passes", "mean_thrust_force", "mean_power") == [6.0, 0, 0]
    assert records.work.engaged_before[ENV] == 7.0
    # 320 mm at 4 rev/m * speed * feed [mm/min], in ten sub-steps.
    assert records.work.sub_step[ENV] == pytest.approx(PITCH / (4.0 * speed * feed) / 10.0)
    assert records.work.sub_steps_left[ENV] == 10


def test_the_nominal_depth_of_a_pass_is_at_least_a_hundredth_of_a_millimetre() -> None:
    records = made()
    put(records.work, passes=1, pass_depth=0.0)
    start_pass(records.state, records.work, records.report, ENV, records.p, ACTION, 0)
    assert MIN_DEPTH == 0.01
    assert records.state.log_nominal_depth[ENV] == pytest.approx(math.log(0.01))


@pytest.mark.parametrize(
    ("engaged_before", "force", "power"),
    [
        # 6000 N s and 30 kJ in the 20 s since the pass began, of 50 s of the step.
        pytest.param(30.0, 300.0, 1.5, id="mean over the pass"),
        pytest.param(50.0, 6000.0, 30.0, id="only air: the sums, which are 0 then, stay"),
    ],
)
def test_a_pass_ends_with_its_means_and_the_return_of_the_tool(
    engaged_before: float, force: float, power: float
) -> None:
    records = made()
    put(records.p, return_time=0.25, thermal_time_constant=0.5)
    put(records.work, engaged_before=engaged_before, part_start=2.0 * PITCH)
    put(records.report, engaged_time=50.0, mean_thrust_force=6000.0, mean_power=30.0, time=9.0)
    put(records.state, clock=4.0, spindle_heat=1.0, pass_floor=1.0, pass_ceiling=2.0)
    end_pass(records.state, records.work, records.report, ENV, records.p)
    assert values_of(records.report, "mean_thrust_force", "mean_power") == [force, power]
    assert values_of(records.state, "lagged_thrust_force", "lagged_power") == [force, power]
    assert records.state.clock[ENV] == 4.25
    assert records.report.time[ENV] == 9.0 + 15.0
    assert records.state.spindle_heat[ENV] == pytest.approx(math.exp(-0.5))
    assert values_of(records.state, "path", "pass_floor", "pass_ceiling") == [
        3.0 * PITCH,
        0.0,
        math.inf,
    ]
