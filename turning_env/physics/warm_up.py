"""Warm-up of the machine: readings of power and force drift, and thermal growth changes the depth of cut.

Both approach their final values exponentially over machine time (assumption; a lathe takes about an hour).
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp


@compiled
def warmth(state, i, p):
    """Return how warm the machine is: 0 at the start, 1 at last."""
    return 1.0 - exp(-state.clock[i] / p.warm_up_time[i])
