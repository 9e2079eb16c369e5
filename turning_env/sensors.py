"""What the controller is told: power, and thrust force or the servo current, each behind a first-order lag and with noise.

The noise levels (power 2 %, force 5 %) and lags are assumptions; the roughness control paper gives up to 10 % for force.
"""

from turning_env.compilation import compiled
from turning_env.drives import servo_current
from turning_env.keyed_random import SENSOR_CHANNEL, normals_of, words


@compiled
def follow_process(lanes, work, i, parameters):
    """Move the lagged power [kW] and thrust force [N] towards the process over one sub-step."""
    runs = work.running[i] > 0
    power_share = parameters.power_sensor_share if runs else 0.0
    force_share = parameters.force_sensor_share if runs else 0.0
    lanes.lagged_power[i] += (lanes.power[i] - lanes.lagged_power[i]) * power_share
    lanes.lagged_thrust_force[i] += (lanes.thrust_force[i] - lanes.lagged_thrust_force[i]) * force_share


@compiled
def read_sensors(lanes, work, first, last, parameters):
    """Measure power [kW], and thrust force [N] or servo current [A], at the end of an interval."""
    p = parameters
    for i in range(first, last):
        work.word_0[i], work.word_1[i] = words(lanes, i, SENSOR_CHANNEL, 0, lanes.interval_count[i])
    power_gain, force_gain = 1.0 + p.power_bias, 1.0 + p.force_bias
    for i in range(first, last):
        power_normal, force_normal = normals_of(work.word_0[i], work.word_1[i])
        power = power_gain * lanes.lagged_power[i] * (1.0 + p.power_noise * power_normal)
        lanes.measured_power[i] = max(power, 0.0)
        work.force_noise[i] = 1.0 + p.force_noise * force_normal
    if p.senses_current:
        for i in range(first, last):
            feed_velocity = lanes.cutting_speed[i] * p.revolutions_per_metre * lanes.feed[i]
            current = force_gain * servo_current(p, lanes.lagged_thrust_force[i], feed_velocity, lanes.path[i])
            lanes.measured_servo_current[i] = max(current * work.force_noise[i], 0.0)
    else:
        for i in range(first, last):
            lanes.measured_thrust_force[i] = max(force_gain * lanes.lagged_thrust_force[i] * work.force_noise[i], 0.0)
