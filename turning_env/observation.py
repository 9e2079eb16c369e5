"""Observations: the numbers that a CNC control knows, scaled to order one.

``quantities.OBSERVATION`` lists the entries. If the servo current is sensed, it replaces the thrust
force. It is compared with the current at the force limit without feed, and with the predicted
current. With parts, an observation describes the last pass: mean power and force, speed and feed.

Predictions use the actual speed and feed, nominal depth and hardness, and the nominal model's wear.
If the load reading is a share of torque (``spindle.reading``), the power limit below the base speed
is that of the available torque.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turning_env.numerics.compilation import compiled, env_range
from turning_env.numerics.functions import exp, expm1, log
from turning_env.physics.drives import force_from_current, steady_current
from turning_env.physics.machinability import force_and_power, loads_with_fresh_share
from turning_env.physics.quantities import (
    DEVIATION_SCALE,
    MAX_LOG_TIME,
    MAX_RATIO,
    OBS,
    OBSERVATION,
    layout,
)
from turning_env.physics.records import parameter_records
from turning_env.physics.spindle import capacity, idle_power
from turning_env.physics.wear import log_wear
from turning_env.scenario import Scenario, ScenarioBatch
from turning_env.scenario.laws import capacity_at

Array = NDArray[np.float64]


def bounds(scenario: Scenario) -> NDArray[np.float32]:
    """Return the lowest and highest values of the entries in ``layout(scenario)``.

    The shape is (2, entries).
    """
    entries = [entry for entry in OBSERVATION if entry.present(scenario)]
    low = [entry.low for entry in entries]
    high = [entry.high for entry in entries]
    return np.array([low, high], np.float32)


@compiled
def range_position(log_value, log_low, scale):
    """Return a value's place in its range on a logarithmic scale, -1 at the low end, 1 at the high.

    ``scale`` is 2 over the span of logarithms.
    """
    return min(max(scale * (log_value - log_low) - 1.0, -1.0), 1.0)


@compiled
def deviation(ratio):
    """Return a ratio's deviation from 1, times ``DEVIATION_SCALE``."""
    return DEVIATION_SCALE * (min(ratio, MAX_RATIO) - 1.0)


@compiled
def observe(state, work, first, last, p):
    """Write the observations of some environments of a block to ``work.observation``.

    Its shape is (entries, environments), and its rows are those of ``OBS``. Rows that the scenario
    does not have keep old values. ``work`` must hold the logarithms of speed and feed.
    """
    for i in env_range(first, last):
        observe_process(state, work, i, p)
    # Two loops: with a branch in one loop, it is not vectorised.
    if p.fresh_edges_load:
        for i in env_range(first, last):
            compare_with_nominal_model(state, work, i, p, loads_with_fresh_share)
    else:
        for i in env_range(first, last):
            compare_with_nominal_model(state, work, i, p, force_and_power)
    if p.has_base_speed:
        for i in env_range(first, last):
            compare_with_available_power(state, work, i, p)
    if p.senses_current:
        for i in env_range(first, last):
            observe_current(state, work, i, p)
    observe_further(state, work, first, last, p)


@compiled
def observe_further(state, work, first, last, p):
    """Observe the entries that only some scenarios have."""
    if p.heats:
        observe_heat(state, work, first, last)
    if p.holds_roughness:
        observe_references(state, work, first, last, p)
    if p.probe:
        observe_blanks(state, work, first, last, p)
    if p.inspects_edges:
        observe_removed_edges(state, work, first, last, p)
    if p.counts_tangles:
        observe_tangles(work, first, last)
    if p.observes_all:
        observe_hidden_state(state, work, first, last, p)


@compiled
def observe_heat(state, work, first, last):
    """Observe the heat of the spindle's motor."""
    for i in env_range(first, last):
        work.observation[OBS.spindle_heat, i] = min(state.spindle_heat[i], MAX_RATIO)


