"""The interval table of the grid search (Alaskari and Oraby 2018) as a program: speed and feed over an edge's cutting time.

The table follows from the nominal models alone: for every interval of an edge's cutting time, from fresh to worn out, the pair
that ``baselines.grid_search`` chooses. As in the paper, it ends with the first interval that no pair survives.
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
from turning_env.scenario.sections import Mismatch
from turning_nc.program import NcError, Program
from turning_nc.schedule import Segment, Totals, bars_of, with_bars

MAX_INTERVALS = 1_000_000


@dataclass(frozen=True)
class Row:
    """A row of the table."""

    start: float  # cutting time of the edge [min]
    end: float  # [min]
    wear: float  # flank wear at its end [mm]
    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]


def interval_table(scenario: Scenario, interval: float | None = None) -> list[Row]:
    """Return the table of a scenario; successive intervals with the same pair are one row.

    Args:
        scenario: gives the nominal models, the grid and the limits; its model mismatch is ignored.
        interval: shortest time for which a pair is kept [min]; None: the scenario's control interval.

    Raises:
        NcError: the scenario's actions do not set speed and feed, a load falls with feed, the interval is not above 0 or so short
            that a table has more than ``MAX_INTERVALS``, or no pair keeps the limits.
    """
    with_bars(scenario, 1)  # raises if no program can be written
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


def program_of(scenario: Scenario, rows: list[Row]) -> tuple[Program, Totals]:
    """Return a program with a section of blocks per row, over as many bars as needed, and the totals by the nominal models.

    Air before a bar is crossed at the speed and feed of the current row.
    """
    segments = list(_segments(scenario, rows))
    program = Program.of(scenario, bars_of(scenario, segments, 0.0))
    depth = scenario.workpiece.depth_of_cut
    removed = sum((row.end - row.start) * row.cutting_speed * row.feed * depth for row in rows)
    return program, Totals(removed, sum(segment.time for segment in segments) / 60.0, rows[-1].wear)


def _segments(scenario: Scenario, rows: list[Row]) -> Iterator[Segment]:
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
                    yield Segment(workpiece.approach, 60.0 * workpiece.approach / velocity, row.cutting_speed, row.feed, note)
                    note = ""
            length = min(left, metal_left)
            yield Segment(length, 60.0 * length / velocity, row.cutting_speed, row.feed, note)
            note = ""
            left -= length
            metal_left -= length


def without_spreads(scenario: Scenario) -> Scenario:
    """Return the scenario without spreads and model mismatch, on which a table can be checked."""
    workpiece = {name: 0.0 for name in type(scenario.workpiece).model_fields if name.endswith("_spread")}
    tool = {name: 0.0 for name in type(scenario.tool).model_fields if name.endswith("_spread")}
    return scenario.model_copy(
        update={
            "workpiece": scenario.workpiece.model_copy(update={**workpiece, "depth_ripple": 0.0, "depth_profile": ()}),
            "tool": scenario.tool.model_copy(update=tool),
            "mismatch": Mismatch(),
        }
    )
