"""The material groups of VDI 3323, with the specific cutting force of each.

The cutting force of an edge at right angles to the feed is kc1.1 ap f^(1 - mc) (Kienzle), with
kc1.1 [N/mm2], the depth of cut ap [mm] and the feed f [mm/rev]. Source of hardness, kc1.1 and mc:
ISCAR, turning tools catalogue 2017, p. 558. Its catalogue of 2022 agrees but for titanium, where
the geometric mean of both is taken. The kc1.1 of duplex steel follows from M14 by ``hardness.py``;
the hardness of titanium is that of handbooks.
"""

import math
from typing import NamedTuple

from turning_shop.catalogue.hardness import FORCE_EXPONENT

SOURCE = "ISCAR catalogues 2017, p. 558, and 2022"
FORCE_DEVIATION = 0.2
"""Log standard deviation of kc1.1 [-].

That of nine public sets of steel about the groups' values: shop/docs/measured_data.md. The values
for 42CrMo4 of ISCAR (1775 N/mm2) and Röhm RN-1391 (2526 N/mm2) differ by 0.35, those for titanium
of ISCAR's two catalogues by 0.53.
"""
LIGHT_METAL_DEVIATION = 0.3
"""Log standard deviation of kc1.1 of group N [-].

Cuts of 6351-T6 took 0.60 to 0.72 of the power of its group: the higher value is the safer one.
"""
EXPONENT_DEVIATION = 0.045
"""Standard deviation of mc [-] (assumption: as that of the family ``shop``)."""

_MODULI_BY_LETTER = {"P": 210e3, "M": 200e3, "K": 170e3, "N": 70e3, "S": 200e3}
_MODULI = {
    **dict.fromkeys(("K15", "K16"), 110e3),
    **dict.fromkeys(("N26", "N27"), 100e3),
    "N28": 115e3,
    **dict.fromkeys(("S36", "S37"), 110e3),
}
"""Moduli of elasticity [N/mm2].

Handbooks: steel 210, austenitic and duplex steel 200, nodular and malleable iron 170, grey iron
110, aluminium 70, brass 100, bronze and copper 115, alloys of iron, nickel or cobalt 200 and more,
titanium 110 kN/mm2.
"""


class Group(NamedTuple):
    """A group of VDI 3323."""

    name: str  # letter of ISO 513 and number of VDI 3323
    description: str
    hardness: float  # Brinell hardness [HB]
    kc11: float  # specific cutting force at 1 mm2 [N/mm2]
    mc: float  # exponent of the chip's thickness [-]

    @property
    def letter(self) -> str:
        """Group of ISO 513: P, M, K, N, S or H."""
        return self.name[0]

    def at(self, hardness: float) -> "Group":
        """Return the group with another hardness of its alloys [HB]."""
        kc11 = self.kc11 * (hardness / self.hardness) ** FORCE_EXPONENT
        return self._replace(hardness=hardness, kc11=kc11)

    @property
    def modulus(self) -> float:
        """Modulus of elasticity [N/mm2]."""
        return _MODULI.get(self.name, _MODULI_BY_LETTER[self.letter])

    @property
    def force_deviation(self) -> float:
        """Log standard deviation of kc1.1 [-]."""
        return LIGHT_METAL_DEVIATION if self.letter == "N" else FORCE_DEVIATION


