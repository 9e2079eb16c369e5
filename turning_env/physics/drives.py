"""Feed servo and spindle: dead time and first-order lags behind their commands, and servo current.

The lag is solved exactly over a sub-step, so a time constant of 0 means no lag. In the sub-step in
which a dead time ends, drives follow the mean of the two commands over time.
"""

import math
from typing import Any

import numpy as np

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import expm1
from turning_env.scenario.sections import MAX_DELAY


def lag_share(time: Any, time_constant: Any) -> Any:
    """Return the share of the distance to a target that a first-order lag covers: 1 - exp(-t / T).

    The target is constant for a ``time`` in the unit of the time constant. Either may be an array.
    """
    if np.ndim(time_constant):
        return np.array([lag_share(time, constant) for constant in time_constant])
    return 1.0 if time_constant == 0 else -expm1(-time / time_constant)


@compiled
def clipped(action):
    """Return an action clipped to -1..1."""
    return min(max(action, -1.0), 1.0)


@compiled
def set_point(action, low, high):
    """Return the value that an action commands, linear between a range's ends.

    The action is clipped to -1..1.
    """
    return low + 0.5 * (clipped(action) + 1.0) * (high - low)


@compiled
def note_command(state, i):
    """Store the commands of the step before in the queue of past ones.

    Before the first step, all of the queue is the initial command.
    """
    for k in range(MAX_DELAY - 1, -1, -1):
        shifts = k > 0 and state.step_count[i] > 0
        state.past_cutting_speeds[k, i] = (
            state.past_cutting_speeds[k - 1, i] if shifts else state.commanded_cutting_speed[i]
        )
        state.past_feeds[k, i] = state.past_feeds[k - 1, i] if shifts else state.commanded_feed[i]


@compiled
def follow_late_command(state, work, i, p):
    """Set the cutting speed and feed that the drives follow in a sub-step, if commands act late."""
    # The delay is ``whole`` steps and a rest. For the rest of a step, the command of whole + 1
    # steps ago holds; then that of ``whole`` steps ago follows. Place k of the queues holds the
    # command of k + 1 steps ago.
    whole = min(max(math.ceil(p.steps_late[i]) - 1, 0), MAX_DELAY - 1)
    sub_steps_before = p.sub_steps - work.sub_steps_left[i]
    sub_steps_held = (p.steps_late[i] - whole) * p.sub_steps - sub_steps_before
    held = min(max(sub_steps_held, 0.0), 1.0)  # share of this sub-step
    speed = (
        state.past_cutting_speeds[whole - 1, i] if whole > 0 else state.commanded_cutting_speed[i]
    )
    feed = state.past_feeds[whole - 1, i] if whole > 0 else state.commanded_feed[i]
    work.target_cutting_speed[i] = speed + (state.past_cutting_speeds[whole, i] - speed) * held
    work.target_feed[i] = feed + (state.past_feeds[whole, i] - feed) * held


@compiled
def steady_current(p, i, thrust_force, feed_velocity):
    """Return the servo current [A] at a thrust force [N] and a feed velocity [mm/min].

    The current's ripple is left out. The motor's torque 3/2 p lambda_m i balances friction, preload
    and force through the ball screw, L_0 / (2 pi eta) times each (servo current paper, equations
    (1), (2) and (8)). The feed force is taken as the thrust force, and the growth of the no-load
    current with feed velocity as linear (assumptions).
    """
    no_load_current = p.no_load_current[i] + p.no_load_current_rate[i] * feed_velocity
    return no_load_current + p.current_per_newton[i] * thrust_force


def force_from_current(p, i, current, feed_velocity):
    """Return the thrust force [N] at which ``steady_current`` is ``current`` [A].

    Takes scalars or arrays. The paper's equation (9) as printed mixes torque and force; this
    function solves the equations from which it follows.
    """
    no_load_current = p.no_load_current[i] + p.no_load_current_rate[i] * feed_velocity
    return (current - no_load_current) / p.current_per_newton[i]
