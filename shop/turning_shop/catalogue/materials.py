"""Find the material group of a material by its group, number or name.

Sources: names that stand for one another: Xometry, "Steel grades: cross-reference table of
designation standards"; AIMS Industrial, "Material cross reference chart"; Rewon, "International
cross references", table 17-5 (JIS and SAE). Groups: VDI 3323 by alloy, in the usual state of
delivery, which is annealed for alloyed steel.
"""

import re
from typing import NamedTuple

from turning_shop import WorkshopError
from turning_shop.catalogue import nearest
from turning_shop.catalogue.groups import GROUPS, STATES, Group

SOURCE = "cross-reference tables of Xometry, AIMS Industrial and Rewon; groups as in VDI 3323"


class NamedMaterial(NamedTuple):
    """A material and its group."""

    name: str  # as the user wrote it, or the first of its names
    group: Group
    number: str = ""  # EN 10027-2 or UNS

    @property
    def described(self) -> str:
        """The material and its group, for people."""
        group = self.group
        state = f"{group.name}, {group.description}, about {group.hardness:.0f} HB"
        if self.name == group.name:
            return state
        number = f" ({self.number})" if self.number and self.number != self.name else ""
        return f"{self.name}{number} is {state}"


# Group, number, and names of EN or DIN, AISI, SAE or UNS, and JIS. A word of everyday use has no
# number; it stands for the usual alloy (assumption).
_MATERIALS = """
P1 1.0037 S235JR St37-2 St37 SS400 A36 A283
P1 1.0577 S355J2 S355 St52-3 St52 A572
P1 1.0401 C15 1015 S15C
P1 1.1141 C15E Ck15 1016
P1 1.0402 C22 1020 1018 S20C
P1 1.0715 11SMn30 9SMn28 1213 1215 SUM22
P1 1.0718 11SMnPb30 9SMnPb28 12L14 12L13 SUM24L
P2 1.0501 C35 1035 S35C
P2 1.0503 C45 1045 S45C
P2 1.1191 C45E Ck45 1042 S48C
P2 1.0726 35S20 1140
P4 1.0601 C60 1060 S58C
P4 1.1221 C60E Ck60 1064
P4 1.1248 C75S Ck75 1075 1078
P6 1.7225 42CrMo4 4140 4142 SCM440 EN19 708M40 709M40
P6 1.7220 34CrMo4 4135 4137 SCM435
P6 1.7218 25CrMo4 4130 SCM430
P6 1.7035 41Cr4 5140 SCr440
P6 1.7131 16MnCr5 5115
P6 1.7147 20MnCr5 5120 SMnC420
P6 1.6582 34CrNiMo6 4340 SNCM447
P6 1.6580 30CrNiMo8 SNCM431
P6 1.6587 18CrNiMo7-6 4820
P6 1.6523 20NiCrMo2-2 20NiCrMo2 8620 SNCM220
P6 1.3505 100Cr6 52100 SUJ2
P6 1.8159 51CrV4 50CrV4 6150 SUP10
P10 1.2344 X40CrMoV5-1 H13 SKD61
P10 1.2343 X37CrMoV5-1 H11 SKD6
P10 1.2379 X153CrMoV12 D2 SKD11
P10 1.2080 X210Cr12 D3 SKD1
P10 1.2842 90MnCrV8 O2
P10 1.3343 HS6-5-2 M2 SKH51
P12 1.4016 X6Cr17 430 SUS430
P12 1.4104 X14CrMoS17 430F SUS430F
P12 1.4006 X12Cr13 410 SUS410
P12 1.4005 X12CrS13 416 SUS416
P12 1.4021 X20Cr13 420 SUS420J1
P12 1.4034 X46Cr13 SUS420J2
P12 1.4057 X17CrNi16-2 431 SUS431
M14 1.4301 X5CrNi18-10 304 SUS304 V2A
M14 1.4307 X2CrNi18-9 304L SUS304L
M14 1.4305 X8CrNiS18-9 303 SUS303
M14 1.4401 X5CrNiMo17-12-2 316 SUS316 V4A
M14 1.4404 X2CrNiMo17-12-2 316L SUS316L
M14 1.4541 X6CrNiTi18-10 321 SUS321
M14 1.4571 X6CrNiMoTi17-12-2 316Ti
M14 1.4539 X1NiCrMoCu25-20-5 904L
M14D 1.4462 X2CrNiMoN22-5-3 2205 318LN SUS329J3L S32205
M14D 1.4362 X2CrNiN23-4 2304 S32304
M14D 1.4410 X2CrNiMoN25-7-4 2507 S32750
M14P 1.4542 X5CrNiCuNb16-4 17-4PH 630 SUS630
K15 0.6015 GG15 EN-GJL-150 GJL-150 FC150
K15 0.6020 GG20 EN-GJL-200 GJL-200 FC200 FC20
K15 0.6025 GG25 EN-GJL-250 GJL-250 FC250 CLASS35
K16 0.6030 GG30 EN-GJL-300 GJL-300 FC300 CLASS45
K16 0.6035 GG35 EN-GJL-350 GJL-350 FC350 CLASS50
K17 0.7040 GGG40 EN-GJS-400-15 GJS-400-15 FCD400 60-40-18
K18 0.7050 GGG50 EN-GJS-500-7 GJS-500-7 FCD500 65-45-12
K18 0.7060 GGG60 EN-GJS-600-3 GJS-600-3 FCD600 80-55-06
K18 0.7070 GGG70 EN-GJS-700-2 GJS-700-2 FCD700 100-70-03
N21 3.3535 AlMg3 5754 EN-AW-5754
N21 3.3547 AlMg4.5Mn 5083 EN-AW-5083
N22 3.3211 AlMg1SiCu 6061 EN-AW-6061
N22 3.2315 AlMgSi1 6082 EN-AW-6082
N22 3.3206 AlMgSi0.5 6060 6063 EN-AW-6060
N22 3.1325 AlCuMg1 2017 EN-AW-2017
N22 3.1355 AlCuMg2 2024 EN-AW-2024
N22 3.1645 AlCuMgPb 2007 2011 EN-AW-2007
N22 3.4365 AlZnMgCu1.5 7075 EN-AW-7075
N24 3.2381 G-AlSi10Mg AlSi10Mg A360
N24 3.2371 G-AlSi7Mg AlSi7Mg A356
N25 3.2581 G-AlSi12 AlSi12 A413
N26 2.0401 CuZn39Pb3 Ms58 C38500 C36000
N27 2.0321 CuZn37 Ms63 C27200
N28 2.0060 E-Cu57 Cu-ETP C11000
N28 2.1020 CuSn6 C51900
S31 1.4980 X6NiCrTiMoVB25-15-2 A286 S66286
S33 2.4856 NiCr22Mo9Nb Inconel625 625 N06625
S34 2.4668 NiCr19NbMo Inconel718 718 N07718
S36 3.7035 Titanium-Grade-2 Ti2 R50400
P1 - mildsteel
M14 - stainless stainlesssteel
K15 - castiron greyiron
N22 - aluminium aluminum
N27 - brass Messing
N28 - bronze copper
S34 - Inconel
S37 - titanium
S37 3.7165 TiAl6V4 Ti-6Al-4V Ti6Al4V Ti64 Titanium-Grade-5 R56400
"""


