"""The power law, the form of all machinability models.

    response = coefficient * V^a * f^b * (d / d0)^c * t^g * U^e * H^h
    U = W, or 1 + wear_growth * W

with V the cutting speed [m/min], f the feed [mm/rev], d the depth of cut [mm], t the cutting time
of the edge [min], W the flank wear [mm] and H the hardness relative to nominal [-]. A factor that a
response does not depend on has exponent 0. (Form: Alaskari and Oraby 2018, equations (1)-(8),
recovered from their tables. The second form of U, with a fresh edge's share: measured data, see
``numerics/wear_term.py``.)
"""

from typing import Any

import numpy as np

from turning_env.numerics.functions import exp, log, where
from turning_env.numerics.wear_term import wear_term_slope
from turning_env.scenario.section import Section, quantity

# An edge that does not cut has neither depth nor wear. Laws take logarithms of these instead.
MIN_DEPTH = 1e-6
"""Smallest depth of cut [mm]."""
MIN_LIFE = 1e-300
"""Smallest used tool life [-]."""

POWER_LAW_RECORD = np.dtype(
    [
        ("log_coefficient", np.float64),
        ("cutting_speed", np.float64),
        ("feed", np.float64),
        ("depth_of_cut", np.float64),
        ("time", np.float64),
        ("wear", np.float64),
        ("wear_growth", np.float64),
        ("hardness", np.float64),
    ]
)
"""A law as the compiled transition reads it."""


def log_response(
    law: Any,
    log_cutting_speed: Any,
    log_feed: Any,
    log_depth_of_cut: Any,
    log_time: Any,
    log_wear_term: Any,
    log_hardness: Any,
) -> Any:
    """Return the natural logarithm of a response by those of its factors.

    ``log_wear_term``: log U (``numerics/wear_term.py``).

    ``law`` has the fields of ``POWER_LAW_RECORD``, as a ``PowerLaw`` has. Factors are scalars,
    arrays, or tensors of PyTorch.
    """
    return (
        law.log_coefficient
        + law.cutting_speed * log_cutting_speed
        + law.feed * log_feed
        + law.depth_of_cut * log_depth_of_cut
        + law.time * log_time
        + law.wear * log_wear_term
        + law.hardness * log_hardness
    )


def log_coefficient(law: Any) -> Any:
    """Return the natural logarithm of a law's coefficient, with the reference depth folded in."""
    return log(law.coefficient) - law.depth_of_cut * log(law.reference_depth_of_cut)


def wear_exponent(law: Any, log_wear: Any) -> Any:
    """Return the derivative of a law's log response by the log wear [-], at a log wear [mm].

    It is the exponent e if U = W, and less if a fresh edge has a share of the load.
    """
    return law.wear * wear_term_slope(law.wear_growth, log_wear)


class PowerLaw(Section):
    """A machinability model.

    Exponents are dimensionless; the coefficient has the response's unit.
    """

    coefficient: float = quantity(
        ..., 1e-12, 1e12, "response", "response at V = f = d/d0 = t = W = H = 1"
    )
    cutting_speed: float = quantity(0.0, -10, 10, "-", "exponent of the cutting speed in m/min")
    feed: float = quantity(0.0, -10, 10, "-", "exponent of the feed in mm/rev")
    depth_of_cut: float = quantity(
        0.0, -10, 10, "-", "exponent of the depth of cut over the reference depth"
    )
    reference_depth_of_cut: float = quantity(
        2.5, 0.01, 100, "mm", "depth of cut at which the law was measured"
    )
    time: float = quantity(0.0, -10, 10, "-", "exponent of the edge's cutting time in min")
    wear: float = quantity(
        0.0, -10, 10, "-", "exponent of the flank wear in mm, or of 1 + wear_growth * wear"
    )
    wear_growth: float = quantity(
        0.0,
        0,
        1000,
        "1/mm",
        "growth of a force or power with the wear, over that of a fresh edge; 0: power of the wear",
    )
    hardness: float = quantity(0.0, -10, 10, "-", "exponent of the relative hardness")

    @property
    def log_coefficient(self) -> Any:
        """Natural logarithm of the coefficient, with the reference depth folded in."""
        return log_coefficient(self)

    def wear_term(self, wear: Any) -> Any:
        """Return U [-] at a flank wear [mm]."""
        return where(self.wear_growth > 0.0, 1.0 + self.wear_growth * wear, wear)

    def __call__(
        self,
        cutting_speed: Any,
        feed: Any,
        depth_of_cut: Any,
        time: Any = 1.0,
        wear: Any = 1.0,
        hardness: Any = 1.0,
    ) -> Any:
        """Return the response to positive scalars or broadcastable arrays.

        The wear may be 0 if the law has a ``wear_growth``.

        Args:
            cutting_speed: cutting speed [m/min].
            feed: feed [mm/rev].
            depth_of_cut: depth of cut [mm].
            time: cutting time of the edge [min].
            wear: flank wear [mm].
            hardness: hardness relative to nominal [-].
        """
        response = log_response(
            self,
            log_cutting_speed=log(cutting_speed),
            log_feed=log(feed),
            log_depth_of_cut=log(depth_of_cut),
            log_time=log(time),
            log_wear_term=log(self.wear_term(wear)),
            log_hardness=log(hardness),
        )
        return exp(response)
