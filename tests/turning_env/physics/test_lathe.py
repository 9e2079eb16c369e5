"""The transition: what edges cost, and how episodes end."""

import math
from typing import Any

import gymnasium
import numpy as np
import pytest

from tests.turning_env.physics.one_env import (
    AFTER,
    ENV,
    Records,
    fill,
    put,
    put_law,
    records_of,
    values_of,
)
from tests.turning_env.playing import (
    HOT_SPINDLE,
    SHORT_LIVED,
    UNDISTURBED,
    changed,
    fixed_actions,
    infos,
    play,
)
from turning_env import IDS, RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.batch.driver import start_episodes
from turning_env.numerics.keyed_random import TANGLE_CHANNEL, exponential
from turning_env.physics.lathe import (
    add_roughness,
    add_to_sums,
    begin_charging,
    change_commanded_edges,
    charge_time_and_life,
    command,
    compare_with_further_limits,
    end_sub_step,
    leave_metal,
    load_edges,
    log_minute_wear,
    look_ahead,
    look_up_cuts,
    move,
    move_tools,
    replace_failed_edges,
    run_step,
    start_episode,
    start_interval,
    start_parts,
    wear_edges,
)
from turning_env.physics.machinability import force_and_power
from turning_env.physics.quantities import (
    AUTOMATIC,
    COMMANDED,
    END,
    INCREMENTAL,
    OVERRIDE,
    PART,
    REPORT,
    SET_POINT,
    STATE,
    WIDTH,
    layout,
)
from turning_env.physics.records import block_records
from turning_env.physics.wear import CLOCK_TIME, EQUIVALENT_TIME
from turning_env.scenario.power_law import MIN_DEPTH, MIN_LIFE


@pytest.mark.compiled
@pytest.mark.parametrize("source", [SHORT_LIVED, "shift", "batch_casting"])
def test_every_edge_is_paid_for_whole(source):
    scenario = Scenario.load(source)
    economics = scenario.economics
    edge_price = 60 * economics.edge_cost
    breakage_price = 0.0
    if scenario.control.edge_changes == "end":
        # Changes take no time, so their time is part of the price.
        edge_price += 60 * economics.edge_change_time
        breakage_price = 60 * economics.breakage_downtime
    actions = fixed_actions(600, 1, scenario)[:, 0]
    record = play(RoughTurningEnv(scenario), seed=1, actions=actions)
    downtime = breakage_price * record["edges_broken"]
    paid = -record["reward_edge"] - record["reward_breakage"] - downtime
    assert paid == pytest.approx(edge_price * record["edges_used"], rel=1e-9, abs=1e-9)
    assert record["edges_used"].sum() > 0.5
    assert record["broken"].tolist() == (record["edges_broken"] > 0).tolist()


@pytest.mark.compiled
def test_a_worn_edge_ends_the_step_at_once():
    wear_law = UNDISTURBED.material.wear
    criterion = UNDISTURBED.tool.wear_criterion
    scenario = changed(UNDISTURBED, control={"sub_steps": 10000, "time_limit": 1e4})
    actions = np.ones((100, 2), np.float32)
    record = play(RoughTurningEnv(scenario), seed=0, actions=actions)
    end = int(np.flatnonzero(record["terminated"])[0])
    life = record["time"][: end + 1].sum() / 60

    # W = W_1 t^n, so the Taylor life is T = (W_max / W_1)^(1 / n).
    wear_after_minute = wear_law(200, 0.6, depth_of_cut=2.5)
    taylor_life = (criterion / wear_after_minute) ** (1 / wear_law.time)
    assert life == pytest.approx(taylor_life, abs=1e-4)
    assert record["wear"][end] == pytest.approx(criterion, rel=1e-4)


def test_an_episode_starts_with_nothing_of_the_one_before():
    """Also in quantities that no effect of the scenario sets."""
    scenario = Scenario()
    quantities = [quantity.name for quantity in STATE if quantity.shape == (WIDTH,)]
    observations = np.zeros((WIDTH, len(layout(scenario))), np.float32)
    table = np.zeros((len(REPORT), WIDTH))
    starts = []
    for left_behind in (0, 7):
        states, parameters, scratches = block_records(scenario)
        for name in set(quantities) - {"seed", "episode"}:
            states[name] = left_behind
        chosen = np.ones(WIDTH, np.bool_)
        start_episodes(states, parameters, scratches, chosen, observations, table)
        starts.append(states)
    for name in quantities:
        assert starts[0][name].tobytes() == starts[1][name].tobytes(), name


def machine(**parameters: Any) -> Records:
    """Return records of a machine that cuts 100..400 m/min (reaching 300) and 0.1..0.6 mm/rev."""
    records = records_of()
    fill(
        records.p,
        cutting_speed_min=100.0,
        cutting_speed_max=400.0,
        reachable_cutting_speed=300.0,
        feed_min=0.1,
        feed_max=0.6,
        initial_feed=0.3,
        initial_cutting_speed=150.0,
        override_max=1.5,
        cutting_speed_step=0.1,
        feed_step=0.2,
    )
    fill(records.state, commanded_cutting_speed=200.0, commanded_feed=0.4)
    put(records.p, **parameters)
    return records


