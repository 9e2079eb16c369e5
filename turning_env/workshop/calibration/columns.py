"""The columns of a table of measurements, and which of them each law takes."""

from typing import NamedTuple


class Column(NamedTuple):
    """What may stand in a column."""

    unit: str
    low: float
    high: float
    """Both: the range that is believed, ends included; what lies outside is most likely given in another unit."""
    meaning: str


COLUMNS = {
    "cutting_speed": Column("m/min", 0.1, 5000, "cutting speed"),
    "feed": Column("mm/rev", 0.001, 10, "feed"),
    "depth_of_cut": Column("mm", 0.01, 50, "depth of cut"),
    "time": Column("min", 1e-4, 1e5, "time for which a fresh edge has cut at this speed, feed and depth"),
    "wear": Column("mm", 1e-4, 5, "flank wear of the edge, accumulated since it was fresh"),
    "thrust_force": Column("N", 1e-3, 1e6, "thrust force"),
    "power": Column("kW", 1e-4, 1e4, "spindle power"),
    "hardness": Column("-", 0.1, 10, "hardness of the bar over nominal hardness: 1 is nominal"),
}
"""Every column that is understood."""

EDGE = "edge"
"""A further column, of text: which edge was read. It may be missing, and cells may be empty: edges of their own."""

REQUIRED = ("cutting_speed", "feed", "depth_of_cut")
"""Columns without which no law can be fitted."""

FACTORS = {
    "wear": ("cutting_speed", "feed", "depth_of_cut", "time", "hardness"),
    "thrust_force": ("cutting_speed", "feed", "depth_of_cut", "wear", "hardness"),
    "power": ("cutting_speed", "feed", "depth_of_cut", "wear", "hardness"),
}
"""The factors of each law, named as in ``turning_env.PowerLaw``; a law is called after the column that it predicts."""


class CalibrationError(ValueError):
    """Laws cannot be fitted to these measurements. The message says what is wrong and what is needed."""


class MeasurementError(CalibrationError):
    """A table of measurements that cannot be read. The message names file, line, column and value, and what is allowed."""
