"""Start values: makers' cutting speeds for an edge's life of 15 minutes, by group and grade.

Makers state a lowest, a usual and a highest speed. The usual one is taken as that of a life of 15
minutes, as Dormer Pramet (2024, p. 76) states for its own; the other two as the ends of its 95 %
interval. Speeds at other feeds and depths follow from V f^0.35 ap^0.15 = constant.
"""

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from turning_shop import WorkshopError
from turning_shop.catalogue import Range
from turning_shop.catalogue.groups import GROUPS, Group, softest
from turning_shop.catalogue.hardness import SPEED_EXPONENT

LIFE = 15.0  # of the start values [min]
FEED_EXPONENT = 0.35
"""Exponent of feed in V f^x ap^y [-].

Handbook exponents of the adaptive part programming paper: T ~ V^-5 f^-1.75 ap^-0.75. DGI Supply's
catalogue has 0.33 to 0.66.
"""
FEED_EXPONENT_DEVIATION = 0.1  # (assumption, from the same range) [-]
DEPTH_EXPONENT = 0.15  # of depth of cut, from the same source [-]
TAYLOR_DEVIATION = 0.2
"""Log standard deviation of Taylor's n (assumption: as that of the family ``shop``) [-]."""
REFERENCE_FEED = 0.3  # at which start values are compared [mm/rev]
REFERENCE_DEPTH = 2.0  # [mm]


class StartValue(NamedTuple):
    """A maker's start value for one grade."""

    grade: int  # number of the application of ISO 513, such as 25 of P25
    speed: Range  # [m/min]
    feed: float  # [mm/rev]
    depth: float  # [mm]
    source: str
    interrupted: bool = False  # whether it is for interrupted cuts

    @property
    def described(self) -> str:
        """The source, with the feed and the depth at which it states the speed."""
        return f"{self.source}, at {self.feed:g} mm/rev and {self.depth:g} mm"

    @property
    def reference_speed(self) -> float:
        """The usual speed at the reference feed and depth [m/min]."""
        by_feed = (self.feed / REFERENCE_FEED) ** FEED_EXPONENT
        by_depth = (self.depth / REFERENCE_DEPTH) ** DEPTH_EXPONENT
        return float(self.speed.usual * by_feed * by_depth)


_SUMITOMO_STEEL = "Sumitomo general catalogue 2019-2020, p. 13"
_SUMITOMO_IRON = "Sumitomo general catalogue 2019-2020, p. 16"
_KYOCERA = "Kyocera catalogue 2016-2017, p. 214"
_DGI = "DGI Supply, recommended starting speeds for turning, p. 5, range over feeds"
_HANDBOOK = "Carvill, Mechanical Engineer's Data Handbook, p. 191"
_TITANIUM = "Machining Doctor, Ti-6Al-4V (70 to 90 m/min), and Kyocera 2021-2022, p. 301 (50 m/min)"
_RATIO = "times the ratio of ISCAR's milling speeds, catalogue 2022, IC808"

