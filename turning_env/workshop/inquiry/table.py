"""What-if tables as text, JSON and CSV."""

import csv
import io
import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from turning_env.workshop.inquiry.whatif import Cuts

_SHOWN = {
    "cutting_speed": ("speed", "m/min", "g", 1),
    "feed": ("feed", "mm/rev", "g", 1),
    "depth_of_cut": ("depth", "mm", "g", 1),
    "hardness": ("hardness", "-", "g", 1),
    "time": ("time", "min", ".2f", 1),
    "wear": ("wear", "mm", ".3f", 1),
    "wear_share": ("of limit", "%", ".0f", 100),
    "thrust_force": ("force", "N", ".0f", 1),
    "thrust_force_share": ("of limit", "%", ".0f", 100),
    "power": ("power", "kW", ".2f", 1),
    "power_share": ("of limit", "%", ".0f", 100),
    "tool_life": ("tool life", "min", ".1f", 1),
    "removal_rate": ("removal", "cm3/min", ".1f", 1),
    "spindle_speed": ("spindle", "rev/min", ".0f", 1),
}
"""Heading, unit, format and factor of each column of the text."""


def records(cuts: Cuts) -> Iterator[dict[str, Any]]:
    """One record per cut; what is too long to be a number is None."""
    columns = {name: values.ravel() for name, values in cuts._asdict().items()}
    within = cuts.within_limits.ravel()
    for index in range(len(within)):
        numbers = {name: float(values[index]) for name, values in columns.items()}
        yield {name: value if np.isfinite(value) else None for name, value in numbers.items()} | {
            "within_limits": bool(within[index])
        }


def as_json(cuts: Cuts) -> str:
    """A list of records."""
    return json.dumps(list(records(cuts)), indent=1, allow_nan=False)


def as_csv(cuts: Cuts) -> str:
    """A header and one line per cut; the units are those of ``Cuts``."""
    text = io.StringIO()
    writer = csv.DictWriter(text, [*Cuts._fields, "within_limits"], lineterminator="\n")
    writer.writeheader()
    writer.writerows(records(cuts))
    return text.getvalue().removesuffix("\n")


def as_text(cuts: Cuts) -> str:
    """A table with units; a last column names what is beyond its limit."""
    over = {"wear": cuts.wear_share, "force": cuts.thrust_force_share, "power": cuts.power_share}
    beyond = [
        ", ".join(name for name, share in zip(over, shares, strict=True) if share > 1)
        for shares in np.stack([share.ravel() for share in over.values()], axis=1)
    ]
    columns = []
    for name, (heading, unit, shape, factor) in _SHOWN.items():
        cells = [heading, unit, *(format(factor * value, shape) for value in getattr(cuts, name).ravel())]
        width = max(map(len, cells))
        columns.append([cell.rjust(width) for cell in cells])
    columns.append(["  beyond", "", *(f"  {names}" for names in beyond)])
    return "\n".join(" ".join(cells).rstrip() for cells in zip(*columns, strict=True))
