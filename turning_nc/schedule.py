"""Schedules: the commanded speed and feed along a row of bars, as the blocks of a program."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

from turning_env import Scenario
from turning_nc.program import FEED_DECIMALS, LENGTH_DECIMALS, SPEED_DECIMALS, Block, rounded_within

TOLERANCE = 0.01  # relative difference up to which successive speeds and feeds merge into one block [-]


@dataclass(frozen=True)
class Segment:
    """A stretch of the row of bars, including the air before each bar, under one command."""

    length: float  # [mm]
    time: float  # [s]
    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]


def bars_of(scenario: Scenario, segments: Iterable[Segment], tolerance: float) -> tuple[tuple[Block, ...], ...]:
    """Return the blocks of every bar that successive segments cut.

    Successive segments merge into one block while neither their cutting speeds nor their feeds differ by more than ``tolerance``
    (relative). The block has their time-averaged speed, and the feed with which it takes the same time. Its end is exact to the
    control's resolution at any tolerance. Speeds and feeds are rounded within the machine's range.
    """
    workpiece = scenario.workpiece
    bars: list[tuple[Block, ...]] = []
    for of_bar in _split_by_bar(segments, workpiece.approach + workpiece.bar_length):
        blocks: list[Block] = []
        path = 0.0
        for group in _groups(of_bar, tolerance):
            path += sum(segment.length for segment in group)
            block = _block(scenario, group, round(workpiece.approach - path, LENGTH_DECIMALS) + 0.0)  # no -0.0
            last = blocks[-1].z if blocks else workpiece.approach
            if block.z >= last:  # shorter than the resolution
                continue
            if blocks and (block.cutting_speed, block.feed) == (blocks[-1].cutting_speed, blocks[-1].feed):
                blocks[-1] = replace(blocks[-1], z=block.z)
            else:
                blocks.append(block)
        if blocks:
            bars.append(tuple(blocks))
    return tuple(bars)


def _split_by_bar(segments: Iterable[Segment], pitch: float) -> Iterator[list[Segment]]:
    """Yield the segments of each bar, split where a bar ends."""
    of_bar: list[Segment] = []
    left = pitch
    for whole in segments:
        segment = whole
        while segment.length >= left - 1e-6:
            share = min(left / segment.length, 1.0)
            of_bar.append(replace(segment, length=left, time=segment.time * share))
            yield of_bar
            segment = replace(segment, length=segment.length - left, time=segment.time * (1.0 - share))
            of_bar, left = [], pitch
        if segment.length > 1e-6:
            of_bar.append(segment)
            left -= segment.length
    if sum(segment.length for segment in of_bar) >= 10.0**-LENGTH_DECIMALS:
        yield of_bar


def _groups(segments: list[Segment], tolerance: float) -> Iterator[list[Segment]]:
    """Yield successive segments that become one block."""
    group: list[Segment] = []
    max_ratio = 1.0 + tolerance + 1e-12
    for segment in segments:
        speeds = [each.cutting_speed for each in (*group, segment)]
        feeds = [each.feed for each in (*group, segment)]
        if max(speeds) > max_ratio * min(speeds) or max(feeds) > max_ratio * min(feeds):
            yield group
            group = []
        group.append(segment)
    if group:
        yield group


def _block(scenario: Scenario, group: list[Segment], z: float) -> Block:
    machine = scenario.machine
    time = sum(segment.time for segment in group)
    distance = sum(segment.time * segment.cutting_speed for segment in group)  # that the cutting edge travels
    feed = sum(segment.time * segment.cutting_speed * segment.feed for segment in group) / distance
    return Block(
        z,
        rounded_within(distance / time, machine.cutting_speed_min, machine.cutting_speed_max, SPEED_DECIMALS),
        rounded_within(feed, machine.feed_min, machine.feed_max, FEED_DECIMALS),
    )
