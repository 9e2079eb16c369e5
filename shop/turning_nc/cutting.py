"""Play the moves of a program with a scenario's laws: times, loads, wear and tool life by slice.

All values are nominal: they ignore model mismatch and the spread of edges and bars. Drives and axes
follow at once. When edges are changed is decided in ``edges``; other feeds and speeds are chosen in
``adapt``.
"""

import copy
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from turning_nc.chips import drilled_thickness, drilled_width, thread_chips
from turning_nc.kinds import DRILL, check_called, diameter_of_drill
from turning_nc.moves import Moves
from turning_nc.removal import MIN_DEPTH, RADIUS, Removal
from turning_nc.words import NcError
from turning_shop import Values
from turning_shop.allowed import feed_range
from turning_shop.whatif import NO_LIMIT

from turning_env.numerics.conversions import cutting_speed_at
from turning_env.scenario import Scenario
from turning_env.scenario.laws import (
    Loads,
    LoadShares,
    capacity_at,
    cutting_power_limit,
    feed_at_limit,
    idle_power_at,
    life_rate,
    load_shares,
    used_life_at,
    wear_at,
)

if TYPE_CHECKING:
    from turning_shop.prediction import Evidence

MIN_ACROSS = 1e-3  # change of the radius over a slice below which it counts as constant [mm]
MIN_RADIUS = 1e-6  # at which cutting speeds are computed [mm]: 0 would divide by 0
MIN_SPINDLE_SPEED = 1e-9  # [rev/min], for the same reason


@dataclass(frozen=True)
class AssumedMachine:
    """Properties of a machine that a scenario lacks (assumptions)."""

    max_spindle_speed: float = 4000.0  # [rev/min]
    rapid: float = 10_000.0  # rapid traverse [mm/min]
    tool_change: float = 2.0  # [s]
    max_feed: float = math.inf  # of the inserts [mm/rev]; the scenario's machine has its own


@dataclass(frozen=True)
class Laws:
    """A scenario whose laws and limits hold for tools, and the evidence for its laws."""

    scenario: Scenario
    evidence: "Evidence | None" = None  # None if the laws were not fitted

    @property
    def has_force_limit(self) -> bool:
        """Whether the scenario limits the thrust force."""
        return bool(self.scenario.limits.thrust_force != NO_LIMIT["thrust_force"])

    @property
    def has_power_limit(self) -> bool:
        """Whether the scenario limits the power."""
        return bool(self.scenario.limits.power != NO_LIMIT["power"])


class ToolGroup(NamedTuple):
    """The tools of a program for which the same laws hold."""

    laws: Laws
    tools: tuple[str, ...]
    slices: NDArray[np.bool_]  # marks those of the tools

    @property
    def scenario(self) -> Scenario:
        """The scenario of the laws."""
        return self.laws.scenario