@pytest.mark.parametrize(
    ("kind", "action", "speed", "feed"),
    [
        pytest.param(SET_POINT, (-0.5, 0.5), 175.0, 0.475, id="set point"),
        pytest.param(SET_POINT, (1.0, -2.0), 300.0, 0.1, id="set point, out of reach"),
        pytest.param(
            INCREMENTAL, (0.5, -1.0), 200.0 * math.exp(0.05), 0.4 * math.exp(-0.2), id="increment"
        ),
        pytest.param(INCREMENTAL, (9.0, 0.0), 200.0 * math.exp(0.1), 0.4, id="clipped increment"),
        # 0.5 * (0.2 + 1) * 1.5 = 0.9 of 0.3 mm/rev.
        pytest.param(OVERRIDE, (0.2, 9.0), 200.0, 0.27, id="override"),
        pytest.param(OVERRIDE, (-1.0, 9.0), 200.0, 0.1, id="override 0, at the lowest feed"),
        pytest.param(OVERRIDE, (1.0, 9.0), 200.0, 0.45, id="highest override"),
    ],
)
def test_an_action_commands_speed_and_feed(
    kind: int, action: tuple[float, float], speed: float, feed: float
) -> None:
    records = machine(action=kind)
    command(records.state, records.work, np.tile(action, (AFTER, 1)), AFTER, records.p)
    commanded = values_of(records.state, "commanded_cutting_speed", "commanded_feed")
    assert commanded == pytest.approx([speed, feed])


@pytest.mark.parametrize(
    ("before", "action", "after"),
    [((101.0, 0.11), -1.0, (100.0, 0.1)), ((299.0, 0.59), 1.0, (300.0, 0.6))],
)
def test_increments_stay_within_the_machines_range(
    before: tuple[float, float], action: float, after: tuple[float, float]
) -> None:
    records = machine(action=INCREMENTAL)
    put(records.state, commanded_cutting_speed=before[0], commanded_feed=before[1])
    command(records.state, records.work, np.full((AFTER, 2), action), AFTER, records.p)
    commanded = values_of(records.state, "commanded_cutting_speed", "commanded_feed")
    assert commanded == pytest.approx(list(after))


@pytest.mark.parametrize(("limited", "speed"), [(True, 120.0), (False, 250.0)])
def test_a_section_limits_the_commanded_speed(limited: bool, speed: float) -> None:
    records = machine(action=SET_POINT, has_section_speeds=limited, depth_sections=1)
    records.p.section_speeds[0] = 120.0
    command(records.state, records.work, np.zeros((AFTER, 2)), AFTER, records.p)
    assert records.state.commanded_cutting_speed[ENV] == pytest.approx(speed)


@pytest.mark.parametrize("delays", [True, False])
def test_an_interval_starts_with_its_sub_steps_and_the_command_before(delays: bool) -> None:
    records = machine(action=SET_POINT, delays_commands=delays, sub_steps=7, sub_step=0.01)
    start_interval(records.state, records.work, np.zeros((AFTER, 2)), AFTER, records.p)
    assert records.work.sub_steps_left[ENV] == 7
    assert records.work.sub_step[ENV] == 0.01
    assert records.state.commanded_cutting_speed[ENV] == pytest.approx(250.0)
    assert records.state.past_cutting_speeds[0, ENV] == (200.0 if delays else 0.0)


def moving(**parameters: Any) -> Records:
    """Return records of a tool that turns 2 rev/m, 10 mm before a bar of 300 mm."""
    records = records_of()
    fill(
        records.p,
        spindle_share=0.5,
        feed_share=0.25,
        revolutions_per_metre=2.0,
        bar_length=300.0,
        approach=20.0,
        bar_pitch=320.0,
        bars_per_path=1.0 / 320.0,
    )
    put(records.p, **parameters)
    fill(records.state, cutting_speed=100.0, feed=0.2, path=10.0, turns=5.0)
    fill(records.work, target_cutting_speed=200.0, target_feed=0.6, sub_steps_left=3)
    fill(records.work, sub_step=0.1, time=1.0)
    return records


def test_drives_follow_their_lags_and_the_tool_moves_with_their_new_speeds() -> None:
    records = moving()
    move(records.state, records.work, ENV, records.p)
    # 150 m/min at 2 rev/m for 0.1 min; 0.3 mm/rev.
    assert values_of(records.state, "cutting_speed", "feed") == pytest.approx([150.0, 0.3])
    assert values_of(records.state, "turns", "path") == pytest.approx([35.0, 19.0])
    assert values_of(records.work, "turns", "time") == pytest.approx([30.0, 1.1])
    assert values_of(records.work, "cut", "middle", "engaged") == [0.0, 0.0, 0.0]
    assert records.work.sub_steps_left[ENV] == 2
    assert records.state.cutting[ENV] == 0


def test_only_the_metal_that_was_passed_counts_as_cut() -> None:
    records = moving()
    put(records.state, path=20.0 + 5.0 - 9.0)
    move(records.state, records.work, ENV, records.p)
    # Of 9 mm at 90 mm/min, 5 mm lie in metal.
    assert values_of(records.work, "cut", "middle") == pytest.approx([5.0, 2.5])
    assert records.work.engaged[ENV] == pytest.approx(5.0 / 90.0)
    assert records.state.cutting[ENV] == 1
    # On the way back of a new pass, nothing is cut.
    put(records.work, cut=100.0)
    move(records.state, records.work, ENV, records.p)
    assert records.work.engaged[ENV] == 0.0


def test_a_stopped_tool_stands() -> None:
    records = moving()
    put(records.work, sub_steps_left=0)
    put(records.state, cutting=1)
    move(records.state, records.work, ENV, records.p)
    assert values_of(records.state, "cutting_speed", "feed", "turns", "path") == [
        100.0,
        0.2,
        5.0,
        10.0,
    ]
    assert values_of(records.work, "turns", "time", "sub_steps_left") == [0.0, 1.0, 0.0]
    assert records.state.cutting[ENV] == 1


@pytest.mark.parametrize(("delays", "speed"), [(True, 120.0), (False, 150.0)])
def test_drives_may_follow_late_commands(delays: bool, speed: float) -> None:
    records = moving(delays_commands=delays, sub_steps=3)
    fill(records.p, steps_late=1.0)
    records.state.past_cutting_speeds[0] = 140.0
    records.state.past_feeds[0] = 0.2
    move_tools(records.state, records.work, AFTER, records.p)
    assert records.state.cutting_speed[ENV] == pytest.approx(speed)


