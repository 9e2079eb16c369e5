"""Speeds of a turned bar, and power and torque of the spindle.

    n = 1000 vc / (pi d)    vc = pi d n / 1000    vf = n f / 60    M = 30000 P / (pi n)

with n [rev/min], vc [m/min], d [mm], f [mm/rev], vf [mm/s], P [kW] and M [N m] (ISO 3002). Numbers
and arrays alike.
"""

import math
from typing import Any


def spindle_speed_at(cutting_speed: Any, diameter: Any) -> Any:
    """Return the spindle speed [rev/min] at a cutting speed [m/min] on a diameter [mm]."""
    return 1000.0 * cutting_speed / (math.pi * diameter)


def cutting_speed_at(spindle_speed: Any, diameter: Any) -> Any:
    """Return the cutting speed [m/min] at a spindle speed [rev/min] on a diameter [mm]."""
    return math.pi * diameter / 1000.0 * spindle_speed


def feed_velocity_at(cutting_speed: Any, feed: Any, diameter: Any) -> Any:
    """Return the feed velocity [mm/s] at a cutting speed [m/min] and a feed [mm/rev]."""
    return spindle_speed_at(cutting_speed * feed, diameter) / 60.0


def torque_at(power: Any, spindle_speed: Any) -> Any:
    """Return the torque [N m] of a power [kW] at a spindle speed [rev/min]."""
    return 30000.0 * power / (math.pi * spindle_speed)


def power_at(torque: Any, spindle_speed: Any) -> Any:
    """Return the power [kW] of a torque [N m] at a spindle speed [rev/min]."""
    return math.pi * spindle_speed / 30000.0 * torque
