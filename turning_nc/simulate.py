"""Play policies and programs in the environment: a policy to make its schedule, and a program to compare it with its original.

A schedule is the commanded speed and feed along a row of bars, as the blocks of a program.
"""

import bisect
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np

from turning_env import Reading, RoughTurningEnv, Scenario, read
from turning_env.action import set_point_action, towards
from turning_env.scoring.policy import Actions, Observations, PolicyFactory
from turning_nc.law import LOAD, PATH_VELOCITY, SPINDLE_SPEED, STATE
from turning_nc.program import FEED_DECIMALS, LENGTH_DECIMALS, SPEED_DECIMALS, Block, Program, rounded_within
from turning_nc.words import NcError

TOLERANCE = 0.01  # relative difference up to which successive speeds and feeds merge into one block [-]
MIN_INTERVAL = 0.001  # shortest control interval that a scenario allows [s]

Act = Callable[[Observations, dict[str, Any]], Actions]
"""A function from the observation, shape (1, entries), and the last ``info`` to the action, shape (1, actions)."""


@dataclass(frozen=True)
class Totals:
    """Totals of an episode."""

    removed: float  # [cm3]
    time: float  # machine time [min]
    wear: float  # flank wear at the end [mm]

    @classmethod
    def of(cls, infos: Iterable[dict[str, Any]]) -> Self:
        """Return the totals of an episode's steps."""
        steps = list(infos)
        return cls(sum(info["removed"] for info in steps), sum(info["time"] for info in steps) / 60.0, steps[-1]["wear"])

    def difference(self, other: "Totals") -> float:
        """Return the largest of the relative differences [-]."""
        mine, its = ((totals.removed, totals.time, totals.wear) for totals in (self, other))
        return max(abs(a - b) / max(abs(b), 1e-9) for a, b in zip(mine, its, strict=True))


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


def _steps(scenario: Scenario, seed: int, act: Act) -> Iterator[dict[str, Any]]:
    """Play an episode; yield the ``info`` of every step."""
    env = RoughTurningEnv(scenario)
    observation, info = env.reset(seed=seed)
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(act(observation[None], info)[0])
        yield info
        ended = terminated or truncated


def _acting(make_policy: PolicyFactory) -> Act:
    policy = make_policy(1)
    policy.reset(np.ones(1, np.bool_))
    return lambda observations, info: policy.act(observations)


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


def play_schedule(
    make_policy: PolicyFactory,
    scenario: Scenario,
    seed: int,
    bars: int,
    tolerance: float = TOLERANCE,
    on_path: Callable[[float], object] = lambda path: None,
) -> tuple[Program, Totals]:
    """Play a policy on the first bars of a seed; return the program of its commands, and the episode's totals.

    If the episode ends before the last bar, the program ends there. See ``schedule.bars_of`` for the tolerance; ``on_path`` is
    called after each step with the tool's position along the row [mm].

    Raises:
        NcError: see ``with_bars``.
        ValueError: the policy's actions are not finite numbers.
    """
    infos: list[dict[str, Any]] = []
    segments: list[Segment] = []
    path = 0.0
    for info in _steps(with_bars(scenario, bars), seed, _acting(make_policy)):
        infos.append(info)
        segments.append(Segment(info["path"] - path, info["time"], info["commanded_cutting_speed"], info["commanded_feed"]))
        path = info["path"]
        on_path(path)
    beyond = path - bars * (scenario.workpiece.approach + scenario.workpiece.bar_length)
    if beyond > 0.0:  # the last sub-step leads beyond the last bar
        segments[-1] = replace(segments[-1], length=segments[-1].length - beyond)
    return Program.of(scenario, bars_of(scenario, segments, tolerance)), Totals.of(infos)


