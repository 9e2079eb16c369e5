"""Override laws of controllers as synchronized actions, which the control runs in every interpolation cycle.

``one_line_law`` is a function of the load: one polynomial into the override. The other laws go from the present override to the
next. That is kept in ``STATE``, and what depends on the load is tabulated: polynomials of third degree between loads, into
``GAIN``.

    fuzzy forms, iadapts    next = present + gain(load) (end - present)
    omative                 wanted = gain(load) actual feed / programmed feed; next = wanted, or on the way up a share of the way
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.polynomial import Polynomial as Fitted

from baselines import catalogue
from baselines.fuzzy_override import MIN_HEADROOM
from baselines.load_override import LOWEST_OVERRIDE
from baselines.models.part_program import PartProgram, on_override, target_load
from baselines.omative import ENTRY_TIME
from baselines.rule import Parameters
from turning_env import Scenario
from turning_env.physics.drives import lag_share
from turning_nc.expression import as_written, number_text, parse
from turning_nc.program import FEED_DECIMALS, SPEED_DECIMALS, Block, NcError, Program, rounded_within
from turning_nc.schedule import with_bars
from turning_nc.synchronous import (
    LOAD,
    MAX_OVERRIDE,
    OVERRIDE,
    PATH_VELOCITY,
    READABLE,
    SPINDLE_SPEED,
    Action,
    Assign,
    Condition,
    Evaluate,
    Law,
    Polynomial,
)

STATE, GAIN, WANTED, TIME_IN_METAL = (f"$AC_PARAM[{index}]" for index in range(4))
AIR_LOAD = 1.0
"""Load below which the tool is taken to be in air [%] (assumption): the control has no other sign of it."""
MAX_LOAD = 200.0
"""Load up to which a law is tabulated [%]; beyond, it is constant."""
GAIN_TOLERANCE = 0.002
"""Largest error of a tabulated gain: relative, or absolute for gains below 1."""

Function = Callable[[float], float]


class _Writer:
    """Collects polynomials and actions, and numbers them."""

    def __init__(self) -> None:
        self.polynomials: list[Polynomial] = []
        self.actions: list[Action] = []

    def act(self, assignment: str, *conditions: str) -> None:
        output, _, expression = assignment.partition("=")
        self._append(Assign(output, parse(expression, READABLE)), conditions)

    def polynomial(self, coefficients: tuple[float, ...], low: float, high: float, output: str, *conditions: str) -> None:
        number = len(self.polynomials) + 1
        a0, a1, a2, a3 = (as_written(value) for value in coefficients)
        self.polynomials.append(Polynomial(number, as_written(low), as_written(high), (a0, a1, a2, a3)))
        self._append(Evaluate(number, output, LOAD), conditions)

    def table(self, function: Function, first: float, last: float, *, beyond: bool) -> None:
        """Tabulate a function of the load [%] from ``first`` to ``last`` into the gain; ``beyond``: constant above ``last``."""
        for low, high, coefficients in fitted(function, as_written(first), as_written(last)):
            lowest, highest = sorted((function(low), function(high)))
            self.polynomial(coefficients, lowest, highest, GAIN, f"{LOAD}>={number_text(low)}", f"{LOAD}<{number_text(high)}")
        if beyond:
            value = function(last)
            self.polynomial((value, 0.0, 0.0, 0.0), value, value, GAIN, f"{LOAD}>={number_text(last)}")

    def law(self, low: float, high: float) -> Law:
        """Return the law, which clips the state to limits [%] and writes it to the override."""
        for comparison, limit in (("<", low), (">", high)):
            self.act(f"{STATE}={number_text(limit)}", f"{STATE}{comparison}{number_text(limit)}")
        self.act(f"{OVERRIDE}={STATE}")
        return Law(tuple(self.polynomials), ((STATE, 100.0),), tuple(self.actions))

    def _append(self, effect: Assign | Evaluate, conditions: tuple[str, ...]) -> None:
        self.actions.append(Action(len(self.actions) + 1, tuple(map(_condition, conditions)), effect))


def _condition(text: str) -> Condition:
    for comparison in ("<=", ">=", "<", ">"):
        variable, found, value = text.partition(comparison)
        if found:
            return Condition(variable, comparison, parse(value, READABLE))
    raise AssertionError(text)


def fitted(function: Function, low: float, high: float) -> list[tuple[float, float, tuple[float, ...]]]:
    """Return cubic polynomials (from, to, a0 to a3) that fit a function within ``GAIN_TOLERANCE``, by bisection."""
    nodes = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.pi * (np.arange(4) + 0.5) / 4)
    fit = Fitted.fit(nodes, [function(node) for node in nodes], 3, domain=[low, high])
    xs = np.linspace(low, high, 41)
    if all(abs(fit(x) - y) <= GAIN_TOLERANCE * max(1.0, abs(y)) for x, y in ((x, function(x)) for x in xs)):
        coefficients = fit.convert().coef.tolist()
        return [(low, high, (*coefficients, *[0.0] * (4 - len(coefficients))))]
    middle = as_written(0.5 * (low + high))
    return fitted(function, low, middle) + fitted(function, middle, high)


def _range_of(part: PartProgram) -> tuple[float, float]:
    """Return the lowest and highest override [%] at which neither override nor feed leaves its limits."""
    machine = part.scenario.machine
    feed = rounded_within(part.feed, machine.feed_min, machine.feed_max, FEED_DECIMALS)
    high = 100.0 * min(part.override_max, machine.feed_max / feed)
    if high > MAX_OVERRIDE + 1e-9:
        raise NcError(f"control.override_max is {part.override_max}, but a control's override goes to {MAX_OVERRIDE} %")
    # Rounded to the inside: the feed must not be below its lowest value by a last decimal.
    return math.ceil(1e8 * machine.feed_min / feed - 1e-6) / 1e6, math.floor(high * 1e6 + 1e-6) / 1e6


def _one_line(part: PartProgram, parameters: Parameters) -> Law:
    (low, high), writer = _range_of(part), _Writer()
    writer.polynomial((160.0, -2.0, 0.0, 0.0), low, min(120.0, high), OVERRIDE)
    return Law(tuple(writer.polynomials), (), tuple(writer.actions))


def _towards_end(writer: _Writer, end: float, *conditions: str) -> None:
    writer.act(f"{STATE}={STATE}+{GAIN}*({number_text(end)}-{STATE})", *conditions)


def _fuzzy(part: PartProgram, parameters: Parameters) -> Law:
    target = target_load(part.scenario, parameters["target"])
    k, p, d = (parameters[name] for name in ("k", "p", "d"))
    sharpness = 10.0 / max(1.0 - target, MIN_HEADROOM)
    limits, writer, middle = _range_of(part), _Writer(), as_written(100.0 * target)
    writer.table(lambda load: k * math.exp(-5.0 * (0.01 * load / target) ** 2), 0.0, middle, beyond=False)
    writer.table(lambda load: p - p * math.exp(-sharpness * (0.01 * load - target) ** 2), middle, MAX_LOAD, beyond=True)
    _towards_end(writer, 100.0 * part.override_max, f"{LOAD}<{number_text(middle)}")
    _towards_end(writer, 100.0 * d, f"{LOAD}>={number_text(middle)}")
    return writer.law(*limits)


def _constant_load(part: PartProgram, parameters: Parameters) -> Law:
    target = 100.0 * target_load(part.scenario, parameters["target"])
    share = lag_share(part.scenario.control.interval, 1.0 / parameters["gain"])
    limits, writer = _range_of(part), _Writer()
    writer.polynomial((-share, share / target, 0.0, 0.0), -share, share * (MAX_LOAD / target - 1.0), GAIN)
    _towards_end(writer, 0.0)
    return writer.law(max(100.0 * LOWEST_OVERRIDE, limits[0]), limits[1])


def _air_gap(part: PartProgram, parameters: Parameters) -> Law:
    scenario = part.scenario
    target = 100.0 * target_load(scenario, parameters["target"])
    exponent, interval = scenario.material.power.feed, scenario.control.interval
    share = lag_share(interval, 1.0 / parameters["rise"])
    limits, writer = _range_of(part), _Writer()
    in_air, in_metal = (f"{LOAD}{comparison}{number_text(AIR_LOAD)}" for comparison in ("<", ">="))
    lowest, highest = (number_text(value) for value in (max(100.0 * LOWEST_OVERRIDE, limits[0]), limits[1]))
    feed = rounded_within(part.feed, scenario.machine.feed_min, scenario.machine.feed_max, FEED_DECIMALS)
    writer.act(f"{TIME_IN_METAL}=0.0", in_air)
    writer.table(lambda load: (target / load) ** (1.0 / exponent), AIR_LOAD, MAX_LOAD, beyond=True)
    writer.act(f"{WANTED}={GAIN}*100.0*{PATH_VELOCITY}/({SPINDLE_SPEED}*{number_text(feed)})", in_metal)
    writer.act(f"{WANTED}={lowest}", f"{WANTED}<{lowest}")
    writer.act(f"{WANTED}={highest}", f"{WANTED}>{highest}")
    writer.act(f"{STATE}={STATE}+{number_text(share)}*({WANTED}-{STATE})", in_metal, f"{WANTED}>{STATE}")
    writer.act(f"{STATE}={WANTED}", in_metal, f"{WANTED}<={STATE}")
    entering = f"{TIME_IN_METAL}<{number_text(ENTRY_TIME)}"
    writer.act(f"{STATE}={number_text(100.0 * parameters['entry'])}", in_metal, entering)
    writer.act(f"{TIME_IN_METAL}={TIME_IN_METAL}+{number_text(interval)}", in_metal)
    writer.act(f"{STATE}={highest}", in_air)
    return writer.law(*limits)


LAWS: dict[str, Callable[[PartProgram, Parameters], Law]] = {
    "one_line_law": _one_line,
    "fuzzy_override": _fuzzy,
    "modified_fuzzy_override": _fuzzy,
    "iadapts": _constant_load,
    "omative": _air_gap,
}
"""Controllers that can be written as synchronized actions, by name."""


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
    block = Block(
        -scenario.workpiece.bar_length,
        rounded_within(part.cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max, SPEED_DECIMALS),
        rounded_within(part.feed, machine.feed_min, machine.feed_max, FEED_DECIMALS),
    )
    return Program.of(scenario, ((block,),), LAWS[name](part, parameters))