@pytest.mark.parametrize(("floor", "engaged"), [(0.0, 0.1), (2.0, 0.0)])
@pytest.mark.parametrize("bends", [False, True])
def test_a_cut_has_its_depth_and_logarithms(floor: float, engaged: float, bends: bool) -> None:
    records = moving(bends=bends)
    fill(records.p, depth_of_cut=2.0, depth_bar_spread=0.0, depth_along_spread=0.0)
    fill(records.p, bars_per_cut=1.0 / 300.0, bar_flexibility=1e-9, radial_share=0.5)
    fill(records.state, pass_floor=floor, pass_ceiling=math.inf, used_life=0.3)
    fill(records.state, depth_of_cut=1.0, thrust_force=900.0)
    fill(records.work, engaged=0.1)
    records.p.support = 1
    look_up_cuts(records.state, records.work, AFTER, records.p)
    # A cantilever of 300 mm yields 0.027 mm/N to half of 900 N/mm.
    expected = (2.0 - floor) / (1.0 + (0.5 * 900.0 * 0.027 if bends else 0.0))
    assert records.state.depth_of_cut[ENV] == pytest.approx(expected)
    assert records.work.engaged[ENV] == engaged
    assert records.work.life_before[ENV] == 0.3
    logarithms = values_of(records.work, "log_cutting_speed", "log_feed", "log_depth")
    expected_logarithms = [math.log(100.0), math.log(0.2), math.log(max(expected, MIN_DEPTH))]
    assert logarithms == pytest.approx(expected_logarithms)


def cutting(**parameters: Any) -> Records:
    """Return records of an edge that cuts with K = 0.05 mm, W = 0.4 D^(1/2), in a hard skin."""
    records = records_of()
    p = records.p
    for law in (p.wear_law, p.force_law, p.power_law, p.nominal.wear_law):
        for name in law.dtype.names:
            law[name][...] = 0.0
    p.wear_law.log_coefficient[...] = math.log(0.05)
    p.wear_law.cutting_speed[...] = 1.0
    p.wear_law.time[...] = 0.5
    fill(p, life_exponent=2.0, log_wear_criterion=math.log(0.4))
    fill(records.state, used_life=0.25, cutting_time=4.0, edge_strength=1e9)
    fill(records.work, engaged=5.0, life_before=0.25)
    put(p, **parameters)
    return records


@pytest.mark.parametrize(
    ("rule", "life"),
    [
        # Per minute (0.05 / 0.4)^2 = 1 / 64; by the clock, W / 0.4 grows by (3 - 2) / 8.
        pytest.param(EQUIVALENT_TIME, 0.25 + 5.0 / 64.0, id="equivalent time"),
        pytest.param(CLOCK_TIME, 0.625**2, id="clock time"),
    ],
)
def test_an_edge_wears_by_the_rule_of_the_scenario(rule: int, life: float) -> None:
    records = cutting(wear_rule=rule, has_phases=False)
    wear_edges(records.state, records.work, AFTER, records.p)
    assert records.state.used_life[ENV] == pytest.approx(life)


def test_by_the_clock_an_edge_does_not_wear_in_air_and_never_becomes_sharper() -> None:
    records = cutting(wear_rule=CLOCK_TIME, has_phases=False)
    put(records.work, engaged=0.0)
    put(records.state, used_life=0.1)
    wear_edges(records.state, records.work, AFTER, records.p)
    assert records.state.used_life[ENV] == 0.1
    lives = np.linspace(0.01, 0.9, 50)
    for life in lives:
        put(records.work, engaged=1e-17)
        put(records.state, used_life=life)
        wear_edges(records.state, records.work, AFTER, records.p)
        assert records.state.used_life[ENV] >= life


def test_phases_count_where_the_scenario_has_them() -> None:
    records = cutting(wear_rule=EQUIVALENT_TIME, has_phases=True)
    fill(records.p, tertiary_rate=0.0, running_in=0.0, built_up_edge=1.0, built_up_width=0.25)
    fill(records.p, log_built_up_speed=0.0)
    wear_edges(records.state, records.work, AFTER, records.p)
    # At the speed of the built-up edge (its logarithm is 0 here) wear is twice as fast.
    assert records.state.used_life[ENV] == pytest.approx(0.25 + 10.0 / 64.0)


def test_insert_and_skin_multiply_the_wear_of_the_law() -> None:
    records = cutting()
    put(records.state, log_wear_factor=0.1, log_skin_wear=0.2)
    put(records.work, log_cutting_speed=0.4)
    log_k = log_minute_wear(records.state, records.work, ENV, records.p)
    assert log_k == pytest.approx(math.log(0.05) + 0.4 + 0.1 + 0.2)


@pytest.mark.parametrize(
    ("chips_lag", "chatters", "engaged", "force", "power"),
    [
        # F = 1000 N * 0.2 mm / mm, P = 4 kW.
        pytest.param(False, False, 0.5, 200.0, 4.0, id="cuts"),
        pytest.param(False, False, 0.0, 120.0, 3.0, id="in air"),
        pytest.param(True, False, 0.5, 200.0 - 80.0 / math.e, 4.0 - 1.0 / math.e, id="chip lags"),
        pytest.param(False, True, 0.5, 300.0, 4.0, id="chatters"),
    ],
)
@pytest.mark.parametrize("fresh_edges_load", [False, True])
def test_loads_follow_their_laws_and_the_chip(
    chips_lag: bool,
    chatters: bool,
    engaged: float,
    force: float,
    power: float,
    fresh_edges_load: bool,
) -> None:
    records = cutting(chips_lag=chips_lag, chatters=chatters, fresh_edges_load=fresh_edges_load)
    put_law(records.p.force_law, 1000.0, wear=1.0)
    put_law(records.p.power_law, 4.0)
    fill(records.p, chip_lag=2.0, chatter=0.5, chatter_width=0.1, log_chatter_cutting_speed=0.0)
    fill(records.p, depth_of_cut=1.0)
    fill(records.state, thrust_force=120.0, power=3.0, depth_of_cut=1.0)
    fill(records.work, turns=2.0, engaged=engaged)
    load_edges(records.state, records.work, AFTER, records.p)
    loads = values_of(records.state, "thrust_force", "power")
    assert loads == pytest.approx([force, power])
    assert records.state.cutting_time[ENV] == 4.0 + engaged
    assert records.work.log_wear[ENV] == pytest.approx(math.log(0.2))


