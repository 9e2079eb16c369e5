"""The watch: finds readings that do not bound the load, because they are wrong.

``readings.py`` says what a reading may be by itself. Here readings are compared with the ones
before, with one another and with the commands. A sensor with a wrong scale passes.
"""

from collections import deque

import numpy as np
from turning_control.observer import MIN_WEAR
from turning_control.readings import (
    NUMBERS,
    OVERSHOOT,
    Readings,
    ReadingsTable,
    bar_spindle_speed,
    force_reading,
)

from turning_env.observation import Reading
from turning_env.scenario import Scenario
from turning_env.scenario.laws import idle_power_at

# A fault that chance or a lag can explain for a moment must last this long [s], and this number of
# control intervals: at long intervals, a short time holds too few readings.
STUCK_TIME = 0.5
STUCK_INTERVALS = 5
# Readings that all repeat need the intervals only: chance does not explain them.
FROZEN_INTERVALS = 5
LAGS = 5.0  # time constants of a drive in which it follows its command [-]
# Actual over commanded speed and feed up to which a drive follows [-].
FOLLOWS = 1.1
# Smallest and largest distance that the position may move over that of the feed's velocity [-].
MIN_MOVED = 0.3
MAX_MOVED = 3.0
RESOLUTION = 0.02  # of the position [mm]
FAR_BACK = 0.5  # share of the bar's length by which the position falls when the next bar begins [-]
# Load over its limit that only a cut causes, and load over nominal that no cut falls below [-].
CUT_LOAD = 0.2
AIR_LOAD = 0.1
# Shortest time in metal between two readings in metal, over the control interval [-].
MIN_ENGAGED = 0.5


