"""Feed servo and spindle: first-order lags behind their commands, and the current of the feed's motor.

The feed servo's time constant, 0.13 s, was measured (roughness control paper); the spindle's is an assumption. The lag is solved
exactly over a sub-step, so a time constant of 0 means no lag.
"""

import math
from typing import Any

import numpy as np

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import sine_and_cosine


def lag_share(time: float, time_constant: Any) -> Any:
    """Return the share of the distance to a constant target that a first-order lag covers in ``time`` (both in the same unit)."""
    if np.ndim(time_constant):
        return np.array([lag_share(time, each) for each in time_constant])
    return 1.0 if time_constant == 0 else -math.expm1(-time / time_constant)


@compiled
def clipped(action):
    """Return an action clipped to -1..1."""
    return min(max(action, -1.0), 1.0)


@compiled
def set_point(action, low, high):
    """Return the value that an action commands, linear between a range's ends; the action is clipped to -1..1."""
    return low + 0.5 * (clipped(action) + 1.0) * (high - low)


@compiled
def steady_current(parameters, thrust_force, feed_velocity):
    """Return the servo current [A] at a thrust force [N] and a feed velocity [mm/min], without ripple.

    The motor's torque 3/2 p lambda_m i balances friction, preload and force through the ball screw, L_0 / (2 pi eta) times
    each (servo current paper, equations (1), (2) and (8)). The feed force is taken as the thrust force, and the growth of
    the no-load current with feed velocity as linear (assumptions).
    """
    no_load_current = parameters.no_load_current + parameters.no_load_current_rate * feed_velocity
    return no_load_current + parameters.current_per_newton * thrust_force


def force_from_current(parameters, current, feed_velocity):
    """Return the thrust force [N] at which ``steady_current`` is ``current`` [A]. Scalars or arrays.

    The paper's equation (9) as printed mixes torque and force; this function solves the equations from which it follows.
    """
    no_load_current = parameters.no_load_current + parameters.no_load_current_rate * feed_velocity
    return (current - no_load_current) / parameters.current_per_newton


@compiled
def servo_current(parameters, thrust_force, feed_velocity, path):
    """Return the servo current [A] with the ripple at a position [mm] of the screw."""
    sine, _ = sine_and_cosine(parameters.ripples_per_path * path)
    ripple = 1.0 + parameters.current_ripple * sine
    return steady_current(parameters, thrust_force, feed_velocity) * ripple


@compiled
def spindle_torque(power, spindle_speed):
    """Return the spindle torque [N m] for a power [kW] at a spindle speed [rev/min], which must be above 0."""
    return 30000.0 * power / (math.pi * spindle_speed)