def simulate(program: Program, scenario: Scenario, seed: int) -> Totals:
    """Play a program on the first bars of a seed until the program or the edge ends; return the totals.

    In every sub-step of the integration, the control reads the tool's position and commands the speed and feed of the block
    there. An override law sets the override instead, once per step. The drives follow as in any episode. No time passes between
    bars.

    Raises:
        NcError: the program is not one for this scenario, or its law leaves the machine's range or divides by 0.
    """
    program.check(scenario)
    scenario = with_bars(scenario, len(program.bars))
    if program.law.actions:
        policy = LawPolicy(program, scenario)
        return Totals.of(_steps(scenario, seed, lambda observations, info: policy.act(observations)))
    machine, workpiece = scenario.machine, scenario.workpiece
    pitch = workpiece.approach + workpiece.bar_length
    blocks = [block for bar in program.bars for block in bar]
    ends = [number * pitch + program.start - block.z for number, bar in enumerate(program.bars) for block in bar]
    max_speed = program.max_spindle_speed * math.pi * program.diameter / 1000.0
    speeds = np.array([min(block.cutting_speed, max_speed) for block in blocks])
    feeds = np.array([block.feed for block in blocks])
    mapped = set_point_action(speeds, machine.cutting_speed_min, machine.cutting_speed_max)
    actions = np.stack((mapped, set_point_action(feeds, machine.feed_min, machine.feed_max)), axis=1).astype(np.float32)

    def act(observations: Observations, info: dict[str, Any]) -> Actions:
        index = min(bisect.bisect_right(ends, info["path"] + 1e-9), len(blocks) - 1)
        return actions[index : index + 1]

    infos = []
    for info in _steps(_stepwise(scenario), seed, act):
        infos.append(info)
        if info["path"] >= ends[-1] - 1e-6:
            break
    return Totals.of(infos)


def _stepwise(scenario: Scenario) -> Scenario:
    """Return the scenario with set points as actions, and a control interval for each of its sub-steps."""
    control = scenario.control
    interval = control.interval / control.sub_steps
    finer = {"interval": interval, "sub_steps": 1} if interval >= MIN_INTERVAL else {}
    return scenario.model_copy(
        update={"control": control.model_copy(update={"action": "set_point", "edge_changes": "end", **finer})}
    )


class LawPolicy:
    """A program's law as the policy of one episode; it runs once per step."""

    def __init__(self, program: Program, scenario: Scenario) -> None:
        if not program.law.actions or program.blocks != 1 or scenario.control.action != "override":
            raise NcError("a law is played in one block along one bar, of a scenario whose action is the override")
        self._law, self._scenario, self._diameter = program.law, scenario, program.diameter
        self._speed, self._feed = program.bars[0][0].cutting_speed, program.bars[0][0].feed
        self._variables = self._law.variables()

    def override(self, reading: Reading, present: float | None = None) -> float:
        """Return the next override [%] for a reading; ``present`` [%] replaces the program's own present override.

        Raises:
            NcError: the feed would be outside the machine's range, or an expression divides by 0.
        """
        variables, machine = self._variables, self._scenario.machine
        spindle_speed = 1000.0 * float(reading.cutting_speed[0]) / (math.pi * self._diameter)
        variables[LOAD] = 100.0 * max(float(reading.load[0]), 0.0)
        variables[SPINDLE_SPEED], variables[PATH_VELOCITY] = spindle_speed, spindle_speed * float(reading.feed[0])
        if present is not None:
            variables[STATE] = present
        try:
            override = self._law.cycle(variables)
        except ZeroDivisionError as error:
            raise NcError(f"the law divides by 0 at a load of {variables[LOAD]:.1f} %") from error
        feed = 0.01 * override * self._feed
        if not machine.feed_min - 1e-9 <= feed <= machine.feed_max + 1e-9:
            allowed = f"the machine's range is {machine.feed_min} to {machine.feed_max}"
            raise NcError(f"the law sets a feed of {feed:.6f} mm/rev at a load of {variables[LOAD]:.1f} %, but {allowed}")
        return override

    def act(self, observations: Observations) -> Actions:
        """Return actions, shape (1, 1), for observations, shape (1, entries)."""
        reading = read(observations, self._scenario)
        feed = np.array([0.01 * self.override(reading) * self._feed])
        return towards(reading, self._scenario, np.array([self._speed]), feed)


def compare(program: Program, make_policy: PolicyFactory, scenario: Scenario, seed: int) -> tuple[list[float], Totals]:
    """Play a controller on the first bar of a seed; return by how much the law's overrides differ from it, and its totals.

    Both compute the next override [%] of every step from the same measurements and present override.

    Raises:
        NcError: the program is not one for this scenario, or its law is missing or leaves the machine's range.
    """
    program.check(scenario)
    law, acting, feed = LawPolicy(program, scenario), _acting(make_policy), program.bars[0][0].feed
    overrides: list[float] = []

    def act(observations: Observations, info: dict[str, Any]) -> Actions:
        reading = read(observations, scenario)
        overrides.append(law.override(reading, 100.0 * float(reading.commanded_feed[0]) / feed))
        return acting(observations, info)

    infos = list(_steps(with_bars(scenario, 1), seed, act))
    differences = [abs(mine - 100.0 * info["commanded_feed"] / feed) for mine, info in zip(overrides, infos, strict=True)]
    return differences, Totals.of(infos)
