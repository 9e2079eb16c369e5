"""Expressions in programs, such as ``-R1*2`` or ``[#100+5.]``, and numbers as they are written.

Controls differ in some operations: AND and OR work on bits or on truth values, and bind more or
less tightly; MOD, FIX and FUP differ for numbers below 0. Only what means the same on all of them
has a value here; the rest is refused. The caller gives the values of variables, and knows which
variables a control has.
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from operator import itemgetter
from typing import NamedTuple

DECIMALS = 12
MAX_LENGTH = 500  # characters of an expression; a block of a control has fewer
MAX_SHOWN = 40  # characters of an expression that a message shows

# Difference below which two numbers count as equal, relative or absolute. A control computes with
# decimals, where 0.1 + 0.2 is 0.3.
SAME = 1e-9

# Variables are those of Fanuc (#100), LinuxCNC (#<name>) and SINUMERIK (R1, $AC_PARAM[0]).
# Comparisons and functions by name are Fanuc's custom macro B; LinuxCNC has them, too.
_TOKEN = re.compile(
    r"""
    \s*
    (?:
        (?P<number>\d+\.?\d*|\.\d+)(?![\w.]) |
        (?P<variable>[\#R]\d+|\#<\w+>|\$[A-Z_]+(?:\[[A-Z0-9]+\])?)(?![_\d]) |
        (?P<function>(?:ABS|SIN|COS|TAN|SQRT|EXP|LN|FIX|FUP|ROUND|TRUNC)(?=\s*[\[(])) |
        (?P<operator>
            <=|>=|<>|==|[-+*/<>()[\]] |
            (?:AND|OR|EQ|NE|GT|GE|LT|LE|MOD)(?![A-Z])
        )
    )
    \s*
    """,
    re.ASCII | re.VERBOSE,
)

Variables = Mapping[str, float]
Value = Callable[[Variables], float]
"""The value of a part of an expression, by the values of variables."""
Operation = Callable[[float, float], float]


# Operations.


def _is_same(first: float, second: float) -> bool:
    return math.isclose(first, second, rel_tol=SAME, abs_tol=SAME)


def _equal(first: float, second: float) -> float:
    return float(_is_same(first, second))


def _unequal(first: float, second: float) -> float:
    return float(not _is_same(first, second))


def _greater(first: float, second: float) -> float:
    return float(first > second and not _is_same(first, second))


def _less(first: float, second: float) -> float:
    return _greater(second, first)


def _at_least(first: float, second: float) -> float:
    return 1.0 - _less(first, second)


def _at_most(first: float, second: float) -> float:
    return 1.0 - _greater(first, second)


def _and(first: float, second: float) -> float:
    _check_truth("AND", first, second)
    return min(first, second)


def _or(first: float, second: float) -> float:
    _check_truth("OR", first, second)
    return max(first, second)


def _check_truth(name: str, *values: float) -> None:
    """Raise ValueError unless numbers are 1 or 0: of these, bits and truth values are the same."""
    for value in values:
        if value not in (0.0, 1.0):
            raise ValueError(
                f"{name} of {value:g} differs between controls (bits or truth values): "
                "it is read of comparisons, 1 and 0"
            )


def _remainder(first: float, second: float) -> float:
    if first < 0.0 or second < 0.0 or first % 1.0 or second % 1.0:
        raise ValueError("MOD of numbers below 0 or with decimals differs between controls")
    return first % second


COMPARISONS: dict[str, Operation] = {
    "EQ": _equal,
    "==": _equal,
    "NE": _unequal,
    "<>": _unequal,
    "GT": _greater,
    ">": _greater,
    "GE": _at_least,
    ">=": _at_least,
    "LT": _less,
    "<": _less,
    "LE": _at_most,
    "<=": _at_most,
}
LOGIC: dict[str, Operation] = {"AND": _and, "OR": _or}
SUMS: dict[str, Operation] = {
    "+": lambda first, second: first + second,
    "-": lambda first, second: first - second,
}
PRODUCTS: dict[str, Operation] = {
    "*": lambda first, second: first * second,
    "/": lambda first, second: first / second,
    "MOD": _remainder,
}


OPERATIONS = COMPARISONS | LOGIC | SUMS | PRODUCTS


def _sine(degrees: float) -> float:
    return math.sin(math.radians(degrees))


def _cosine(degrees: float) -> float:
    return math.cos(math.radians(degrees))


def _tangent(degrees: float) -> float:
    return math.tan(math.radians(degrees))


def _nearest(value: float) -> float:
    """Return the nearest whole number; halves go away from 0, as on controls."""
    return math.copysign(math.floor(abs(value) + 0.5), value)


def _whole_below(value: float) -> float:
    """FIX: towards 0 on a Fanuc, down in LinuxCNC."""
    _check_sign("FIX", value)
    return math.floor(value)


def _whole_above(value: float) -> float:
    """FUP: away from 0 on a Fanuc, up in LinuxCNC."""
    _check_sign("FUP", value)
    return math.ceil(value)


def _check_sign(name: str, value: float) -> None:
    if value < 0.0 and value % 1.0:
        raise ValueError(f"{name} of a number below 0, {value:g}, differs between controls")


_FUNCTIONS: dict[str, Callable[[float], float]] = {
    "ABS": abs,
    "SQRT": math.sqrt,
    "FIX": _whole_below,
    "TRUNC": math.trunc,
    "FUP": _whole_above,
    "ROUND": _nearest,
    "SIN": _sine,
    "COS": _cosine,
    "TAN": _tangent,
    "EXP": math.exp,
    "LN": math.log,
}


# Expressions.


@dataclass(frozen=True)
class Expression:
    """A sum, product, function, comparison or conjunction of numbers and a control's variables."""

    text: str
    variables: frozenset[str]
    _value: Value = field(repr=False, compare=False)

    def value(self, variables: Variables) -> float:
        """Return the value, which is finite; a comparison's is 1 or 0.

        Raises:
            KeyError: a variable has no value.
            ZeroDivisionError: it divides by 0.
            ValueError: it takes the root or the logarithm of a number below 0, its value is too
                large, or controls differ in it.
        """
        try:
            value = float(self._value(variables))
        except OverflowError:
            raise ValueError("its value is too large") from None
        except RecursionError:
            raise ValueError("it has too many operations") from None
        if not math.isfinite(value):
            raise ValueError("its value is too large")
        return value


@lru_cache(10_000)
def parse(text: str) -> Expression:
    """Return the expression of a text.

    Raises:
        ValueError: the text is not an expression, or controls differ in how they read it.
    """
    shown = repr(text.strip()[:MAX_SHOWN])
    if len(text) > MAX_LENGTH:
        raise ValueError(
            f"an expression of {len(text)} characters is longer than "
            f"the {MAX_LENGTH} that are read: {shown}"
        )
    parser = _Parser(_tokens(text))
    try:
        value = parser.whole()
    # Deep nesting exhausts Python's stack before it exhausts ``MAX_LENGTH``.
    except (_NoExpression, RecursionError):
        raise ValueError(
            f"{shown} is not an expression of numbers, variables, + - * / and parentheses"
        ) from None
    return Expression(text.strip(), frozenset(parser.variables), value)


class _Token(NamedTuple):
    kind: str  # number, variable, function or operator
    text: str


def _tokens(text: str) -> list[_Token]:
    """Return the tokens of an expression.

    Raises:
        ValueError: a part of the text is no token, or a number is too large.
    """
    tokens = []
    place = 0
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None:
            rest = text[place:].strip()[:MAX_SHOWN]
            raise ValueError(f"{rest!r} is neither number, variable, operator nor parenthesis")
        place = match.end()
        # The pattern is a choice of groups, so the last group is the only one that matched.
        kind = match.lastgroup
        assert kind is not None
        token = _Token(kind, match[kind])
        if kind == "number" and not math.isfinite(float(token.text)):
            raise ValueError(f"the number {token.text[:MAX_SHOWN]}... is too large")
        tokens.append(token)
    return tokens


class _NoExpression(Exception):  # noqa: N818 - it is no error of the caller
    """The tokens are no expression."""


class _Parser:
    """A parser by recursive descent: each method reads what its name says, from the next token."""

    def __init__(self, tokens: Sequence[_Token]) -> None:
        self._tokens = tokens
        self._place = 0
        self._primary_begin = 0  # where the last primary that was read begins
        self.variables: set[str] = set()

    @property
    def _next(self) -> _Token:
        """The next token; an operator without text at the end."""
        if self._place < len(self._tokens):
            return self._tokens[self._place]
        return _Token("operator", "")

    def _take(self, *texts: str) -> str:
        """Take the next token if it is one of some operators; return it, or an empty text."""
        token = self._next
        if token.kind != "operator" or token.text not in texts:
            return ""
        self._place += 1
        return token.text

    def whole(self) -> Value:
        """Return the value of all tokens."""
        value = self._condition()
        if self._place < len(self._tokens):
            raise _NoExpression
        return value

    def _condition(self) -> Value:
        """Read operands of AND or of OR, or a comparison.

        Fanuc binds AND as tightly as a product, LinuxCNC less than a comparison, and SINUMERIK in
        between. So operands need brackets, and so does AND beside OR.
        """
        begin = self._place
        value = self._comparison()
        name = self._take(*LOGIC)
        if not name:
            return value
        if self._primary_begin != begin:
            raise _unclear(name)
        value = _combined(LOGIC[name], value, self._primary())
        while self._take(name):
            value = _combined(LOGIC[name], value, self._primary())
        if self._next.text in OPERATIONS:
            raise _unclear(name)
        return value

    def _comparison(self) -> Value:
        """Read a sum, or the comparison of two."""
        value = self._sum()
        name = self._take(*COMPARISONS)
        if not name:
            return value
        value = _combined(COMPARISONS[name], value, self._sum())
        if self._next.text in COMPARISONS:
            raise ValueError(
                f"controls differ in chains of comparisons, such as {name} and "
                f"{self._next.text} here: write each in brackets"
            )
        return value

    def _sum(self) -> Value:
        value = self._product()
        while name := self._take(*SUMS):
            value = _combined(SUMS[name], value, self._product())
        return value

    def _product(self) -> Value:
        value = self._factor()
        while name := self._take(*PRODUCTS):
            value = _combined(PRODUCTS[name], value, self._factor())
        return value

    def _factor(self) -> Value:
        """Read a number with or without signs."""
        sign = self._take("+", "-")
        if not sign:
            return self._primary()
        value = self._factor()
        return value if sign == "+" else _applied(lambda number: -number, value)

    def _primary(self) -> Value:
        """Read a number, a variable, a function, or an expression in brackets."""
        begin = self._place
        token = self._next
        self._place += 1
        value: Value
        if token.kind == "number":
            value = _constant(float(token.text))
        elif token.kind == "variable":
            self.variables.add(token.text)
            value = itemgetter(token.text)
        elif token.kind == "function":
            opening = self._take("[", "(")
            value = _applied(_FUNCTIONS[token.text], self._in_brackets(opening))
        else:
            value = self._in_brackets(token.text)
        self._primary_begin = begin
        return value

    def _in_brackets(self, opening: str) -> Value:
        """Read an expression and its closing bracket, after the opening one."""
        closing = {"[": "]", "(": ")"}.get(opening)
        if closing is None:
            raise _NoExpression
        value = self._condition()
        if not self._take(closing):
            raise _NoExpression
        return value


def _unclear(name: str) -> ValueError:
    """Return the error for AND or OR beside other operators."""
    return ValueError(
        f"controls differ in how tightly {name} binds: write its operands in brackets"
    )


def _constant(number: float) -> Value:
    return lambda variables: number


def _combined(operation: Operation, first: Value, second: Value) -> Value:
    return lambda variables: operation(first(variables), second(variables))


def _applied(function: Callable[[float], float], value: Value) -> Value:
    return lambda variables: function(value(variables))


def number_text(value: float, decimals: int = DECIMALS) -> str:
    """Return a number with 1 to ``decimals`` decimals, without needless zeros and exponent."""
    rounded = f"{value:.{decimals}f}"
    whole, _, digits = rounded.partition(".")
    needed_digits = digits.rstrip("0") or "0"
    text = f"{whole}.{needed_digits}"
    # A value that rounds to 0 has no sign.
    if float(text) == 0.0:
        return text.removeprefix("-")
    return text
