"""Control programs of controllers: override laws, and the interval table of the grid search.

A law runs in the control, in every interpolation cycle. ``one_line_law`` is a function of the load: one polynomial into the
override. The other laws go from the present override to the next. That is kept in ``STATE``, and what depends on the load is
tabulated: polynomials of third degree between loads, into ``GAIN``.

    fuzzy forms, iadapts    next = present + gain(load) (end - present)
    omative                 wanted = gain(load) actual feed / programmed feed; next = wanted, or on the way up a share of the way

The interval table (Alaskari and Oraby 2018) holds speed and feed over an edge's cutting time. It follows from the nominal models
alone: for every interval, from fresh to worn out, the pair that ``baselines.grid_search`` chooses. As in the paper, it ends with
the first interval that no pair survives.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from baselines import catalogue
from baselines.fuzzy_override import MIN_HEADROOM
from baselines.grid_search import best_pair, grid, predict
from baselines.load_override import LOWEST_OVERRIDE
from baselines.models.part_program import PartProgram, on_override, target_load
from baselines.omative import ENTRY_TIME
from baselines.rule import Parameters
from turning_env import Scenario
from turning_env.action import sets_speed_and_feed
from turning_env.numerics.functions import exp
from turning_env.physics.drives import lag_share
from turning_env.physics.records import parameter_records
from turning_env.physics.wear import log_wear
from turning_env.scenario.sections import Mismatch
from turning_nc.expression import DECIMALS, number_text
from turning_nc.law import (
    GAIN,
    LOAD,
    MAX_LOAD,
    MAX_OVERRIDE,
    OVERRIDE,
    PARAMETERS,
    PATH_VELOCITY,
    SPINDLE_SPEED,
    STATE,
    Law,
    LawWriter,
)
from turning_nc.program import FEED_DECIMALS, SPEED_DECIMALS, Block, Program, rounded_within
from turning_nc.schedule import Segment, bars_of
from turning_nc.simulate import Totals, with_bars
from turning_nc.words import NcError

WANTED, TIME_IN_METAL = PARAMETERS[2:4]
AIR_LOAD = 1.0
"""Load below which the tool is taken to be in air [%] (assumption): the control has no other sign of it."""
MAX_INTERVALS = 1_000_000


def law_program(name: str, scenario: Scenario) -> Program:
    """Return a program of one cut along one bar at the programmed speed and feed, under a controller's override law.

    Raises:
        KeyError: there is no such controller.
        NcError: the controller is not one of ``LAWS``, or the scenario does not set the override of a programmed feed.
        ValueError: the controller cannot play the scenario, or has not been tuned for it.
    """
    entry = catalogue.spec(name, scenario)
    if name not in LAWS:
        raise NcError(f"{name} cannot be written as synchronized actions; those that can are {', '.join(LAWS)}")
    with_bars(scenario, 1)  # raises if no program can be written
    if not on_override(scenario):
        raise NcError(f"scenario {scenario.name!r} does not set the override of a programmed feed")
    machine = scenario.machine
    parameters = {key: float(value) for key, value in entry.parameters.items()}  # type: ignore[arg-type]
    part = PartProgram(scenario.nominal(), parameters)
    speed = rounded_within(part.cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max, SPEED_DECIMALS)
    block = Block(-scenario.workpiece.bar_length, speed, _programmed_feed(part))
    return Program.of(scenario, ((block,),), LAWS[name](part, parameters))


def _programmed_feed(part: PartProgram) -> float:
    machine = part.scenario.machine
    return rounded_within(part.feed, machine.feed_min, machine.feed_max, FEED_DECIMALS)


def _range_of(part: PartProgram) -> tuple[float, float]:
    """Return the lowest and highest override [%] at which neither override nor feed leaves its limits."""
    machine, feed = part.scenario.machine, _programmed_feed(part)
    high = 100.0 * min(part.override_max, machine.feed_max / feed)
    if high > MAX_OVERRIDE + 1e-9:
        raise NcError(f"control.override_max is {part.override_max}, but a control's override goes to {MAX_OVERRIDE} %")
    # Rounded to the inside: the feed must not be below its lowest value by a last decimal.
    return math.ceil(1e8 * machine.feed_min / feed - 1e-6) / 1e6, math.floor(high * 1e6 + 1e-6) / 1e6


def _one_line(part: PartProgram, parameters: Parameters) -> Law:
    (low, high), writer = _range_of(part), LawWriter()
    writer.polynomial((160.0, -2.0, 0.0, 0.0), low, min(120.0, high), OVERRIDE)
    return writer.law()


def _towards_end(writer: LawWriter, end: float, *conditions: str) -> None:
    writer.act(f"{STATE}={STATE}+{GAIN}*({number_text(end)}-{STATE})", *conditions)


def _fuzzy(part: PartProgram, parameters: Parameters) -> Law:
    target = target_load(part.scenario, parameters["target"])
    k, p, d = (parameters[name] for name in ("k", "p", "d"))
    sharpness = 10.0 / max(1.0 - target, MIN_HEADROOM)
    limits, writer, middle = _range_of(part), LawWriter(), round(100.0 * target, DECIMALS)
    writer.table(lambda load: k * math.exp(-5.0 * (0.01 * load / target) ** 2), 0.0, middle, beyond=False)
    writer.table(lambda load: p - p * math.exp(-sharpness * (0.01 * load - target) ** 2), middle, MAX_LOAD, beyond=True)
    _towards_end(writer, 100.0 * part.override_max, f"{LOAD}<{number_text(middle)}")
    _towards_end(writer, 100.0 * d, f"{LOAD}>={number_text(middle)}")
    return writer.law(limits)


def _constant_load(part: PartProgram, parameters: Parameters) -> Law:
    target = 100.0 * target_load(part.scenario, parameters["target"])
    share = lag_share(part.scenario.control.interval, 1.0 / parameters["gain"])
    (low, high), writer = _range_of(part), LawWriter()
    writer.polynomial((-share, share / target, 0.0, 0.0), -share, share * (MAX_LOAD / target - 1.0), GAIN)
    _towards_end(writer, 0.0)
    return writer.law((max(100.0 * LOWEST_OVERRIDE, low), high))


def _air_gap(part: PartProgram, parameters: Parameters) -> Law:
    scenario = part.scenario
    target = 100.0 * target_load(scenario, parameters["target"])
    exponent, interval = scenario.material.power.feed, scenario.control.interval
    share = lag_share(interval, 1.0 / parameters["rise"])
    limits, writer = _range_of(part), LawWriter()
    in_air, in_metal = (f"{LOAD}{comparison}{number_text(AIR_LOAD)}" for comparison in ("<", ">="))
    lowest, highest = (number_text(value) for value in (max(100.0 * LOWEST_OVERRIDE, limits[0]), limits[1]))
    writer.act(f"{TIME_IN_METAL}=0.0", in_air)
    writer.table(lambda load: (target / load) ** (1.0 / exponent), AIR_LOAD, MAX_LOAD, beyond=True)
    actual = f"100.0*{PATH_VELOCITY}/({SPINDLE_SPEED}*{number_text(_programmed_feed(part))})"
    writer.act(f"{WANTED}={GAIN}*{actual}", in_metal)
    writer.act(f"{WANTED}={lowest}", f"{WANTED}<{lowest}")
    writer.act(f"{WANTED}={highest}", f"{WANTED}>{highest}")
    writer.act(f"{STATE}={STATE}+{number_text(share)}*({WANTED}-{STATE})", in_metal, f"{WANTED}>{STATE}")
    writer.act(f"{STATE}={WANTED}", in_metal, f"{WANTED}<={STATE}")
    entering = f"{TIME_IN_METAL}<{number_text(ENTRY_TIME)}"
    writer.act(f"{STATE}={number_text(100.0 * parameters['entry'])}", in_metal, entering)
    writer.act(f"{TIME_IN_METAL}={TIME_IN_METAL}+{number_text(interval)}", in_metal)
    writer.act(f"{STATE}={highest}", in_air)
    return writer.law(limits)


LAWS: dict[str, Callable[[PartProgram, Parameters], Law]] = {
    "one_line_law": _one_line,
    "fuzzy_override": _fuzzy,
    "modified_fuzzy_override": _fuzzy,
    "iadapts": _constant_load,
    "omative": _air_gap,
}
"""Controllers that can be written as synchronized actions, by name."""


@dataclass(frozen=True)
class Row:
    """A row of the interval table."""

    start: float
    """Cutting time of the edge at its begin [min]."""
    end: float  # [min]
    wear: float
    """Flank wear at its end [mm]."""
    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]


def interval_table(scenario: Scenario, interval: float | None = None) -> list[Row]:
    """Return the interval table of a scenario; successive intervals with the same pair are one row.

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
    nominal = scenario.nominal()
    parameters, limits, (speeds, feeds) = parameter_records(nominal)[0], nominal.limits, grid(nominal)
    rows: list[Row] = []
    used_life = 0.0
    for count in range(MAX_INTERVALS):
        start, end = count * step, (count + 1) * step
        speed, feed = best_pair(parameters, speeds, feeds, used_life, start, end, limits.thrust_force, limits.power, 1.0)
        if speed < 0:
            break
        used_life, _, _ = predict(parameters, speeds[speed], feeds[feed], used_life, start, end)
        row = Row(start, end, float(exp(log_wear(parameters, 0, used_life))), float(speeds[speed]), float(feeds[feed]))
        if rows and (rows[-1].cutting_speed, rows[-1].feed) == (row.cutting_speed, row.feed):
            row = replace(row, start=rows.pop().start)
        rows.append(row)
    else:
        raise NcError(f"an interval of {step} min is too short: the table would have more than {MAX_INTERVALS} intervals")
    if not rows:
        raise NcError(f"no speed and feed of the grid keeps the limits for an interval of {step} min")
    return rows


def table_program(scenario: Scenario, rows: list[Row]) -> tuple[Program, Totals]:
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
            stretches = []
            if metal_left <= 1e-9:
                metal_left = workpiece.bar_length
                stretches = [workpiece.approach] if workpiece.approach > 0.0 else []
            cut = min(left, metal_left)
            for length in (*stretches, cut):
                yield Segment(length, 60.0 * length / velocity, row.cutting_speed, row.feed, note)
                note = ""
            left -= cut
            metal_left -= cut


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
