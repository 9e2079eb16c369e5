"""Override laws: synchronized actions from measured load to feed override, which a control runs in every interpolation cycle.

They are a subset of SINUMERIK's (Programming Guide Advanced, edition 04.00, chapter 10). ``FCTDEF`` defines a polynomial of
third degree with limits. ``SYNFCT`` assigns its value at one variable to another. Assignments compute with the four basic
operations. ``WHENEVER`` makes an action depend on comparisons. Modal actions run once per cycle, in the order of their ``ID``.
Override and load are in per cent.
"""

import re
from collections.abc import Callable, Mapping, MutableMapping
from dataclasses import dataclass, field

import numpy as np
from numpy.polynomial import Polynomial as Fitted
from turning_nc.expression import DECIMALS, Expression, number_text, parse
from turning_nc.words import BlockError

OVERRIDE, LOAD = "$AC_OVR", "$AA_LOAD[S1]"
"""Feed override of the path [%], an output; load of the spindle's drive [%], measured."""
PATH_VELOCITY, SPINDLE_SPEED = "$AC_VACTB", "$AA_S[1]"
"""Actual velocity along the path [mm/min] and of the spindle [rev/min], measured."""
PARAMETERS = tuple(f"$AC_PARAM[{index}]" for index in range(10))
"""Variables to compute with."""
STATE, GAIN = PARAMETERS[:2]
"""Variables of ``LawWriter``: the override of the last cycle [%], and the function tabulated over the load."""
READABLE = (LOAD, PATH_VELOCITY, SPINDLE_SPEED, *PARAMETERS)
WRITABLE = (OVERRIDE, *PARAMETERS)
MAX_OVERRIDE = 200.0  # highest override that the control allows [%]
MAX_LOAD = 200.0  # load up to which a function is tabulated [%]; beyond, it is constant
GAIN_TOLERANCE = 0.002  # largest error of a tabulated gain: relative, or absolute for gains below 1

_NUMBER = r"-?(?:\d{1,12}(?:\.\d{0,12})?|\.\d{1,12})"
"""A number without exponent, because controls read exponents differently."""
_FIRST_VALUE = re.compile(rf"(\$AC_PARAM\[\d\])\s*=\s*({_NUMBER})")
_POLYNOMIAL = re.compile(rf"FCTDEF\((\d{{1,3}}),({_NUMBER}(?:,{_NUMBER}){{5}})\)")
_ACTION = re.compile(
    r"ID=(\d{1,3}) +(?:WHENEVER +(\S(?:.*\S)?) +)?DO +(?:SYNFCT\((\d{1,3}),([^,]+),([^,]+)\)|([^=]+)=([^=]+))"
)


Function = Callable[[Mapping[str, float]], float]
"""A function of the control's variables."""


@dataclass
class Law:
    """A law: first values; polynomials, with limits and coefficients; actions, with condition, output and its value."""

    lines: list[str] = field(default_factory=list)
    first_values: dict[str, float] = field(default_factory=dict, init=False, compare=False)
    polynomials: dict[int, tuple[float, ...]] = field(
        default_factory=dict, init=False, compare=False
    )
    actions: dict[int, tuple[Expression | None, str, Function]] = field(
        default_factory=dict, init=False, compare=False
    )

    def __post_init__(self) -> None:
        given, self.lines = self.lines, []
        for line in given:
            self.add(line)

    def add(self, line: str) -> None:
        """Add a block."""
        if match := _FIRST_VALUE.fullmatch(line):
            self.first_values[match[1]] = float(match[2])
        elif match := _POLYNOMIAL.fullmatch(line):
            low, high, *_ = self.polynomials[int(match[1])] = tuple(map(float, match[2].split(",")))
            if low > high:
                raise BlockError(
                    f"the lower limit of polynomial {match[1]} is {low}, above the upper one, {high}"
                )
        elif match := _ACTION.fullmatch(line):
            self._act(*match.groups())
        else:
            allowed = "$AC_PARAM[n]=value, FCTDEF(number,lower limit,upper limit,a0,a1,a2,a3) and ID=n WHENEVER ... DO ..."
            raise BlockError(f"{line!r} is not understood: a law consists of {allowed}")
        self.lines.append(line)

    def _act(
        self,
        identity: str,
        condition: str | None,
        number: str | None,
        target: str,
        source: str,
        *assigned: str,
    ) -> None:
        output, text = (target, source) if number else assigned
        if (output := output.strip()) not in WRITABLE:
            raise BlockError(f"{output!r} cannot be written, only {', '.join(WRITABLE)}")
        if int(identity) <= max(self.actions, default=0):
            raise BlockError(
                f"ID={identity} must precede ID={max(self.actions)}: actions run in this order"
            )
        if number is not None and int(number) not in self.polynomials:
            raise BlockError(f"polynomial {number} is not defined")
        expression, when = _parse(text), None if condition is None else _parse(condition)
        value = expression.value if number is None else self._polynomial(int(number), expression)
        self.actions[int(identity)] = when, output, value

    def _polynomial(self, number: int, expression: Expression) -> Function:
        low, high, a0, a1, a2, a3 = self.polynomials[number]

        def value(variables: Mapping[str, float]) -> float:
            x = expression.value(variables)
            return min(max(a0 + x * (a1 + x * (a2 + x * a3)), low), high)

        return value

    def variables(self) -> dict[str, float]:
        """Return the variables at the start of the program: 0 by default, and an override of 100 %."""
        return dict.fromkeys(READABLE, 0.0) | {OVERRIDE: 100.0} | self.first_values

    def cycle(self, variables: MutableMapping[str, float]) -> float:
        """Run one interpolation cycle on the variables; return the override [%], 100 if no action writes it.

        Raises:
            ZeroDivisionError: an expression divides by 0, which stops a control.
        """
        variables[OVERRIDE] = 100.0
        for condition, output, value in self.actions.values():
            if condition is None or condition.value(variables):
                variables[output] = value(variables)
        return min(max(variables[OVERRIDE], 0.0), MAX_OVERRIDE)


