"""Read and evaluate the formulas of families (``family.py``).

A formula has numbers, names, + - * / **, and a few functions. A file may come from anywhere, so a
formula is refused unless it is short and every number on the way to its value is finite. Values
are numbers or arrays of them. They are never changed, and the same bits come out on every
processor.
"""

import ast
import operator
import re
import sys
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from turning_env.numerics.functions import exp, log, real_power
from turning_env.scenario.section import names_instead

MAX_LENGTH = 1000  # characters; the longest formula that ships has 143
MAX_DEPTH = 100  # levels of brackets, signs and operators: a sum of n terms has n
MAX_EXPONENT = 708.0  # largest absolute argument of exp that ``numerics.functions`` takes
MIN_POSITIVE = sys.float_info.min  # smallest argument of log
MAX_EXACT = 2**53  # up to which a number holds every whole number
MAX_SHOWN = 80  # characters of a formula that an error quotes
_CHARACTERS = re.compile(r"[\w\s.+\-*/(),]*")
_TOO_LARGE = "is too large: allowed are numbers up to 1.79e308"


class FormulaError(ValueError):
    """A formula that cannot be evaluated.

    The message names its place in the file, the formula and what is allowed.
    """


class _NoValueError(Exception):
    """An operation has no value; the message says why."""


class _Function(NamedTuple):
    """A function of formulas, and the number of its arguments."""

    apply: Callable[..., Any]
    arity: int


def evaluate(place: str, formula: Any, variables: Mapping[str, Any]) -> Any:
    """Return the value of a formula; FormulaError if it has none.

    A value that is no text is no formula, and is returned as it is.

    Args:
        place: where the formula stands, such as ``fields.limits.power``.
        formula: the formula.
        variables: numbers, or arrays of one shape, by name.
    """
    if not isinstance(formula, str):
        return formula
    reader = _Reader(place, formula, variables)
    # Results that overflow or are NaN raise an error below; NumPy need not warn of them, too.
    with np.errstate(all="ignore"):
        return reader.value(reader.tree(), depth=1)


class _Reader:
    """Evaluates one formula."""

    def __init__(self, place: str, formula: str, variables: Mapping[str, Any]) -> None:
        self._place = place
        self._formula = formula.strip()
        self._variables = variables

    def tree(self) -> ast.expr:
        """Return the syntax tree of the formula; check its length and characters first."""
        if len(self._formula) > MAX_LENGTH:
            raise self._error(
                f"has {len(self._formula)} characters, but at most {MAX_LENGTH} are allowed"
            )
        if not _CHARACTERS.fullmatch(self._formula):
            raise self._error(_ALLOWED)
        try:
            return ast.parse(self._formula, mode="eval").body
        except (SyntaxError, ValueError, MemoryError, RecursionError):
            raise self._error(f"is not a formula: {_ALLOWED}") from None

    def value(self, node: ast.AST, depth: int) -> Any:
        """Return the value of a part of the formula, which lies ``depth`` levels below its top."""
        if depth > MAX_DEPTH:
            levels = f"{MAX_DEPTH} levels of brackets, signs and operators"
            raise self._error(f"has more than the {levels} that are allowed", node)
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                return self._number(node, number)
            case ast.Name(id=name):
                return self._variable(node, name)
            case ast.UnaryOp(op=op, operand=operand) if type(op) in _SIGNS:
                return self._apply(_SIGNS[type(op)], [operand], node=node, depth=depth)
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _OPERATORS:
                return self._apply(_OPERATORS[type(op)], [left, right], node=node, depth=depth)
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self._call(node, name, arguments=arguments, depth=depth)
            case _:
                raise self._error(_ALLOWED, node)

    def _number(self, node: ast.AST, number: float) -> float:
        # Not ``float(number)``: a whole number may be too large to be one.
        if abs(number) > sys.float_info.max:
            raise self._error(f"a number {_TOO_LARGE}", node)
        # A whole number stays one, for fields that count, as long as every number can hold it.
        return number if abs(number) <= MAX_EXACT else float(number)

    def _variable(self, node: ast.AST, name: str) -> Any:
        if name not in self._variables:
            advice = names_instead(name, self._variables)
            raise self._error(f"there is no variable {name!r}; {advice}", node)
        return self._variables[name]

    def _call(self, node: ast.AST, name: str, arguments: list[ast.expr], depth: int) -> Any:
        if name not in _FUNCTIONS:
            raise self._error(_ALLOWED, node)
        function = _FUNCTIONS[name]
        if len(arguments) != function.arity:
            raise self._error(
                f"{name} has {len(arguments)} arguments, but needs {function.arity}", node
            )
        return self._apply(function.apply, arguments, node=node, depth=depth)

    def _apply(
        self, function: Callable[..., Any], arguments: list[ast.expr], node: ast.AST, depth: int
    ) -> Any:
        """Return the value of a function; ``node`` is its call, ``depth`` levels below the top."""
        values = []
        for argument in arguments:
            value = self.value(argument, depth + 1)
            # Python's whole numbers grow without bounds, and have errors of their own.
            values.append(float(value) if isinstance(value, int) else value)
        try:
            result = function(*values)
        except _NoValueError as error:
            raise self._error(str(error), node) from None
        if not np.all(np.isfinite(result)):
            raise self._error(f"a result {_TOO_LARGE}", node)
        return result

    def _error(self, reason: str, node: ast.AST | None = None) -> FormulaError:
        """Return the error that quotes the formula and says where in it a part is wrong."""
        shown = self._formula
        if len(shown) > MAX_SHOWN:
            shown = f"{shown[:MAX_SHOWN]}..."
        column = getattr(node, "col_offset", None)
        if column is not None:
            # Python counts bytes.
            before = self._formula.encode()[:column].decode("utf-8", "ignore")
            reason = f"{reason} (character {len(before) + 1})"
        return FormulaError(f"{self._place}: {shown!r}: {reason}")


