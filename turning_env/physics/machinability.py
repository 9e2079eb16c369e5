"""The material's three responses: wear of the edge, thrust force and power.

All factors are natural logarithms: cutting speed [m/min], feed [mm/rev], depth of cut [mm], flank wear [mm] and relative
hardness [-].
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp


@compiled
def log_response(law, i, log_cutting_speed, log_feed, log_depth_of_cut, log_wear, log_hardness):
    """Return the logarithm of environment i's response by a law that does not depend on time (``scenario.power_law``)."""
    return (
        law.log_coefficient[i]
        + law.cutting_speed[i] * log_cutting_speed
        + law.feed[i] * log_feed
        + law.depth_of_cut[i] * log_depth_of_cut
        + law.wear[i] * log_wear
        + law.hardness[i] * log_hardness
    )


@compiled
def log_wear_coefficient(p, i, log_cutting_speed, log_feed, log_depth_of_cut, log_hardness):
    """Return the logarithm of K in the fresh-edge wear W = K t^n: the wear [mm] after one minute."""
    return log_response(
        p.wear_law, i, log_cutting_speed, log_feed, log_depth_of_cut, 0.0, log_hardness
    )


@compiled
def force_and_power(p, i, log_cutting_speed, log_feed, log_depth_of_cut, log_wear, log_hardness):
    """Return thrust force [N] and spindle power [kW]."""
    log_force = log_response(
        p.force_law, i, log_cutting_speed, log_feed, log_depth_of_cut, log_wear, log_hardness
    )
    log_power = log_response(
        p.power_law, i, log_cutting_speed, log_feed, log_depth_of_cut, log_wear, log_hardness
    )
    return exp(log_force), exp(log_power)


@compiled
def excess_over_further_limit(p, number, log_feed, log_depth_of_cut, log_hardness):
    """Return the relative excess [-], at least 0, over a further limit: of radial force, torque or roughness."""
    law = p.further_laws[number]
    log_share = law[0] + law[1] * log_feed + law[2] * log_depth_of_cut + law[3] * log_hardness
    return max(exp(log_share) - 1.0, 0.0)