def _parse(text: str) -> Expression:
    try:
        expression = parse(text)
    except ValueError as error:
        raise BlockError(str(error)) from None
    if unknown := expression.variables - set(READABLE):
        raise BlockError(
            f"the variable {min(unknown)} cannot be read here, only {', '.join(READABLE)}"
        )
    return expression


class LawWriter:
    """A writer that collects the blocks of a law and numbers them."""

    def __init__(self) -> None:
        self._polynomials: list[str] = []
        self._actions: list[str] = []

    def act(self, effect: str, *conditions: str) -> None:
        """Add an action that holds while all conditions do."""
        texts = (
            conditions if len(conditions) < 2 else [f"({condition})" for condition in conditions]
        )
        when = f"WHENEVER {' AND '.join(texts)} " if texts else ""
        self._actions.append(f"ID={len(self._actions) + 1} {when}DO {effect}")

    def polynomial(
        self,
        coefficients: tuple[float, ...],
        low: float,
        high: float,
        output: str,
        *conditions: str,
    ) -> None:
        """Add a polynomial of the load, and the action that writes it to an output."""
        number = len(self._polynomials) + 1
        self._polynomials.append(
            f"FCTDEF({number},{','.join(map(number_text, (low, high, *coefficients)))})"
        )
        self.act(f"SYNFCT({number},{output},{LOAD})", *conditions)

    def table(
        self, function: Callable[[float], float], first: float, last: float, *, beyond: bool
    ) -> None:
        """Tabulate a function of the load [%] from ``first`` to ``last`` into the gain; ``beyond``: constant above ``last``."""
        for low, high, coefficients in _fitted(
            function, round(first, DECIMALS), round(last, DECIMALS)
        ):
            lowest, highest = sorted((function(low), function(high)))
            self.polynomial(
                coefficients,
                lowest,
                highest,
                GAIN,
                f"{LOAD}>={number_text(low)}",
                f"{LOAD}<{number_text(high)}",
            )
        if beyond:
            value = function(last)
            self.polynomial(
                (value, 0.0, 0.0, 0.0), value, value, GAIN, f"{LOAD}>={number_text(last)}"
            )

    def law(self, limits: tuple[float, float] | None = None) -> Law:
        """Return the law; with limits [%], it clips the state to them and writes it to the override."""
        if limits is None:
            return Law([*self._polynomials, *self._actions])
        for comparison, limit in zip("<>", map(number_text, limits), strict=True):
            self.act(f"{STATE}={limit}", f"{STATE}{comparison}{limit}")
        self.act(f"{OVERRIDE}={STATE}")
        return Law([f"{STATE}=100.0", *self._polynomials, *self._actions])


def _fitted(
    function: Callable[[float], float], low: float, high: float
) -> list[tuple[float, float, tuple[float, ...]]]:
    """Return cubic polynomials (from, to, a0 to a3) that fit a function within ``GAIN_TOLERANCE``, by bisection."""
    nodes = 0.5 * (low + high) - 0.5 * (high - low) * np.cos(np.pi * (np.arange(4) + 0.5) / 4)
    fit = Fitted.fit(nodes, [function(node) for node in nodes], 3, domain=[low, high])
    xs = np.linspace(low, high, 41)
    if all(
        abs(fit(x) - y) <= GAIN_TOLERANCE * max(1.0, abs(y))
        for x, y in ((x, function(x)) for x in xs)
    ):
        coefficients = fit.convert().coef.tolist()
        return [(low, high, (*coefficients, *[0.0] * (4 - len(coefficients))))]
    middle = round(0.5 * (low + high), DECIMALS)
    return _fitted(function, low, middle) + _fitted(function, middle, high)