class Situation:
    """A program on its stock with a scenario.

    Attributes:
        scenario: laws and limits of all tools without laws of their own, and the machine.
        machine: what the scenario lacks.
        moves: the moves of the program.
        removal: the metal that they remove, by slice.
        evidence: the evidence for the scenario's laws; None if they were not fitted.
        described: the tools whose insert the scenario describes. Loads and wear of others are
            computed with its laws, too, but say little of them.
        own_laws: the tools with laws of their own.
        groups: all tools, by their laws.
        unknown: slices whose load is not known, by the reason.

    All other attributes are arrays over the slices. They do not change with feed and speed:

    * ``kind``, ``tool``, ``line``, ``per_revolution``, ``constant_speed`` and ``spindle_on`` are
      those of the slice's move.
    * ``feed`` is the programmed one [mm/rev], or [mm/min] if not per revolution. ``speed`` is the
      programmed one [m/min], or [rev/min] if not constant.
    * ``max_spindle`` is the highest spindle speed [rev/min].
    * ``other_time`` is the time of rapid moves, dwells and tool changes [s].
    * ``fed`` marks slices that are run at feed, ``threads_and_drills`` those of them that thread
      or drill, and ``engaged`` those that turn metal.
    * ``loaded`` marks slices with a law of power: ``engaged`` ones, and ``drilled`` and
      ``threaded`` ones, which are drills and threads in metal.
    * ``chip_width`` is the width of their chips [mm]: the depth of cut where they turn.
    * ``diameter`` is that at which they are cut [mm]: twice the radius, or that of the drill.
    * ``is_described`` marks the slices of the tools that the scenario or their own laws describe.
    * ``by_tool`` marks the slices of each tool, in the order of their first use.
    """

    def __init__(
        self,
        scenario: Scenario,
        machine: AssumedMachine,
        moves: Moves,
        removal: Removal,
        evidence: "Evidence | None" = None,
        described: Collection[str] = (),
        own_laws: Mapping[str, Laws] = {},
    ) -> None:
        """Put a program on its stock.

        Args:
            scenario: laws, limits and machine.
            machine: what the scenario lacks.
            moves: the moves of the program.
            removal: the metal that they remove.
            evidence: the evidence for the scenario's laws.
            described: the tools whose insert the scenario describes; by default the one that
                removes most metal outside, or inside if none turns outside, unless it has laws of
                its own.
            own_laws: laws that hold for tools in place of the scenario's.

        Raises:
            NcError: a tool is not in the program, or is described twice.
        """
        self.scenario = scenario
        self.machine = machine
        self.moves = moves
        self.removal = removal
        self.evidence = evidence
        slices = removal.slices
        all_moves = moves.moves

        def per_slice(values: Iterable[Any]) -> NDArray[Any]:
            return np.array(list(values))[slices.move]

        self.kind = per_slice(move.kind for move in all_moves)
        self.tool = per_slice(move.tool for move in all_moves)
        self.line = per_slice(move.line for move in all_moves)
        self.feed = per_slice(move.feed.value for move in all_moves)
        self.speed = per_slice(move.speed.value for move in all_moves)
        self.per_revolution = per_slice(move.per_revolution for move in all_moves)
        self.constant_speed = per_slice(move.constant_cutting_speed for move in all_moves)
        self.spindle_on = per_slice(move.spindle_on for move in all_moves)
        programmed_limit = per_slice(move.max_spindle_speed for move in all_moves)
        self.max_spindle = np.minimum(programmed_limit, machine.max_spindle_speed)

        # A dwell or a tool change takes its time in the first slice of its move.
        changed = [False]
        for before, after in pairwise(all_moves):
            changed.append(before.tool != after.tool)
        waits = per_slice(
            move.time + machine.tool_change * change
            for move, change in zip(all_moves, changed, strict=True)
        )
        is_first = np.diff(slices.move, prepend=-1) > 0
        rapid = np.where(self.kind == "rapid", 60.0 * slices.length / machine.rapid, 0.0)
        self.other_time = rapid + np.where(is_first, waits, 0.0)

        self.fed = np.isin(self.kind, ("feed", "thread"))
        drills = [tool for tool, kind in removal.tools.items() if kind.startswith(DRILL)]
        is_thread = self.kind == "thread"
        self.threads_and_drills = self.fed & (is_thread | np.isin(self.tool, drills))
        self.engaged = self.fed & (slices.depth > MIN_DEPTH) & ~self.threads_and_drills
        tools = dict.fromkeys(self.tool.tolist())
        self.by_tool = {tool: self.tool == tool for tool in tools}
        check_called([*described, *own_laws], self.by_tool)
        for name in described:
            if name in own_laws:
                raise NcError(
                    f"tool {name} has a scenario of its own, so the command's cannot describe it"
                )
        self.own_laws = own_laws
        main_tool = tuple(tool for tool in self._main_tool() if tool not in own_laws)
        self.described = tuple(described) or main_tool
        self.is_described = np.isin(self.tool, [*self.described, *own_laws])
        self.groups = self._groups()
        self._add_chips(is_thread)

    def _groups(self) -> list[ToolGroup]:
        """Return all tools by their laws, in the order of their first use."""
        shared = Laws(self.scenario, self.evidence)
        tools_of: dict[int, list[str]] = {}
        laws_of: dict[int, Laws] = {}
        for tool in self.by_tool:
            laws = self.own_laws.get(tool, shared)
            laws_of[id(laws)] = laws
            tools_of.setdefault(id(laws), []).append(tool)
        groups = []
        for key, tools in tools_of.items():
            groups.append(ToolGroup(laws_of[key], tuple(tools), np.isin(self.tool, tools)))
        return groups

    def under(self, group: ToolGroup) -> Self:
        """Return the same with the laws of a group in place of the scenario's.

        It describes the tools of the group alone. The laws by which all tools are played stay.
        """
        view = copy.copy(self)
        view.scenario = group.scenario
        view.evidence = group.laws.evidence
        view.is_described = self.is_described & group.slices
        return view

    def _add_chips(self, is_thread: NDArray[np.bool_]) -> None:
        """Add the chips of all slices, and the slices whose chips are not known."""
        slices = self.removal.slices
        self.diameter = 2.0 * slices.radius
        self.chip_width = slices.depth.copy()
        self.unknown: dict[str, NDArray[np.bool_]] = {}
        drilled = np.zeros(len(self.tool), np.bool_)
        for tool, kind in self.removal.tools.items():
            is_drill = self.by_tool[tool] & self.fed & ~is_thread
            diameter = diameter_of_drill(kind)
            if diameter is not None:
                self.diameter[is_drill] = diameter
                drilled |= is_drill & (slices.depth > MIN_DEPTH)
            elif kind == DRILL:
                self.unknown[f"give --tool {tool}=drill:DIAMETER"] = is_drill
        self.chip_width[drilled] = drilled_width(
            slices.volume[drilled], slices.length[drilled], diameter=self.diameter[drilled]
        )
        self.drilled = drilled

        moves = self.moves.moves
        thickness = np.zeros(len(moves))
        width = np.zeros(len(moves))
        unknown_moves: dict[str, list[int]] = {}
        for index, chip in thread_chips(moves, self.removal.part).items():
            if chip is not None:
                thickness[index] = chip.thickness
                width[index] = chip.width
                continue
            move = moves[index]
            reason = f"{move.tool} meets no metal at the thread's root: give --stock"
            if abs(move.path.end.x) < MIN_RADIUS:
                reason = "taps have no law"
            unknown_moves.setdefault(reason, []).append(index)
        for reason, indices in unknown_moves.items():
            self.unknown[reason] = np.isin(slices.move, indices)
        self.thread_thickness = thickness[slices.move]
        self.chip_width += width[slices.move]
        self.threaded = self.thread_thickness > 0.0
        self.loaded = self.engaged | drilled | self.threaded

    def chip_thickness(self, feed: Values) -> Values:
        """Return the thickness of the chips of all slices at their feeds [mm/rev], in mm."""
        thickness = np.where(self.drilled, drilled_thickness(feed), feed)
        return np.where(self.threaded, self.thread_thickness, thickness)

    def _main_tool(self) -> tuple[str, ...]:
        """Return the insert that turns most metal, outside if one does; empty if none turns."""
        kinds = self.removal.tools
        volume = self.removal.slices.volume
        removed: dict[str, float] = {}
        for tool, is_tool in self.by_tool.items():
            if "groove" not in kinds[tool] and not kinds[tool].startswith(DRILL):
                removed[tool] = float(volume[is_tool].sum())
        outside = [tool for tool in removed if not kinds[tool].endswith("inside")]
        candidates = outside or list(removed)
        return tuple(sorted(candidates, key=removed.__getitem__)[-1:])

    @property
    def has_force_limit(self) -> bool:
        """Whether the thrust force of any tool is limited."""
        return any(group.laws.has_force_limit for group in self.groups)

    @property
    def has_power_limit(self) -> bool:
        """Whether the power of any tool is limited."""
        return any(group.laws.has_power_limit for group in self.groups)

    @property
    def min_feed(self) -> float:
        """Lowest feed to choose [mm/rev]: that of ``turning_shop.allowed.feed_range``."""
        return feed_range(self.scenario)[0]

    @property
    def max_feed(self) -> float:
        """Highest feed to choose [mm/rev]: of ``feed_range``, and of the inserts."""
        highest = min(feed_range(self.scenario)[1], self.machine.max_feed)
        return max(highest, self.min_feed)


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
    force_share: Values  # over its law's limit [-]; 0 if it has none, and of threads and drills
    power_share: Values
    power: Values  # at the cut, without the idle power [kW]

    @property
    def load(self) -> Values:
        """The higher of the shares of force and power [-]."""
        return np.maximum(self.force_share, self.power_share)


