"""Play the moves of a part program with a scenario's laws: times, loads, wear and tool life, slice by slice.

All values are nominal: they ignore model mismatch and the spread of edges and bars. Drives and axes follow at once.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from turning_nc.kinds import DRILL
from turning_nc.moves import Moves
from turning_nc.removal import MIN_DEPTH, Removal
from turning_shop import Values
from turning_shop.whatif import NO_LIMIT

from turning_env.physics.spindle import capacity_at, idle_power_at
from turning_env.scenario import Scenario

if TYPE_CHECKING:
    from turning_shop.prediction import Evidence

MIN_ACROSS = 1e-3  # change of the radius over a slice below which it counts as constant [mm]
FINISHING_DEPTH = 0.5  # depth of cut up to which a cut is finishing: its feed makes the surface, and stays [mm] (assumption)


@dataclass(frozen=True)
class Machine:
    """Properties of a machine that a scenario lacks (assumptions)."""

    max_spindle_speed: float = 4000.0  # [rev/min]
    rapid: float = 10_000.0  # rapid traverse [mm/min]
    tool_change: float = 2.0  # [s]
    max_feed: float = (
        math.inf
    )  # highest feed that the inserts take [mm/rev]; the scenario's machine has its own


class Situation:
    """A program on its stock with a scenario: the slices, and all of them that does not change with feed and speed."""

    def __init__(
        self,
        scenario: Scenario,
        machine: Machine,
        moves: Moves,
        removal: Removal,
        evidence: "Evidence | None" = None,
    ) -> None:
        self.scenario, self.machine, self.moves, self.removal, self.evidence = (
            scenario,
            machine,
            moves,
            removal,
            evidence,
        )
        slices, all_moves = removal.slices, moves.moves

        def of(values: Iterable[Any]) -> NDArray[Any]:
            return np.array(list(values))[slices.move]

        self.kinds = of(move.kind for move in all_moves)
        self.tool = of(move.tool for move in all_moves)
        self.line = of(move.line for move in all_moves)
        self.feed = of(
            move.feed.value for move in all_moves
        )  # as programmed [mm/rev], or [mm/min] if not per revolution
        self.speed = of(
            move.speed.value for move in all_moves
        )  # as programmed [m/min], or [rev/min] if not constant
        self.per_revolution = of(move.per_revolution for move in all_moves)
        self.constant_speed = of(move.constant_cutting_speed for move in all_moves)
        self.spindle_on = of(move.spindle_on for move in all_moves)
        self.max_spindle = np.minimum(
            of(move.max_spindle_speed for move in all_moves), machine.max_spindle_speed
        )
        changed = [False, *(before.tool != after.tool for before, after in pairwise(all_moves))]
        waits = of(
            move.time + machine.tool_change * change
            for move, change in zip(all_moves, changed, strict=True)
        )
        rapid = np.where(self.kinds == "rapid", 60.0 * slices.length / machine.rapid, 0.0)
        self.other_time = rapid + np.where(
            np.diff(slices.move, prepend=-1) > 0, waits, 0.0
        )  # of rapids, dwells, changes [s]
        self.fed = np.isin(self.kinds, ("feed", "thread"))  # slices that are run at feed
        drills = [tool for tool, kind in removal.tools.items() if kind.startswith(DRILL)]
        self.apart = self.fed & (
            (self.kinds == "thread") | np.isin(self.tool, drills)
        )  # threads, drills: no load is computed
        self.engaged = self.fed & (slices.depth > MIN_DEPTH) & ~self.apart  # slices that turn metal
        self.without_limit = [
            getattr(scenario.limits, name) == none for name, none in NO_LIMIT.items()
        ]  # thrust force, power
        low = scenario.machine.feed_min
        self.feed_range = (
            low,
            max(min(scenario.machine.feed_max, machine.max_feed), low),
        )  # of feeds to choose [mm/rev]
        self.by_tool = {
            tool: self.tool == tool for tool in dict.fromkeys(self.tool.tolist())
        }  # slices, by first use of tools

    def finishing(self, cuts: NDArray[np.int64], depth: float) -> bool:
        """Return whether at most half of the path in metal is deeper than ``depth`` [mm], or a grooving tool cuts.

        ``cuts`` are indices of slices.
        """
        slices = self.removal.slices
        metal = cuts[self.engaged[cuts]]
        length = slices.length[metal]
        deep = float(length[slices.depth[metal] > depth].sum())
        grooving = any(
            self.removal.tools[tool].startswith("groove") for tool in set(self.tool[metal].tolist())
        )
        return grooving or deep <= 0.5 * float(length.sum())


@dataclass(frozen=True)
class Play:
    """A simulated run of a program: arrays over the slices; loads are 0 in air."""

    time: Values  # [s]
    cutting_speed: Values  # at the tool's tip [m/min]
    feed: Values  # [mm/rev]
    spindle_speed: Values  # [rev/min]
    used_life: Values  # share of an edge's life that the slice uses [-]
    wear: Values  # flank wear of the slice's edge after it [mm]
    change_wear: Values  # flank wear at which the slice's edge is changed [mm]
    life_at_change: Values  # share of the tool life that has passed then, by the nominal law [-]
    force_share: Values  # over the scenario's limit [-]; 0 if it has none
    power_share: Values

    @property
    def load(self) -> Values:
        """The higher of the shares of force and power [-]."""
        return np.maximum(self.force_share, self.power_share)


def motion(
    situation: Situation, feed: Values, speed: Values
) -> tuple[Values, Values, Values, Values]:
    """Return time [s], cutting speed [m/min], feed [mm/rev] and spindle speed [rev/min] of the slices."""
    s = situation
    around = 2.0 * math.pi * np.maximum(s.removal.slices.radius, 1e-6) / 1000.0  # [m/rev]
    turns = np.where(s.fed, np.maximum(spindle_speed(s, speed), 1e-9), 0.0)
    per_turn = np.where(s.per_revolution, feed, feed / np.where(s.fed, turns, 1.0))
    velocity = np.where(s.fed, per_turn * turns, 1.0)
    time = s.other_time + np.where(s.fed, 60.0 * s.removal.slices.length / velocity, 0.0)
    return time, turns * around, np.where(s.fed, per_turn, 0.0), turns


def spindle_speed(situation: Situation, speed: Values, slices: Any = slice(None)) -> Values:
    """Return the spindle speed that takes the time of each slice [rev/min], for speeds as programmed.

    At a constant cutting speed a turn takes longer at a larger radius, but never less than at the spindle's limit. A slice in
    air may be as long as its move, so the time of a turn is averaged over the slice.
    """
    least = 1.0 / situation.max_spindle[slices]  # time of a turn [min]
    per_radius = 2.0 * math.pi / (1000.0 * np.maximum(speed, 1e-9))  # [min/mm]
    begin = situation.removal.slices.start[slices, 1]
    end = situation.removal.slices.end[slices, 1]
    knee = least / per_radius  # radius below which the spindle is at its limit [mm]

    def integral(radius: Values) -> Values:
        """Return the time of a turn, integrated from the axis to a radius [min mm]."""
        beyond = np.maximum(abs(radius), knee)
        total = least * np.minimum(abs(radius), knee) + 0.5 * per_radius * (beyond**2 - knee**2)
        return np.asarray(np.sign(radius) * total)

    middle = np.maximum(per_radius * 0.5 * abs(begin + end), least)
    across = end - begin
    small = abs(across) < MIN_ACROSS
    mean = np.where(small, middle, (integral(end) - integral(begin)) / np.where(small, 1.0, across))
    turns = np.where(situation.constant_speed[slices], 1.0 / mean, speed)
    return np.asarray(np.minimum(turns, situation.max_spindle[slices]))


def play(
    situation: Situation,
    wear: Values | float,
    feed: Values | None = None,
    speed: Values | None = None,
) -> Play:
    """Play the slices in their order; every tool has an edge of its own.

    Edges are changed at a flank wear [mm], given for all slices or each. The part is the last of each edge, so that loads are
    the highest of all parts.
    ``feed`` and ``speed`` replace those programmed, in the same units.
    """
    s, scenario = situation, situation.scenario
    feed, speed = (s.feed if feed is None else feed), (s.speed if speed is None else speed)
    time, cutting_speed, per_turn, turns = motion(s, feed, speed)
    on = s.engaged
    life = np.zeros(len(time))
    life[on] = (time - s.other_time)[on] / tool_life(
        scenario, cutting_speed[on], per_turn[on], s.removal.slices.depth[on]
    )
    exponent, criterion = scenario.material.wear.time, scenario.tool.wear_criterion
    worn, wear = np.zeros(len(time)), np.broadcast_to(wear, time.shape)
    end = (wear / criterion) ** (1.0 / exponent)
    for mine in s.by_tool.values():
        used = np.cumsum(life[mine])
        worn[mine] = (
            criterion
            * np.minimum(np.maximum(end[mine] - used[-1], 0.0) + used, end[mine]) ** exponent
        )
    shares = np.zeros((2, len(time)))
    force, power = loads(
        scenario, cutting_speed[on], per_turn[on], s.removal.slices.depth[on], worn[on]
    )
    idle, highest = power_range(scenario, turns[on])
    shares[:, on] = force / scenario.limits.thrust_force, (power + idle) / highest
    shares[s.without_limit] = 0.0
    return Play(time, cutting_speed, per_turn, turns, life, worn, wear, end, *shares)


def tool_life(scenario: Scenario, cutting_speed: Values, feed: Values, depth: Values) -> Values:
    """Return the cutting time from a fresh edge to the wear criterion [s]."""
    law = scenario.material.wear
    after_a_minute = law(_within_laws(scenario, cutting_speed), feed, depth)
    return np.asarray(60.0 * (scenario.tool.wear_criterion / after_a_minute) ** (1.0 / law.time))


def loads(
    scenario: Scenario, cutting_speed: Values, feed: Values, depth: Values, wear: Values
) -> tuple[Values, Values]:
    """Return thrust force [N] and spindle power [kW], without the idle power.

    Power falls with the cutting speed to 0, as at the centre of a face.
    """
    speed = _within_laws(scenario, cutting_speed)
    power = scenario.material.power(speed, feed, depth, wear=wear) * np.minimum(
        cutting_speed / speed, 1.0
    )
    return scenario.material.thrust_force(speed, feed, depth, wear=wear), power


def power_range(scenario: Scenario, spindle_speed: Values) -> tuple[Values, Values]:
    """Return the power of the idling spindle and the highest power [kW] at spindle speeds [rev/min]."""
    speed = (
        math.pi * scenario.workpiece.diameter * spindle_speed / 1000.0
    )  # at which the scenario states them
    return idle_power_at(scenario, speed), scenario.limits.power * capacity_at(scenario, speed)


def highest_feed(
    scenario: Scenario,
    cutting_speed: Values,
    spindle_speed: Values,
    depth: Values,
    wear: Values,
    high: float,
) -> Values:
    """Return the highest feed within the limits of force and power, and at most ``high`` [mm/rev]."""
    material, (idle, highest) = scenario.material, power_range(scenario, spindle_speed)
    force, power = loads(
        scenario, cutting_speed, np.ones_like(cutting_speed), depth, wear
    )  # at 1 mm/rev
    feed = np.full(cutting_speed.shape, high)
    force_limit, power_limit = scenario.limits.thrust_force, np.maximum(highest - idle, 1e-9)
    for load, limit, law in (
        (force, force_limit, material.thrust_force),
        (power, power_limit, material.power),
    ):
        if law.feed > 0.0:
            feed = np.minimum(feed, (limit / load) ** (1.0 / law.feed))
    return feed


def _within_laws(scenario: Scenario, cutting_speed: Values) -> Values:
    """Return the cutting speed at which the laws are evaluated: not below the machine's lowest (assumption)."""
    return np.maximum(cutting_speed, scenario.machine.cutting_speed_min)
