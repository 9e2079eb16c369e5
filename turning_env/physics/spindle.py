"""The spindle's motor: torque over speed, idling, and short-time overload.

At the speed n, the share c(n) = min(1, n / n_b) of the rated power P_r is available, with the base
speed n_b. The limit of power falls with c. The heat h of the motor follows
tau dh/dt = (P / (c P_r))^2 - h; until h reaches 1, the limit is ``short_time_load`` times as high.
What exceeds the limit counts as overload; the speed does not drop (assumption). Sources:
``docs/models.md``. For arrays: ``scenario/laws.py``.
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp


@compiled
def capacity(p, i, cutting_speed):
    """Return the available over the rated power [-] at a cutting speed [m/min]."""
    return min(p.capacity_per_speed[i] * cutting_speed, 1.0)


@compiled
def idle_power(p, i, cutting_speed):
    """Return the power of the idling spindle [kW] at a cutting speed [m/min]."""
    return p.idle_power_per_speed[i] * cutting_speed


@compiled
def allowed_share(state, i, p):
    """Return the power that is allowed now over the limit of power [-]."""
    short_time = p.short_time_load[i] if state.spindle_heat[i] < 1.0 else 1.0
    return short_time * capacity(p, i, state.cutting_speed[i])


@compiled
def heat_up(state, work, i, p):
    """Move the motor's heat [-] towards that of the present load over one sub-step."""
    speed = state.cutting_speed[i]
    power = state.power[i] + idle_power(p, i, speed)
    load = power / (p.rated_power[i] * capacity(p, i, speed))
    minutes = work.sub_step[i] if work.turns[i] > 0.0 else 0.0
    share = 1.0 - exp(-minutes / p.thermal_time_constant[i])
    state.spindle_heat[i] += (load * load - state.spindle_heat[i]) * share


@compiled
def cool_down(state, i, p, minutes):
    """Let the motor cool without load."""
    state.spindle_heat[i] *= exp(-minutes / p.thermal_time_constant[i])