_ROWS = (
    ("P1", "non-alloy steel below 0.25 % C, annealed", 125, 1350, 0.21),
    ("P2", "non-alloy steel from 0.25 % C, annealed", 190, 1500, 0.22),
    ("P3", "non-alloy steel below 0.55 % C, quenched and tempered", 250, 1675, 0.24),
    ("P4", "non-alloy steel from 0.55 % C, annealed", 220, 1700, 0.24),
    ("P5", "non-alloy steel from 0.55 % C, quenched and tempered", 300, 1900, 0.24),
    ("P6", "low-alloy steel, annealed", 200, 1775, 0.24),
    ("P7", "low-alloy steel, quenched and tempered", 275, 1675, 0.24),
    ("P8", "low-alloy steel, quenched and tempered", 300, 1725, 0.24),
    ("P9", "low-alloy steel, quenched and tempered", 350, 1800, 0.24),
    ("P10", "high-alloy and tool steel, annealed", 200, 2450, 0.23),
    ("P11", "high-alloy and tool steel, quenched and tempered", 325, 2500, 0.23),
    ("P12", "stainless steel, ferritic or martensitic, annealed", 200, 1875, 0.21),
    ("P13", "stainless steel, martensitic, quenched and tempered", 240, 1875, 0.21),
    ("M14", "stainless steel, austenitic", 180, 2150, 0.20),
    ("M14D", "stainless steel, duplex", 260, 2360, 0.20),
    # As delivered, 277 HB (H1150) to 363 HB (solution annealed) by ASTM A564. The force is that of
    # P13 by the law of hardness.
    ("M14P", "stainless steel, precipitation hardening, as delivered", 330, 2030, 0.21),
    ("K15", "grey cast iron, ferritic or pearlitic", 180, 1150, 0.20),
    ("K16", "grey cast iron, pearlitic or martensitic", 260, 1350, 0.28),
    ("K17", "nodular cast iron, ferritic", 160, 1225, 0.25),
    ("K18", "nodular cast iron, pearlitic", 250, 1350, 0.28),
    ("K19", "malleable cast iron, ferritic", 130, 1225, 0.25),
    ("K20", "malleable cast iron, pearlitic", 230, 1420, 0.30),
    ("N21", "wrought aluminium alloy, not hardenable", 60, 700, 0.25),
    ("N22", "wrought aluminium alloy, hardened", 100, 800, 0.25),
    ("N23", "cast aluminium alloy up to 12 % Si, not hardenable", 75, 700, 0.25),
    ("N24", "cast aluminium alloy up to 12 % Si, hardened", 90, 700, 0.25),
    ("N25", "cast aluminium alloy above 12 % Si", 130, 750, 0.25),
    ("N26", "copper alloy, free cutting", 110, 700, 0.27),
    ("N27", "brass", 90, 700, 0.27),
    ("N28", "electrolytic copper, bronze", 100, 700, 0.27),
    ("S31", "heat-resistant alloy of iron, annealed", 200, 2600, 0.24),
    ("S32", "heat-resistant alloy of iron, hardened", 280, 3100, 0.24),
    ("S33", "heat-resistant alloy of nickel or cobalt, annealed", 250, 3300, 0.24),
    ("S34", "heat-resistant alloy of nickel or cobalt, hardened", 350, 3300, 0.24),
    ("S35", "heat-resistant alloy of nickel or cobalt, cast", 320, 3300, 0.24),
    ("S36", "titanium, pure, 400 N/mm2", 120, 1404, 0.235),
    ("S37", "titanium alloy, alpha and beta, 1050 N/mm2", 310, 1621, 0.23),
)
GROUPS = {row[0]: Group(*row) for row in _ROWS}
"""All groups with a specific cutting force and a start value, by name.

Hardened steel and chilled iron (H38 to H41) are left out: their tools are ceramics and CBN, for
which the sources have no start values.
"""

STATES = (
    ("P2", "P3"),
    ("P4", "P5"),
    ("P6", "P7", "P8", "P9"),
    ("P10", "P11"),
    ("P12", "P13"),
)
"""Groups of the same steels in other states: annealed, then quenched and tempered, ever harder."""


def softest(group: Group) -> Group:
    """Return the group of the same alloys as annealed."""
    for names in STATES:
        if group.name in names:
            return GROUPS[names[0]]
    return group


def with_hardness(group: Group, hardness: float) -> Group:
    """Return the group of the same alloys that is nearest to a hardness [HB], at that hardness."""
    names: tuple[str, ...] = (group.name,)
    for states in STATES:
        if group.name in states:
            names = states
    nearest = min(names, key=lambda name: abs(math.log(GROUPS[name].hardness / hardness)))
    return GROUPS[nearest].at(hardness)