class Motion(NamedTuple):
    """How slices are run: arrays over them; speeds and feeds are 0 if they are not run at feed."""

    time: Values  # [s]
    cutting_speed: Values  # [m/min]
    feed: Values  # [mm/rev]
    spindle_speed: Values  # [rev/min]


def motion(situation: Situation, feed: Values, speed: Values) -> Motion:
    """Return how slices are run at feeds and speeds, in the units of the program."""
    s = situation
    slices = s.removal.slices
    turning = np.maximum(spindle_speed(s, speed), MIN_SPINDLE_SPEED)
    turns = np.where(s.fed, turning, 0.0)
    # Rapid moves have no turns, and moves per minute in air may have none, as those of a bar
    # puller. A 1 in their place keeps quotients defined.
    has_turns = s.fed & (s.engaged | (turns > MIN_SPINDLE_SPEED))
    per_turn_of_time = np.where(has_turns, feed / np.where(has_turns, turns, 1.0), 0.0)
    per_turn = np.where(s.per_revolution, feed, per_turn_of_time)
    velocity = np.where(s.per_revolution, feed * turns, feed)  # [mm/min]
    feed_time = np.where(s.fed, 60.0 * slices.length / np.where(s.fed, velocity, 1.0), 0.0)
    return Motion(
        time=s.other_time + feed_time,
        cutting_speed=cutting_speed_at(turns, diameter=np.maximum(s.diameter, 2.0 * MIN_RADIUS)),
        feed=np.where(s.fed, per_turn, 0.0),
        spindle_speed=turns,
    )


