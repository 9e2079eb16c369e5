"""The grid search's table of intervals (Alaskari and Oraby 2018): which speed and feed from when to when, as a program.

The table follows from the nominal models alone: one edge from fresh to worn out, interval by interval of its cutting time, the
pair that ``baselines.grid_search`` chooses. It ends, as the paper's, with the first interval that no pair survives.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from baselines.grid_search import best_pair, grid, predict
from turning_env import Scenario
from turning_env.action import sets_speed_and_feed
from turning_env.numerics.functions import exp
from turning_env.physics.records import parameter_records
from turning_env.physics.wear import log_wear
from turning_env.programs.course import Piece, bars_of
from turning_env.programs.program import NcError, Program
from turning_env.programs.schedule import Sums, job
from turning_env.scenario.sections import Mismatch

MAX_INTERVALS = 1_000_000


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    start: float  # cutting time of the edge [min]
    end: float  # [min]
    wear: float  # flank wear at its end [mm]
    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]


def interval_table(scenario: Scenario, interval: float | None = None) -> list[Row]:
    """The table of a scenario; successive intervals of the same pair are one row.

    Args:
        scenario: whose nominal models, grid and limits are used; of its lot nothing.
        interval: how long a pair is kept at least [min]; without, the scenario's control interval.

    Raises:
        NcError: the scenario's actions do not set speed and feed, a load falls with feed, the interval is not above 0 or so short
            that a table has more than ``MAX_INTERVALS``, or no pair keeps the limits.
    """
    job(scenario, 1)
    if not sets_speed_and_feed(scenario) or any(law.feed < 0 for _, law in scenario.material):
        raise NcError(f"the grid search cannot play scenario {scenario.name!r}")
    step = scenario.control.interval / 60.0 if interval is None else interval
    if not 0.0 < step < math.inf:
        raise NcError(f"the interval is {step} min, but must be above 0")
    rows: list[Row] = []
    for row in _intervals(scenario.nominal(), step):
        last = rows[-1] if rows else None
        if last and (last.cutting_speed, last.feed) == (row.cutting_speed, row.feed):
            rows[-1] = replace(row, start=last.start)
        else:
            rows.append(row)
    if not rows:
        raise NcError(f"no speed and feed of the grid keeps the limits for an interval of {step} min")
    return rows


def _intervals(scenario: Scenario, step: float) -> Iterator[Row]:
    parameters, limits = parameter_records(scenario)[0], scenario.limits
    speeds, feeds = grid(scenario)
    used_life = 0.0
    for count in range(MAX_INTERVALS):
        start, end = count * step, (count + 1) * step
        speed, feed = best_pair(parameters, speeds, feeds, used_life, start, end, limits.thrust_force, limits.power, 1.0)
        if speed < 0:
            return
        used_life, _, _ = predict(parameters, speeds[speed], feeds[feed], used_life, start, end)
        wear = float(exp(log_wear(parameters, used_life)))
        yield Row(start, end, wear, float(speeds[speed]), float(feeds[feed]))
    raise NcError(f"an interval of {step} min is too short: the table would have more than {MAX_INTERVALS} intervals")


def program_of(scenario: Scenario, rows: list[Row]) -> tuple[Program, Sums]:
    """A section of blocks per row, over as many bars as these are long; and what the nominal models say comes of it.

    Air before a bar is crossed at the speed and feed of the row that is under way.
    """
    course = list(_course(scenario, rows))
    program = Program.of(scenario, bars_of(scenario, course, 0.0))
    depth = scenario.workpiece.depth_of_cut
    removed = sum((row.end - row.start) * row.cutting_speed * row.feed * depth for row in rows)
    return program, Sums(removed, sum(piece.time for piece in course) / 60.0, rows[-1].wear)


def _course(scenario: Scenario, rows: list[Row]) -> Iterator[Piece]:
    workpiece = scenario.workpiece
    metal_left = 0.0  # of the bar [mm]
    for number, row in enumerate(rows, 1):
        velocity = 1000.0 * row.cutting_speed / (math.pi * workpiece.diameter) * row.feed  # [mm/min]
        note = f"section {number}: cutting time {row.start:.3f} to {row.end:.3f} min, wear to {row.wear:.3f} mm"
        left = (row.end - row.start) * velocity
        while left > 1e-9:
            if metal_left <= 1e-9:
                metal_left = workpiece.bar_length
                if workpiece.approach > 0.0:
                    air = Piece(workpiece.approach, 60.0 * workpiece.approach / velocity, row.cutting_speed, row.feed, note)
                    yield air
                    note = ""
            length = min(left, metal_left)
            yield Piece(length, 60.0 * length / velocity, row.cutting_speed, row.feed, note)
            note = ""
            left -= length
            metal_left -= length


def as_drawn(scenario: Scenario) -> Scenario:
    """A scenario whose bars, edges and lot are the nominal ones, on which a table can be checked."""
    workpiece = {name: 0.0 for name in type(scenario.workpiece).model_fields if name.endswith("_spread")}
    tool = {name: 0.0 for name in type(scenario.tool).model_fields if name.endswith("_spread")}
    return scenario.model_copy(
        update={
            "workpiece": scenario.workpiece.model_copy(update={**workpiece, "depth_ripple": 0.0, "depth_profile": ()}),
            "tool": scenario.tool.model_copy(update=tool),
            "mismatch": Mismatch(),
        }
    )