def _divide(dividend: Any, divisor: Any) -> Any:
    if np.any(np.equal(divisor, 0.0)):
        raise _NoValueError("/ needs a divisor other than 0, but 0 is among them")
    return operator.truediv(dividend, divisor)


def _power(base: Any, exponent: Any) -> Any:
    _check_above_zero("**", base)
    if np.any(np.abs(exponent * log(base)) > MAX_EXPONENT):
        raise _NoValueError("a result of ** is too large or too small: allowed are 1e-307 to 1e307")
    return real_power(base, exponent)


def _exp(x: Any) -> Any:
    if np.any(np.abs(x) > MAX_EXPONENT):
        allowed = f"within -{MAX_EXPONENT:g} to {MAX_EXPONENT:g}"
        raise _NoValueError(f"exp needs numbers {allowed}, but {_farthest(x)} is among them")
    return exp(x)


def _log(x: Any) -> Any:
    _check_above_zero("log", x)
    return log(x)


def _sqrt(x: Any) -> Any:
    if np.any(np.less(x, 0.0)):
        raise _NoValueError(f"sqrt needs numbers of 0 or more, but {np.min(x)} is among them")
    return np.sqrt(x)


def _minimum(x: Any, y: Any) -> Any:
    # Not ``np.minimum`` itself, whose third argument is where it writes its result.
    return np.minimum(x, y)


def _maximum(x: Any, y: Any) -> Any:
    return np.maximum(x, y)


def _check_above_zero(name: str, x: Any) -> None:
    if np.any(np.less(x, MIN_POSITIVE)):
        raise _NoValueError(f"{name} needs numbers above 0, but {np.min(x)} is among them")


def _farthest(x: Any) -> float:
    values = np.ravel(x)
    return float(values[np.argmax(np.abs(values))])


_SIGNS: dict[type, Callable[[Any], Any]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}
_OPERATORS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: _divide,
    ast.Pow: _power,
}
_FUNCTIONS = {
    "exp": _Function(_exp, 1),
    "log": _Function(_log, 1),
    "sqrt": _Function(_sqrt, 1),
    "minimum": _Function(_minimum, 2),
    "maximum": _Function(_maximum, 2),
}
_ALLOWED = f"a formula has numbers, names, + - * / ** and {', '.join(_FUNCTIONS)} only"
