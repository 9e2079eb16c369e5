"""Chip breakers of makers, and the windows of feed and depth in which their chips break.

A maker's name of a breaker says for which cuts it is made, but each maker in another way: Sandvik's
PF and Kennametal's FN are for finishing. So names are looked up, never parsed. A name that is not
in the table is unknown, and gets a narrower window.

Windows are stated for negative inserts with an inscribed circle of 12.7 mm and a nose radius of
0.8 mm. ``scaled_window`` scales them to an insert.
"""

import math
from typing import NamedTuple

from turning_shop.catalogue import Range


class Window(NamedTuple):
    """The cuts for which a chip breaker is made."""

    name: str
    feed: Range  # [mm/rev]
    depth: Range  # [mm]
    source: str
    wiper: bool = False  # whether the nose smooths the surface


_SUMITOMO = "Sumitomo general catalogue 2019-2020, p. 13"
_KYOCERA = "Kyocera catalogue 2016-2017, p. 214"
_A014 = "Mitsubishi catalogue 2020-2021, p. A014"

FINISHING = Window("finishing", Range(0.1, 0.25, 0.4), Range(0.5, 1.0, 1.5), f"{_SUMITOMO}, FE")
MEDIUM = Window("medium cuts", Range(0.2, 0.35, 0.5), Range(1.0, 2.5, 4.0), f"{_SUMITOMO}, GU")
ROUGHING = Window("roughing", Range(0.3, 0.45, 0.6), Range(1.5, 4.0, 6.0), f"{_SUMITOMO}, MU")
UNKNOWN = Window(
    "an unknown chip breaker",
    Range(0.15, 0.25, 0.35),
    Range(0.75, 1.5, 3.0),
    "assumption: between finishing and medium cuts",
)
FLAT = Window(
    "a flat rake without chip breaker",
    Range(0.1, 0.25, 0.4),
    Range(0.5, 2.0, 4.0),
    "Sumitomo general catalogue 2019-2020, p. 16, cast iron",
)
_FINE = Window("fine finishing", Range(0.05, 0.15, 0.25), Range(0.2, 0.6, 1.0), f"{_SUMITOMO}, FB")
_ALUMINIUM = Window(
    "aluminium",
    Range(0.1, 0.2, 0.4),
    Range(0.5, 1.5, 4.0),
    "Kyocera catalogue 2021-2022, p. B14, AH",
)


_FINISHING_WIPER = FINISHING._replace(name="finishing with a wiper", wiper=True)
_MEDIUM_WIPER = MEDIUM._replace(name="medium cuts with a wiper", wiper=True)