_MILD_STEEL = (
    StartValue(15, Range(260, 350, 440), 0.25, 1.0, _SUMITOMO_STEEL + ", AC8015P"),
    StartValue(25, Range(200, 260, 320), 0.35, 2.5, _SUMITOMO_STEEL + ", AC8025P"),
    StartValue(35, Range(140, 180, 220), 0.45, 4.0, _SUMITOMO_STEEL + ", AC8035P"),
)
_ALLOY_STEEL = (
    StartValue(15, Range(210, 285, 360), 0.25, 1.0, _SUMITOMO_STEEL + ", AC8015P"),
    StartValue(25, Range(150, 190, 230), 0.35, 2.5, _SUMITOMO_STEEL + ", AC8025P"),
    StartValue(35, Range(110, 135, 160), 0.45, 4.0, _SUMITOMO_STEEL + ", AC8035P"),
)
_STAINLESS = (
    StartValue(15, Range(120, 160, 200), 0.2, 2.0, _KYOCERA + ", CA6515, up to 220 HB"),
    StartValue(
        25,
        Range(80, 140, 180),
        0.3,
        2.0,
        _KYOCERA + ", CA6525, up to 220 HB, interrupted cuts",
        interrupted=True,
    ),
)
_DUPLEX = (
    StartValue(15, Range(100, 120, 150), 0.15, 1.5, _KYOCERA + ", CA6515, up to 300 HB"),
    StartValue(
        25,
        Range(80, 100, 120),
        0.15,
        2.0,
        _KYOCERA + ", CA6525, up to 300 HB, interrupted cuts",
        interrupted=True,
    ),
)
_GREY_IRON = (
    StartValue(10, Range(200, 400, 700), 0.25, 2.0, _SUMITOMO_IRON + ", AC4010K"),
    StartValue(15, Range(180, 300, 450), 0.3, 2.0, _SUMITOMO_IRON + ", AC4015K"),
    StartValue(20, Range(150, 200, 300), 0.3, 2.0, _SUMITOMO_IRON + ", AC420K"),
)
_FERRITIC_NODULAR = (StartValue(25, Range(149, 200, 270), 0.3, 2.0, _DGI + ", K325"),)
_PEARLITIC_NODULAR = (StartValue(25, Range(122, 149, 200), 0.3, 2.0, _DGI + ", K325"),)
# DGI Supply has 1100 to 2100 m/min for soft alloys such as 5050, Kyocera (2016-2017, p. 461) 200 to
# 500 for all aluminium: the safer row is that of 6061.
_ALUMINIUM = (StartValue(15, Range(200, 300, 500), 0.2, 2.0, _DGI + ", N425"),)
_SILICON_ALUMINIUM = (StartValue(15, Range(122, 200, 300), 0.2, 2.0, _DGI + ", N425"),)
_FREE_CUTTING_BRASS = (StartValue(15, Range(270, 320, 390), 0.2, 2.0, _DGI + ", N425"),)
# DGI Supply has 270 to 390 m/min for all copper alloys, Kyocera (2021-2022, p. 301) 100 to 200 for
# bars below 16 mm: the handbook is between them, and is the safer one for other than small bars.
_BRASS = (StartValue(15, Range(120, 240, 360), 0.2, 2.0, _HANDBOOK + ", brass, rough to fine"),)
_COPPER = (
    StartValue(
        15, Range(120, 200, 300), 0.2, 2.0, _HANDBOOK + ", bronze and copper, rough to fine"
    ),
)
_IRON_BASED = (StartValue(15, Range(70, 85, 101), 0.2, 2.0, _DGI + ", S515"),)
_NICKEL_BASED = (StartValue(15, Range(35, 46, 61), 0.2, 2.0, _DGI + ", S515"),)
_TITANIUM_ALLOY = (StartValue(15, Range(50, 70, 90), 0.2, 1.0, _TITANIUM),)


def _scaled(
    values: tuple[StartValue, ...], factor: float, reason: str = _RATIO
) -> tuple[StartValue, ...]:
    """Return the start values of a group from those of another."""
    scaled = []
    for value in values:
        speed = Range(*(factor * end for end in value.speed))
        source = f"{value.source}, {factor:.3g} {reason}"
        scaled.append(value._replace(speed=speed, source=source))
    return tuple(scaled)


def speed_factor(hardness: float, nominal: float) -> float:
    """Return the cutting speed for the same life at a hardness, over that at a nominal one [-]."""
    return float((nominal / hardness) ** SPEED_EXPONENT)


_ANNEALED = {
    "P1": _MILD_STEEL,
    **dict.fromkeys(("P2", "P4", "P6"), _ALLOY_STEEL),
    "P10": _scaled(_ALLOY_STEEL, 0.80),
    "P12": _scaled(_ALLOY_STEEL, 0.93),
    "M14": _STAINLESS,
    "M14D": _DUPLEX,
    "M14P": _scaled(
        # Kyocera's row is for all stainless steel of up to 300 HB.
        _DUPLEX,
        speed_factor(GROUPS["M14P"].hardness, nominal=300.0),
        "for 330 in place of 300 HB",
    ),
    **dict.fromkeys(("K15", "K16"), _GREY_IRON),
    "K17": _FERRITIC_NODULAR,
    "K18": _PEARLITIC_NODULAR,
    "K19": _scaled(_FERRITIC_NODULAR, 1.16),
    "K20": _scaled(_FERRITIC_NODULAR, 1.05),
    **dict.fromkeys(("N21", "N22", "N23", "N24"), _ALUMINIUM),
    "N25": _SILICON_ALUMINIUM,
    "N26": _FREE_CUTTING_BRASS,
    "N27": _BRASS,
    "N28": _COPPER,
    **dict.fromkeys(("S31", "S32"), _IRON_BASED),
    **dict.fromkeys(("S33", "S34", "S35"), _NICKEL_BASED),
    **dict.fromkeys(("S36", "S37"), _TITANIUM_ALLOY),
}