@compiled
def observe_blanks(state, work, first, last, p):
    """Observe the mean allowance of the next blank."""
    for i in env_range(first, last):
        ratio = state.probed_depth[i] / p.depth_of_cut[i]
        work.observation[OBS.probed_depth, i] = deviation(ratio)


@compiled
def observe_removed_edges(state, work, first, last, p):
    """Observe the wear of the edge that was taken out last."""
    for i in env_range(first, last):
        ratio = state.removed_wear[i] / p.wear_criterion[i]
        work.observation[OBS.removed_wear, i] = min(ratio, MAX_RATIO)


@compiled
def observe_tangles(work, first, last):
    """Observe the stops for tangled chips."""
    for i in env_range(first, last):
        work.observation[OBS.tangles, i] = min(float(work.tangles[i]), MAX_RATIO)


@compiled
def observe_hidden_state(state, work, first, last, p):
    """Observe the true cut and the true edge."""
    entries = work.observation
    for i in env_range(first, last):
        in_metal = state.cutting[i] > 0
        hardness = exp(state.log_hardness[i])
        depth = state.depth_of_cut[i] / p.depth_of_cut[i]
        wear = exp(log_wear(p, i, state.used_life[i])) / p.wear_criterion[i]
        strength = state.edge_strength[i] / p.thrust_force_limit[i]
        entries[OBS.hardness, i] = deviation(hardness) if in_metal else 0.0
        entries[OBS.depth_of_cut, i] = deviation(depth) if in_metal else 0.0
        entries[OBS.wear, i] = min(wear, MAX_RATIO) if state.used_life[i] > 0.0 else 0.0
        entries[OBS.wear_factor, i] = deviation(exp(state.log_wear_factor[i]))
        entries[OBS.edge_strength, i] = deviation(strength)


@compiled
def observe_process(state, work, i, p):
    """Observe measured loads, speeds, feeds and cutting time."""
    entries = work.observation
    speed_low = p.log_cutting_speed_min[i]
    speed_scale = p.cutting_speed_scale[i]
    feed_low = p.log_feed_min[i]
    feed_scale = p.feed_scale[i]
    power_share = state.measured_power[i] * p.per_power_limit[i]
    force_share = state.measured_thrust_force[i] * p.per_thrust_force_limit[i]
    speed = range_position(work.log_cutting_speed[i], speed_low, speed_scale)
    feed = range_position(work.log_feed[i], feed_low, feed_scale)
    log_commanded_speed = log(state.commanded_cutting_speed[i])
    log_commanded_feed = log(state.commanded_feed[i])
    commanded_speed = range_position(log_commanded_speed, speed_low, speed_scale)
    commanded_feed = range_position(log_commanded_feed, feed_low, feed_scale)
    entries[OBS.power, i] = deviation(power_share)
    entries[OBS.thrust_force, i] = deviation(force_share)
    entries[OBS.cutting_speed, i] = speed
    entries[OBS.feed, i] = feed
    entries[OBS.commanded_cutting_speed, i] = commanded_speed
    entries[OBS.commanded_feed, i] = commanded_feed
    entries[OBS.cutting_time, i] = min(log(1.0 + state.cutting_time[i]), MAX_LOG_TIME)
    entries[OBS.cutting, i] = 1.0 if state.cutting[i] > 0 else 0.0


