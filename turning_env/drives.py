"""Feed servo and spindle: first-order lags behind their commands.

The feed servo's time constant, 0.13 s, was measured (roughness control paper); the spindle's is an assumption. The
exact solution of the lag over a sub-step is used, so a time constant of 0 means no lag.
"""

import math

from turning_env.compilation import compiled


def lag_share(time: float, time_constant: float) -> float:
    """Share of the distance to a constant target that a first-order lag covers in ``time`` (same unit, e.g. s)."""
    return 1.0 if time_constant == 0 else -math.expm1(-time / time_constant)


@compiled
def follow_commands(lane, parameters):
    """Move actual cutting speed [m/min] and feed [mm/rev] towards their commands over one sub-step."""
    lane.cutting_speed += (lane.commanded_cutting_speed - lane.cutting_speed) * parameters.spindle_share
    lane.feed += (lane.commanded_feed - lane.feed) * parameters.feed_share


@compiled
def spindle_torque(power, spindle_speed):
    """Spindle torque [N m] for a power [kW] at a spindle speed [rev/min], which must be above 0."""
    return 30000.0 * power / (math.pi * spindle_speed)
