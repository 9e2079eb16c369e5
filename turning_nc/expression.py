"""Numbers and expressions in programs: plain decimals, variables, + - * / and parentheses."""

import operator
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

DECIMALS = 12
"""Decimals of coefficients: at a load of 200 %, the error of a cubic term is at most 4e-6."""
NUMBER = rf"\d{{1,12}}(?:\.\d{{0,{DECIMALS}}})?|\.\d{{1,{DECIMALS}}}"
"""Regular expression of a number without sign; without exponent, because controls read exponents differently."""
MAX_DEPTH = 20
"""Deepest nesting of parentheses that is read."""
_TOKEN = re.compile(rf"\s*(?:({NUMBER})|(\$[A-Z_]+(?:\[[A-Z0-9]+\])?)|([-+*/()]))")
_OPERATIONS: dict[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}
_RANK = {"+": 0, "-": 0, "*": 1, "/": 1}
"""Precedence; operators of equal rank associate to the left."""


def number_text(value: float) -> str:
    """Return a number as a decimal with 1 to ``DECIMALS`` decimals, without needless zeros."""
    whole, _, decimals = f"{value:.{DECIMALS}f}".partition(".")
    text = f"{whole}.{decimals.rstrip('0') or '0'}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def as_written(value: float) -> float:
    """Return the number that a program holds for a value."""
    return float(number_text(value))


@dataclass(frozen=True)
class Number:
    """A number that is not negative: the sign is an operation."""

    number: float

    def value(self, variables: Mapping[str, float]) -> float:
        """Return the number."""
        return self.number

    def __str__(self) -> str:
        return number_text(self.number)


@dataclass(frozen=True)
class Variable:
    """A variable of the control."""

    name: str

    def value(self, variables: Mapping[str, float]) -> float:
        """Return the variable's value."""
        return variables[self.name]

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Operation:
    """Two expressions and an operator. Its text has no needless parentheses."""

    left: "Expression"
    sign: str
    right: "Expression"

    def value(self, variables: Mapping[str, float]) -> float:
        """Return the result.

        Raises:
            ZeroDivisionError: it divides by 0.
        """
        return _OPERATIONS[self.sign](self.left.value(variables), self.right.value(variables))

    def __str__(self) -> str:
        rank = _RANK[self.sign]
        left = f"({self.left})" if _rank(self.left) < rank else str(self.left)
        right = f"({self.right})" if _rank(self.right) <= rank else str(self.right)
        return f"{left}{self.sign}{right}"


Expression = Number | Variable | Operation


def _rank(expression: Expression) -> int:
    return _RANK[expression.sign] if isinstance(expression, Operation) else 2


def parse(text: str, readable: Collection[str]) -> Expression:
    """Return the expression of a text, which may contain the variables ``readable``.

    Raises:
        ValueError: the text is not an expression; the message says why.
    """
    parser = _Parser(_tokens(text), readable)
    expression = parser.sum(0)
    if parser.tokens:
        raise ValueError(f"{parser.tokens[0]!r} is not expected in the expression {text!r}")
    return expression


def _tokens(text: str) -> list[str]:
    tokens, place = [], 0
    while place < len(text.rstrip()):
        match = _TOKEN.match(text, place)
        if match is None:
            raise ValueError(f"{text[place:].strip()!r} is neither number, variable, + - * / nor parenthesis")
        tokens.append(match.group(match.lastindex or 0))
        place = match.end()
    return tokens


class _Parser:
    """Recursive descent; consumes tokens from the front."""

    def __init__(self, tokens: list[str], readable: Collection[str]) -> None:
        self.tokens = tokens
        self._readable = readable

    def sum(self, depth: int) -> Expression:
        expression = self._product(depth)
        while self.tokens and self.tokens[0] in "+-":
            expression = Operation(expression, self.tokens.pop(0), self._product(depth))
        return expression

    def _product(self, depth: int) -> Expression:
        expression = self._atom(depth)
        while self.tokens and self.tokens[0] in "*/":
            expression = Operation(expression, self.tokens.pop(0), self._atom(depth))
        return expression

    def _atom(self, depth: int) -> Expression:
        if not self.tokens:
            raise ValueError("an expression ends where a number or a variable must stand")
        token = self.tokens.pop(0)
        if token == "(":
            if depth == MAX_DEPTH:
                raise ValueError(f"parentheses are nested more than {MAX_DEPTH} deep")
            expression = self.sum(depth + 1)
            if not self.tokens or self.tokens.pop(0) != ")":
                raise ValueError("a parenthesis is not closed")
            return expression
        if token.startswith("$"):
            if token not in self._readable:
                raise ValueError(f"the variable {token} cannot be read here, only {', '.join(self._readable)}")
            return Variable(token)
        if token in ("+", "-", "*", "/", ")"):
            raise ValueError(f"{token!r} stands where a number or a variable must")
        return Number(float(token))