@compiled
def compare_with_nominal_model(state, work, i, p, laws):
    """Observe nominal wear, and measured over predicted power and force.

    ``laws``: function of ``machinability.py``. Before the edge has cut, nothing is predicted; wear
    and ratios are 0 then.
    """
    entries = work.observation
    wear = log_wear(p.nominal, i, state.nominal_used_life[i])
    force, power = laws(
        p.nominal,
        i,
        work.log_cutting_speed[i],
        work.log_feed[i],
        state.log_nominal_depth[i],
        wear,
        0.0,
    )
    power += idle_power(p.nominal, i, state.cutting_speed[i])
    work.predicted_force[i] = force
    # The logarithm of no wear is out of range, so ratios to predictions of it mean nothing.
    has_cut = state.nominal_used_life[i] > 0.0
    power_ratio = state.measured_power[i] / power if has_cut else 0.0
    force_ratio = state.measured_thrust_force[i] / force if has_cut else 0.0
    relative_wear = min(exp(wear - p.log_wear_criterion[i]), MAX_RATIO)
    entries[OBS.power_ratio, i] = deviation(power_ratio)
    entries[OBS.force_ratio, i] = deviation(force_ratio)
    entries[OBS.nominal_wear, i] = relative_wear if has_cut else 0.0


@compiled
def compare_with_available_power(state, work, i, p):
    """Observe the power over its limit at the present speed, below the base speed c P_limit."""
    available = capacity(p, i, state.cutting_speed[i])
    share = state.measured_power[i] * p.per_power_limit[i] / available
    work.observation[OBS.power, i] = deviation(share)


@compiled
def observe_current(state, work, i, p):
    """Observe the servo current in place of the thrust force."""
    at_limit = steady_current(p.nominal, i, p.thrust_force_limit[i], feed_velocity=0.0)
    feed_velocity = state.cutting_speed[i] * p.revolutions_per_metre[i] * state.feed[i]
    predicted = steady_current(p.nominal, i, work.predicted_force[i], feed_velocity)
    has_cut = state.nominal_used_life[i] > 0.0
    ratio = state.measured_servo_current[i] / predicted if has_cut else 0.0
    work.observation[OBS.thrust_force, i] = deviation(state.measured_servo_current[i] / at_limit)
    work.observation[OBS.force_ratio, i] = deviation(ratio)


@compiled
def observe_references(state, work, first, last, p):
    """Observe the reference of the roughness; 0 if the scenario has one reference only."""
    for i in env_range(first, last):
        # A range without a span has no places in it.
        single = p.log_reference_span[i] == 0.0
        scale = 0.0 if single else 2.0 / p.log_reference_span[i]
        log_reference = log(state.roughness_reference[i])
        position = range_position(log_reference, p.log_reference_min[i], scale)
        work.observation[OBS.roughness_reference, i] = 0.0 if single else position


class Reading(NamedTuple):
    """A batch of observations in physical units: arrays of shape (environments,).

    A quantity that the scenario does not observe is NaN.

    Measured are `power` [kW]; `load` [-], power over the spindle's rated power, or torque over the
    torque that it has at its speed (`spindle.reading`); `thrust_force` [N], if the servo current is
    sensed the force whose steady current it is; `servo_current` [A]; `probed_depth` [mm], the mean
    allowance of the next blank; and `removed_wear` [mm], of the edge that was taken out last, 0
    before the first change. `tangles` [-] are the stops for tangled chips in the last step.

    Cutting speeds are in m/min and feeds in mm/rev. `cutting_time` [min] is the edge's,
    `nominal_wear` [mm] the nominal model's prediction. `power_ratio` and `force_ratio` [-] are
    measured over predicted; if the servo current is sensed, `force_ratio` is the current's.
    `cutting` is true in metal. `roughness_reference` [um] is the reference of Ra, `spindle_heat`
    [-] the heating of the spindle's motor over that of its rated load.
    """

    power: Array
    load: Array
    thrust_force: Array
    servo_current: Array
    cutting_speed: Array
    feed: Array
    commanded_cutting_speed: Array
    commanded_feed: Array
    cutting_time: Array
    nominal_wear: Array
    power_ratio: Array
    force_ratio: Array
    cutting: NDArray[np.bool_]
    roughness_reference: Array
    probed_depth: Array
    spindle_heat: Array
    removed_wear: Array
    tangles: Array


def _in_range(position: Array, low: Any, high: Any) -> Array:
    """Return the value at a place in its range; the inverse of ``range_position``."""
    return np.asarray(low * exp(0.5 * (position + 1.0) * log(high / low)))