def diameters(radius: Values) -> Values:
    """Return the diameters at which cutting speeds are computed [mm], above 0."""
    return 2.0 * np.maximum(radius, MIN_RADIUS)


def spindle_speed(situation: Situation, speed: Values, slices: Any = slice(None)) -> Values:
    """Return the spindle speed that takes the time of each slice [rev/min].

    At a constant cutting speed a turn takes longer at a larger radius, but never less than at the
    spindle's limit. A slice in air may be as long as its move, so the time of a turn is averaged
    over the slice.

    Args:
        situation: a program on its stock.
        speed: speeds of the slices as programmed, [m/min] where the cutting speed is constant and
            [rev/min] elsewhere; the last axis is that of the slices.
        slices: indices of the slices; by default all.
    """
    max_speed = situation.max_spindle[slices]
    min_turn = 1.0 / max_speed  # time of a turn [min]
    per_radius = 2.0 * math.pi / (1000.0 * np.maximum(speed, 1e-9))  # [min/mm]
    start = situation.removal.slices.start[slices, RADIUS]
    end = situation.removal.slices.end[slices, RADIUS]
    knee = min_turn / per_radius  # radius below which the spindle is at its limit [mm]

    def integral(radius: Values) -> Values:
        """Return the time of a turn, integrated from the axis to a radius [min mm]."""
        distance = abs(radius)
        beyond = np.maximum(distance, knee)
        at_limit = min_turn * np.minimum(distance, knee)
        total = at_limit + 0.5 * per_radius * (beyond**2 - knee**2)
        return np.asarray(np.sign(radius) * total)

    # Along the bar the radius hardly changes, and the mean over it would divide 0 by 0.
    across = end - start
    is_small = abs(across) < MIN_ACROSS
    turn_in_middle = np.maximum(per_radius * 0.5 * abs(start + end), min_turn)
    divisor = np.where(is_small, 1.0, across)
    mean_across = (integral(end) - integral(start)) / divisor
    mean_turn = np.where(is_small, turn_in_middle, mean_across)
    revolutions = np.where(situation.constant_speed[slices], 1.0 / mean_turn, speed)
    return np.asarray(np.minimum(revolutions, max_speed))


def play(
    situation: Situation,
    wear: Values | float,
    feed: Values | None = None,
    speed: Values | None = None,
) -> Play:
    """Play the slices in their order; every tool has an edge of its own.

    The part is the last of each edge, so that loads are the highest of all parts.

    Args:
        situation: a program on its stock.
        wear: flank wear at which edges are changed [mm], for all slices or each.
        feed: feeds that replace those programmed, in the same units.
        speed: speeds that replace those programmed, in the same units.
    """
    s = situation
    moved = motion(
        s,
        feed=s.feed if feed is None else feed,
        speed=s.speed if speed is None else speed,
    )
    cutting_time = moved.time - s.other_time
    count = len(moved.time)
    depth = s.removal.slices.depth

    # An edge begins the part with the life that is left of it when it is changed after the part.
    change_wear = np.broadcast_to(wear, moved.time.shape)
    used_life = np.zeros(count)
    life_at_change = np.zeros(count)
    worn = np.zeros(count)
    force_share = np.zeros(count)
    power_share = np.zeros(count)
    power = np.zeros(count)
    thickness = s.chip_thickness(moved.feed)
    for group in s.groups:
        scenario = group.scenario
        on = s.engaged & group.slices
        cutting_speed = moved.cutting_speed[on]
        lives = tool_life(scenario, cutting_speed, feed=moved.feed[on], depth=depth[on])
        used_life[on] = cutting_time[on] / lives
        life_at_change[group.slices] = used_life_at(scenario, change_wear[group.slices])
        for tool in group.tools:
            is_tool = s.by_tool[tool]
            end = life_at_change[is_tool]
            used = np.cumsum(used_life[is_tool])
            life = np.maximum(end - used[-1], 0.0) + used
            worn[is_tool] = wear_at(scenario, np.minimum(life, end))
        loaded = s.loaded & group.slices
        turns_metal = s.engaged[loaded]
        loads = loads_of_cuts(
            scenario,
            moved.cutting_speed[loaded],
            feed=thickness[loaded],
            depth=s.chip_width[loaded],
            wear=np.where(turns_metal, worn[loaded], _wear_of_other_edges(scenario)),
        )
        shares = _load_shares(scenario, loads, spindle_speed=moved.spindle_speed[loaded])
        power[loaded] = loads.power
        if group.laws.has_force_limit:
            # The thrust and its limit are those of inserts that turn.
            force_share[loaded] = np.where(turns_metal, shares.thrust_force, 0.0)
        if group.laws.has_power_limit:
            power_share[loaded] = shares.power
    return Play(
        time=moved.time,
        cutting_speed=moved.cutting_speed,
        feed=moved.feed,
        spindle_speed=moved.spindle_speed,
        used_life=used_life,
        wear=worn,
        change_wear=change_wear,
        life_at_change=life_at_change,
        force_share=force_share,
        power_share=power_share,
        power=power,
    )


