"""Quantities that follow from the values of a scenario, or of many scenarios side by side."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from turning_env.numerics.conversions import cutting_speed_at


class DerivedQuantities:
    """Base of ``Scenario`` and ``ScenarioBatch``: its properties are numbers, or arrays of them."""

    if TYPE_CHECKING:
        machine: Any
        spindle: Any
        swarf: Any
        workpiece: Any
        control: Any
        economics: Any

    @property
    def cutting_speed_max(self) -> Any:
        """Highest cutting speed that machine and spindle allow at the diameter [m/min]."""
        by_spindle = cutting_speed_at(self.spindle.max_speed, self.workpiece.diameter)
        by_spindle = np.where(np.equal(by_spindle, 0.0), np.inf, by_spindle)  # 0: unlimited
        return np.minimum(self.machine.cutting_speed_max, by_spindle)

    @property
    def feed_range(self) -> tuple[Any, Any]:
        """Lowest and highest feed of the machine, and of chips that can tangle [mm/rev]."""
        tangles = np.greater(self.swarf.tangle_rate, 0.0)
        low = np.where(tangles, self.swarf.chip_feed_min, 0.0)
        high = np.where(tangles, self.swarf.chip_feed_max, np.inf)
        return np.maximum(self.machine.feed_min, low), np.minimum(self.machine.feed_max, high)

    @property
    def base_cutting_speed(self) -> Any:
        """Cutting speed at the spindle's base speed [m/min]."""
        return cutting_speed_at(self.spindle.base_speed, self.workpiece.diameter)

    @property
    def max_episode_steps(self) -> int | None:
        """Largest number of steps of an episode; None if edge changes can add steps."""
        control = self.control
        if control.action == "part":
            bars: int = self.workpiece.bars
            return bars
        steps: float = control.time_limit * 60.0 / control.interval
        if control.edge_changes == "end":
            return round(steps)
        if self.economics.edge_change_time * 60.0 < control.interval:
            return None
        # Half a sub-step of tolerance, as the clock is a sum and rounded.
        tolerance: float = 0.5 / control.sub_steps
        return math.ceil(steps - tolerance)
