"""Sensors of power, and of thrust force or servo current, each with a first-order lag and noise.

As the machine warms up, their readings drift, and thermal growth changes the depth of cut
(``docs/models.md``).
"""

from turning_env.numerics.compilation import compiled, env_range
from turning_env.numerics.functions import exp, sine_and_cosine
from turning_env.numerics.keyed_random import SENSOR_CHANNEL, normals_of, words
from turning_env.physics.drives import steady_current
from turning_env.physics.spindle import idle_power


@compiled
def warmth(state, i, p):
    """Return how warm the machine is: 1 - exp(-t / T), 0 at the start.

    The form is an assumption; a lathe takes about an hour.
    """
    return 1.0 - exp(-state.clock[i] / p.warm_up_time[i])


@compiled
def follow_process(state, work, i, p):
    """Move the lagged power [kW] and thrust force [N] towards the process over one sub-step."""
    runs = work.turns[i] > 0.0
    power_share = p.power_sensor_share[i] if runs else 0.0
    force_share = p.force_sensor_share[i] if runs else 0.0
    power = state.power[i] + idle_power(p, i, state.cutting_speed[i])
    force = state.thrust_force[i]
    state.lagged_power[i] += (power - state.lagged_power[i]) * power_share
    state.lagged_thrust_force[i] += (force - state.lagged_thrust_force[i]) * force_share


@compiled
def read_sensors(state, work, first, last, p):
    """Measure power [kW], and thrust force [N] or servo current [A], at the end of a step.

    reading = (1 + bias) true value (1 + noise) (1 + drift), at least 0.
    """
    # The words have a loop of their own, because the compiler does not vectorise Philox.
    for i in env_range(first, last):
        work.word_0[i], work.word_1[i] = words(
            state, i, channel=SENSOR_CHANNEL, bar=0, index=state.step_count[i]
        )
    for i in env_range(first, last):
        power_normal, force_normal = normals_of(work.word_0[i], work.word_1[i])
        biased_power = (1.0 + p.power_bias[i]) * state.lagged_power[i]
        power = biased_power * (1.0 + p.power_noise[i] * power_normal)
        state.measured_power[i] = max(power, 0.0)
        work.force_noise[i] = 1.0 + p.force_noise[i] * force_normal
    if p.warms_up:
        for i in env_range(first, last):
            warm = warmth(state, i, p)
            state.measured_power[i] *= 1.0 + p.power_drift[i] * warm
            work.force_noise[i] *= 1.0 + p.force_drift[i] * warm
    if p.senses_current:
        for i in env_range(first, last):
            feed_velocity = state.cutting_speed[i] * p.revolutions_per_metre[i] * state.feed[i]
            sine, _ = sine_and_cosine(p.ripples_per_path[i] * state.path[i])
            current = steady_current(p, i, state.lagged_thrust_force[i], feed_velocity)
            current *= 1.0 + p.current_ripple[i] * sine
            current = (1.0 + p.force_bias[i]) * current
            state.measured_servo_current[i] = max(current * work.force_noise[i], 0.0)
    else:
        for i in env_range(first, last):
            biased_force = (1.0 + p.force_bias[i]) * state.lagged_thrust_force[i]
            state.measured_thrust_force[i] = max(biased_force * work.force_noise[i], 0.0)
