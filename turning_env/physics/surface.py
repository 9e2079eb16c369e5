"""Surface roughness and its reference, which changes in periods.

Ra = a exp(b F) with the thrust force F (roughness control paper, equation (5)).
"""

import numpy as np

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp
from turning_env.numerics.keyed_random import REFERENCE_CHANNEL, uniform

_MAX_EXPONENT = 300.0  # keeps the roughness finite at absurdly high forces


@compiled
def roughness(p, i, thrust_force):
    """Return Ra [um] at a thrust force [N]."""
    exponent = min(p.roughness_rate[i] * thrust_force, _MAX_EXPONENT)
    return p.roughness_at_no_force[i] * exp(exponent)


@compiled
def draw_reference(state, i, p):
    """Set the reference of Ra [um] to that of the present period, uniform on a log scale."""
    # Half a sub-step is added because the clock, a sum of sub-steps, may miss the period's end
    # by rounding.
    period = np.floor((state.clock[i] + 0.5 * p.sub_step[i]) / p.reference_time[i])
    share = uniform(state, i, channel=REFERENCE_CHANNEL, bar=0, index=period)
    state.roughness_reference[i] = exp(p.log_reference_min[i] + share * p.log_reference_span[i])
