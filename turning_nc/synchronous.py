"""Synchronized actions: laws from measured load to feed override, which the control runs in every interpolation cycle.

They are a subset of SINUMERIK's (Programming Guide Advanced, edition 04.00, chapter 10). ``FCTDEF`` defines a polynomial of
third degree with limits. ``SYNFCT`` assigns its value at one variable to another. Assignments compute with the four basic
operations. ``WHENEVER`` makes an action depend on comparisons. Modal actions run once per cycle, in the order of their ``ID``.
Override and load are in per cent.
"""

import operator
from collections.abc import Callable, Mapping, MutableMapping
from dataclasses import dataclass

from turning_nc.expression import Expression

OVERRIDE, LOAD = "$AC_OVR", "$AA_LOAD[S1]"
"""Feed override of the path [%], an output; load of the spindle's drive [%], measured."""
PATH_VELOCITY, SPINDLE_SPEED = "$AC_VACTB", "$AA_S[1]"
"""Actual velocity along the path [mm/min] and of the spindle [rev/min], measured."""
PARAMETERS = tuple(f"$AC_PARAM[{index}]" for index in range(10))
"""Variables to compute with."""
READABLE = (LOAD, PATH_VELOCITY, SPINDLE_SPEED, *PARAMETERS)
WRITABLE = (OVERRIDE, *PARAMETERS)
MAX_OVERRIDE = 200.0
"""Highest override that the control allows [%]."""

COMPARISONS: dict[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}


@dataclass(frozen=True)
class Polynomial:
    """``FCTDEF``: a0 + a1 x + a2 x^2 + a3 x^3, within limits."""

    number: int
    low: float
    high: float
    coefficients: tuple[float, float, float, float]

    def __call__(self, x: float) -> float:
        """Return its value at x."""
        a0, a1, a2, a3 = self.coefficients
        return min(max(a0 + x * (a1 + x * (a2 + x * a3)), self.low), self.high)


@dataclass(frozen=True)
class Condition:
    """A comparison of a variable with an expression."""

    variable: str
    comparison: str
    value: Expression

    def holds(self, variables: Mapping[str, float]) -> bool:
        """Return whether the condition holds."""
        return COMPARISONS[self.comparison](variables[self.variable], self.value.value(variables))


@dataclass(frozen=True)
class Evaluate:
    """``SYNFCT``: assigns a polynomial of one variable to another."""

    polynomial: int
    output: str
    input: str


@dataclass(frozen=True)
class Assign:
    """Assigns an expression to a variable."""

    output: str
    expression: Expression


@dataclass(frozen=True)
class Action:
    """A modal synchronized action."""

    number: int
    conditions: tuple[Condition, ...]
    """All must hold."""
    effect: Evaluate | Assign


@dataclass(frozen=True)
class Law:
    """A law: polynomials, first values of variables, and actions, in the order of their numbers."""

    polynomials: tuple[Polynomial, ...]
    initial: tuple[tuple[str, float], ...]
    actions: tuple[Action, ...]

    def variables(self) -> dict[str, float]:
        """Return the variables at the start of the program: 0 by default, and an override of 100 %."""
        return dict.fromkeys(READABLE, 0.0) | {OVERRIDE: 100.0} | dict(self.initial)

    def cycle(self, variables: MutableMapping[str, float]) -> float:
        """Run one interpolation cycle on the variables; return the override [%], 100 if no action writes it.

        Raises:
            ZeroDivisionError: an expression divides by 0, which stops a control.
        """
        polynomials = {polynomial.number: polynomial for polynomial in self.polynomials}
        variables[OVERRIDE] = 100.0
        for action in self.actions:
            if all(condition.holds(variables) for condition in action.conditions):
                effect = action.effect
                if isinstance(effect, Evaluate):
                    variables[effect.output] = polynomials[effect.polynomial](variables[effect.input])
                else:
                    variables[effect.output] = effect.expression.value(variables)
        return min(max(variables[OVERRIDE], 0.0), MAX_OVERRIDE)