def _start_values() -> dict[str, tuple[StartValue, ...]]:
    """Return the start values of all groups: those of hardened steel follow the law of hardness."""
    values = dict(_ANNEALED)
    for name, group in GROUPS.items():
        if name in values:
            continue
        annealed = softest(group)
        factor = speed_factor(group.hardness, nominal=annealed.hardness)
        reason = f"for {group.hardness:g} in place of {annealed.hardness:g} HB"
        values[name] = _scaled(values[annealed.name], factor, reason)
    return values


START_VALUES = _start_values()
"""Start values of each group of VDI 3323, in the order of their grades."""
_FEEDS = {"M": (0.1, 0.4), "N": (0.1, 0.4), "S": (0.1, 0.3)}
_FEEDS_OF_GROUP = {"M14D": (0.1, 0.2), "M14P": (0.1, 0.2)}
FEEDS_SOURCE = "Kyocera 2016-2017, p. 214, for M; DGI Supply for N and S"


def feeds_of(group: Group) -> tuple[float, float] | None:
    """Return the lowest and highest feed for which makers have start values [mm/rev].

    It is None for groups whose feeds only the chip breaker bounds.
    """
    return _FEEDS_OF_GROUP.get(group.name, _FEEDS.get(group.letter))


class Grade(NamedTuple):
    """An application of ISO 513, such as P25."""

    letter: str
    number: int

    @property
    def name(self) -> str:
        """Its name."""
        return f"{self.letter}{self.number:02d}"


def read_grade(text: str) -> Grade:
    """Return the grade of a text.

    Raises:
        WorkshopError: It is no application of ISO 513.
    """
    plain = text.strip().upper()
    if re.fullmatch(r"[BCD][A-Z]-?[PMKNSH]\d\d", plain):
        raise WorkshopError(
            f"--grade {text}: B is CBN, C ceramics and D diamond, for which the sources have no "
            "start values: --start-speed states that of the box, with an application such as K20"
        )
    match = re.fullmatch(r"(?:H[CWTF]-?)?([PMKNSH])(\d\d)", plain)
    if not match or not 1 <= int(match[2]) <= 50:
        raise WorkshopError(
            f"--grade {text}: this is no application of ISO 513, such as P25 (P steel, "
            "M stainless, K cast iron, N aluminium, S heat-resistant; 01 hard to 50 tough). "
            "A maker's name, such as GC4325, is not read: the box and the catalogue state the "
            "application beside it"
        )
    return Grade(match[1], int(match[2]))


NEIGHBOURS = {"P": "M", "M": "PS", "K": "P", "N": "K", "S": "MK"}
"""Other applications of ISO 513 whose grades also cut a group, such as uncoated K10 aluminium."""


def check_grade(group: Group, grade: Grade) -> None:
    """Raise a WorkshopError if a grade is not for a group, so that its speed is unknown."""
    if grade.letter == group.letter or grade.letter in NEIGHBOURS[group.letter]:
        return
    advice = "--start-speed states that of the box"
    if grade.letter == "H":
        raise WorkshopError(
            f"--grade {grade.name} is made for hardened material, as CBN and ceramics are: their "
            f"speeds in {group.name} are not in the sources; {advice}"
        )
    raise WorkshopError(
        f"--grade {grade.name} is made for {grade.letter}, and not for {group.letter}: its speed "
        f"in {group.name} is not in the sources; {advice}"
    )


class Start(NamedTuple):
    """The start value of a group and a grade."""

    speeds: Range  # that the maker allows [m/min]
    speed: float  # for a life of ``LIFE`` at the reference feed and depth [m/min]
    deviation: float  # log standard deviation of this speed [-]
    sources: tuple[str, ...]
    assumptions: tuple[str, ...]
    interrupted: bool = False  # whether the maker states it for interrupted cuts


