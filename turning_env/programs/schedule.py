"""The schedule of a given row of bars: what a controller commanded along it, as a program."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from turning_env import RoughTurningEnv, Scenario
from turning_env.programs.course import Piece, bars_of
from turning_env.programs.program import NcError, Program
from turning_env.score.policy import PolicyFactory

TOLERANCE = 0.01
"""Up to which speeds and feeds become one block, as a share."""


@dataclass(frozen=True)
class Sums:
    """What came of a play."""

    removed: float  # [cm3]
    time: float
    """Machine time [min]."""
    wear: float
    """Flank wear at the end [mm]."""

    def difference(self, other: "Sums") -> float:
        """The largest of the relative differences [-]."""
        mine, its = ((sums.removed, sums.time, sums.wear) for sums in (self, other))
        return max(abs(a - b) / max(abs(b), 1e-9) for a, b in zip(mine, its, strict=True))


def job(scenario: Scenario, bars: int) -> Scenario:
    """A scenario that ends after so many bars: the same ones.

    Raises:
        NcError: the scenario is not one that a program can be written for; names the field.
    """
    control, workpiece = scenario.control, scenario.workpiece
    if control.action == "part":
        raise NcError('control.action is "part", but a schedule is written where speed and feed are set by the interval')
    if control.edge_changes != "end":
        raise NcError(f'control.edge_changes is {control.edge_changes!r}, but a program is written for one edge: only "end"')
    most = workpiece.bars or 1000
    if not 1 <= bars <= most:
        raise NcError(f"{bars} bars asked for, but there must be 1 to {most}")
    return scenario.model_copy(update={"workpiece": workpiece.model_copy(update={"bars": bars})})


def played(
    make_policy: PolicyFactory,
    scenario: Scenario,
    seed: int,
    bars: int,
    tolerance: float = TOLERANCE,
    on_path: Callable[[float], object] = lambda path: None,
) -> tuple[Program, Sums]:
    """Let a controller turn the first bars of a draw; return the program of what it commanded, and what came of it.

    Where the edge or the time ends before the bars do, the program ends there.

    Args:
        make_policy: makes the controller, for one lane.
        scenario: what it plays.
        seed: of the draw.
        bars: how many.
        tolerance: see ``turning_env.programs.course.bars_of``.
        on_path: called after each interval with where the tool is along the row [mm].

    Raises:
        NcError: see ``job``.
        ValueError: the controller's actions are not finite numbers.
    """
    env = RoughTurningEnv(job(scenario, bars))
    observation, info = env.reset(seed=seed)
    policy = make_policy(1)
    policy.reset(np.ones(1, np.bool_))
    course: list[Piece] = []
    path = removed = 0.0
    ended = False
    while not ended:
        observation, _, terminated, truncated, info = env.step(policy.act(observation[None])[0])
        ended = terminated or truncated
        removed += info["removed"]
        course.append(Piece(info["path"] - path, info["time"], info["commanded_cutting_speed"], info["commanded_feed"]))
        path = info["path"]
        on_path(path)
    row = scenario.workpiece.approach + scenario.workpiece.bar_length
    if path > bars * row:  # the last sub-step leads beyond the last bar
        course[-1] = replace(course[-1], length=course[-1].length - (path - bars * row))
    program = Program.of(scenario, bars_of(scenario, course, tolerance))
    return program, Sums(removed, sum(piece.time for piece in course) / 60.0, info["wear"])
