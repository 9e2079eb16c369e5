"""State of a control between the blocks of its cycles, and the sides that they turn."""

from dataclasses import dataclass, field
from typing import NamedTuple

from turning_nc.passes import Repeating
from turning_nc.paths import Point


class ContourLines(NamedTuple):
    """Lines of a part of the program that describe a contour."""

    part: str
    first: int  # index of the first line
    end: int  # index of the line after the last


class ContourNames(NamedTuple):
    """Numbers of the first and the last block of a contour: P and Q of Fanuc's cycles."""

    first: float
    last: float


@dataclass(frozen=True)
class ThreadSettings:
    """Values that the first block of G76 sets for the second."""

    finishing: int  # number of finishing passes
    angle: float  # by which the tool goes in aslant: half the thread's angle [degrees]
    smallest: float  # least depth of a pass [mm]
    allowance: float  # metal that stays for the finishing passes [mm]


@dataclass(frozen=True)
class Box:
    """The last box cycle, G90, G92 or G94; words that are left out stay as in it."""

    end: Point
    taper: float = 0.0  # [mm]


@dataclass
class CycleState:
    """Values that earlier blocks set for a cycle."""

    depth: float = 0.0  # depth of the passes of G71 and G72 [mm]
    retraction: float = 0.5  # of G71 and G72 [mm]
    repeating: Repeating | None = None  # of G73
    thread: ThreadSettings | None = None  # of G76
    pecking: float = 0.0  # distance by which G74 and G75 draw back [mm]
    box: Box = Box(Point(0.0, 0.0))

    # Lines of the last roughing cycles of contours, for G70 to name.
    roughed: dict[ContourNames, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Side:
    """Side of its contour that a roughing cycle turns."""

    upwards: bool  # whether the metal lies beyond the contour along the axis of infeed
    why: str
    facing: bool
    start: Point
    reach: tuple[float, float]  # least and largest Z of the contour [mm]
    is_settable: bool = True  # whether the user may give another

    @property
    def name(self) -> str:
        """Name of the side; the tool may work beyond the axis, at negative X."""
        if self.facing:
            return "to the right" if self.upwards else "to the left"
        return "outside" if self.upwards == (self.start.x >= 0.0) else "inside"
