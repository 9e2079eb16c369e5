"""Observations: the numbers that a CNC control knows, scaled to order one (``quantities.OBSERVATION``).

If the servo current is sensed, it replaces the thrust force. It is compared with the current at the force limit without feed,
and with the predicted current. With parts, an observation describes the last pass: mean power and force, speed and feed.
Predictions use the actual speed and feed, nominal depth and hardness, and the nominal model's wear. If the load reading is a
share of torque (``spindle.reading``), the power limit below the base speed is that of the available torque.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from turning_env.numerics.compilation import compiled, env_range
from turning_env.numerics.functions import exp, expm1, log
from turning_env.physics.drives import force_from_current, steady_current
from turning_env.physics.machinability import force_and_power
from turning_env.physics.quantities import (
    DEVIATION_SCALE,
    MAX_LOG_TIME,
    MAX_RATIO,
    OBS,
    OBSERVATION,
    layout,
)
from turning_env.physics.records import parameter_records
from turning_env.physics.spindle import capacity, capacity_at, idle_power
from turning_env.physics.wear import log_wear
from turning_env.scenario import Scenario, ScenarioBatch


def bounds(scenario: Scenario) -> NDArray[np.float32]:
    """Return the lowest and highest values of the entries in ``layout(scenario)``, shape (2, entries)."""
    return np.array(
        [(entry.low, entry.high) for entry in OBSERVATION if entry.present(scenario)], np.float32
    ).T


@compiled
def range_position(log_value, log_low, scale):
    """Return a value's place in its range, -1 at the low end and 1 at the high end, on a logarithmic scale (2 over its span)."""
    return min(max(scale * (log_value - log_low) - 1.0, -1.0), 1.0)


@compiled
def deviation(ratio):
    """Return a ratio's deviation from 1, times ``DEVIATION_SCALE``."""
    return DEVIATION_SCALE * (min(ratio, MAX_RATIO) - 1.0)


@compiled
def observe(state, work, first, last, p):
    """Write the observations of some environments of a block to ``work.observation``, shape (entries, environments).

    Rows are those of ``OBS``. ``work`` must hold the logarithms of speed and feed.
    """
    entries = work.observation
    for i in env_range(first, last):
        speed_low, speed_scale = p.log_cutting_speed_min[i], p.cutting_speed_scale[i]
        feed_low, feed_scale = p.log_feed_min[i], p.feed_scale[i]
        commanded_speed, commanded_feed = (
            log(state.commanded_cutting_speed[i]),
            log(state.commanded_feed[i]),
        )
        entries[OBS.power, i] = deviation(state.measured_power[i] * p.per_power_limit[i])
        entries[OBS.thrust_force, i] = deviation(
            state.measured_thrust_force[i] * p.per_thrust_force_limit[i]
        )
        entries[OBS.cutting_speed, i] = range_position(
            work.log_cutting_speed[i], speed_low, speed_scale
        )
        entries[OBS.feed, i] = range_position(work.log_feed[i], feed_low, feed_scale)
        entries[OBS.commanded_cutting_speed, i] = range_position(
            commanded_speed, speed_low, speed_scale
        )
        entries[OBS.commanded_feed, i] = range_position(commanded_feed, feed_low, feed_scale)
        entries[OBS.cutting_time, i] = min(log(1.0 + state.cutting_time[i]), MAX_LOG_TIME)
        entries[OBS.cutting, i] = 1.0 if state.cutting[i] > 0 else 0.0
    for i in env_range(first, last):
        speed, feed, depth = work.log_cutting_speed[i], work.log_feed[i], state.log_nominal_depth[i]
        wear = log_wear(p.nominal, i, state.nominal_used_life[i])
        force, power = force_and_power(p.nominal, i, speed, feed, depth, wear, 0.0)
        power += idle_power(p.nominal, i, state.cutting_speed[i])
        work.predicted_force[i] = force
        has_cut = state.nominal_used_life[i] > 0.0
        entries[OBS.power_ratio, i] = deviation(state.measured_power[i] / power if has_cut else 0.0)
        entries[OBS.force_ratio, i] = deviation(
            state.measured_thrust_force[i] / force if has_cut else 0.0
        )
        entries[OBS.nominal_wear, i] = (
            min(exp(wear - p.log_wear_criterion[i]), MAX_RATIO) if has_cut else 0.0
        )
    if p.reads_torque:
        for i in env_range(first, last):
            available = capacity(p, i, state.cutting_speed[i])
            entries[OBS.power, i] = deviation(
                state.measured_power[i] * p.per_power_limit[i] / available
            )
    if p.heats:
        for i in env_range(first, last):
            entries[OBS.spindle_heat, i] = min(state.spindle_heat[i], MAX_RATIO)
    if p.senses_current:
        for i in env_range(first, last):
            at_limit = steady_current(p.nominal, i, p.thrust_force_limit[i], 0.0)
            feed_velocity = state.cutting_speed[i] * p.revolutions_per_metre[i] * state.feed[i]
            predicted = steady_current(p.nominal, i, work.predicted_force[i], feed_velocity)
            has_cut = state.nominal_used_life[i] > 0.0
            entries[OBS.thrust_force, i] = deviation(state.measured_servo_current[i] / at_limit)
            entries[OBS.force_ratio, i] = deviation(
                state.measured_servo_current[i] / predicted if has_cut else 0.0
            )
    if p.holds_roughness:
        for i in env_range(first, last):
            one_only = p.log_reference_span[i] == 0.0
            scale = 0.0 if one_only else 2.0 / p.log_reference_span[i]
            position = range_position(
                log(state.roughness_reference[i]), p.log_reference_min[i], scale
            )
            entries[OBS.roughness_reference, i] = 0.0 if one_only else position
    if p.probe:
        for i in env_range(first, last):
            entries[OBS.probed_depth, i] = deviation(state.probed_depth[i] / p.depth_of_cut[i])
    if p.inspects_edges:
        for i in env_range(first, last):
            entries[OBS.removed_wear, i] = min(
                state.removed_wear[i] / p.wear_criterion[i], MAX_RATIO
            )


