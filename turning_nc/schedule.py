"""Schedules: the commanded speed and feed along a row of bars, as the blocks of a program."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from turning_env import RoughTurningEnv, Scenario
from turning_env.scoring.policy import PolicyFactory
from turning_nc.program import (
    FEED_DECIMALS,
    LENGTH_DECIMALS,
    SPEED_DECIMALS,
    Block,
    NcError,
    Program,
    rounded_within,
)

TOLERANCE = 0.01
"""Relative difference up to which successive speeds and feeds merge into one block [-]."""
_MIN_LENGTH = 10.0**-LENGTH_DECIMALS


@dataclass(frozen=True)
class Totals:
    """Totals of an episode."""

    removed: float  # [cm3]
    time: float
    """Machine time [min]."""
    wear: float
    """Flank wear at the end [mm]."""

    def difference(self, other: "Totals") -> float:
        """Return the largest of the relative differences [-]."""
        mine, its = ((totals.removed, totals.time, totals.wear) for totals in (self, other))
        return max(abs(a - b) / max(abs(b), 1e-9) for a, b in zip(mine, its, strict=True))


@dataclass(frozen=True)
class Segment:
    """A stretch of the row of bars, including the air before each bar, under one command."""

    length: float  # [mm]
    time: float  # [s]
    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]
    note: str = ""


def with_bars(scenario: Scenario, bars: int) -> Scenario:
    """Return a scenario that ends after its first ``bars`` bars.

    Raises:
        NcError: no program can be written for the scenario; names the field.
    """
    control, workpiece = scenario.control, scenario.workpiece
    if control.action == "part":
        raise NcError('control.action is "part", but a schedule is written where speed and feed are set step by step')
    if control.edge_changes != "end":
        raise NcError(f'control.edge_changes is {control.edge_changes!r}, but a program is written for one edge: only "end"')
    most = workpiece.bars or 1000
    if not 1 <= bars <= most:
        raise NcError(f"{bars} bars asked for, but there must be 1 to {most}")
    return scenario.model_copy(update={"workpiece": workpiece.model_copy(update={"bars": bars})})


def play_schedule(
    make_policy: PolicyFactory,
    scenario: Scenario,
    seed: int,
    bars: int,
    tolerance: float = TOLERANCE,
    on_path: Callable[[float], object] = lambda path: None,
) -> tuple[Program, Totals]:
    """Play a policy on the first bars of a seed; return the program of its commands, and the episode's totals.

    If the episode ends before the last bar, the program ends there.

    Args:
        make_policy: makes the policy for one environment.
        scenario: scenario to play.
        seed: seed of the episode.
        bars: number of bars.
        tolerance: see ``bars_of``.
        on_path: called after each step with the tool's position along the row [mm].

    Raises:
        NcError: see ``with_bars``.
        ValueError: the policy's actions are not finite numbers.
    """
    env = RoughTurningEnv(with_bars(scenario, bars))
    observation, info = env.reset(seed=seed)
    policy = make_policy(1)
    policy.reset(np.ones(1, np.bool_))
    segments: list[Segment] = []
    path = removed = 0.0
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(policy.act(observation[None])[0])
        ended = terminated or truncated
        removed += info["removed"]
        segments.append(Segment(info["path"] - path, info["time"], info["commanded_cutting_speed"], info["commanded_feed"]))
        path = info["path"]
        on_path(path)
    pitch = scenario.workpiece.approach + scenario.workpiece.bar_length
    if path > bars * pitch:  # the last sub-step leads beyond the last bar
        segments[-1] = replace(segments[-1], length=segments[-1].length - (path - bars * pitch))
    program = Program.of(scenario, bars_of(scenario, segments, tolerance))
    return program, Totals(removed, sum(segment.time for segment in segments) / 60.0, info["wear"])


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
            if blocks and not block.note and (block.cutting_speed, block.feed) == (blocks[-1].cutting_speed, blocks[-1].feed):
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
            segment = replace(segment, length=segment.length - left, time=segment.time * (1.0 - share), note="")
            of_bar, left = [], pitch
        if segment.length > 1e-6:
            of_bar.append(segment)
            left -= segment.length
    if sum(segment.length for segment in of_bar) >= _MIN_LENGTH:
        yield of_bar


def _groups(segments: list[Segment], tolerance: float) -> Iterator[list[Segment]]:
    """Yield successive segments that become one block. A segment with a note begins a new one."""
    group: list[Segment] = []
    speeds = feeds = (0.0, 0.0)  # lowest and highest of the group
    max_ratio = 1.0 + tolerance + 1e-12
    for segment in segments:
        if group:
            speeds = min(speeds[0], segment.cutting_speed), max(speeds[1], segment.cutting_speed)
            feeds = min(feeds[0], segment.feed), max(feeds[1], segment.feed)
            if segment.note or speeds[1] > max_ratio * speeds[0] or feeds[1] > max_ratio * feeds[0]:
                yield group
                group = []
        if not group:
            speeds, feeds = (segment.cutting_speed,) * 2, (segment.feed,) * 2
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
        group[0].note,
    )
