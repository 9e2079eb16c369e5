"""Laws of wear, thrust force and power from a material group, a start value and an insert.

All are power laws, so that everything that reads fitted laws reads them. Their evidence states the
width of their sources as the covariance of the logarithms, as a fit does.
"""

import math

import numpy as np
from turning_shop.catalogue import start_values, thrust
from turning_shop.catalogue.groups import EXPONENT_DEVIATION, Group
from turning_shop.catalogue.hardness import FORCE_EXPONENT, SPEED_EXPONENT
from turning_shop.catalogue.start_values import (
    DEPTH_EXPONENT,
    FEED_EXPONENT,
    FEED_EXPONENT_DEVIATION,
    REFERENCE_DEPTH,
    REFERENCE_FEED,
    TAYLOR_DEVIATION,
    Start,
)
from turning_shop.fit import TYPICAL_EDGE_SPREAD, TYPICAL_GROWTH
from turning_shop.prediction import LawEvidence
from turning_shop.provenance import TAYLOR

from turning_env.scenario.power_law import PowerLaw
from turning_env.scenario.sections import Material

WEAR_EXPONENT = 0.5
"""Exponent of time in flank wear, W ~ t^g [-].

Assumption: the readings of 72 pairs of materials of KIT-AMEL (AIST) have 0.39 to 0.73.
"""
MANY = 1e6  # degrees of freedom of a width that is not estimated from rows

ASSUMED = (
    f"flank wear grows with the root of time, W ~ t^{WEAR_EXPONENT:g}",
    f"thrust grows as 1 + {TYPICAL_GROWTH['thrust_force']:g} VB and power as "
    f"1 + {TYPICAL_GROWTH['power']:g} VB, with flank wear VB in mm, as on 13 tools of Vicomtech",
)
"""Assumptions of the laws, as sentences for people."""


def material_of(
    group: Group, start: Start, wear_criterion: float, entering_sine: float = 1.0
) -> Material:
    """Return the laws of a group at a start value, worn out at a flank wear [mm].

    With the sine s of the entering angle, the chip is f s thick and ap / s wide: Kienzle's force
    kc1.1 ap f^(1 - mc) grows by s^-mc, the share of thrust by the thinner chip, and V f^x ap^y
    keeps its constant with the thickness and the width of the chip.
    """
    force_feed = 1.0 - group.mc
    specific_force = group.kc11 * entering_sine**-group.mc  # at unit feed and depth [N/mm2]
    power = _worn(
        PowerLaw(
            coefficient=specific_force / 60_000.0,  # N/mm2 mm2 m/min to kW
            cutting_speed=1.0,
            feed=force_feed,
            depth_of_cut=1.0,
            reference_depth_of_cut=1.0,
            hardness=FORCE_EXPONENT,
        ),
        growth=TYPICAL_GROWTH["power"],
    )
    share = thrust.share_of(group)
    reference_cut = thrust.REFERENCE_FEED * thrust.REFERENCE_DEPTH
    share_at_unit_cut = share.value * (reference_cut / entering_sine) ** share.thinning
    thrust_force = _worn(
        PowerLaw(
            coefficient=share_at_unit_cut * specific_force,
            feed=force_feed - share.thinning,
            depth_of_cut=1.0 - share.thinning,
            reference_depth_of_cut=1.0,
            hardness=FORCE_EXPONENT,
        ),
        growth=TYPICAL_GROWTH["thrust_force"],
    )
    return Material(
        wear=wear_law(start.speed, TAYLOR, wear_criterion, entering_sine=entering_sine),
        thrust_force=thrust_force,
        power=power,
    )


def _worn(law: PowerLaw, growth: float) -> PowerLaw:
    """Return a law of a fresh edge that grows with the wear."""
    return law.model_copy(update={"wear": 1.0, "wear_growth": growth})


