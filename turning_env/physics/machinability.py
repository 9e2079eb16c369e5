"""The material's three responses: wear of the edge, thrust force and power.

All factors are natural logarithms: cutting speed [m/min], feed [mm/rev], depth of cut [mm], flank
wear [mm] and relative hardness [-]. Form and coefficients: Alaskari and Oraby 2018, equations (1)
to (8), recovered from their tables (``scenario/power_law.py``).
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp
from turning_env.numerics.wear_term import log_wear_term


@compiled
def log_response(law, i, log_cutting_speed, log_feed, log_depth_of_cut, wear_term, log_hardness):
    """Return the logarithm of environment i's response by a law that does not depend on time.

    log response = log k + a log V + b log f + c log d + e log U + h log H (``PowerLaw``), where
    ``wear_term`` is log U: the logarithm of the flank wear, except in ``loads_with_fresh_share``.
    """
    return (
        law.log_coefficient[i]
        + law.cutting_speed[i] * log_cutting_speed
        + law.feed[i] * log_feed
        + law.depth_of_cut[i] * log_depth_of_cut
        + law.wear[i] * wear_term
        + law.hardness[i] * log_hardness
    )


@compiled
def log_wear_coefficient(p, i, log_cutting_speed, log_feed, log_depth_of_cut, log_hardness):
    """Return log K of the fresh-edge wear W = K t^n; K is the wear [mm] after one minute."""
    return log_response(
        p.wear_law,
        i,
        log_cutting_speed=log_cutting_speed,
        log_feed=log_feed,
        log_depth_of_cut=log_depth_of_cut,
        wear_term=0.0,
        log_hardness=log_hardness,
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
def loads_with_fresh_share(
    p, i, log_cutting_speed, log_feed, log_depth_of_cut, log_wear, log_hardness
):
    """Return thrust force [N] and spindle power [kW] by laws that may have a fresh edge's share.

    A law without one gives the bits of ``force_and_power``, which needs fewer logarithms.
    """
    force_term = log_wear_term(p.force_law.wear_growth[i], log_wear)
    power_term = log_wear_term(p.power_law.wear_growth[i], log_wear)
    log_force = log_response(
        p.force_law, i, log_cutting_speed, log_feed, log_depth_of_cut, force_term, log_hardness
    )
    log_power = log_response(
        p.power_law, i, log_cutting_speed, log_feed, log_depth_of_cut, power_term, log_hardness
    )
    return exp(log_force), exp(log_power)


@compiled
def excess_over_further_limit(p, number, log_feed, log_depth_of_cut, log_hardness):
    """Return the relative excess [-], at least 0, over a further limit.

    Further limits bound the radial force, the torque or the roughness (adaptive part programming
    paper, "boundary conditions"). All environments of a block share them.
    """
    law = p.further_laws[number]
    log_share = (
        law.log_share
        + law.feed * log_feed
        + law.depth_of_cut * log_depth_of_cut
        + law.hardness * log_hardness
    )
    return max(exp(log_share) - 1.0, 0.0)
