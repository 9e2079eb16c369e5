"""Show numbers in metric or inch units.

All computing and all files are metric. Tables, maps and the page convert their columns and axes.
Sentences are written in metric units; ``Units.text`` rewrites the quantities in a finished one.
"""

import argparse
import re
from typing import NamedTuple

import numpy as np

_NUMBER = r"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?"


class Unit(NamedTuple):
    """A unit in which a quantity is shown."""

    name: str
    factor: float = 1.0  # over the metric unit
    decimals: int = 0  # further decimals than a metric number has


class Units:
    """A system of units."""

    def __init__(self, units: dict[str, Unit]) -> None:
        self._units = units
        # A longer unit first: mm/rev before mm.
        names = sorted(map(re.escape, units), key=len, reverse=True)
        self._quantity = re.compile(
            rf"(?<![\w.])(?:(?P<low>{_NUMBER})(?P<to> to |-))?(?P<value>{_NUMBER}) "
            rf"(?P<unit>{'|'.join(names)})(?![\w/])"
            rf"(?:(?P<between>(?: deep)? \()(?P<first>{_NUMBER}) to (?P<last>{_NUMBER})\))?"
        )

    @property
    def is_metric(self) -> bool:
        """Whether nothing is converted."""
        return not self._units

    def unit(self, metric: str) -> Unit:
        """Return the unit in which a metric one is shown."""
        return self._units.get(metric, Unit(metric))

    def name(self, metric: str) -> str:
        """Return the name of the unit in which a metric one is shown."""
        return self.unit(metric).name

    def cell(self, value: float, metric: str, form: str) -> str:
        """Return a number of a table, whose format is that of the metric number."""
        unit = self.unit(metric)
        if unit.factor == 1.0:
            return format(value, form)
        if form.endswith("f"):
            decimals = int(form[1:-1]) + unit.decimals
            return format(unit.factor * value, f".{decimals}f")
        return short(unit.factor * value)

    def text(self, sentence: str) -> str:
        """Return a sentence with its quantities in these units.

        A quantity is a number before its unit, or two with "to" or a hyphen between them; a range
        in brackets after it has the same unit.
        """
        return sentence if self.is_metric else self._quantity.sub(self._rewritten, sentence)

    def _rewritten(self, match: re.Match[str]) -> str:
        """Return a quantity of a sentence in these units; see ``text``."""
        unit = self.unit(match["unit"])

        def shown(group: str) -> str:
            number = float(match[group])
            return short(unit.factor * number)

        text = f"{shown('value')} {unit.name}"
        if match["low"]:
            text = f"{shown('low')}{match['to']}{text}"
        if match["between"]:
            ends = f"{shown('first')} to {shown('last')}"
            text += f"{match['between']}{ends})"
        return text


def short(value: float) -> str:
    """Return a number with three digits, or with all before the point, and no exponent."""
    if not np.isfinite(value) or value == 0.0:
        return f"{value:g}"
    if abs(value) >= 100.0:
        return f"{value:.0f}"
    power_of_ten = int(np.floor(np.log10(abs(value))))
    decimals = 2 - power_of_ten
    digits = f"{value:.{decimals}f}"
    return digits.rstrip("0").rstrip(".")


METRIC = Units({})
INCH = Units(
    {
        "m/min": Unit("SFM", 1.0 / 0.3048),
        "mm/rev": Unit("IPR", 1.0 / 25.4, decimals=1),
        "mm": Unit("in", 1.0 / 25.4, decimals=1),
        "um": Unit("uin", 1000.0 / 25.4),
        "N": Unit("lbf", 1.0 / 4.4482216),
        "kW": Unit("hp", 1.0 / 0.74569987),
        "cm3/min": Unit("in3/min", 1.0 / 16.387064, decimals=1),
        "cm3": Unit("in3", 1.0 / 16.387064, decimals=1),
        "N/mm2": Unit("ksi", 1.0 / 6.8947573),
        "1/mm": Unit("1/in", 25.4),
    }
)
SYSTEMS = {"metric": METRIC, "inch": INCH}
"""Systems of units by the names of ``--units``."""


def add_units(parser: argparse.ArgumentParser) -> None:
    """Add the option for the units of the output."""
    parser.add_argument(
        "--units",
        choices=tuple(SYSTEMS),
        default="metric",
        help=(
            "units of text, tables, maps and pages; inch: SFM, IPR, in, hp, lbf; "
            "options and JSON stay metric (default: %(default)s)"
        ),
    )