def test_an_unused_edge_has_the_least_wear_instead_of_none() -> None:
    records = cutting()
    put(records.state, used_life=0.0)
    load_edges(records.state, records.work, AFTER, records.p)
    assert records.work.log_wear[ENV] == pytest.approx(math.log(0.4 * MIN_LIFE**0.5))
    logs = (0.0, 0.0, 0.0, 0.0, 0.0)
    assert force_and_power(records.p, ENV, *logs) == pytest.approx((1.0, 1.0))


def test_the_deviation_of_the_roughness_is_1_in_air() -> None:
    records = records_of(roughness_at_no_force=0.5, roughness_rate=0.002, sub_step=0.25)
    put(records.state, thrust_force=500.0, roughness_reference=2.0)
    put(records.work, engaged=0.2)
    put(records.report, roughness_deviation=1.0)
    add_roughness(records.state, records.work, records.report, ENV, records.p)
    # Ra = 0.5 e um for 12 s, then 3 s of air.
    expected = 1.0 + 12.0 * (1.0 - 0.25 * math.e) + 3.0
    assert records.report.roughness_deviation[ENV] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("shares", "over"),
    [
        pytest.param([], 0.7, id="no limit keeps what was"),
        pytest.param([1.5], 0.5, id="one"),
        pytest.param([1.5, 3.0, 1.2], 2.0, id="largest of three"),
        pytest.param([0.5, 0.2], 0.0, id="within both"),
    ],
)
def test_the_largest_excess_over_further_limits_counts(shares: list[float], over: float) -> None:
    records = records_of(further_limits=len(shares))
    for place, share in enumerate(shares):
        records.p.further_laws[place] = (math.log(share), 0.0, 0.0, 0.0)
    fill(records.work, over_further=0.7)
    compare_with_further_limits(records.state, records.work, AFTER, records.p)
    assert records.work.over_further[ENV] == pytest.approx(over)


IN_METAL = {"engaged": 0.1}


@pytest.mark.parametrize(
    ("state", "work", "kind", "worn", "broken", "failed", "left"),
    [
        pytest.param({}, IN_METAL, SET_POINT, 0, 0, 0, 5, id="goes on"),
        pytest.param({"used_life": 1.0}, IN_METAL, SET_POINT, 1, 0, 1, 0, id="worn"),
        pytest.param({"used_life": 1.0}, {}, SET_POINT, 0, 0, 0, 5, id="worn, in air"),
        pytest.param({"used_life": 1.0}, IN_METAL, PART, 1, 0, 1, 5, id="worn in a part"),
        pytest.param({"thrust_force": 901.0}, IN_METAL, SET_POINT, 0, 1, 1, 0, id="broken"),
        pytest.param({"thrust_force": 900.0}, IN_METAL, SET_POINT, 0, 0, 0, 5, id="just held"),
        pytest.param({"thrust_force": 901.0}, {}, SET_POINT, 0, 0, 0, 5, id="overload, in air"),
        pytest.param({}, {"broken": 1}, SET_POINT, 0, 1, 1, 0, id="broken before"),
        pytest.param({}, {"worn": 1}, SET_POINT, 1, 0, 1, 0, id="worn before"),
        pytest.param({"path": 640.0}, IN_METAL, SET_POINT, 0, 0, 0, 0, id="arrived"),
        pytest.param({"path": 640.0}, IN_METAL, PART, 0, 0, 0, 5, id="part arrived"),
        pytest.param(
            {"used_life": 1.0, "thrust_force": 901.0}, IN_METAL, SET_POINT, 1, 1, 1, 0, id="both"
        ),
    ],
)
def test_a_sub_step_finds_edges_that_failed_and_jobs_that_ended(
    state: dict[str, float],
    work: dict[str, float],
    kind: int,
    worn: int,
    broken: int,
    failed: int,
    left: int,
) -> None:
    records = records_of(action=kind, path_end=640.0)
    fill(records.state, cutting_speed=100.0, edge_strength=900.0, path=500.0)
    put(records.p, path_end=640.0)
    put(records.state, **state)
    put(records.work, sub_steps_left=5, **work)
    found = end_sub_step(records.state, records.work, records.report, AFTER, records.p)
    assert found == failed
    assert values_of(records.work, "worn", "broken", "edge_failed") == [worn, broken, failed]
    assert records.work.sub_steps_left[ENV] == left


def test_a_failure_earlier_in_the_step_stays_noted_and_sensors_follow() -> None:
    records = records_of(power_sensor_share=0.5, force_sensor_share=1.0)
    fill(records.state, cutting_speed=100.0, edge_strength=900.0)
    put(records.state, thrust_force=300.0, power=2.0, cutting=1, depth_of_cut=1.0)
    put(records.work, edge_failed=1, turns=1.0)
    end_sub_step(records.state, records.work, records.report, AFTER, records.p)
    assert records.work.edge_failed[ENV] == 1
    assert values_of(records.state, "lagged_thrust_force", "lagged_power") == [300.0, 1.0]


