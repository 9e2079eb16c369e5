"""A part program as the workpiece of an environment: its tool path, with changing depth of cut and diameter."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from turning_nc.cutting import Machine, Situation, motion
from turning_nc.moves import run
from turning_nc.removal import remove
from turning_nc.stock import guessed_stock, read_stock
from turning_nc.words import NcError, naming, read_program_file
from turning_shop import Values

from turning_env.action import set_point_action
from turning_env.env import RoughTurningEnv
from turning_env.scenario import Scenario, Source
from turning_env.scenario.sections import MAX_DEPTHS

MAX_OVERRIDE = 2.0  # highest feed over the programmed feed [-]
TIME_LIMIT = 10.0  # time limit of an episode over the programmed time of its parts [-]
_MIN_SECTION = 0.01  # shallowest depth of cut of a section [mm]; less is air


class ToolPath:
    """The path of one tool of a program through its stock, and the scenario that it makes.

    The path is stretched by the ratio of the tip's diameter to a mean diameter, so that its time and metal at that one diameter
    are right. It holds the moves at feed; rapid moves, dwells and tool changes take no time.

    The scenario's job is a number of parts, and edges are changed automatically. Its reference removal rate is the program's own:
    metal over time at the programmed feeds and speeds. Its time limit is ``TIME_LIMIT`` times the programmed time of all parts.
    """

    def __init__(
        self,
        program: str | os.PathLike[str],
        scenario: Source = "rough_turning",  # bars, edge changes, time limit and reference removal rate are replaced
        stock: str
        | None = None,  # see ``stock.read_stock``; by default a bar that the program fits in
        tools: Mapping[str, str] = {},  # kinds, as for ``stock.remove``
        tool: str | None = None,  # whose edge is played; by default the one that removes most metal
        max_spindle_speed: float = Machine.max_spindle_speed,  # of the machine [rev/min]
        parts: int = 20,  # of an episode
    ) -> None:
        """Read a program and sweep its tools.

        Raises:
            NcError: the program, the stock or a tool is refused, the tool cuts nothing, or there are no parts.
        """
        if parts < 1:
            raise NcError(f"parts is {parts}, but must be at least 1")
        base = Scenario.load(scenario)
        if base.control.action == "part":
            raise NcError(
                'control.action is "part", but a program is played where speed and feed are set step by step'
            )
        text = read_program_file(Path(program))
        with naming(program):
            moves = run(text)
        removal = remove(
            moves, read_stock(stock) if stock else guessed_stock(moves, tools)[0], tools
        )
        situation = Situation(base, Machine(max_spindle_speed), moves, removal)
        slices = removal.slices
        metal = {name: float(slices.volume[mine].sum()) for name, mine in situation.by_tool.items()}
        tool = tool or max(metal, key=metal.__getitem__)
        if metal.get(tool, 0.0) <= 0.0:
            cutting = ", ".join(name for name, removed in metal.items() if removed > 0.0) or "none"
            raise NcError(f"tool {tool!r} cuts nothing; the tools that do: {cutting}")
        machine, mine = base.machine, situation.fed & situation.by_tool[tool]
        depth = np.where(slices.depth[mine] > _MIN_SECTION, slices.depth[mine], 0.0)
        radius = np.maximum(slices.radius[mine], 0.5)
        self.diameter = float(2.0 * np.average(radius, weights=slices.volume[mine]))
        self.lengths = slices.length[mine] * 2.0 * radius / self.diameter
        self.ends = np.cumsum(self.lengths)
        _, self.speeds, self.feeds, _ = (
            values[mine] for values in motion(situation, situation.feed, situation.speed)
        )
        speed_range = machine.cutting_speed_min, machine.cutting_speed_max
        velocity = (
            1000.0 * np.clip(self.speeds, *speed_range) / (np.pi * self.diameter)
        )  # [rev/min]
        velocity *= np.clip(self.feeds, machine.feed_min, machine.feed_max)  # [mm/min]
        self.minutes = float((self.lengths / velocity).sum())
        limits = np.clip(np.pi * 2.0 * radius * situation.max_spindle[mine] / 1000.0, *speed_range)
        lengths, depths, limits = _merged(self.lengths, depth, limits)
        cut = depths > 0.0
        removal_rate = (
            np.pi * self.diameter * np.dot(depths, lengths) / 1000.0 / self.minutes
        )  # [cm3/min]
        workpiece: dict[str, Any] = {
            "bars": parts,
            "bar_length": float(lengths.sum()),
            "approach": 0.0,
        }
        workpiece |= {
            "diameter": self.diameter,
            "depth_of_cut": float(np.average(depths[cut], weights=lengths[cut])),
        }
        profile = {"depth_profile": depths, "section_lengths": lengths, "section_speeds": limits}
        workpiece |= {name: tuple(values.tolist()) for name, values in profile.items()}
        job = {"edge_changes": "automatic", "time_limit": TIME_LIMIT * parts * self.minutes}
        changes = {
            "workpiece": workpiece,
            "control": job,
            "economics": {"reference_removal_rate": float(removal_rate)},
        }
        sections = {name: getattr(base, name) for name in changes}
        changed = {
            name: type(old).model_validate(old.model_dump() | changes[name])
            for name, old in sections.items()
        }
        self.scenario = base.model_copy(update=changed)

    def programmed(self, path: float) -> tuple[float, float]:
        """Return the programmed cutting speed [m/min] and feed [mm/rev] at a position along the row of parts [mm]."""
        index = min(
            int(np.searchsorted(self.ends, path % self.ends[-1], "right")), len(self.ends) - 1
        )
        return float(self.speeds[index]), float(self.feeds[index])


def _merged(lengths: Values, depths: Values, limits: Values) -> tuple[Values, Values, Values]:
    """Return lengths, mean depths and lowest limits of at most ``MAX_DEPTHS`` sections."""
    tolerance = 0.02
    starts: list[int] = []
    while not starts or (len(starts) > MAX_DEPTHS and tolerance <= 2.0):
        starts = _starts(lengths, depths, limits, tolerance)
        tolerance *= 1.3
    if len(starts) > MAX_DEPTHS:
        starts = np.linspace(0, len(depths), MAX_DEPTHS, endpoint=False).astype(int).tolist()
    total = np.add.reduceat(lengths, starts)
    mean = np.add.reduceat(lengths * depths, starts) / total
    mean = np.where(mean < _MIN_SECTION, 0.0, mean)
    return total, mean, np.minimum.reduceat(limits, starts)


def _starts(lengths: Values, depths: Values, limits: Values, tolerance: float) -> list[int]:
    """Return where sections begin, so that depths differ from their section's mean by less than a share of the largest depth."""
    starts = [0]
    apart = tolerance * float(depths.max())
    length, area = float(lengths[0]), float(lengths[0] * depths[0])  # of the section up to here
    cuts = (depths > 0.0).tolist()
    for k, (next_length, depth, limit) in enumerate(
        zip(lengths.tolist(), depths.tolist(), limits.tolist(), strict=True)
    ):
        if k == 0:
            continue
        into_metal = cuts[k] != cuts[k - 1] and tolerance < 0.3
        if (
            abs(depth - area / max(length, 1e-12)) > apart
            or into_metal
            or limit < limits[starts[-1]] / 1.3
        ):
            starts.append(k)
            length = area = 0.0
        length += next_length
        area += next_length * depth
    return starts