class Reading(NamedTuple):
    """A batch of observations in physical units: arrays of shape (environments,), NaN for what a scenario does not observe.

    Measured are `power` [kW]; `load` [-], power over the spindle's rated power, or torque over the torque that it has at its
    speed (`spindle.reading`); `thrust_force` [N], if the servo current is sensed the force whose steady current it is;
    `servo_current` [A]; `probed_depth` [mm], the mean allowance of the next blank; and `removed_wear` [mm], of the edge that was
    taken out last, 0 before the first change. Cutting speeds are in m/min and feeds in mm/rev. `cutting_time` [min] is the
    edge's, `nominal_wear` [mm] the nominal model's prediction. `power_ratio` and `force_ratio` [-] are measured over predicted;
    if the servo current is sensed, `force_ratio` is the current's. `cutting` is true in metal. `roughness_reference` [um] is the
    reference of Ra, `spindle_heat` [-] the heating of the spindle's motor over that of its rated load.
    """

    power: NDArray[np.float64]
    load: NDArray[np.float64]
    thrust_force: NDArray[np.float64]
    servo_current: NDArray[np.float64]
    cutting_speed: NDArray[np.float64]
    feed: NDArray[np.float64]
    commanded_cutting_speed: NDArray[np.float64]
    commanded_feed: NDArray[np.float64]
    cutting_time: NDArray[np.float64]
    nominal_wear: NDArray[np.float64]
    power_ratio: NDArray[np.float64]
    force_ratio: NDArray[np.float64]
    cutting: NDArray[np.bool_]
    roughness_reference: NDArray[np.float64]
    probed_depth: NDArray[np.float64]
    spindle_heat: NDArray[np.float64]
    removed_wear: NDArray[np.float64]


def _in_range(position: NDArray[np.float64], low: Any, high: Any) -> NDArray[np.float64]:
    return np.asarray(low * exp(0.5 * (position + 1.0) * log(high / low)))


def _ratio(deviation: NDArray[np.float64]) -> NDArray[np.float64]:
    return deviation / DEVIATION_SCALE + 1.0


parameters_of = cache(parameter_records)
"""Parameters of one block of environments of a scenario, to be read only."""


def read(observation: NDArray[np.float32], scenario: Scenario | ScenarioBatch) -> Reading:
    """Convert observations of shape (environments, entries) to physical units."""
    rows = np.asarray(observation, np.float64).T
    columns = dict(zip(layout(scenario), rows, strict=True))
    unknown = np.full(rows.shape[1], np.nan)
    machine, limits, surface = scenario.machine, scenario.limits, scenario.surface
    ranges = np.broadcast_arrays(
        machine.cutting_speed_min, machine.feed_min, machine.cutting_speed_max, machine.feed_max
    )
    lows, highs = np.reshape(ranges, (2, 2, -1))
    controlled = _in_range(
        rows[OBS.cutting_speed : OBS.commanded_feed + 1].reshape(2, 2, -1), lows, highs
    )
    (cutting_speed, feed), (commanded_cutting_speed, commanded_feed) = controlled
    power = _ratio(columns["power"]) * limits.power
    thrust_force, servo_current = _ratio(columns["thrust_force"]) * limits.thrust_force, unknown
    if scenario.sensors.force == "servo_current":
        p = parameters_of(scenario)[0]
        feed_velocity = cutting_speed * p.revolutions_per_metre[0] * feed
        servo_current = _ratio(columns["thrust_force"]) * steady_current(
            p, 0, limits.thrust_force, 0.0
        )
        thrust_force = np.maximum(force_from_current(p, 0, servo_current, feed_velocity), 0.0)
    reference = columns.get("roughness_reference", unknown)
    return Reading(
        power=power * capacity_at(scenario, cutting_speed)
        if scenario.spindle.reading == "torque"
        else power,
        load=power / machine.rated_power,
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
        roughness_reference=_in_range(reference, surface.reference_min, surface.reference_max),
        probed_depth=_ratio(columns.get("probed_depth", unknown)) * scenario.workpiece.depth_of_cut,
        spindle_heat=columns.get("spindle_heat", unknown),
        removed_wear=columns.get("removed_wear", unknown) * scenario.tool.wear_criterion,
    )
