"""Readings of a machine, and the table of the values that each may have.

``watch.py`` compares readings with one another and over time; ``core.py`` decides.
"""

import math
from dataclasses import dataclass, fields, replace
from typing import Any, NamedTuple

import numpy as np

from turning_env.numerics.conversions import spindle_speed_at
from turning_env.observation import parameters_of
from turning_env.physics.drives import steady_current
from turning_env.physics.quantities import MAX_RATIO, layout
from turning_env.scenario import Scenario

# A machine may exceed its highest speed and feed by this factor, as drives overshoot [-].
OVERSHOOT = 1.2
# Load over its limit up to which a reading may be true [-]. A limit may be set to a fraction of
# what the machine bears, and a collision exceeds that.
MAX_LOAD = 10.0
# Lowest reading over the highest one, as the zero of a sensor drifts [-].
ZERO_ERROR = 0.005
# Longest time between two decisions [s], and in control intervals, if that is longer. A policy's
# process may take so long before it is ended.
LONGEST_GAP = 10.0
LONGEST_GAP_INTERVALS = 5.0
# Readings that only some scenarios need.
FURTHER = ("spindle_heat", "roughness_reference", "removed_wear")
NEEDED_BY_ALL = ("spindle_speed", "feed_velocity", "engaged_time", "power")
SWITCHES = ("in_feed", "cutting", "new_edge")


@dataclass(frozen=True)
class Readings:
    """Readings of a machine at the end of a control interval.

    NaN or None: the machine has no such sensor, or the sensor is lost. ``possible_values`` is the
    table of the values that each may have.
    """

    spindle_speed: float  # [rev/min]
    feed_velocity: float  # [mm/min]
    # Whether the program moves at feed: no rapid, no pause, no feed hold, no emergency stop.
    in_feed: bool | None
    cutting: bool | None  # whether the tool is in metal
    engaged_time: float  # time in metal since the last readings [s]
    power: float = math.nan  # [kW]
    thrust_force: float = math.nan  # [N]
    servo_current: float = math.nan  # [A]
    # Tool position along the bar, below 0 before it [mm]. NaN: the shield integrates the feed.
    position: float = math.nan
    # Whether the edge has been changed since the last readings.
    new_edge: bool | None = False
    spindle_heat: float = math.nan  # [-]
    roughness_reference: float = math.nan  # [um]
    # Measured flank wear of the edge that was taken out last, 0 before the first change [mm].
    removed_wear: float = math.nan


NUMBERS = tuple(field.name for field in fields(Readings) if field.name not in SWITCHES)


class Span(NamedTuple):
    """Lowest and highest value that a reading may have."""

    low: float
    high: float


def force_reading(scenario: Scenario) -> str:
    """Return the name of the reading from which the force is known."""
    return "servo_current" if scenario.sensors.force == "servo_current" else "thrust_force"


def needed_readings(scenario: Scenario) -> list[str]:
    """Return the names of the readings without which the load is unknown."""
    observed = layout(scenario)
    further = [name for name in FURTHER if name in observed]
    return [*NEEDED_BY_ALL, force_reading(scenario), *further]


def possible_values(scenario: Scenario) -> dict[str, Span]:
    """Return the table of the values that the scenario's machine can show while it moves at feed.

    It holds the numbers that the scenario uses. The switches are true or false.
    """
    machine = scenario.machine
    limits = scenario.limits
    work = scenario.workpiece
    surface = scenario.surface
    turns = bar_spindle_speed(scenario, float(scenario.cutting_speed_max))
    rated_power = max(limits.power * scenario.spindle.short_time_load, machine.rated_power)
    max_force = MAX_LOAD * limits.thrust_force
    max_current = float(steady_current(parameters_of(scenario)[0], 0, max_force, 0.0))
    # Run-up and overrun are shorter than the bar.
    reach = work.bar_length + work.approach
    gap = max(LONGEST_GAP, LONGEST_GAP_INTERVALS * scenario.control.interval)
    values = {
        "spindle_speed": _from_zero(OVERSHOOT * turns),
        "feed_velocity": _from_zero(OVERSHOOT * turns * machine.feed_max),
        "engaged_time": Span(0.0, gap),
        "power": _from_zero(MAX_LOAD * rated_power),
        "thrust_force": _from_zero(max_force),
        "servo_current": _from_zero(max_current),
        "position": Span(-reach, work.bar_length + reach),
        "spindle_heat": Span(0.0, MAX_RATIO),
        "roughness_reference": Span(0.99 * surface.reference_min, 1.01 * surface.reference_max),
        "removed_wear": Span(0.0, MAX_RATIO * scenario.tool.wear_criterion),
    }
    used = [*needed_readings(scenario), "position"]
    return {name: values[name] for name in used}


def _from_zero(high: float) -> Span:
    """Return the span of a sensor whose lowest value is 0."""
    return Span(-ZERO_ERROR * high, high)


def bar_spindle_speed(scenario: Scenario, cutting_speed: float) -> float:
    """Return the spindle speed [rev/min] at a cutting speed [m/min] on the scenario's bar."""
    return float(spindle_speed_at(cutting_speed, scenario.workpiece.diameter))


def is_switch(value: Any) -> bool:
    """Return whether a value is true or false."""
    return isinstance(value, bool | np.bool_)


class ReadingsTable:
    """What each reading of a machine may be, and which readings it must give.

    A reading that the machine has given once is needed from then on.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._spans = possible_values(scenario)
        self._interval = scenario.control.interval
        self._needed = needed_readings(scenario)
        self._given: set[str] = set()

    def lost(self, readings: Readings) -> list[str]:
        """Return the names of needed readings that are missing."""
        names = []
        for name in self._spans:
            value = getattr(readings, name)
            if not math.isnan(value):
                self._given.add(name)
            elif name in self._needed or name in self._given:
                names.append(name)
        return names + [name for name in SWITCHES if getattr(readings, name) is None]

    def impossible(self, readings: Readings) -> list[str]:
        """Return the names of readings that are given, but that the machine cannot show."""
        names = []
        for name, span in self._spans.items():
            value = getattr(readings, name)
            if value < span.low or value > span.high:  # false for NaN, which is lost
                names.append(name)
        for name in SWITCHES:
            value = getattr(readings, name)
            if value is not None and not is_switch(value):
                names.append(name)
        return names

    def bounded(self, readings: Readings) -> Readings:
        """Return readings in which no impossible value can harm what is known of the edge.

        The time of the edge then runs, and the edge is not taken as new.
        """
        values: dict[str, Any] = {}
        span = self._spans["engaged_time"]
        # NaN is in no span.
        if not span.low <= readings.engaged_time <= span.high:
            values["engaged_time"] = self._interval
        if not is_switch(readings.new_edge):
            values["new_edge"] = False
        if not is_switch(readings.cutting):
            values["cutting"] = True
        return replace(readings, **values) if values else readings