class ProgramEnv(RoughTurningEnv):
    """``RoughTurning-Program-v1``: turn the parts of a program of your own; the policy sets feed override and speed.

    ## Description

    As `RoughTurningEnv`, but the bars are the parts of a program: one tool's path with its depth of cut, its diameters and the
    air at feed. An episode turns `parts` parts, 20 by default. An edge that is worn out or broken is changed within the step.
    A change takes 2 min, plus 3 min if the edge wore out, or plus 10 min if it broke. Hardness and depth vary as the scenario
    says. The spindle's limit at each diameter counts at the start of a step. `path` and lengths are at the program's mean
    diameter.

    ## Action space

    `Box(-1, 1, (2,), float32)`

    | Index | Action        | -1           | 0                  | 1                              |
    |-------|---------------|--------------|--------------------|--------------------------------|
    | 0     | feed override | 0 %          | 100 %              | 200 % of the programmed feed   |
    | 1     | cutting speed | the lowest   |                    | the highest of the machine     |

    Speed and feed stay within the machine's range. `tool_path.scenario` is the job as a scenario for every other environment,
    batch and policy, with that scenario's own actions.

    ## Observation space

    As for `RoughTurningEnv`; cutting time and nominal wear are the present edge's.

    ## Reward and end

    As for `RoughTurningEnv`, with two differences. An edge costs 3 min only, because the time to change it passes. The reference
    removal rate is the program's own, its metal over its time at the programmed feeds and speeds. So the programmed values earn
    0, less edges, stops, overload and breakage. Every policy that finishes removes the same metal, within the error of
    integration (1 % in a job of a minute, 0.4 % in 20 parts), so a lower cost is a higher return.

    Terminated when all parts are done (`info["finished"]`); truncated after ten times the programmed time of all parts. A
    truncated episode has then cost more than nine times what all metal is worth.

    ## Arguments

    Those of `ToolPath`:

        gymnasium.make("turning_nc:RoughTurning-Program-v1", program="part.mpf", stock="bar:80x120", parts=10)
    """

    def __init__(
        self, program: str | os.PathLike[str], render_mode: str | None = None, **arguments: Any
    ) -> None:
        self.tool_path = ToolPath(program, **arguments)
        scenario = self.tool_path.scenario
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
        if np.shape(action) == (2,):  # others are refused below
            machine = self.scenario.machine
            override = 0.5 * MAX_OVERRIDE * (np.clip(float(action[0]), -1.0, 1.0) + 1.0)
            feed = override * self.tool_path.programmed(self._path)[1]
            mapped = set_point_action(np.float64(feed), machine.feed_min, machine.feed_max)  # type: ignore[arg-type]
            action = np.array((action[1], np.clip(mapped, -1.0, 1.0)), np.float32)
        observation, reward, terminated, truncated, info = super().step(action)
        self._path = float(info["path"])
        return observation, reward, terminated, truncated, info