@pytest.mark.parametrize(
    ("cutting_now", "depth", "share"),
    [
        pytest.param(1, 2.0, 1.0, id="in metal"),
        pytest.param(1, 0.5, 1.0, id="in metal, shallow"),
        pytest.param(0, 2.0, 0.25, id="out of the bar"),
        pytest.param(1, 0.0, 0.25, id="section of air"),
    ],
)
def test_loads_fall_behind_the_chip_out_of_the_metal(
    cutting_now: int, depth: float, share: float
) -> None:
    records = records_of()
    put(records.state, cutting=cutting_now, depth_of_cut=depth, thrust_force=800.0, power=4.0)
    put(records.work, chip_remains=0.25)
    leave_metal(records.state, records.work, ENV)
    assert values_of(records.state, "thrust_force", "power") == [800.0 * share, 4.0 * share]


SUMS = (
    "engaged_time",
    "removed",
    "mean_thrust_force",
    "mean_power",
    "excess_force",
    "excess_power",
)
TIMES = (
    "overload_time",
    "severe_overload_time",
    "overload_2_percent_time",
    "overload_10_percent_time",
)


@pytest.mark.parametrize(
    ("force", "power", "further", "varies", "excess_force", "excess_power", "times"),
    [
        # Limits of 1000 N and 5 kW; idling takes 1 kW; 0.1 min = 6 s of cutting.
        pytest.param(800.0, 3.0, 0.0, False, 0.0, 0.0, [0, 0, 0, 0], id="within"),
        pytest.param(1250.0, 3.0, 0.0, False, 0.25, 0.0, [6, 6, 6, 6], id="force"),
        pytest.param(800.0, 6.5, 0.0, False, 0.0, 0.5, [6, 6, 6, 6], id="power"),
        pytest.param(800.0, 3.0, 0.3, False, 0.3, 0.0, [6, 6, 6, 6], id="further limit"),
        pytest.param(1250.0, 3.0, 0.1, False, 0.25, 0.0, [6, 6, 6, 6], id="force above further"),
        # Half of the power is available: 4 kW of 2.5 kW.
        pytest.param(800.0, 3.0, 0.0, True, 0.0, 0.6, [6, 6, 6, 6], id="low speed"),
        pytest.param(1010.0, 3.0, 0.0, False, 0.01, 0.0, [6, 0, 0, 0], id="by 1 %"),
        pytest.param(1030.0, 3.0, 0.0, False, 0.03, 0.0, [6, 0, 6, 0], id="by 3 %"),
        pytest.param(1075.0, 3.0, 0.0, False, 0.075, 0.0, [6, 6, 6, 0], id="by 7.5 %"),
        pytest.param(800.0, 4.55, 0.0, False, 0.0, 0.11, [6, 6, 6, 6], id="power by 11 %"),
    ],
)
def test_metal_and_excess_over_the_limits_are_summed(
    force: float,
    power: float,
    further: float,
    varies: bool,
    excess_force: float,
    excess_power: float,
    times: list[float],
) -> None:
    records = records_of(
        per_thrust_force_limit=1e-3,
        per_power_limit=0.2,
        idle_power_per_speed=0.005,
        capacity_per_speed=0.0025,
        overload_tolerance=0.05,
        overload_allowance=0.2,
    )
    put(records.state, thrust_force=force, power=power, cutting_speed=200.0, feed=0.3)
    put(records.state, depth_of_cut=2.0, spindle_heat=2.0)
    put(records.work, engaged=0.1, over_further=further)
    put(records.report, **dict.fromkeys((*SUMS, *TIMES), 1.0))
    add_to_sums(records.state, records.work, records.report, ENV, records.p, varies)
    # 200 m/min * 0.3 mm * 2 mm = 120 cm3/min.
    expected = [7.0, 13.0, 1.0 + 6.0 * force, 1.0 + 6.0 * (power + 1.0)]
    expected += [1.0 + 0.1 * excess_force, 1.0 + 0.1 * excess_power]
    assert values_of(records.report, *SUMS) == pytest.approx(expected)
    assert values_of(records.report, *TIMES) == pytest.approx([1.0 + time for time in times])


@pytest.mark.parametrize(("flag"), ["heats", "has_base_speed", ""])
def test_the_limit_of_power_varies_with_heat_or_a_base_speed(flag: str) -> None:
    records = records_of(heats=False, has_base_speed=False)
    fill(records.state, cutting_speed=100.0, spindle_heat=2.0, edge_strength=1e9)
    fill(records.p, capacity_per_speed=0.005, per_power_limit=0.2, idle_power_per_speed=0.0)
    put(records.state, power=5.0)
    put(records.work, engaged=1.0)
    if flag:
        put(records.p, **{flag: True})
    end_sub_step(records.state, records.work, records.report, AFTER, records.p)
    assert records.report.excess_power[ENV] == pytest.approx(1.0 if flag else 0.0)


@pytest.mark.parametrize(("used_life", "before"), [(0.3, 0.3), (1.2, 1.0)])
def test_charging_begins_with_at_most_a_whole_life(used_life: float, before: float) -> None:
    records = records_of()
    put(records.state, used_life=used_life, cutting_time=5.0)
    put(records.work, time=3.0)
    begin_charging(records.state, records.work, ENV)
    names = ("time", "used_life_before", "cutting_time_before")
    assert values_of(records.work, *names) == [0.0, before, 5.0]


