"""One law of hardness for force, power and life, and hardness in HB and HRC.

Within an alloy, kc1.1 grows as HB^0.25 and the cutting speed for the same life falls as HB^-0.7.
The groups of ``groups.py`` and ``start_values.py`` that are the same alloys in another state, such
as P6 annealed and P9 quenched and tempered, follow the same law.
"""

import re

import numpy as np
from turning_shop import WorkshopError

FORCE_EXPONENT = 0.25
"""Exponent of hardness in kc1.1, and thus in force and power [-].

The median over ISCAR's eleven pairs of groups of the same alloy, P2 and P3 to S33 and S34, which
have 0 to 0.52. 4340 of 35 and 45 HRC (Chinchanikar) has 0.6.
"""
SPEED_EXPONENT = 0.7
"""Exponent of 1 / hardness in the cutting speed for the same life [-].

Ingersoll catalogue 2011, p. 1353: alloy steel 0.69 to 1.17 from 200 to 300, 350 and 400 HB,
martensitic stainless steel 0.63 to 0.73, carbon steel 0.43. Sumitomo's rows of alloy and of hard
steel differ by less; this is the safer side.
"""
MAX_OF_CARBIDE = 430.0
"""Brinell hardness above which steel is turned with CBN or ceramics, about 45 HRC [HB]."""

# ISO 18265, table A.1, and ASTM E140 above 45 HRC: unalloyed and low-alloy steel.
_HRC = (20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 55.0, 60.0, 65.0)
_HB = (226.0, 253.0, 286.0, 327.0, 371.0, 421.0, 481.0, 560.0, 654.0, 739.0)


def brinell(text: str) -> float:
    """Return the Brinell hardness of text such as 300HB or 32HRC.

    Raises:
        WorkshopError: It is neither.
    """
    match = re.fullmatch(r"(\d+(?:\.\d+)?)\s*(HBW?|HRC)", text.strip().upper())
    if not match:
        raise WorkshopError(f"--hardness {text}: give a hardness such as 300HB or 32HRC")
    value = float(match[1])
    if match[2] == "HRC":
        if not _HRC[0] <= value <= _HRC[-1]:
            raise WorkshopError(f"--hardness {text}: HRC is read from 20 to 65; give HB")
        return float(np.interp(value, _HRC, _HB))
    if not 20.0 <= value <= 750.0:
        raise WorkshopError(f"--hardness {text}: HB is read from 20 to 750")
    return value


def ratio(text: str, nominal: float) -> float:
    """Return the hardness of text over a nominal one [-].

    Args:
        text: the ratio, or a hardness such as 300HB or 32HRC.
        nominal: hardness [HB]; 0 if it is unknown.

    Raises:
        WorkshopError: The text is no hardness, or in HB or HRC with the nominal one unknown.
    """
    if re.fullmatch(r"\d*\.?\d+", text):
        return float(text)
    hardness = brinell(text)
    if not nominal:
        raise WorkshopError(
            f"--hardness {text}: no file states the hardness of the bar: give it over the nominal "
            "one, such as 1.1"
        )
    return hardness / nominal