def start_of(group: Group, grade: Grade) -> Start:
    """Return the start value of a group and a grade, between those of the nearest grades."""
    values = START_VALUES[group.name]
    first = values[0]
    last = values[-1]
    if grade.number <= first.grade:
        below = above = first
    elif grade.number >= last.grade:
        below = above = last
    else:
        below = max(value for value in values if value.grade <= grade.number)
        above = min(value for value in values if value.grade >= grade.number)
    span = above.grade - below.grade
    share = (grade.number - below.grade) / span if span else 0.0
    factor = speed_factor(group.hardness, nominal=GROUPS[group.name].hardness)
    speeds = Range(
        low=factor * _between(below.speed.low, above.speed.low, share),
        usual=factor * _between(below.speed.usual, above.speed.usual, share),
        high=factor * _between(below.speed.high, above.speed.high, share),
    )
    sources = dict.fromkeys((below.described, above.described))
    return Start(
        speeds=speeds,
        speed=factor * _between(below.reference_speed, above.reference_speed, share),
        deviation=math.log(speeds.high / speeds.low) / (2 * 1.96),
        sources=tuple(sources),
        assumptions=tuple(_assumptions(group, grade, below=below, above=above)),
        interrupted=below.interrupted or above.interrupted,
    )


def stated_start(speed: float, feed: float, depth: float) -> Start:
    """Return the start value that a box of inserts states, at a feed and a depth of cut."""
    value = StartValue(0, Range(speed, speed, speed), feed, depth, source="")
    return Start(
        speeds=Range(0.75 * speed, speed, 1.25 * speed),
        speed=value.reference_speed,
        deviation=STATED_DEVIATION,
        sources=(f"--start-speed {speed:g} m/min, at {feed:g} mm/rev and {depth:g} mm",),
        assumptions=("the start speed that you state lasts 15 min, within 20 % of speed",),
    )


_DORMER = "Dormer Pramet 2024, p. 76"
CONDITIONS = {
    "interrupted": (0.80, _DORMER),
    "skin": (0.70, _DORMER),
    "unstable": (0.85, _DORMER),
    "dry": (0.80, "assumption: dry where the maker's speed is with coolant"),
}
"""Conditions of a cut: the cutting speed for the same life over that of a smooth one, and why."""


def for_conditions(start: Start, conditions: Sequence[str], group: Group) -> Start:
    """Return a start value for a cut that is not smooth, wet, clean and firm.

    A start value that the maker states for interrupted cuts needs no factor for them. Cast iron is
    usually cut dry.
    """
    sources = list(start.sources)
    factor = 1.0
    for condition in conditions:
        share, source = CONDITIONS[condition]
        if condition == "interrupted" and start.interrupted:
            sources.append("for interrupted cuts as the maker states it")
        elif condition == "dry" and group.letter == "K":
            sources.append("for dry cuts, as is usual in cast iron")
        else:
            factor *= share
            sources.append(f"times {share:g} for --cut {condition} ({source})")
    speeds = Range(*(factor * speed for speed in start.speeds))
    return start._replace(speeds=speeds, speed=factor * start.speed, sources=tuple(sources))


STATED_DEVIATION = 0.1
"""Log standard deviation of a start speed that the user states [-] (assumption)."""


def _between(low: float, high: float, share: float) -> float:
    """Return the number at a share of the way between two, in their logarithms."""
    return round(math.exp((1.0 - share) * math.log(low) + share * math.log(high)), 6)


def _assumptions(group: Group, grade: Grade, below: StartValue, above: StartValue) -> list[str]:
    """Return what is assumed if no start value is known of a grade, or of grades about as tough."""
    assumptions = []
    nearest = min(max(grade.number, below.grade), above.grade)
    if grade.letter != group.letter:
        assumptions.append(
            f"grade {grade.name} is made for {grade.letter}, not for {group.letter}: the start "
            f"value is that of {group.letter}{nearest}; --start-speed states that of the box"
        )
    elif not below.grade - 5 <= grade.number <= above.grade + 5:
        assumptions.append(
            f"no start value of {grade.name} is known: that of {group.letter}{nearest} is taken"
        )
    return assumptions
