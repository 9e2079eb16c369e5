"""Play a program on the bars of a seed: its set points change at the ends of its blocks."""

import bisect
import math

import numpy as np

from turning_env import RoughTurningEnv, Scenario
from turning_env.action import set_point_action
from turning_nc.program import NcError, Program
from turning_nc.schedule import Totals, with_bars

MIN_INTERVAL = 0.001
"""Shortest control interval that a scenario allows [s]."""


def simulate(program: Program, scenario: Scenario, seed: int) -> Totals:
    """Play a program's blocks on the first bars of a seed until the program or the edge ends; return the totals.

    In every sub-step of the integration, the control reads the tool's position and commands the speed and feed of the block
    there. The drives follow as in any episode. No time passes between bars.

    Raises:
        NcError: the program has an override law, or is not one for this scenario.
    """
    if program.law is not None:
        raise NcError("the program has an override law: what it does depends on the measured load, not on its blocks alone")
    program.check(scenario)
    machine, workpiece = scenario.machine, scenario.workpiece
    env = RoughTurningEnv(_stepwise(with_bars(scenario, len(program.bars))))
    pitch = workpiece.approach + workpiece.bar_length
    blocks = [block for bar in program.bars for block in bar]
    ends = [number * pitch + program.start - block.z for number, bar in enumerate(program.bars) for block in bar]
    max_speed = program.max_spindle_speed * math.pi * program.diameter / 1000.0
    actions = [
        np.array(
            (
                _action(min(block.cutting_speed, max_speed), machine.cutting_speed_min, machine.cutting_speed_max),
                _action(block.feed, machine.feed_min, machine.feed_max),
            ),
            np.float32,
        )
        for block in blocks
    ]
    _, info = env.reset(seed=seed)
    removed = time = 0.0
    while info["path"] < ends[-1] - 1e-6:
        index = min(bisect.bisect_right(ends, info["path"] + 1e-9), len(blocks) - 1)
        _, _, terminated, truncated, info = env.step(actions[index])
        removed += info["removed"]
        time += info["time"]
        if terminated or truncated:
            break
    return Totals(removed, time / 60.0, info["wear"])


def _action(value: float, low: float, high: float) -> float:
    return float(set_point_action(np.float64(value), low, high))  # type: ignore[arg-type]


def _stepwise(scenario: Scenario) -> Scenario:
    """Return the scenario with set points as actions, and a control interval for each of its sub-steps."""
    control = scenario.control
    interval = control.interval / control.sub_steps
    finer = {"interval": interval, "sub_steps": 1} if interval >= MIN_INTERVAL else {}
    return scenario.model_copy(
        update={"control": control.model_copy(update={"action": "set_point", "edge_changes": "end", **finer})}
    )