def _load_shares(scenario: Scenario, loads: Loads, spindle_speed: Values) -> LoadShares:
    """Return the loads of cuts over their limits, with the idle power."""
    spindle = spindle_as_cutting_speed(scenario, spindle_speed)
    return load_shares(
        Loads(loads.thrust_force, power=loads.power + idle_power_at(scenario, spindle)),
        scenario.limits,
        capacity=capacity_at(scenario, spindle),
    )


def _wear_of_other_edges(scenario: Scenario) -> float:
    """Return the flank wear at which drills and threading tools cut [mm] (assumption).

    Their wear has no law, so they count as sharp. A law of power that vanishes without wear holds
    for worn edges only, so they count as worn out.
    """
    law = scenario.material.power
    is_of_worn_edges = law.wear > 0.0 and law.wear_growth == 0.0
    return scenario.tool.wear_criterion if is_of_worn_edges else 0.0


def tool_life(scenario: Scenario, cutting_speed: Values, feed: Values, depth: Values) -> Values:
    """Return the cutting time from a fresh edge to the wear criterion [s]."""
    speed = _within_laws(scenario, cutting_speed)
    rate = life_rate(
        scenario.material.wear,
        scenario.tool.wear_criterion,
        cutting_speed=speed,
        feed=feed,
        depth_of_cut=depth,
    )
    return np.asarray(60.0 / rate)


def loads_of_cuts(
    scenario: Scenario, cutting_speed: Values, feed: Values, depth: Values, wear: Values
) -> Loads:
    """Return the loads of cuts, without the idle power.

    Power falls with the cutting speed to 0, as at the centre of a face.
    """
    material = scenario.material
    speed = _within_laws(scenario, cutting_speed)
    share = np.minimum(cutting_speed / speed, 1.0)
    return Loads(
        thrust_force=material.thrust_force(speed, feed, depth, wear=wear),
        power=material.power(speed, feed, depth, wear=wear) * share,
    )


def spindle_as_cutting_speed(scenario: Scenario, spindle_speed: Values) -> Values:
    """Return spindle speeds [rev/min] as cutting speeds [m/min] at the workpiece's diameter.

    By these the scenario states the power of its spindle.
    """
    return np.asarray(cutting_speed_at(spindle_speed, scenario.workpiece.diameter))


def highest_feed(
    scenario: Scenario,
    cutting_speed: Values,
    spindle_speed: Values,
    depth: Values,
    wear: Values,
    max_feed: float,
) -> Values:
    """Return the highest feed within the limits of force and power, up to ``max_feed`` [mm/rev]."""
    material = scenario.material
    unit_feed = np.ones_like(cutting_speed)  # 1 mm/rev
    load = loads_of_cuts(scenario, cutting_speed, feed=unit_feed, depth=depth, wear=wear)
    max_force = scenario.limits.thrust_force
    max_power = cutting_power_limit(scenario, spindle_as_cutting_speed(scenario, spindle_speed))
    by_force = feed_at_limit(material.thrust_force, max_force, at_unit_feed=load.thrust_force)
    by_power = feed_at_limit(material.power, max_power, at_unit_feed=load.power)
    feed: Values = np.minimum(np.minimum(by_force, by_power), max_feed)
    return feed


def _within_laws(scenario: Scenario, cutting_speed: Values) -> Values:
    """Return the cutting speed at which the laws are evaluated.

    It is not below the machine's lowest (assumption).
    """
    return np.maximum(cutting_speed, scenario.machine.cutting_speed_min)