@pytest.mark.parametrize(
    ("used_life", "by_equivalent_time", "cutting_time", "charged", "nominal"),
    [
        # The nominal model wears as in ``cutting``, at twice the coefficient: 4 / 64 per minute.
        pytest.param(0.75, True, 9.0, 0.25, 0.25 + 20.0 / 64.0, id="equivalent time"),
        pytest.param(1.2, True, 9.0, 0.5, 0.25 + 20.0 / 64.0, id="at most a whole life"),
        pytest.param(0.75, False, 9.0, 0.25, 0.75**2, id="clock time"),
        pytest.param(0.75, False, 4.0, 0.25, 0.25, id="clock time, in air"),
    ],
)
def test_time_and_life_are_charged_and_the_nominal_edge_wears(
    used_life: float, by_equivalent_time: bool, cutting_time: float, charged: float, nominal: float
) -> None:
    records = cutting()
    put(records.p, edge_price=100.0)
    nominal_model = records.p.nominal
    nominal_model.wear_law.log_coefficient[ENV] = math.log(0.1 / 2.0)
    nominal_model.wear_law.cutting_speed[ENV] = 1.0
    nominal_model.wear_law.depth_of_cut[ENV] = 1.0
    nominal_model.wear_law.hardness[ENV] = 5.0
    nominal_model.wear_law.time[ENV] = 0.5
    nominal_model.life_exponent[ENV] = 2.0
    nominal_model.log_wear_criterion[ENV] = math.log(0.4)
    put(records.work, time=2.0, minutes=1.0, used_life_before=0.5, cutting_time_before=4.0)
    put(records.work, log_cutting_speed=math.log(4.0))
    put(records.state, used_life=used_life, cutting_time=cutting_time, nominal_used_life=0.25)
    put(records.state, log_nominal_depth=math.log(0.5), log_hardness=1.0, clock=10.0)
    put(records.report, time=30.0, edges_used=1.0)
    charge_time_and_life(
        records.state, records.work, records.report, ENV, records.p, by_equivalent_time
    )
    assert records.state.clock[ENV] == 12.0
    assert records.work.minutes[ENV] == 3.0
    assert records.report.time[ENV] == 150.0
    assert records.report.edges_used[ENV] == pytest.approx(1.0 + charged)
    assert records.report.reward_edge[ENV] == pytest.approx(-100.0 * charged)
    assert records.state.nominal_used_life[ENV] == pytest.approx(nominal)


@pytest.mark.parametrize(
    ("worn", "broken", "changes", "edge", "stopped", "edges_broken"),
    [
        pytest.param(0, 0, AUTOMATIC, 4, 0.0, 0.0, id="whole"),
        pytest.param(1, 0, AUTOMATIC, 5, 3.5, 0.0, id="worn"),
        pytest.param(0, 1, COMMANDED, 5, 9.0, 1.0, id="broken"),
        pytest.param(1, 1, AUTOMATIC, 5, 9.0, 1.0, id="worn and broken"),
        pytest.param(0, 1, END, 4, 0.0, 1.0, id="ends with its edge"),
    ],
)
def test_failed_edges_are_paid_for_and_replaced(
    worn: int, broken: int, changes: int, edge: int, stopped: float, edges_broken: float
) -> None:
    records = cutting(edge_changes=changes, edge_change_time=2.0)
    put(records.p, unplanned_stop=1.5, breakage_downtime=7.0, clock_limit=math.inf)
    put(records.p, initial_used_life=0.0)
    put(records.state, edge=4)
    put(records.work, worn=worn, broken=broken, time=1.0, used_life_before=0.125)
    replace_failed_edges(
        records.state, records.work, records.report, AFTER, records.p, by_equivalent_time=True
    )
    assert records.state.edge[ENV] == edge
    assert records.report.stopped_time[ENV] == 60.0 * stopped
    assert records.report.edges_broken[ENV] == edges_broken
    failed = worn + broken > 0
    assert records.report.edges_used[ENV] == ((0.875 if broken else 0.125) if failed else 0.0)
    # The time since charging began counts once.
    assert records.work.time[ENV] == (0.0 if failed else 1.0)
    assert records.work.used_life_before[ENV] == (0.0 if edge == 5 else 0.25 if failed else 0.125)
    assert values_of(records.work, "worn", "broken") == [0.0, 0.0]


@pytest.mark.parametrize(("order", "used", "edges_used"), [(0.1, 0.25, 0.75), (0.1, 1.5, 0.0)])
def test_a_commanded_change_pays_for_the_life_that_is_left(
    order: float, used: float, edges_used: float
) -> None:
    records = cutting(edge_price=100.0, edge_change_time=2.0, clock_limit=math.inf)
    put(records.state, used_life=used)
    actions = np.zeros((AFTER, 3))
    actions[ENV, -1] = order
    change_commanded_edges(records.state, records.report, actions, AFTER, records.p)
    assert records.report.edges_used[ENV] == edges_used
    assert records.report.stopped_time[ENV] == 120.0
    # 0 does not ask for a change.
    assert records.state.edge[: AFTER + 1].tolist() == [0, 0, 0, 1, 0]


def test_the_part_with_most_passes_decides_their_number() -> None:
    records = records_of(passes_max=3)
    actions = np.full((AFTER, 8), -1.0)
    actions[1, 0] = 1.0
    passes = start_parts(records.state, records.work, actions, AFTER, records.p)
    assert passes == 3
    assert records.work.passes[:AFTER].tolist() == [1, 3, 1, 1]
    actions[1, 0] = -1.0
    assert start_parts(records.state, records.work, actions, AFTER, records.p) == 1


def test_the_control_looks_ahead_where_the_scenario_lets_it() -> None:
    for holds, probes in ((True, False), (False, True), (False, False)):
        records = records_of(holds_roughness=holds, probe=probes)
        look_ahead(records.state, ENV, AFTER, records.p)
        assert (records.state.roughness_reference[ENV] > 0.0) == holds
        assert (records.state.probed_depth[ENV] > 0.0) == probes


