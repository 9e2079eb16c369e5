"""Speeds of a turned bar: cutting speed, spindle speed and feed velocity.

    n = 1000 vc / (pi d)    vc = pi d n / 1000    vf = n f / 60

with n [rev/min], vc [m/min], d [mm], f [mm/rev] and vf [mm/s] (ISO 3002). Numbers and arrays alike.
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
