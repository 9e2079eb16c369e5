"""Override laws: synchronized actions from measured load to feed override.

A control runs them in every interpolation cycle. They are a subset of SINUMERIK's (Programming
Guide Advanced, edition 04.00, chapter 10). ``FCTDEF`` defines a polynomial of third degree with
limits. ``SYNFCT`` assigns its value at one variable to another. Assignments compute with the four
basic operations. ``WHENEVER`` makes an action depend on comparisons. Modal actions run once per
cycle, in the order of their ``ID``. Override and load are in per cent.
"""

import re
from collections.abc import Callable, Iterable, Mapping, MutableMapping
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from numpy.polynomial import Polynomial as FittedPolynomial
from turning_nc.expression import DECIMALS, Expression, number_text, parse
from turning_nc.words import BlockError

OVERRIDE = "$AC_OVR"
"""Feed override of the path [%], an output."""
LOAD = "$AA_LOAD[S1]"
"""Load of the spindle's drive [%], measured."""
PATH_VELOCITY = "$AC_VACTB"
"""Actual velocity along the path [mm/min], measured."""
SPINDLE_SPEED = "$AA_S[1]"
"""Actual speed of the spindle [rev/min], measured."""
PARAMETERS = tuple(f"$AC_PARAM[{index}]" for index in range(10))
"""Variables to compute with."""
STATE = PARAMETERS[0]
"""The override of the last cycle [%], in the laws of ``LawWriter``."""
GAIN = PARAMETERS[1]
"""The function tabulated over the load, in the laws of ``LawWriter``."""
READABLE = (LOAD, PATH_VELOCITY, SPINDLE_SPEED, *PARAMETERS)
WRITABLE = (OVERRIDE, *PARAMETERS)
MAX_OVERRIDE = 200.0  # highest override that the control allows [%]
MAX_LOAD = 200.0  # load up to which a function is tabulated [%]; beyond, it is constant

# Largest error of a tabulated gain: relative, or absolute for gains below 1.
GAIN_TOLERANCE = 0.002
CHECKED_LOADS = 41  # number of loads at which a fitted piece is compared with its function

# Numbers have no exponent, because controls read exponents differently.
_NUMBER = r"-?(?:\d{1,12}(?:\.\d{0,12})?|\.\d{1,12})"

# A block of a first value; of FCTDEF, with its number, its limits and a0 to a3; and of an action.
_FIRST_VALUE = re.compile(rf"(\$AC_PARAM\[\d\])\s*=\s*({_NUMBER})")
_POLYNOMIAL = re.compile(rf"FCTDEF\((\d{{1,3}}),({_NUMBER}(?:,{_NUMBER}){{5}})\)")
_ACTION = re.compile(
    r"ID=(?P<identity>\d{1,3}) +"
    r"(?:WHENEVER +(?P<condition>\S(?:.*\S)?) +)?"
    r"DO +"
    r"(?:"
    r"SYNFCT\((?P<polynomial>\d{1,3}),(?P<output>[^,]+),(?P<input>[^,]+)\)|"
    r"(?P<variable>[^=]+)=(?P<value>[^=]+)"
    r")"
)
_FORMS = (
    "$AC_PARAM[n]=value, FCTDEF(number,lower limit,upper limit,a0,a1,a2,a3) "
    "and ID=n WHENEVER ... DO ..."
)


class Function(Protocol):
    """A function of the control's variables."""

    def value(self, variables: Mapping[str, float]) -> float:
        """Return the value."""


class Polynomial(NamedTuple):
    """A polynomial of third degree with limits: ``FCTDEF`` without its number."""

    low: float
    high: float
    a0: float
    a1: float
    a2: float
    a3: float

    def __call__(self, x: float) -> float:
        """Return the value within the limits."""
        value = self.a0 + x * (self.a1 + x * (self.a2 + x * self.a3))
        return min(max(value, self.low), self.high)


@dataclass(frozen=True)
class PolynomialOf:
    """A polynomial of an expression: the value of ``SYNFCT``."""

    polynomial: Polynomial
    expression: Expression

    def value(self, variables: Mapping[str, float]) -> float:
        """Return the value."""
        return self.polynomial(self.expression.value(variables))


