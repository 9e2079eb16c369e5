"""The course of commanded speed and feed along the row of bars, and how it becomes blocks."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from turning_env import Scenario
from turning_env.programs.program import FEED_DECIMALS, LENGTH_DECIMALS, SPEED_DECIMALS, Block, rounded_within

_MIN_LENGTH = 10.0**-LENGTH_DECIMALS


@dataclass(frozen=True)
class Piece:
    """A stretch of the row, air before the bars included, under one command."""

    length: float  # [mm]
    time: float  # [s]
    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]
    note: str = ""


def bars_of(scenario: Scenario, course: Iterable[Piece], tolerance: float) -> tuple[tuple[Block, ...], ...]:
    """The blocks of every bar that a course cuts.

    Successive pieces become one block while neither their cutting speeds nor their feeds differ by more than ``tolerance`` (as a
    share), under the mean speed by time and the feed that then takes as long. Where blocks end is as exact as the control's
    resolution, whatever the tolerance. Speeds and feeds are rounded within the machine's range.
    """
    workpiece = scenario.workpiece
    row = workpiece.approach + workpiece.bar_length
    bars: list[tuple[Block, ...]] = []
    for pieces in _by_bar(course, row):
        blocks: list[Block] = []
        path = 0.0
        for group in _groups(pieces, tolerance):
            path += sum(piece.length for piece in group)
            block = _block(scenario, group, round(workpiece.approach - path, LENGTH_DECIMALS) + 0.0)  # no -0.0
            last = blocks[-1].z if blocks else workpiece.approach
            if block.z >= last:  # less than the resolution
                continue
            same = blocks and not block.note and (block.cutting_speed, block.feed) == (blocks[-1].cutting_speed, blocks[-1].feed)
            if same:
                blocks[-1] = replace(blocks[-1], z=block.z)
            else:
                blocks.append(block)
        if blocks:
            bars.append(tuple(blocks))
    return tuple(bars)


def _by_bar(course: Iterable[Piece], row: float) -> Iterator[list[Piece]]:
    """The pieces of each bar, cut where a bar ends."""
    pieces: list[Piece] = []
    left = row
    for whole in course:
        piece = whole
        while piece.length >= left - 1e-6:
            share = min(left / piece.length, 1.0)
            pieces.append(replace(piece, length=left, time=piece.time * share))
            yield pieces
            piece = replace(piece, length=piece.length - left, time=piece.time * (1.0 - share), note="")
            pieces, left = [], row
        if piece.length > 1e-6:
            pieces.append(piece)
            left -= piece.length
    if sum(piece.length for piece in pieces) >= _MIN_LENGTH:
        yield pieces


def _groups(pieces: list[Piece], tolerance: float) -> Iterator[list[Piece]]:
    """Successive pieces that are to be one block. One with a note begins a new one."""
    group: list[Piece] = []
    most = 1.0 + tolerance + 1e-12
    slowest = fastest = finest = coarsest = 0.0
    for piece in pieces:
        speeds = min(slowest, piece.cutting_speed), max(fastest, piece.cutting_speed)
        feeds = min(finest, piece.feed), max(coarsest, piece.feed)
        if not group or piece.note or speeds[1] > most * speeds[0] or feeds[1] > most * feeds[0]:
            if group:
                yield group
            group, speeds, feeds = [], (piece.cutting_speed, piece.cutting_speed), (piece.feed, piece.feed)
        group.append(piece)
        (slowest, fastest), (finest, coarsest) = speeds, feeds
    if group:
        yield group


def _block(scenario: Scenario, group: list[Piece], z: float) -> Block:
    machine = scenario.machine
    time = sum(piece.time for piece in group)
    metres = sum(piece.time * piece.cutting_speed for piece in group)
    feed = sum(piece.time * piece.cutting_speed * piece.feed for piece in group) / metres
    return Block(
        z,
        rounded_within(metres / time, machine.cutting_speed_min, machine.cutting_speed_max, SPEED_DECIMALS),
        rounded_within(feed, machine.feed_min, machine.feed_max, FEED_DECIMALS),
        group[0].note,
    )