def wear_law(
    speed: float,
    taylor: float,
    wear_criterion: float,
    feed_exponent: float = FEED_EXPONENT,
    entering_sine: float = 1.0,
) -> PowerLaw:
    """Return the law of wear whose edge is worn out after ``LIFE`` at a speed.

    The speed [m/min] is that at the reference feed and depth. From V f^x ap^y T^n = constant and
    W = c V^a f^b ap^d T^g follow a = g / n, b = a x and d = a y.
    """
    by_speed = WEAR_EXPONENT / taylor
    by_feed = by_speed * feed_exponent
    log_coefficient = (
        math.log(wear_criterion)
        - by_speed * math.log(speed)
        - by_feed * math.log(REFERENCE_FEED)
        - WEAR_EXPONENT * math.log(start_values.LIFE)
        + (by_feed - by_speed * DEPTH_EXPONENT) * math.log(entering_sine)
    )
    return PowerLaw(
        coefficient=math.exp(log_coefficient),
        cutting_speed=by_speed,
        feed=by_feed,
        depth_of_cut=by_speed * DEPTH_EXPONENT,
        reference_depth_of_cut=REFERENCE_DEPTH,
        time=WEAR_EXPONENT,
        hardness=by_speed * SPEED_EXPONENT,
    )


def catalogue_evidence(
    material: Material,
    group: Group,
    start: Start,
    *,
    feeds: tuple[float, float],
    depths: tuple[float, float],
) -> dict[str, LawEvidence]:
    """Return the evidence for the laws: the width of their sources, and where these hold.

    Args:
        material: the laws.
        group: the material's group.
        start: the start value.
        feeds: lowest and highest feed of the insert [mm/rev].
        depths: smallest and largest depth of cut of the insert [mm].
    """
    window = {"feed": feeds, "depth_of_cut": depths}
    by_speed = {"cutting_speed": (start.speeds.low, start.speeds.high)}
    thrust_deviation = math.hypot(group.force_deviation, thrust.share_of(group).deviation)
    return {
        "wear": _wear_evidence(material.wear, start, measured=window | by_speed),
        "thrust_force": _load_evidence(
            material.thrust_force,
            thrust_deviation,
            scatter=TYPICAL_EDGE_SPREAD["thrust_force"],
            measured=window,
        ),
        "power": _load_evidence(
            material.power,
            group.force_deviation,
            scatter=TYPICAL_EDGE_SPREAD["power"],
            measured=window,
        ),
    }


def _wear_evidence(
    law: PowerLaw, start: Start, measured: dict[str, tuple[float, float]]
) -> LawEvidence:
    """Return the evidence for the law of wear.

    Its level is known at the start value; from there, its exponents of speed and feed turn it.
    """
    deviations = np.array(
        (
            law.cutting_speed * start.deviation,
            law.cutting_speed * TAYLOR_DEVIATION,
            law.cutting_speed * FEED_EXPONENT_DEVIATION,
        )
    )
    # The coefficient's logarithm is the level less the exponents times the pivot's logarithms.
    turned = np.eye(3)
    turned[0, 1] = -math.log(start.speed)
    turned[0, 2] = -math.log(REFERENCE_FEED)
    covariance = turned @ np.diag(deviations**2) @ turned.T
    return LawEvidence(
        coefficient=law.coefficient,
        terms=("cutting_speed", "feed"),
        covariance=tuple(tuple(row) for row in covariance.tolist()),
        degrees=MANY,
        scatter=0.0,
        measured=measured,
        origin="catalogue",
    )


def _load_evidence(
    law: PowerLaw, deviation: float, scatter: float, measured: dict[str, tuple[float, float]]
) -> LawEvidence:
    """Return the evidence for a law of force or power, by kc1.1 and mc."""
    return LawEvidence(
        coefficient=law.coefficient,
        terms=("feed",),
        covariance=((deviation**2, 0.0), (0.0, EXPONENT_DEVIATION**2)),
        degrees=MANY,
        scatter=scatter,
        measured=measured,
        origin="catalogue",
    )