class Action(NamedTuple):
    """A synchronized action."""

    condition: Expression | None
    output: str  # a variable
    function: Function


@dataclass
class Law:
    """A law: first values of variables, polynomials by their numbers, and actions by their ID."""

    lines: list[str] = field(default_factory=list)
    first_values: dict[str, float] = field(default_factory=dict, init=False, compare=False)
    polynomials: dict[int, Polynomial] = field(default_factory=dict, init=False, compare=False)
    actions: dict[int, Action] = field(default_factory=dict, init=False, compare=False)

    def __post_init__(self) -> None:
        """Read the lines."""
        lines = self.lines
        self.lines = []
        for line in lines:
            self.add(line)

    def add(self, line: str) -> None:
        """Add a block.

        Raises:
            BlockError: the block is not understood.
        """
        if match := _FIRST_VALUE.fullmatch(line):
            self.first_values[match[1]] = float(match[2])
        elif match := _POLYNOMIAL.fullmatch(line):
            polynomial = Polynomial(*map(float, match[2].split(",")))
            self.polynomials[int(match[1])] = polynomial
            if polynomial.low > polynomial.high:
                raise BlockError(
                    f"the lower limit of polynomial {match[1]} is {polynomial.low}, "
                    f"above the upper one, {polynomial.high}"
                )
        elif match := _ACTION.fullmatch(line):
            self._add_action(match)
        else:
            raise BlockError(f"{line!r} is not understood: a law consists of {_FORMS}")
        self.lines.append(line)

    def _add_action(self, match: re.Match[str]) -> None:
        """Add the action of a match."""
        number = match["polynomial"]
        output = (match["output"] if number else match["variable"]).strip()
        if output not in WRITABLE:
            raise BlockError(f"{output!r} cannot be written, only {', '.join(WRITABLE)}")
        # A control runs modal actions in the order of their ID, a law in that of its blocks.
        identity = int(match["identity"])
        last = max(self.actions, default=0)
        if identity <= last:
            raise BlockError(
                f"ID={match['identity']} must precede ID={last}: actions run in this order"
            )
        if number and int(number) not in self.polynomials:
            raise BlockError(f"polynomial {number} is not defined")
        expression = _parse(match["input"] if number else match["value"])
        function: Function = expression
        if number:
            function = PolynomialOf(self.polynomials[int(number)], expression)
        condition = None if match["condition"] is None else _parse(match["condition"])
        self.actions[identity] = Action(condition, output, function)

    def variables(self) -> dict[str, float]:
        """Return the variables at the start of the program.

        They are 0 by default, and the override is 100 %.
        """
        return dict.fromkeys(READABLE, 0.0) | {OVERRIDE: 100.0} | self.first_values

    def cycle(self, variables: MutableMapping[str, float]) -> float:
        """Run one interpolation cycle on the variables.

        Returns:
            The override [%], 100 if no action writes it.

        Raises:
            ZeroDivisionError: an expression divides by 0, which stops a control.
        """
        # Synchronized actions act on the path for one cycle: without one, the override is the
        # operator's, taken as 100 %.
        variables[OVERRIDE] = 100.0
        for action in self.actions.values():
            if action.condition is None or action.condition.value(variables):
                variables[action.output] = action.function.value(variables)
        return min(max(variables[OVERRIDE], 0.0), MAX_OVERRIDE)


def _parse(text: str) -> Expression:
    """Return an expression of variables that actions can read."""
    try:
        expression = parse(text)
    except ValueError as error:
        raise BlockError(str(error)) from None
    unknown = expression.variables - set(READABLE)
    if unknown:
        raise BlockError(
            f"the variable {min(unknown)} cannot be read here, only {', '.join(READABLE)}"
        )
    return expression


class Limits(NamedTuple):
    """Limits of the override."""

    low: float  # [%]
    high: float  # [%]