# Maker, its breakers, and the window of their class. Classes are those that makers' product pages
# state, as known in the trade, not read from each catalogue; windows are Sumitomo's of the class.
_CLASSES = (
    ("Sandvik", "PF MF KF QF XF SF LC", FINISHING),
    ("Sandvik", "PM MM KM QM XM SM SMC LM", MEDIUM),
    ("Sandvik", "PR MR KR QR HR XMR MRR SR SMR", ROUGHING),
    ("Sandvik", "WF WL", _FINISHING_WIPER),
    ("Sandvik", "WM WMX WR", _MEDIUM_WIPER),
    ("ISCAR", "F3P F3M F3S SF NF TF", FINISHING),
    ("ISCAR", "M3P M3M M3S GN PP", MEDIUM),
    ("ISCAR", "R3P R3M NR HM", ROUGHING),
    ("ISCAR", "WF", _FINISHING_WIPER),
    ("ISCAR", "WG", _MEDIUM_WIPER),
    ("Kennametal", "FF FN FP FS FV LF K UF", FINISHING),
    ("Kennametal", "MN MP MV MS P MG UP", MEDIUM),
    ("Kennametal", "RN RP RM RH", ROUGHING),
    ("Kennametal", "FW", _FINISHING_WIPER),
    ("Kennametal", "MW", _MEDIUM_WIPER),
    ("Walter", "FP5 FM5 FK5 NF4", FINISHING),
    ("Walter", "MP3 MP5 MM5 MK5 MS3 NM4 NM6", MEDIUM),
    ("Walter", "RP5 RP7 RM5 RK5 RK7 NR4", ROUGHING),
    ("Seco", "FF1 FF2 MF1 MF2", FINISHING),
    ("Seco", "M3 M5 MF3 MF4 MF5", MEDIUM),
    ("Seco", "M6 MR6 MR7 R4 R5 R7", ROUGHING),
    ("Mitsubishi", "MP MA MM GM GK MK MH", MEDIUM),
    ("Mitsubishi", "RP RM RK GH", ROUGHING),
    ("Korloy, Lamina and others", "AL AK AR HA NS", _ALUMINIUM),
    ("Sumitomo", "FB", _FINE),
    ("Sumitomo", "FE FL SU SE SX LU FP FC", FINISHING),
    ("Sumitomo", "GU GE UX GZ UZ", MEDIUM),
    ("Sumitomo", "MU ME MX", ROUGHING),
)
# Breakers whose own window a maker states.
_KYOCERA_FINE = Window("finishing", Range(0.08, 0.15, 0.2), Range(0.5, 1.0, 1.5), _KYOCERA)
_KYOCERA_MEDIUM = Window("medium cuts", Range(0.1, 0.2, 0.4), Range(1.0, 2.0, 3.0), _KYOCERA)
_LIGHT = Window("light cuts", Range(0.1, 0.25, 0.4), Range(0.3, 1.0, 2.0), _A014)
_LIGHT_MILD = Window("light cuts", Range(0.18, 0.25, 0.33), Range(0.5, 0.8, 1.2), _A014)
_FINE_MILD = Window("finishing", Range(0.1, 0.18, 0.25), Range(0.2, 0.5, 0.8), _A014)
_STATED = (
    ("Kyocera", "PQ MQ", _KYOCERA_FINE),
    ("Kyocera", "MS", _KYOCERA_MEDIUM),
    ("Mitsubishi", "FY", _FINE_MILD),
    ("Mitsubishi", "SY", _LIGHT_MILD),
    ("Mitsubishi", "LP", _LIGHT),
)


class Breaker(NamedTuple):
    """A breaker as one maker or more name it."""

    makers: str
    window: Window


def _by_name() -> dict[str, Breaker]:
    """Return all breakers. A name of several makers gets the window with the lowest feeds."""
    breakers: dict[str, Breaker] = {}
    for maker, names, window in _CLASSES + _STATED:
        for name in names.split():
            other = breakers.get(name)
            if other is None:
                breakers[name] = Breaker(maker, window)
                continue
            safer = min(other.window, window, key=lambda each: each.feed.high)
            breakers[name] = Breaker(f"{other.makers}, {maker}", safer)
    return breakers


BREAKERS = _by_name()
"""Breakers by their letters on the box."""

REFERENCE_CIRCLE = 12.7  # inscribed circle of the inserts for which windows are stated [mm]
REFERENCE_RADIUS = 0.8  # their nose radius [mm]
POSITIVE_SHARE = 0.7
"""Feeds of positive inserts over those of negative ones [-].

Kyocera's medium cuts are 0.1 to 0.2 mm/rev and 0.5 to 2 mm deep with small positive inserts of 0.4
mm radius (2021-2022, p. 301), and 0.2 to 0.4 mm/rev and 1 to 3 mm with negative ones of 0.8 mm.
"""


def scaled_window(window: Window, circle: float, nose_radius: float, is_positive: bool) -> Window:
    """Return a window for an insert of another size, nose radius and clearance.

    Depths are in proportion to the inscribed circle. Feeds fall with the root of a nose radius
    below the reference, and in positive inserts (assumption, from Kyocera's rows).
    """
    sharpness = min(1.0, math.sqrt(nose_radius / REFERENCE_RADIUS))
    by_feed = sharpness * (POSITIVE_SHARE if is_positive else 1.0)
    by_depth = circle / REFERENCE_CIRCLE
    return window._replace(
        feed=_scaled(window.feed, by_feed), depth=_scaled(window.depth, by_depth)
    )


def _scaled(values: Range, factor: float) -> Range:
    """Return a range in which all values are multiplied by a factor."""
    low, usual, high = (round(factor * value, 3) for value in values)
    return Range(low, usual, high)
