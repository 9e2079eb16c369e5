"""Chips that do not break tangle, and the machine stops until they are cleared.

The next stop comes when the integral of the rate over the cutting time outside the window of feed
and depth exceeds a margin. The margin is an exponential number with mean 1, drawn again after every
stop, so stops are a Poisson process. The makers' windows have this form; the numbers are
assumptions (``docs/models.md``).
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.keyed_random import TANGLE_CHANNEL, exponential

# Relative error of a commanded feed [-]: actions have single precision, and the ends of the window
# belong to it.
ROUNDING = 1e-6


@compiled
def tangle(state, work, count, p):
    """Let chips tangle in the sub-step where the integral of the rate has used up the margin [-].

    It counts tangles in ``work`` and ``state``, at most one per sub-step, and draws their next
    margins. The integral grows with ``work.engaged`` [min] while feed or depth of cut is outside
    the window in which chips break.
    """
    tangled = 0
    for i in range(count):
        feed = state.feed[i]
        depth = state.depth_of_cut[i]
        breaks = (p.chip_feed_min[i] <= feed * (1.0 + ROUNDING)) & (
            feed <= p.chip_feed_max[i] * (1.0 + ROUNDING)
        )
        breaks &= (p.chip_depth_min[i] <= depth) & (depth <= p.chip_depth_max[i])
        state.tangle_margin[i] -= 0.0 if breaks else p.tangle_rate[i] * work.engaged[i]
        tangled += state.tangle_margin[i] <= 0.0
    # Stops are rare, so most sub-steps need no second loop.
    if tangled:
        for i in range(count):
            if state.tangle_margin[i] <= 0.0:
                work.tangles[i] += 1
                state.tangles[i] += 1
                state.tangle_margin[i] += exponential(
                    state, i, channel=TANGLE_CHANNEL, bar=0, index=state.tangles[i]
                )