class LawWriter:
    """A writer that collects the blocks of a law and numbers them."""

    def __init__(self) -> None:
        self._polynomials: list[str] = []
        self._actions: list[str] = []

    def act(self, effect: str, *conditions: str) -> None:
        """Add an action that holds while all conditions do."""
        when = ""
        if len(conditions) == 1:
            when = f"WHENEVER {conditions[0]} "
        elif conditions:
            in_brackets = [f"({condition})" for condition in conditions]
            when = f"WHENEVER {' AND '.join(in_brackets)} "
        identity = len(self._actions) + 1
        self._actions.append(f"ID={identity} {when}DO {effect}")

    def polynomial(self, polynomial: Polynomial, output: str, *conditions: str) -> None:
        """Add a polynomial of the load, and the action that writes it to an output."""
        number = len(self._polynomials) + 1
        values = ",".join(number_text(value) for value in polynomial)
        self._polynomials.append(f"FCTDEF({number},{values})")
        self.act(f"SYNFCT({number},{output},{LOAD})", *conditions)

    def table(
        self, function: Callable[[float], float], first: float, last: float, *, beyond: bool
    ) -> None:
        """Tabulate a function of the load [%] into the gain.

        Args:
            function: a monotone function.
            first: the least load.
            last: the largest load.
            beyond: whether the gain is constant at larger loads; otherwise it is not written.
        """
        for piece in _pieces(function, round(first, DECIMALS), round(last, DECIMALS)):
            above = f"{LOAD}>={number_text(piece.first)}"
            below = f"{LOAD}<{number_text(piece.last)}"
            self.polynomial(piece.polynomial, GAIN, above, below)
        if beyond:
            value = function(last)
            constant = Polynomial(value, value, a0=value, a1=0.0, a2=0.0, a3=0.0)
            self.polynomial(constant, GAIN, f"{LOAD}>={number_text(last)}")

    def law(self, limits: Limits | None = None) -> Law:
        """Return the law; with limits, it clips the state to them and writes it to the override."""
        start: list[str] = []
        if limits is not None:
            # The state starts at 100 % and stays within the limits, so that it does not wind up.
            start.append(f"{STATE}=100.0")
            low = number_text(limits.low)
            high = number_text(limits.high)
            self.act(f"{STATE}={low}", f"{STATE}<{low}")
            self.act(f"{STATE}={high}", f"{STATE}>{high}")
            self.act(f"{OVERRIDE}={STATE}")
        return Law([*start, *self._polynomials, *self._actions])


class _Piece(NamedTuple):
    """A polynomial between two loads."""

    first: float  # [%]
    last: float  # [%]
    polynomial: Polynomial


def _pieces(function: Callable[[float], float], low: float, high: float) -> list[_Piece]:
    """Return cubic polynomials that fit a function within ``GAIN_TOLERANCE``, by bisection."""
    # A cubic through the four Chebyshev nodes is close to the best one.
    middle = 0.5 * (low + high)
    half = 0.5 * (high - low)
    angles = np.pi * (np.arange(4) + 0.5) / 4
    nodes = middle - half * np.cos(angles)
    values = [function(node) for node in nodes]
    fit = FittedPolynomial.fit(nodes, values, 3, domain=[low, high])
    checked_loads = np.linspace(low, high, CHECKED_LOADS)
    if not _is_close(fit, function, checked_loads):
        middle = round(middle, DECIMALS)
        lower = _pieces(function, low, middle)
        upper = _pieces(function, middle, high)
        return lower + upper
    coefficients = fit.convert().coef.tolist()
    coefficients += [0.0] * (4 - len(coefficients))
    lowest, highest = sorted((function(low), function(high)))
    polynomial = Polynomial(lowest, highest, *coefficients)
    return [_Piece(low, high, polynomial=polynomial)]


def _is_close(
    fit: Callable[[float], float], function: Callable[[float], float], loads: Iterable[float]
) -> bool:
    """Return whether a fit is within the tolerance at all loads."""
    for load in loads:
        value = function(load)
        tolerance = GAIN_TOLERANCE * max(1.0, abs(value))
        if not abs(fit(load) - value) <= tolerance:
            return False
    return True
