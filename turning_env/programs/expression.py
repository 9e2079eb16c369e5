"""Arithmetic of synchronized actions: numbers, variables, + - * / and parentheses."""

import operator
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

from turning_env.programs.numbers import NUMBER, number_text

DEEPEST = 20
"""Parentheses within parentheses that are read."""
_TOKEN = re.compile(rf"\s*(?:({NUMBER})|(\$[A-Z_]+(?:\[[A-Z0-9]+\])?)|([-+*/()]))")
_OPERATIONS: dict[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}
_RANK = {"+": 0, "-": 0, "*": 1, "/": 1}
"""Which operation comes first, of equals the left one."""


@dataclass(frozen=True)
class Number:
    """A number, which is not negative: the sign is an operation."""

    number: float

    def value(self, variables: Mapping[str, float]) -> float:
        """Itself."""
        return self.number

    def __str__(self) -> str:
        return number_text(self.number)


@dataclass(frozen=True)
class Variable:
    """A variable of the control."""

    name: str

    def value(self, variables: Mapping[str, float]) -> float:
        """What it is now."""
        return variables[self.name]

    def __str__(self) -> str:
        return self.name


@dataclass(frozen=True)
class Operation:
    """Two expressions and what is done with them. Its text has the parentheses that it needs, and no others."""

    left: "Expression"
    sign: str
    right: "Expression"

    def value(self, variables: Mapping[str, float]) -> float:
        """Its result.

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
    """The expression of a text, in which the variables ``readable`` may stand.

    Raises:
        ValueError: it is none; says why.
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
    """Takes tokens from the front, product before sum."""

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
            if depth == DEEPEST:
                raise ValueError(f"parentheses are nested more than {DEEPEST} deep")
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