class Watch:
    """Finds faults in a sequence of readings."""

    def __init__(self, scenario: Scenario) -> None:
        control = scenario.control
        machine = scenario.machine
        self._scenario = scenario
        self._table = ReadingsTable(scenario)
        self._force = force_reading(scenario)
        self._sets_speed = control.action != "override"
        self._stuck = max(STUCK_TIME / control.interval, STUCK_INTERVALS)
        self._feed_lags = self._intervals_to_follow(machine.feed_time_constant)
        self._spindle_lags = self._intervals_to_follow(machine.spindle_time_constant)
        self._min_wear = MIN_WEAR * scenario.tool.wear_criterion
        self._drawn = scenario.workpiece.drawn_sections()
        self.reset()

    def _intervals_to_follow(self, time_constant: float) -> float:
        """Return the control intervals after which a drive follows its command."""
        seconds = LAGS * time_constant + self._scenario.machine.command_delay
        return max(self._stuck, seconds / self._scenario.control.interval)

    def reset(self) -> None:
        """Forget the readings before."""
        self._before: Readings | None = None
        self._counts: dict[str, int] = {}  # intervals in a row in which a suspicion holds
        # Positions of the last intervals [mm], and the distances that the feed moved in them [mm].
        self._positions: deque[float] = deque(maxlen=STUCK_INTERVALS + 1)
        self._distances: deque[float] = deque(maxlen=STUCK_INTERVALS)

    def lost(self, readings: Readings) -> list[str]:
        """Return the names of needed readings that are missing."""
        return self._table.lost(readings)

    def bounded(self, readings: Readings) -> Readings:
        """Return readings in which no impossible value can harm what is known of the edge."""
        return self._table.bounded(readings)

    def fault(self, readings: Readings, reading: Reading) -> str:
        """Return a fault in a few words, or an empty text.

        Call it once per control interval, because it counts.

        Args:
            readings: the present ones.
            reading: the observation of them, in physical units.
        """
        before = self._before
        self._before = readings
        lost = self.lost(readings)
        if lost:
            return f"no {lost[0]}"
        impossible = self._table.impossible(readings)
        if impossible:
            return f"impossible {impossible[0]}"
        if before is not None and self._repeats(readings, before):
            return "sensor stuck"
        if not readings.in_feed:
            self._forget_motion()
            return ""
        return self._contradiction(readings, reading, before)

    def _forget_motion(self) -> None:
        """Forget what is known of a motion at feed that has ended."""
        repeats = {name: n for name, n in self._counts.items() if name in ("all", "load")}
        self._counts = repeats
        self._positions.clear()
        self._distances.clear()

    def _lasts(self, name: str, holds: bool, intervals: float) -> bool:
        """Count the intervals in which a suspicion holds; return whether they are enough."""
        self._counts[name] = self._counts.get(name, 0) + 1 if holds else 0
        return self._counts[name] >= intervals

    def _repeats(self, readings: Readings, before: Readings) -> bool:
        """Return whether all readings, or a load in the cut, have repeated for too long."""
        # Time in metal is not measured. NaN never repeats, but is no reading either.
        names = [name for name in NUMBERS if name != "engaged_time"]
        now = [getattr(readings, name) for name in names]
        then = [getattr(before, name) for name in names]
        same_numbers = np.array_equal(now, then, equal_nan=True)
        same_switches = readings.in_feed == before.in_feed and readings.cutting == before.cutting
        is_frozen = same_numbers and same_switches and bool(readings.in_feed)
        # Noise changes every reading of a sensor that works.
        same_power = readings.power == before.power
        same_force = getattr(readings, self._force) == getattr(before, self._force)
        frozen = self._lasts("all", is_frozen, FROZEN_INTERVALS)
        stuck = self._lasts("load", same_power or same_force, self._stuck)
        return frozen or (stuck and bool(readings.cutting))

    def _contradiction(self, readings: Readings, reading: Reading, before: Readings | None) -> str:
        """Return which readings at feed contradict one another or the commands."""
        machine = self._scenario.machine
        feed = readings.feed_velocity / max(readings.spindle_speed, 1e-9)
        if feed > OVERSHOOT * machine.feed_max:
            return "feed_velocity contradicts spindle_speed"

        metal = self._in_the_bar(readings)
        was_cutting = before is not None and bool(before.cutting)
        stays_in_metal = bool(readings.cutting) and was_cutting
        if stays_in_metal and readings.new_edge:
            return "new_edge in the cut"

        short = readings.engaged_time < MIN_ENGAGED * self._scenario.control.interval
        commanded_feed = float(reading.commanded_feed[0])
        # In a run-up adaptive feed is off, so the feed must follow only where there may be metal.
        obeys = bool(readings.cutting) or bool(metal)
        too_fast = obeys and feed > FOLLOWS * commanded_feed + machine.feed_min
        turns = bar_spindle_speed(self._scenario, float(reading.commanded_cutting_speed[0]))
        ratio = readings.spindle_speed / turns
        off_speed = self._sets_speed and not 1.0 / FOLLOWS < ratio < FOLLOWS
        wrong_place = metal is not None and metal != readings.cutting
        suspicions = (
            ("engaged_time contradicts cutting", stays_in_metal and short, self._stuck),
            ("feed_velocity does not follow", too_fast, self._feed_lags),
            ("spindle_speed does not follow", off_speed, self._spindle_lags),
            ("position contradicts cutting", wrong_place, self._stuck),
            ("loads contradict cutting", self._wrong_loads(readings, reading), self._stuck),
        )
        faults = []
        for name, holds, intervals in suspicions:
            if self._lasts(name, holds, intervals):
                faults.append(name)
        if self._strays(readings):
            faults.append("position contradicts feed_velocity")
        return faults[0] if faults else ""

    def _in_the_bar(self, readings: Readings) -> bool | None:
        """Return whether the tool is where the drawing has metal; None: nobody knows."""
        position = readings.position
        if np.isnan(position):
            return None
        if position < 0.0 or position > self._drawn.ends[-1]:
            return False
        section = int(np.searchsorted(self._drawn.ends, position))
        # A section without depth may be cut or not.
        return True if self._drawn.depths[section] > 0.0 else None

    def _wrong_loads(self, readings: Readings, reading: Reading) -> bool:
        """Return whether loads are too high for air, or too low for metal."""
        scenario = self._scenario
        limits = scenario.limits
        material = scenario.material
        speed = reading.cutting_speed
        power = float((reading.power - idle_power_at(scenario, speed))[0])
        force = float(reading.thrust_force[0])
        if not readings.cutting:
            return power > CUT_LOAD * limits.power or force > CUT_LOAD * limits.thrust_force
        depths = self._drawn.depths
        depth = depths[depths > 0.0].min(initial=scenario.workpiece.depth_of_cut)
        least_power = material.power(speed, reading.feed, depth, wear=self._min_wear)
        least_force = material.thrust_force(speed, reading.feed, depth, wear=self._min_wear)
        return bool(power < AIR_LOAD * least_power[0] and force < AIR_LOAD * least_force[0])

    def _strays(self, readings: Readings) -> bool:
        """Return whether the position has not moved as the feed's velocity says."""
        position = readings.position
        if np.isnan(position):
            return False
        far_back = FAR_BACK * self._scenario.workpiece.bar_length
        if self._positions and position < self._positions[-1] - far_back:
            self._positions.clear()  # the next bar
            self._distances.clear()
        if self._positions:
            distance = readings.feed_velocity / 60.0 * self._scenario.control.interval
            self._distances.append(distance)
        self._positions.append(position)
        if len(self._distances) < STUCK_INTERVALS:
            return False
        moved = position - self._positions[0]
        expected = sum(self._distances)
        too_little = moved < MIN_MOVED * expected - RESOLUTION
        too_much = moved > MAX_MOVED * expected + RESOLUTION
        return too_little or too_much