@pytest.mark.parametrize(("approach", "in_metal"), [(3.0, 0), (0.0, 1)])
def test_an_episode_starts_at_the_first_bar_with_a_fresh_edge(
    approach: float, in_metal: int
) -> None:
    records = machine(chips_tangle=True)
    fill(records.p, approach=approach, depth_of_cut=2.0, log_depth_of_cut=math.log(2.0))
    fill(records.p, depth_bar_spread=0.0, depth_along_spread=0.0)
    put(records.state, seed=5, episode=2)
    put(records.work, tangles=3)
    records.report.table[:] = 7.0
    start_episode(records.state, records.work, records.report, ENV, records.p)
    state = records.state
    assert state.cutting[ENV] == in_metal
    assert values_of(state, "seed", "episode", "step_count", "bar") == [5.0, 2.0, 0.0, 0.0]
    names = ("commanded_cutting_speed", "commanded_feed", "cutting_speed", "feed")
    assert values_of(state, *names) == [150.0, 0.3, 150.0, 0.3]
    assert values_of(state, "depth_of_cut", "pass_ceiling") == [2.0, math.inf]
    assert state.log_nominal_depth[ENV] == math.log(2.0)
    # The first tangle then draws the margin with index 1.
    margin = exponential(state, ENV, channel=TANGLE_CHANNEL, bar=0, index=0)
    assert state.tangle_margin[ENV] == margin
    assert state.bar_hardness_normal[ENV] != 0.0
    assert state.edge_strength[ENV] > 0.0
    logarithms = values_of(records.work, "log_cutting_speed", "log_feed")
    assert logarithms == pytest.approx([math.log(150.0), math.log(0.3)])
    assert records.work.tangles[ENV] == 0
    assert records.report.removed[ENV] == 0.0


def test_a_minute_of_one_metal_by_hand() -> None:
    """125 m/min, 0.33 mm/rev and 2.5 mm, with the coefficients of docs/models.md."""
    (info,) = infos(UNDISTURBED, [(0.0, 0.0)])
    assert info["time"] == pytest.approx(60.0)
    assert info["engaged_time"] == pytest.approx(60.0)
    assert info["removed"] == pytest.approx(125.0 * 0.33 * 2.5)
    assert info["path"] == pytest.approx(125.0 * 1000.0 / (math.pi * 100.0) * 0.33)
    wear = 0.00956410 * 125.0**0.577 * 0.33**0.168
    assert info["wear"] == pytest.approx(wear, rel=1e-6)
    force = 106580.08 * 125.0**-0.484 * 0.33**0.236 * wear**1.1
    power = 0.30338170 * 125.0**0.820 * 0.33**0.627 * wear**0.342
    assert info["thrust_force"] == pytest.approx(force, rel=1e-6)
    assert info["power"] == pytest.approx(power, rel=1e-6)
    assert info["mean_power"] < info["power"]
    terms = [info[name] for name in info if name.startswith("reward_")]
    assert info["reward"] == pytest.approx(sum(terms))


def test_the_excess_of_a_constant_power_is_its_mean_over_the_step() -> None:
    """0.1 kW per m/min is 12.5 kW at 125 m/min: 1.25 times as much as 10 kW."""
    exponents = {"cutting_speed": 1.0, "feed": 0.0, "depth_of_cut": 0.0, "wear": 0.0}
    material = {"power": {"coefficient": 0.1} | exponents}
    limits = {"power": 10.0, "thrust_force": 1e6, "overload_tolerance": 0.0}
    scenario = changed(UNDISTURBED, material=material, limits=limits)
    for info in infos(scenario, [(0.0, 0.0), (0.0, 0.0)]):
        assert info["mean_power"] == pytest.approx(12.5)
        assert info["excess_power"] == pytest.approx(0.25)
        assert info["excess"] == pytest.approx(0.25)


@pytest.mark.parametrize("rule", ["equivalent_time", "clock_time"])
def test_the_nominal_edge_wears_by_the_rule_of_the_scenario(rule: str) -> None:
    """Where the nominal model is true, after two minutes at different cutting speeds."""
    scenario = changed(UNDISTURBED, tool={"wear_rule": rule})
    records = records_of(scenario)
    for i in range(AFTER):
        start_episode(records.state, records.work, records.report, i, records.p)
    for speed in (-0.5, 0.5):
        actions = np.tile((speed, 0.0), (AFTER, 1))
        run_step(records.state, records.work, records.report, actions, AFTER, records.p)
    assert records.state.used_life[ENV] > 0.0
    nominal, used = values_of(records.state, "nominal_used_life", "used_life")
    assert nominal == pytest.approx(used)


def test_the_motor_becomes_hot_where_it_may_be_overloaded_for_a_short_time() -> None:
    actions = [(1.0, 1.0, -1.0)] * 3
    heats = [info["spindle_heat"] for info in infos(HOT_SPINDLE, actions)]
    assert 0.0 < heats[0] < heats[1] < heats[2]
    (info,) = infos(changed(HOT_SPINDLE, spindle={"short_time_load": 1.0}), actions[:1])
    assert info["spindle_heat"] == 0.0


def test_a_part_of_fewer_passes_waits_for_the_others() -> None:
    """One pass beside a part of four takes no more time or path than alone."""
    actions = np.zeros((2, 10), np.float32)
    actions[:, 0] = (-1.0, 1.0)
    env = RoughTurningVectorEnv(2, scenario=Scenario.load("batch_casting"))
    env.reset(seed=[4, 5])
    *_, info = env.step(actions)
    assert info["passes"].tolist() == [1.0, 4.0]
    (alone,) = infos(Scenario.load("batch_casting"), actions[:1], seed=4)
    for name in ("path", "time", "engaged_time", "used_life", "removed"):
        assert info[name][0] == alone[name], name


def test_a_step_of_four_tangled_chips_stops_four_times() -> None:
    """At a rate of 100 per minute chips tangle in nearly every sub-step of 6 s."""
    swarf = {"tangle_rate": 1e3, "tangle_time": 0.25, "chip_feed_min": 0.5, "chip_feed_max": 0.6}
    scenario = changed(UNDISTURBED, swarf=swarf, control={"sub_steps": 4})
    (info,) = infos(scenario, [(0.0, 0.0)])
    assert info["stopped_time"] == pytest.approx(4.0 * 15.0)
    assert info["time"] == pytest.approx(120.0)


