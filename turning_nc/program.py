"""A part program: blocks of one cutting speed and feed along Z, bar by bar, and optionally an override law.

X is a diameter. Z is 0 at the bar's face and decreases towards the chuck.
"""

import math
from dataclasses import dataclass, field
from typing import Self

from turning_env import Scenario
from turning_env.console import Mistake
from turning_nc.synchronous import Law

SPEED_DECIMALS, FEED_DECIMALS, LENGTH_DECIMALS, LIMIT_DECIMALS = 1, 3, 3, 1
"""A control's resolution: cutting speed 0.1 m/min, feed 0.001 mm/rev, lengths 0.001 mm, spindle speed 0.1 rev/min."""
RETRACTION = 10.0
"""Radial distance by which the tool leaves the cut before it returns [mm] (assumption)."""


class NcError(Mistake):
    """A program that cannot be written, read or played. The message names the block and the reason."""


@dataclass(frozen=True)
class Block:
    """A feed block."""

    z: float
    """Position of its end [mm]."""
    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]
    note: str = field(default="", compare=False)
    """Comment on what begins with the block."""


@dataclass(frozen=True)
class Program:
    """A turning program: the same cut on successive bars, each with its own blocks."""

    diameter: float
    """Diameter of the cut [mm]."""
    start: float
    """Z at which every bar's first block starts, in the air before the face [mm]."""
    max_spindle_speed: float  # [rev/min]
    bars: tuple[tuple[Block, ...], ...]
    law: Law | None = None
    """Law from measured load to feed override, if there is one."""

    @classmethod
    def of(cls, scenario: Scenario, bars: tuple[tuple[Block, ...], ...], law: Law | None = None) -> Self:
        """Return a program for a scenario's machine and bars.

        Raises:
            NcError: see ``check``.
        """
        workpiece = scenario.workpiece
        highest = _spindle_speed(scenario.machine.cutting_speed_max, workpiece.diameter)
        program = cls(
            round(workpiece.diameter, LENGTH_DECIMALS),
            round(workpiece.approach, LENGTH_DECIMALS),
            rounded_within(highest, 0.0, highest, LIMIT_DECIMALS),
            bars,
            law,
        )
        program.check(scenario)
        return program

    def check(self, scenario: Scenario) -> None:
        """Check that a scenario's machine can run the program and that its bars are the program's.

        Raises:
            NcError: a speed or feed is outside the machine's range, or a position is not the scenario's. Names bar and block.
        """
        workpiece, machine = scenario.workpiece, scenario.machine
        for what, mine, its in (
            ("diameter", self.diameter, workpiece.diameter),
            ("first position", self.start, workpiece.approach),
        ):
            if abs(mine - its) > 0.5 * 10.0**-LENGTH_DECIMALS + 1e-9:
                raise NcError(f"the program's {what} is {mine} mm, but that of scenario {scenario.name!r} is {its} mm")
        highest = _spindle_speed(machine.cutting_speed_max, workpiece.diameter)
        if self.max_spindle_speed > highest * (1.0 + 1e-9):
            raise NcError(f"LIMS is {self.max_spindle_speed} rev/min, but the machine's highest is {highest:.1f}")
        if not self.bars or not all(self.bars):
            raise NcError("a program must cut at least one bar, and every bar in at least one block")
        for number, blocks in enumerate(self.bars, 1):
            position = self.start
            for index, block in enumerate(blocks, 1):
                where = f"bar {number}, feed block {index}"
                _within(where, "cutting speed", block.cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max)
                _within(where, "feed", block.feed, machine.feed_min, machine.feed_max)
                if not -workpiece.bar_length - 1e-3 <= block.z < position:
                    raise NcError(f"{where}: Z is {block.z}, but must lie below {position} and not below -{workpiece.bar_length}")
                position = block.z
            if number < len(self.bars) and abs(position + workpiece.bar_length) > 1e-3:
                raise NcError(f"bar {number} ends at Z{position}, but all but the last must end at -{workpiece.bar_length}")

    @property
    def blocks(self) -> int:
        """Number of feed blocks."""
        return sum(len(bar) for bar in self.bars)


def rounded_within(value: float, low: float, high: float, decimals: int) -> float:
    """Return the nearest value of a control's resolution within a range.

    Raises:
        NcError: the range holds none.
    """
    scale = 10.0**decimals
    first, last = math.ceil(low * scale - 1e-9), math.floor(high * scale + 1e-9)
    if first > last:
        raise NcError(f"the range {low} to {high} holds no value of {decimals} decimals")
    return float(round(min(max(round(value * scale), first), last) / scale, decimals))


def _spindle_speed(cutting_speed: float, diameter: float) -> float:
    return 1000.0 * cutting_speed / (math.pi * diameter)


def _within(where: str, what: str, value: float, low: float, high: float) -> None:
    if not low * (1.0 - 1e-9) <= value <= high * (1.0 + 1e-9):
        raise NcError(f"{where}: {what} is {value}, but the machine's range is {low} to {high}")