def _plain(name: str) -> str:
    """Return a name without what people write differently: case, blanks, hyphens."""
    return re.sub(r"[\s_-]", "", name).upper()


def _by_name() -> dict[str, NamedMaterial]:
    """Return all materials by their plain names and numbers."""
    materials = {}
    for line in _MATERIALS.strip().splitlines():
        group, number, *names = line.split()
        has_number = number != "-"
        material = NamedMaterial(names[0], GROUPS[group], number if has_number else "")
        for name in (number, *names) if has_number else names:
            materials[_plain(name)] = material
    return materials


_BY_NAME = _by_name()
# States of delivery of EN 10027-1, as in 42CrMo4+QT.
_STATE = re.compile(r"(.+)\+[A-Z]+")
_PREFIXES = ("AISI", "SAE", "ASTM", "UNS", "JIS", "DIN", "EN", "W.NR.", "WNR", "AL", "AA")


def find_material(text: str) -> NamedMaterial:
    """Return the material of a group, a number or a name.

    Raises:
        WorkshopError: It is unknown; the message says what is near.
    """
    plain = _plain(text)
    if plain in GROUPS:
        return NamedMaterial(plain, GROUPS[plain])
    for prefix in ("", *_PREFIXES):
        if material := _BY_NAME.get(plain.removeprefix(prefix)):
            return material._replace(name=text.strip())
    if state := _STATE.fullmatch(plain):
        group = find_material(state[1]).group
        raise WorkshopError(
            f"--material {text}: states of delivery are not in the table: leave out the state, and "
            f"give --hardness, such as 300HB; annealed it is {group.name}{_harder(group)}"
        )
    raise WorkshopError(f"--material {text}: {_what_is_near(plain)}")


def _harder(group: Group) -> str:
    """Return the groups of a group's alloys in another state, for people, or nothing."""
    states = other_states(group)
    return f", {states}" if states else ""


def other_states(group: Group) -> str:
    """Return the groups of an annealed group's alloys as hardened, for people; empty if none."""
    for annealed, *harder in STATES:
        if group.name == annealed:
            names = " or ".join(f"{name} ({GROUPS[name].hardness:g} HB)" for name in harder)
            return f"quenched and tempered it is {names}"
    return ""


def _what_is_near(plain: str) -> str:
    """Return what an unknown material may have been meant to be."""
    if re.fullmatch(r"[PMKNSH]\d*", plain):
        if plain[0] == "H":
            return "hardened materials have no start values here: measure a cut, and use calibrate"
        names = [name for name in GROUPS if name[0] == plain[0]]
        return f"the groups of VDI 3323 with this letter are {', '.join(names)}"
    near = nearest(plain, _BY_NAME)
    meant = f"did you mean {near}? Or give" if near else "give"
    return (
        f"this material is not in the table; {meant} "
        "its group of VDI 3323, as in catalogues of inserts: P1 to P13 steel, M14 "
        "austenitic, M14D duplex and M14P precipitation hardening stainless, K15 to K20 cast "
        "iron, N21 to N28 aluminium and copper, S31 to S37 heat-resistant alloys and titanium"
    )