def test_a_step_in_air_deviates_by_the_whole_roughness_for_its_time() -> None:
    """The tool needs longer than a step of 10 ms to reach the bar."""
    scenario = changed("surface", workpiece={"approach": 50.0})
    (info,) = infos(scenario, [[0.0]])
    assert info["engaged_time"] == 0.0
    assert info["roughness_deviation"] == pytest.approx(info["time"])


def test_parts_are_turned_in_their_passes() -> None:
    """A casting in two passes: its volume, time and passes by hand."""
    scenario = changed(
        "batch_casting",
        workpiece={"depth_bar_spread": 0.0, "depth_along_spread": 0.0},
        mismatch={"skin_thickness": 0.0},
        tool={"edge_strength": 1e6},
    )
    passes = scenario.control.passes_max
    action = np.zeros(2 + 2 * passes, np.float32)
    # The middle of the second share of the range.
    action[0] = -1.0 + 3.0 / passes
    action[2:] = -0.5
    machine_ = scenario.machine
    speed = 0.75 * machine_.cutting_speed_min + 0.25 * scenario.machine.cutting_speed_max
    feed = 0.75 * machine_.feed_min + 0.25 * machine_.feed_max
    speed = min(speed, scenario.cutting_speed_max)
    (info,) = infos(changed(scenario, machine=LAGLESS), [action])
    work = scenario.workpiece
    assert info["passes"] == 2.0
    circumference = math.pi * work.diameter / 1000.0  # [m]
    minutes = work.bar_length / (speed / circumference * feed)
    assert info["engaged_time"] == pytest.approx(2.0 * 60.0 * minutes, rel=1e-4)
    removed = circumference * work.bar_length * work.depth_of_cut  # [cm3]
    assert info["removed"] == pytest.approx(removed, rel=1e-4)
    # The tool passes the air, too, and returns after each pass.
    pitch = work.bar_length + work.approach
    assert info["path"] == pytest.approx(pitch)
    minutes *= pitch / work.bar_length
    returns = machine_.return_time
    assert info["time"] == pytest.approx(2.0 * 60.0 * (minutes + returns), rel=1e-4)


def test_an_edge_with_a_notch_breaks_in_the_sub_step_where_it_is_too_deep() -> None:
    scenario = changed(UNDISTURBED, edge_failure={"notch_growth": 20.0}, control={"sub_steps": 50})
    (info,) = infos(scenario, [(1.0, 1.0)])
    assert info["broken"]
    assert info["terminated"]
    assert info["time"] < 60.0
    assert info["used_life"] == pytest.approx(1.0 / 20.0, rel=0.1)


def test_a_worn_edge_is_replaced_within_the_step() -> None:
    """The step ends with the edge, after 2 min for its change and 1.5 min unplanned."""
    scenario = changed(
        UNDISTURBED,
        tool={"wear_criterion": 0.02},
        control={"edge_changes": "automatic"},
        economics={"edge_change_time": 2.0, "unplanned_stop": 1.5},
    )
    (info,) = infos(scenario, [(0.0, 0.0)])
    assert info["edges_used"] == 1.0
    assert info["stopped_time"] == pytest.approx(210.0)
    assert info["cutting_time"] == 0.0
    assert info["used_life"] == 0.0
    assert not info["terminated"]


LAGLESS = {"spindle_time_constant": 0.0, "feed_time_constant": 0.0}


@pytest.mark.compiled
@pytest.mark.parametrize("env_id", IDS)
def test_over_an_episode_of_every_id_nothing_is_lost(env_id: str) -> None:
    """Volume, time, life and reward of steps add up to those of the path, clock and edges."""
    env = gymnasium.make(env_id).unwrapped
    assert isinstance(env, RoughTurningEnv)
    scenario = env.scenario
    env.reset(seed=3)
    scenario = env.scenario
    steps = []
    for _ in range(200):
        action = np.full(env.action_space.shape, -0.2, np.float32)
        _, reward, terminated, truncated, info = env.step(action)
        steps.append(info | {"reward": reward})
        if terminated or truncated:
            break
    economics = scenario.economics
    ends_with_edge = scenario.control.edge_changes == "end"
    edge_price = 60.0 * economics.edge_cost
    edge_price += 60.0 * economics.edge_change_time if ends_with_edge else 0.0
    downtime = 60.0 * economics.breakage_downtime if ends_with_edge else 0.0
    for info in steps:
        terms = [info[name] for name in info if name.startswith("reward_")]
        assert info["reward"] == pytest.approx(math.fsum(terms), rel=1e-12, abs=1e-9)
        metal = 60.0 * info["removed"] / economics.reference_removal_rate
        assert info["reward_metal"] == pytest.approx(metal)
        assert info["reward_time"] == -info["time"]
        overload = 60.0 * economics.overload_price * info["excess"]
        minutes = (info["time"] - info["stopped_time"]) / 60.0
        if scenario.control.action != "part":
            assert info["reward_overload"] == pytest.approx(-overload * minutes, abs=1e-9)
        life = -info["reward_edge"] - info["reward_breakage"] - downtime * info["edges_broken"]
        assert life == pytest.approx(edge_price * info["edges_used"], abs=1e-9)
        deviation = economics.roughness_price * info["roughness_deviation"]
        assert info["reward_roughness"] == pytest.approx(-deviation)
    if ends_with_edge:
        used = sum(info["edges_used"] for info in steps)
        assert used == pytest.approx(1.0 if steps[-1]["broken"] else min(steps[-1]["used_life"], 1))
