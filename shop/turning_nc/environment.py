"""A part program as the workpiece of an environment: its tool path, with its depths and diameters.

``ToolPath`` turns a program into a scenario; ``ProgramEnv`` plays it with actions of its own.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_nc.cutting import Machine, Situation, motion
from turning_nc.moves import run
from turning_nc.program_files import read_program
from turning_nc.removal import remove
from turning_nc.stock import guessed_stock, read_stock
from turning_nc.words import NcError, naming
from turning_shop import Values

from turning_env.action import set_point_action
from turning_env.env import RoughTurningEnv
from turning_env.scenario import Scenario, Source
from turning_env.scenario.sections import MAX_DEPTHS

MAX_OVERRIDE = 2.0  # highest feed over the programmed feed [-]
TIME_LIMIT = 10.0  # time limit of an episode over the programmed time of its parts [-]
MIN_DEPTH = 0.01  # shallowest depth of cut of a section [mm]; less is air
MIN_RADIUS = 0.5  # of the path; nearer to the axis, a path would shrink to nothing [mm]

# Depths within a section differ from its mean by less than a tolerance, a share of the largest
# depth. It grows until there are few enough sections.
FIRST_TOLERANCE = 0.02
TOLERANCE_GROWTH = 1.3
MAX_TOLERANCE = 2.0
# Up to here, metal and air are not in one section.
MAX_TOLERANCE_OF_AIR = 0.3
MAX_LIMIT_RATIO = 1.3  # of speed limits within a section


class Programmed(NamedTuple):
    """Values that a program sets at a place of its path."""

    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]


class ToolPath:
    """The path of one tool of a program through its stock, and the scenario that it makes.

    The path is stretched by the ratio of the tip's diameter to a mean diameter, so that its time
    and metal at that one diameter are right. It holds the moves at feed; rapid moves, dwells and
    tool changes take no time.

    The scenario's job is a number of parts, and edges are changed automatically. Its reference
    removal rate is the program's own: metal over time at the programmed feeds and speeds. Its time
    limit is ``TIME_LIMIT`` times the programmed time of all parts.

    Attributes:
        scenario: the scenario.
        diameter: mean diameter [mm].
        lengths: of the pieces of the path [mm].
        ends: of the pieces along the path [mm].
        speeds: programmed cutting speed of the pieces [m/min].
        feeds: programmed feed of the pieces [mm/rev].
        minutes: programmed time of a part [min].
    """

    def __init__(
        self,
        program: str | os.PathLike[str],
        scenario: Source = "rough_turning",
        stock: str | None = None,
        tools: Mapping[str, str] = {},
        tool: str | None = None,
        max_spindle_speed: float = Machine.max_spindle_speed,
        parts: int = 20,
    ) -> None:
        """Read a program and sweep its tools.

        Args:
            program: a file.
            scenario: the scenario; its bars, edge changes, time limit and reference removal rate
                are replaced.
            stock: see ``stock.read_stock``; by default a stock in which the program fits.
            tools: kinds, as for ``removal.remove``.
            tool: whose edge is played; by default the one that removes most metal.
            max_spindle_speed: of the machine [rev/min].
            parts: of an episode.

        Raises:
            NcError: the program, the stock or a tool is refused, the tool cuts nothing, or there
                are no parts.
        """
        if parts < 1:
            raise NcError(f"parts is {parts}, but must be at least 1")
        base = Scenario.load(scenario)
        if base.control.action == "part":
            raise NcError(
                'control.action is "part", but a program is played where speed and feed are set '
                "step by step"
            )
        text = read_program(Path(program))
        with naming(program):
            moves = run(text)
        polygon = read_stock(stock) if stock else guessed_stock(moves, tools)[0]
        removal = remove(moves, polygon, tools)
        situation = Situation(base, Machine(max_spindle_speed), moves=moves, removal=removal)
        played = situation.fed & situation.by_tool[_cutting_tool(situation, tool)]

        slices = removal.slices
        radius = np.maximum(slices.radius[played], MIN_RADIUS)
        self.diameter = float(2.0 * np.average(radius, weights=slices.volume[played]))
        self.lengths = slices.length[played] * 2.0 * radius / self.diameter
        self.ends = np.cumsum(self.lengths)
        programmed = motion(situation, situation.feed, speed=situation.speed)
        self.speeds = programmed.cutting_speed[played]
        self.feeds = programmed.feed[played]

        # The machine of the scenario runs the program within its own range.
        machine = base.machine
        speed_range = (machine.cutting_speed_min, machine.cutting_speed_max)
        speeds = np.clip(self.speeds, *speed_range)
        feeds = np.clip(self.feeds, machine.feed_min, machine.feed_max)
        velocity = 1000.0 * speeds / (np.pi * self.diameter)  # [rev/min]
        velocity *= feeds  # [mm/min]
        self.minutes = float((self.lengths / velocity).sum())

        depth = slices.depth[played]
        spindle_limit = np.pi * 2.0 * radius * situation.max_spindle[played] / 1000.0
        sections = _merged(
            _Sections(
                lengths=self.lengths,
                depths=np.where(depth > MIN_DEPTH, depth, 0.0),
                speed_limits=np.clip(spindle_limit, *speed_range),
            )
        )
        self.scenario = self._job(base, sections, parts=parts)

    def _job(self, base: Scenario, sections: "_Sections", parts: int) -> Scenario:
        """Return the scenario in which parts of these sections are turned."""
        depths = sections.depths
        lengths = sections.lengths
        is_metal = depths > 0.0
        metal = np.pi * self.diameter * np.dot(depths, lengths) / 1000.0  # [cm3]
        removal_rate = float(metal / self.minutes)
        workpiece = {
            "bars": parts,
            "bar_length": float(lengths.sum()),
            "approach": 0.0,
            "diameter": self.diameter,
            "depth_of_cut": float(np.average(depths[is_metal], weights=lengths[is_metal])),
            "depth_profile": tuple(depths.tolist()),
            "section_lengths": tuple(lengths.tolist()),
            "section_speeds": tuple(sections.speed_limits.tolist()),
        }
        time_limit = TIME_LIMIT * parts * self.minutes
        return base.model_copy(
            update={
                "workpiece": _changed(base.workpiece, workpiece),
                "control": _changed(
                    base.control, {"edge_changes": "automatic", "time_limit": time_limit}
                ),
                "economics": _changed(base.economics, {"reference_removal_rate": removal_rate}),
            }
        )

    def programmed(self, path: float) -> Programmed:
        """Return what the program sets at a position along the row of parts [mm]."""
        place = path % self.ends[-1]
        index = int(np.searchsorted(self.ends, place, "right"))
        index = min(index, len(self.ends) - 1)
        return Programmed(
            cutting_speed=float(self.speeds[index]),
            feed=float(self.feeds[index]),
        )


class _Sections(NamedTuple):
    """Sections of a path: arrays of one length."""

    lengths: Values  # [mm]
    depths: Values  # of cut; 0 in air [mm]
    speed_limits: Values  # highest cutting speed [m/min]


def _cutting_tool(situation: Situation, tool: str | None) -> str:
    """Return the tool, or by default the one that removes most metal, if it cuts."""
    volume = situation.removal.slices.volume
    removed = {}
    for name, is_tool in situation.by_tool.items():
        of_tool = volume[is_tool]
        removed[name] = float(of_tool.sum())
    chosen = tool or max(removed, key=removed.__getitem__)
    if removed.get(chosen, 0.0) <= 0.0:
        cutting = [name for name, metal in removed.items() if metal > 0.0]
        listed = ", ".join(cutting) or "none"
        raise NcError(f"tool {chosen!r} cuts nothing; the tools that do: {listed}")
    return chosen


def _changed(section: Any, changes: Mapping[str, Any]) -> Any:
    """Return a section of a scenario with other values, checked."""
    return type(section).model_validate(section.model_dump() | changes)


def _merged(sections: _Sections) -> _Sections:
    """Return at most ``MAX_DEPTHS`` sections, with mean depths and lowest speed limits."""
    tolerance = FIRST_TOLERANCE
    starts = _starts(sections, tolerance)
    while len(starts) > MAX_DEPTHS:
        tolerance *= TOLERANCE_GROWTH
        if tolerance > MAX_TOLERANCE:
            even = np.linspace(0, len(sections.depths), MAX_DEPTHS, endpoint=False)
            starts = even.astype(int).tolist()
            break
        starts = _starts(sections, tolerance)
    lengths = np.add.reduceat(sections.lengths, starts)
    depths = np.add.reduceat(sections.lengths * sections.depths, starts) / lengths
    return _Sections(
        lengths=lengths,
        depths=np.where(depths < MIN_DEPTH, 0.0, depths),
        speed_limits=np.minimum.reduceat(sections.speed_limits, starts),
    )


def _starts(sections: _Sections, tolerance: float) -> list[int]:
    """Return the indices at which sections begin that are even enough.

    Args:
        sections: narrow sections to merge.
        tolerance: difference of a depth from the mean of its section that begins the next one, as a
            share of the largest depth [-].
    """
    lengths = sections.lengths.tolist()
    depths = sections.depths.tolist()
    limits = sections.speed_limits.tolist()
    max_difference = tolerance * max(depths)
    starts = [0]
    length = lengths[0]  # of the section up to here
    area = lengths[0] * depths[0]
    for k in range(1, len(lengths)):
        mean_depth = area / max(length, 1e-12)
        is_uneven = abs(depths[k] - mean_depth) > max_difference
        crosses_surface = (depths[k] > 0.0) != (depths[k - 1] > 0.0)
        is_slower = limits[k] < limits[starts[-1]] / MAX_LIMIT_RATIO
        if crosses_surface and tolerance >= MAX_TOLERANCE_OF_AIR:
            crosses_surface = False
        if is_uneven or crosses_surface or is_slower:
            starts.append(k)
            length = 0.0
            area = 0.0
        length += lengths[k]
        area += lengths[k] * depths[k]
    return starts


class ProgramEnv(RoughTurningEnv):
    """``RoughTurning-Program-v1``: turn the parts of a program of your own.

    The policy sets feed override and cutting speed.

    ## Description

    As `RoughTurningEnv`, but the bars are the parts of a program: one tool's path with its depth of
    cut, its diameters and the air at feed. An episode turns `parts` parts, 20 by default. An edge
    that is worn out or broken is changed within the step. A change takes 2 min, plus 3 min if the
    edge wore out, or plus 10 min if it broke. Hardness and depth vary as the scenario says. The
    spindle's limit at each diameter counts at the start of a step. `path` and lengths are at the
    program's mean diameter.

    ## Action space

    `Box(-1, 1, (2,), float32)`

    | Index | Action        | -1         | 0     | 1                            |
    |-------|---------------|------------|-------|------------------------------|
    | 0     | feed override | 0 %        | 100 % | 200 % of the programmed feed |
    | 1     | cutting speed | the lowest |       | the highest of the machine   |

    Speed and feed stay within the machine's range. `tool_path.scenario` is the job as a scenario
    for every other environment, batch and policy, with that scenario's own actions.

    ## Observation space

    As for `RoughTurningEnv`; cutting time and nominal wear are the present edge's.

    ## Reward and end

    As for `RoughTurningEnv`, with two differences. An edge costs 3 min only, because the time to
    change it passes. The reference removal rate is the program's own, its metal over its time at
    the programmed feeds and speeds. So the programmed values earn 0, less edges, stops, overload
    and breakage. Every policy that finishes removes the same metal, within the error of integration
    (1 % in a job of a minute, 0.4 % in 20 parts), so a lower cost is a higher return.

    Terminated when all parts are done (`info["finished"]`); truncated after ten times the
    programmed time of all parts. A truncated episode has then cost more than nine times what all
    metal is worth.

    ## Arguments

    Those of `ToolPath`:

        gymnasium.make(
            "turning_nc:RoughTurning-Program-v1", program="part.mpf", stock="bar:80x120", parts=10
        )
    """

    def __init__(
        self, program: str | os.PathLike[str], render_mode: str | None = None, **arguments: Any
    ) -> None:
        self.tool_path = ToolPath(program, **arguments)
        scenario = self.tool_path.scenario

        # An action of this environment is mapped to the set points of the scenario's.
        control = scenario.control.model_copy(update={"action": "set_point"})
        super().__init__(scenario.model_copy(update={"control": control}), render_mode)
        self._path = 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], Any]:
        observation, info = super().reset(seed=seed, options=options)
        self._path = float(info["path"])
        return observation, info

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, Any]:
        if np.shape(action) == (2,):  # the base class refuses others
            action = self._set_point(action)
        observation, reward, terminated, truncated, info = super().step(action)
        self._path = float(info["path"])
        return observation, reward, terminated, truncated, info

    def _set_point(self, action: Any) -> NDArray[np.float32]:
        """Return the action of ``RoughTurningEnv`` for a feed override and a cutting speed."""
        machine = self.scenario.machine
        override_action = np.clip(float(action[0]), -1.0, 1.0)
        override = 0.5 * MAX_OVERRIDE * (override_action + 1.0)
        programmed = self.tool_path.programmed(self._path)
        feed = np.float64(override * programmed.feed)
        mapped = set_point_action(feed, machine.feed_min, machine.feed_max)  # type: ignore[arg-type]
        feed_action = np.clip(mapped, -1.0, 1.0)
        return np.array((action[1], feed_action), np.float32)
