"""Slender bars bend away from the tool and chatter (``docs/models.md``).

The cut is shallower than commanded by the deflection. Force and deflection depend on each other:
the force is taken as proportional to the depth, with the ratio of the sub-step before.

Chatter is a dynamic force about one spindle speed n_c (assumption). Its ratio to the static force
is c (depth / nominal depth) exp(-(log(n / n_c) / s)^2). Power stays, because its mean does.
"""

from typing import Any

import numpy as np

from turning_env.numerics.compilation import compiled
from turning_env.numerics.functions import exp

RIGID, CHUCK, TAILSTOCK = range(3)
SUPPORTS = {"rigid": RIGID, "chuck": CHUCK, "tailstock": TAILSTOCK}


def rod_flexibility(diameter: Any, elastic_modulus: Any) -> Any:
    """Return 1 / (3 E I) of a round rod [1/(N mm2)], with its diameter [mm] and E [N/mm2]."""
    moment = np.pi * diameter**4 / 64.0  # second moment of area [mm4]
    return 1.0 / (3.0 * elastic_modulus * moment)


@compiled
def compliance(support, along, length, flexibility):
    """Return deflection over radial force [mm/N] at places along a bar [mm].

    Beam theory (Euler and Bernoulli), with a the distance to the chuck, b the one to the free end:
    a^3 / (3 E I), with a tailstock times b^2 (3 a + 4 b) / (4 L^3).

    Args:
        support: ``CHUCK`` or ``TAILSTOCK``.
        along: distance to the free end [mm].
        length: of the bar from the chuck to its free end [mm].
        flexibility: ``rod_flexibility`` [1/(N mm2)].
    """
    a = length - along
    cantilever = a * a * a * flexibility
    if support == CHUCK:
        return cantilever
    # In units of the length, where a + b = 1, the factor is b^2 (3 + b) / 4.
    b = along / length
    return cantilever * b * b * (3.0 + b) * 0.25


@compiled
def note_stiffness(state, work, i):
    """Store thrust force over depth of cut [N/mm] of the sub-step before."""
    cuts = min(state.depth_of_cut[i], state.thrust_force[i]) > 0.0
    work.cut_stiffness[i] = state.thrust_force[i] / state.depth_of_cut[i] if cuts else 0.0


@compiled
def bend_bar(state, work, i, p):
    """Take the deflection from the depth of cut [mm].

    The depth d, commanded as d_0, solves d = d_0 - q d, with the compliance times the radial
    stiffness of the cut q. So d = d_0 / (1 + q).
    """
    compliance_here = compliance(p.support, work.along[i], p.bar_length[i], p.bar_flexibility[i])
    share = compliance_here * p.radial_share[i] * work.cut_stiffness[i]
    depth = state.depth_of_cut[i]
    state.depth_of_cut[i] = depth / (1.0 + share) if work.engaged[i] > 0.0 else depth


@compiled
def chatter(state, work, i, p):
    """Set the dynamic over the static thrust force [-]."""
    off = (work.log_cutting_speed[i] - p.log_chatter_cutting_speed[i]) / p.chatter_width[i]
    relative_depth_gain = p.chatter[i] * state.depth_of_cut[i] / p.depth_of_cut[i]
    work.chatter[i] = relative_depth_gain * exp(-off * off)
