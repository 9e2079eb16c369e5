"""Published values for a cut that nobody has measured: material, insert, grade, and laws from them.

Every number names its source, and every law its width. Advice on them belongs in ``start.py``,
one folder up; laws from measured cuts in ``fit.py``.
"""

from collections.abc import Iterable
from difflib import get_close_matches
from typing import NamedTuple

UNMEASURED = "catalogue, not measured"


class Range(NamedTuple):
    """A range of a maker: the lowest, the usual and the highest value."""

    low: float
    usual: float
    high: float


def nearest(text: str, allowed: Iterable[str], count: int = 3) -> str:
    """Return the names that resemble a text, for an error message; empty if none does."""
    by_upper = {name.upper(): name for name in allowed}
    matches = get_close_matches(text.upper(), by_upper, n=count, cutoff=0.6)
    return ", ".join(by_upper[match] for match in matches)
