"""The share of the thrust force in the cutting force, by material, from public measurements.

The thrust force is the resultant of feed force and passive force. Its share in the cutting force
grows as the chip gets thinner and the nose takes more of the cut, in steel with t = 0.15:

    thrust / cutting force = share * (f / 0.3 mm/rev)^-t * (ap / 2 mm)^-t

``shop/examples/measured_sets.py papers`` computes shares and exponents of the public sets;
``shop/docs/measured_data.md`` lists them.
"""

from typing import NamedTuple

from turning_shop.catalogue.groups import Group

REFERENCE_FEED = 0.3  # at which shares are stated [mm/rev]
REFERENCE_DEPTH = 2.0  # [mm]
THINNING = 0.15
"""Exponent of feed and of depth by which the share falls [-].

The medians of ten public sets of turned steel are 0.16 for both; they differ by up to 0.4.
"""


class Share(NamedTuple):
    """Thrust force over cutting force at the reference feed and depth, with a fresh edge."""

    value: float  # [-]
    deviation: float  # log standard deviation [-]
    source: str
    thinning: float = THINNING  # exponent of feed and of depth by which it falls [-]


_STEEL = Share(
    0.70,
    0.15,
    "eight public sets of steel of 190 HB to 50 HRC: 0.63 to 0.77",
)
_LIKE_STEEL = Share(0.70, 0.25, "assumption: as steel, for no public set was found")
_ALUMINIUM = Share(
    0.18,
    0.4,
    "23 cuts of 6351-T6 (M. C. dos Santos Jr., livro-doe-usinagem) have about 0.11; 0.18 is the "
    "safer side, as no second public set was found",
    thinning=0.0,  # it does not depend on the feed in these cuts
)
_COPPER = Share(0.45, 0.3, "assumption: 0.25 to 0.8, for no public set was found")
_NICKEL = Share(
    0.58,
    0.25,
    "Pawade 2007, Inconel 718: the cutting force is two to three times each of feed and passive "
    "force",
)
_TITANIUM = Share(0.58, 0.3, "assumption: as nickel alloys, for no public set was found")

_BY_LETTER = {"P": _STEEL, "M": _LIKE_STEEL, "K": _LIKE_STEEL, "N": _ALUMINIUM, "S": _NICKEL}
_BY_GROUP = {
    **dict.fromkeys(("N26", "N27", "N28"), _COPPER),
    **dict.fromkeys(("S36", "S37"), _TITANIUM),
}


def share_of(group: Group) -> Share:
    """Return the share of thrust of a material group."""
    return _BY_GROUP.get(group.name, _BY_LETTER[group.letter])
