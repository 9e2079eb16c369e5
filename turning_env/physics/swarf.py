"""Chips that do not break tangle, and the machine stops until they are cleared (``docs/effects.md``).

The next stop comes when the integral of the rate over the cutting time outside the window of feed and depth exceeds a margin, an
exponential number with mean 1 that is drawn anew after every stop.
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.keyed_random import TANGLE_CHANNEL, exponential

ROUNDING = 1e-6  # relative error of a commanded feed [-]: actions are of single precision, and an end of the window belongs to it


@compiled
def tangle(state, work, count, p):
    """Use up margins while cutting outside the window, and count a tangle if none is left: at most one per sub-step."""
    tangled = 0
    for i in range(count):
        feed, depth = state.feed[i] * (1.0 + ROUNDING), state.depth_of_cut[i]
        breaks = (p.chip_feed_min[i] <= feed) & (
            state.feed[i] <= p.chip_feed_max[i] * (1.0 + ROUNDING)
        )
        breaks &= (p.chip_depth_min[i] <= depth) & (depth <= p.chip_depth_max[i])
        state.tangle_margin[i] -= 0.0 if breaks else p.tangle_rate[i] * work.engaged[i]
        tangled += state.tangle_margin[i] <= 0.0
    if tangled:
        for i in range(count):
            if state.tangle_margin[i] <= 0.0:
                work.tangles[i] += 1
                state.tangles[i] += 1
                state.tangle_margin[i] += exponential(state, i, TANGLE_CHANNEL, 0, state.tangles[i])