def _ratio(deviation: Array) -> Array:
    """Return the ratio of a deviation; the inverse of ``deviation``."""
    return deviation / DEVIATION_SCALE + 1.0


def _speed_over_feed(speed: Any, feed: Any) -> Array:
    """Return a speed and a feed as rows, shape (2, 1), or (2, scenarios) if they are arrays."""
    if isinstance(speed, float) and isinstance(feed, float):
        # Rules of one scenario do this at every step: it takes a fifth of the time of broadcasting.
        return np.array([[speed], [feed]])
    return np.reshape(np.broadcast_arrays(speed, feed), (2, -1))


@cache
def parameters_of(scenario: Scenario) -> Any:
    """Return the parameters of one block of environments of a scenario, to be read only."""
    return parameter_records(scenario)


def read(observation: NDArray[np.float32], scenario: Scenario | ScenarioBatch) -> Reading:
    """Convert observations of shape (environments, entries) to physical units."""
    rows = np.asarray(observation, np.float64).T
    columns = dict(zip(layout(scenario), rows, strict=True))
    unknown = np.full(rows.shape[1], np.nan)
    machine = scenario.machine
    limits = scenario.limits
    surface = scenario.surface

    # Speed, feed, commanded speed and commanded feed stand together. Converted at once, they take
    # a quarter of the time.
    positions = rows[OBS.cutting_speed : OBS.commanded_feed + 1].reshape(2, 2, -1)
    lows = _speed_over_feed(machine.cutting_speed_min, machine.feed_min)
    highs = _speed_over_feed(machine.cutting_speed_max, machine.feed_max)
    actual, commanded = _in_range(positions, lows, highs)
    cutting_speed, feed = actual
    commanded_cutting_speed, commanded_feed = commanded

    power_of_share = _ratio(columns["power"]) * limits.power
    power = power_of_share * capacity_at(scenario, cutting_speed)
    reads_torque = scenario.spindle.reading == "torque"
    # With the servo current, this is the current over that at the limit of the force.
    force_share = _ratio(columns["thrust_force"])
    thrust_force = force_share * limits.thrust_force
    servo_current = unknown
    if scenario.sensors.force == "servo_current":
        p = parameters_of(scenario)[0]
        feed_velocity = cutting_speed * p.revolutions_per_metre[0] * feed
        servo_current = force_share * steady_current(p, 0, limits.thrust_force, 0.0)
        force = force_from_current(p, 0, servo_current, feed_velocity)
        thrust_force = np.maximum(force, 0.0)
    roughness_reference = unknown
    if "roughness_reference" in columns:
        roughness_reference = _in_range(
            columns["roughness_reference"], surface.reference_min, surface.reference_max
        )
    probed_ratio = _ratio(columns.get("probed_depth", unknown))
    removed_wear = columns.get("removed_wear", unknown)
    return Reading(
        power=power,
        load=(power_of_share if reads_torque else power) / machine.rated_power,
        thrust_force=thrust_force,
        servo_current=servo_current,
        cutting_speed=cutting_speed,
        feed=feed,
        commanded_cutting_speed=commanded_cutting_speed,
        commanded_feed=commanded_feed,
        cutting_time=expm1(columns["cutting_time"]),
        nominal_wear=columns["nominal_wear"] * scenario.tool.wear_criterion,
        power_ratio=_ratio(columns["power_ratio"]),
        force_ratio=_ratio(columns["force_ratio"]),
        cutting=columns["cutting"] > 0.5,
        roughness_reference=roughness_reference,
        probed_depth=probed_ratio * scenario.workpiece.depth_of_cut,
        spindle_heat=columns.get("spindle_heat", unknown),
        removed_wear=removed_wear * scenario.tool.wear_criterion,
        tangles=columns.get("tangles", unknown),
    )
