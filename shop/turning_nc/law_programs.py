"""Override laws of controllers, as synchronized actions.

A law runs in the control, in every interpolation cycle. ``one_line_law`` is a function of the load: one polynomial into the
override. The other laws go from the present override, which is kept in ``STATE``, to the next:

    next = present + gain(load) (end - present)

The gain is tabulated in polynomials of third degree between loads, into ``GAIN``.
"""

import math
from collections.abc import Callable

from turning_nc.expression import DECIMALS, number_text
from turning_nc.law import GAIN, LOAD, MAX_LOAD, MAX_OVERRIDE, OVERRIDE, STATE, Law, LawWriter
from turning_nc.program import FEED_DECIMALS, SPEED_DECIMALS, Program, rounded_within
from turning_nc.words import NcError

from baselines import catalogue
from baselines.fuzzy_override import MIN_HEADROOM
from baselines.load_override import LOWEST_OVERRIDE
from baselines.models.part_program import PartProgram, on_override, target_load
from baselines.rule import Parameters
from turning_env import Scenario
from turning_env.physics.drives import lag_share


def law_program(name: str, scenario: Scenario) -> Program:
    """Return a program of one cut along one bar at the programmed speed and feed, under a controller's override law.

    Raise KeyError or ValueError if there is no such controller on the scenario, NcError if it is not one of ``LAWS``.
    """
    entry = catalogue.spec(name, scenario)
    if name not in LAWS:
        raise NcError(
            f"{name} cannot be written as synchronized actions; those that can are {', '.join(LAWS)}"
        )
    if not on_override(scenario):
        raise NcError(f"scenario {scenario.name!r} does not set the override of a programmed feed")
    machine = scenario.machine
    parameters = {key: float(value) for key, value in entry.parameters.items()}  # type: ignore[arg-type]
    part = PartProgram(scenario.nominal(), parameters)
    speed = rounded_within(
        part.cutting_speed, machine.cutting_speed_min, machine.cutting_speed_max, SPEED_DECIMALS
    )
    return Program.of(scenario, speed, _programmed_feed(part), LAWS[name](part, parameters))


def _programmed_feed(part: PartProgram) -> float:
    machine = part.scenario.machine
    return rounded_within(part.feed, machine.feed_min, machine.feed_max, FEED_DECIMALS)


def _range_of(part: PartProgram) -> tuple[float, float]:
    """Return the lowest and highest override [%] at which neither override nor feed leaves its limits."""
    machine, feed = part.scenario.machine, _programmed_feed(part)
    high = 100.0 * min(part.override_max, machine.feed_max / feed)
    if high > MAX_OVERRIDE + 1e-9:
        raise NcError(
            f"control.override_max is {part.override_max}, but a control's override goes to {MAX_OVERRIDE} %"
        )
    # Rounded to the inside: the feed must not be below its lowest value by a last decimal.
    return math.ceil(1e8 * machine.feed_min / feed - 1e-6) / 1e6, math.floor(
        high * 1e6 + 1e-6
    ) / 1e6


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
    writer.table(
        lambda load: k * math.exp(-5.0 * (0.01 * load / target) ** 2), 0.0, middle, beyond=False
    )
    writer.table(
        lambda load: p - p * math.exp(-sharpness * (0.01 * load - target) ** 2),
        middle,
        MAX_LOAD,
        beyond=True,
    )
    _towards_end(writer, 100.0 * part.override_max, f"{LOAD}<{number_text(middle)}")
    _towards_end(writer, 100.0 * d, f"{LOAD}>={number_text(middle)}")
    return writer.law(limits)


def _constant_load(part: PartProgram, parameters: Parameters) -> Law:
    target = 100.0 * target_load(part.scenario, parameters["target"])
    share = lag_share(part.scenario.control.interval, 1.0 / parameters["gain"])
    (low, high), writer = _range_of(part), LawWriter()
    writer.polynomial(
        (-share, share / target, 0.0, 0.0), -share, share * (MAX_LOAD / target - 1.0), GAIN
    )
    _towards_end(writer, 0.0)
    return writer.law((max(100.0 * LOWEST_OVERRIDE, low), high))


LAWS: dict[str, Callable[[PartProgram, Parameters], Law]] = {
    "one_line_law": _one_line,
    "fuzzy_override": _fuzzy,
    "modified_fuzzy_override": _fuzzy,
    "iadapts": _constant_load,
}
"""Controllers that can be written as synchronized actions, by name."""
