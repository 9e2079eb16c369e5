"""Slender bars bend away from the tool and chatter (``docs/effects.md``).

The cut is shallower than commanded by the deflection. Force and deflection depend on each other: the force is taken as
proportional to the depth, with the ratio of the sub-step before. Chatter is a dynamic force about one spindle speed n_c, an
assumption; power stays, as its mean does. Dynamic over static force: c (depth / nominal depth) exp(-(log(n / n_c) / s)^2).
"""

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp

RIGID, CHUCK, TAILSTOCK = range(3)
SUPPORTS = {"rigid": RIGID, "chuck": CHUCK, "tailstock": TAILSTOCK}


@compiled
def compliance(p, i, along):
    """Return deflection over radial force [mm/N] at a place along the bar [mm]."""
    a = p.bar_length[i] - along
    cantilever = a * a * a * p.bar_flexibility[i]
    if p.support == CHUCK:
        return cantilever
    b = along / p.bar_length[i]
    return cantilever * b * b * (3.0 + b) * 0.25


@compiled
def note_stiffness(state, work, i):
    """Store thrust force over depth of cut [N/mm] of the cut before."""
    cuts = min(state.depth_of_cut[i], state.thrust_force[i]) > 0.0
    work.cut_stiffness[i] = state.thrust_force[i] / state.depth_of_cut[i] if cuts else 0.0


@compiled
def bend_bar(state, work, i, p):
    """Take the deflection from the depth of cut [mm]."""
    share = compliance(p, i, work.along[i]) * p.radial_share[i] * work.cut_stiffness[i]
    depth = state.depth_of_cut[i]
    state.depth_of_cut[i] = depth / (1.0 + share) if work.engaged[i] > 0.0 else depth


@compiled
def chatter(state, work, i, p):
    """Set the dynamic over the static thrust force [-]."""
    off = (work.log_cutting_speed[i] - p.log_chatter_cutting_speed[i]) / p.chatter_width[i]
    work.chatter[i] = p.chatter[i] * state.depth_of_cut[i] / p.depth_of_cut[i] * exp(-off * off)
