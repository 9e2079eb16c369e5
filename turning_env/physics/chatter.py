"""Chatter: about one spindle speed n_c, a dynamic force adds to the thrust force; power stays, as its mean does.

Dynamic over static force: c (depth / nominal depth) exp(-(log(n / n_c) / s)^2), an assumption (``docs/effects.md``).
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp


@compiled
def sing(state, work, i, p):
    """Set the dynamic over the static thrust force [-]."""
    off = (work.log_cutting_speed[i] - p.log_chatter_cutting_speed[i]) / p.chatter_width[i]
    work.chatter[i] = p.chatter[i] * state.depth_of_cut[i] / p.depth_of_cut[i] * exp(-off * off)
