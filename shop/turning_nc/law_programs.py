"""Programs of controllers: their override laws as synchronized actions.

A law runs in the control, in every interpolation cycle. ``one_line_law`` is a function of the load:
one polynomial into the override. The other laws go from the present override, which is kept in
``STATE``, to the next:

    next = present + gain(load) (end - present)

The gain is tabulated in polynomials of third degree between loads, into ``GAIN``.
"""

import math
from collections.abc import Callable

from turning_nc.expression import DECIMALS, number_text
from turning_nc.law import (
    GAIN,
    LOAD,
    MAX_LOAD,
    MAX_OVERRIDE,
    OVERRIDE,
    STATE,
    Law,
    LawWriter,
    Limits,
    Polynomial,
)
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
    """Return a program of one cut along one bar, under a controller's override law.

    Speed and feed are those of the part program that the controller adapts.

    Raises:
        KeyError: there is no such controller.
        ValueError: the controller cannot play the scenario.
        NcError: the controller is not one of ``LAWS``, or the scenario sets no override.
    """
    entry = catalogue.spec(name, scenario)
    if name not in LAWS:
        raise NcError(
            f"{name} cannot be written as synchronized actions; "
            f"those that can are {', '.join(LAWS)}"
        )
    if not on_override(scenario):
        raise NcError(f"scenario {scenario.name!r} does not set the override of a programmed feed")
    parameters = {key: float(value) for key, value in entry.parameters.items()}  # type: ignore[arg-type]
    part = PartProgram(scenario.nominal(), parameters)
    machine = scenario.machine
    cutting_speed = rounded_within(
        part.cutting_speed,
        machine.cutting_speed_min,
        high=machine.cutting_speed_max,
        decimals=SPEED_DECIMALS,
    )
    law = LAWS[name](part, parameters)
    return Program.of(scenario, cutting_speed, feed=_programmed_feed(part), law=law)


def _programmed_feed(part: PartProgram) -> float:
    """Return the feed of the part program in the control's resolution [mm/rev]."""
    machine = part.scenario.machine
    return rounded_within(
        part.feed, machine.feed_min, high=machine.feed_max, decimals=FEED_DECIMALS
    )


def _limits(part: PartProgram) -> Limits:
    """Return the limits within which neither override nor feed leaves its range."""
    machine = part.scenario.machine
    feed = _programmed_feed(part)
    high = 100.0 * min(part.override_max, machine.feed_max / feed)
    if high > MAX_OVERRIDE + 1e-9:
        raise NcError(
            f"control.override_max is {part.override_max}, "
            f"but a control's override goes to {MAX_OVERRIDE} %"
        )
    # Rounded to the inside: the feed must not be below its lowest value by a last decimal.
    return Limits(
        low=math.ceil(1e8 * machine.feed_min / feed - 1e-6) / 1e6,
        high=math.floor(high * 1e6 + 1e-6) / 1e6,
    )


def _one_line(part: PartProgram, parameters: Parameters) -> Law:
    """Return the law 160 % - 2 * load, at most 120 %."""
    limits = _limits(part)
    writer = LawWriter()
    # The example of multiplicative adaptive control in Siemens's guide to synchronized actions.
    line = Polynomial(limits.low, min(120.0, limits.high), a0=160.0, a1=-2.0, a2=0.0, a3=0.0)
    writer.polynomial(line, OVERRIDE)
    return writer.law()


def _towards_end(writer: LawWriter, end: float, *conditions: str) -> None:
    """Add the action that goes a share, the gain, of the way to an end [%]."""
    writer.act(f"{STATE}={STATE}+{GAIN}*({number_text(end)}-{STATE})", *conditions)


def _fuzzy(part: PartProgram, parameters: Parameters) -> Law:
    """Return the law of the fuzzy controllers: bells of the load to both sides of their target."""
    target = target_load(part.scenario, parameters["target"])
    gain_below = parameters["k"]
    gain_above = parameters["p"]
    sharpness = 10.0 / max(1.0 - target, MIN_HEADROOM)
    limits = _limits(part)
    middle = round(100.0 * target, DECIMALS)
    middle_text = number_text(middle)

    # Equations (1), (3) and (5) of the fuzzy override paper go by a share W towards the highest
    # override: W = k exp(-5 (load / target)^2).
    def below(load: float) -> float:
        ratio = 0.01 * load / target
        return gain_below * math.exp(-5.0 * ratio**2)

    # Equations (2), (4), (6) and (7) go by a share 1 - W towards d: 1 - W = p - p exp(...).
    def above(load: float) -> float:
        distance = 0.01 * load - target
        return gain_above - gain_above * math.exp(-sharpness * distance**2)

    writer = LawWriter()
    writer.table(below, 0.0, last=middle, beyond=False)
    writer.table(above, middle, last=MAX_LOAD, beyond=True)
    highest = 100.0 * part.override_max
    _towards_end(writer, highest, f"{LOAD}<{middle_text}")
    _towards_end(writer, 100.0 * parameters["d"], f"{LOAD}>={middle_text}")
    return writer.law(limits)


def _constant_load(part: PartProgram, parameters: Parameters) -> Law:
    """Return the law of a constant load: the override falls by a share of the load's excess.

    The share is that of a first-order lag in one interpolation cycle.
    """
    target = 100.0 * target_load(part.scenario, parameters["target"])
    share = lag_share(part.scenario.control.interval, 1.0 / parameters["gain"])
    limits = _limits(part)
    # next = present - share (load / target - 1) present, so that the end is 0.
    excess = Polynomial(
        low=-share,
        high=share * (MAX_LOAD / target - 1.0),
        a0=-share,
        a1=share / target,
        a2=0.0,
        a3=0.0,
    )
    writer = LawWriter()
    writer.polynomial(excess, GAIN)
    _towards_end(writer, 0.0)
    return writer.law(Limits(max(100.0 * LOWEST_OVERRIDE, limits.low), limits.high))


LAWS: dict[str, Callable[[PartProgram, Parameters], Law]] = {
    "one_line_law": _one_line,
    "fuzzy_override": _fuzzy,
    "modified_fuzzy_override": _fuzzy,
    "iadapts": _constant_load,
}
"""Controllers that can be written as synchronized actions, by name."""
