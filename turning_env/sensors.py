"""What the controller is told: power, and thrust force or the servo current, each behind a first-order lag and with noise.

The noise levels (power 2 %, force 5 %) and lags are assumptions; the roughness control paper gives up to 10 % for force.
"""

from turning_env.compilation import compiled
from turning_env.drives import servo_current
from turning_env.keyed_random import SENSOR_CHANNEL, standard_normals


@compiled
def follow_process(lane, parameters):
    """Move the lagged power [kW] and thrust force [N] towards the process over one sub-step."""
    lane.lagged_power += (lane.power - lane.lagged_power) * parameters.power_sensor_share
    lane.lagged_thrust_force += (lane.thrust_force - lane.lagged_thrust_force) * parameters.force_sensor_share


@compiled
def read_sensors(lane, parameters):
    """Measure power [kW], and thrust force [N] or servo current [A], at the end of an interval."""
    power_normal, force_normal = standard_normals(lane, SENSOR_CHANNEL, 0, lane.interval_count)
    power_gain, force_gain = 1.0 + parameters.power_bias, 1.0 + parameters.force_bias
    power = power_gain * lane.lagged_power * (1.0 + parameters.power_noise * power_normal)
    lane.measured_power = max(power, 0.0)
    if parameters.senses_current:
        feed_velocity = lane.cutting_speed * parameters.revolutions_per_metre * lane.feed
        current = force_gain * servo_current(parameters, lane.lagged_thrust_force, feed_velocity, lane.path)
        lane.measured_servo_current = max(current * (1.0 + parameters.force_noise * force_normal), 0.0)
    else:
        thrust_force = force_gain * lane.lagged_thrust_force * (1.0 + parameters.force_noise * force_normal)
        lane.measured_thrust_force = max(thrust_force, 0.0)
