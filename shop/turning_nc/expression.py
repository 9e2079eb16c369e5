"""Expressions in programs, such as ``-R1*2`` or ``[#100+5.]``, and numbers as they are written.

The caller gives the values of variables, and knows which variables a control has.
"""

import ast
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from types import CodeType

DECIMALS = 12
MAX_LENGTH = 500  # characters of an expression; a block of a control has fewer
MAX_SHOWN = 40  # characters of an expression that a message shows

# Variables are those of Fanuc (#100), LinuxCNC (#<name>) and SINUMERIK (R1, $AC_PARAM[0]).
# Comparisons and functions by name are Fanuc's custom macro B; LinuxCNC has them, too.
_TOKEN = re.compile(
    r"""
    \s*
    (?:
        (?P<number>\d+\.?\d*|\.\d+)(?![\w.]) |
        (?P<variable>[\#R]\d+|\#<\w+>|\$[A-Z_]+(?:\[[A-Z0-9]+\])?)(?![_\d]) |
        (?P<other>
            <=|>=|<>|==|[-+*/<>()[\]] |
            (?:AND|OR|EQ|NE|GT|GE|LT|LE|MOD)(?![A-Z]) |
            (?:ABS|SIN|COS|TAN|SQRT|EXP|LN|FIX|FUP|ROUND|TRUNC)(?=\s*[\[(])
        )
    )
    \s*
    """,
    re.ASCII | re.VERBOSE,
)
_PYTHON = {
    "[": "(",
    "]": ")",
    "AND": "and",
    "OR": "or",
    "EQ": "==",
    "NE": "!=",
    "<>": "!=",
    "GT": ">",
    "GE": ">=",
    "LT": "<",
    "LE": "<=",
    "MOD": "%",
}
"""Operators of controls, and Python's."""


def _sine(degrees: float) -> float:
    return math.sin(math.radians(degrees))


def _cosine(degrees: float) -> float:
    return math.cos(math.radians(degrees))


def _tangent(degrees: float) -> float:
    return math.tan(math.radians(degrees))


def _nearest(value: float) -> float:
    """Return the nearest whole number; halves go away from 0, as on controls."""
    return math.copysign(math.floor(abs(value) + 0.5), value)


_FUNCTIONS = {
    "ABS": abs,
    "SQRT": math.sqrt,
    "FIX": math.trunc,
    "TRUNC": math.trunc,
    "FUP": math.ceil,
    "ROUND": _nearest,
    "SIN": _sine,
    "COS": _cosine,
    "TAN": _tangent,
    "EXP": math.exp,
    "LN": math.log,
}
_NODES = (
    ast.Expression,
    ast.BinOp,
    ast.UnaryOp,
    ast.Compare,
    ast.BoolOp,
    ast.Constant,
    ast.Subscript,
    ast.Name,
    ast.Call,
    ast.operator,
    ast.unaryop,
    ast.cmpop,
    ast.boolop,
    ast.expr_context,
)


@dataclass(frozen=True)
class Expression:
    """A sum, product, function, comparison or conjunction of numbers and a control's variables."""

    text: str
    variables: frozenset[str]
    _code: CodeType = field(repr=False, compare=False)

    def value(self, variables: Mapping[str, float]) -> float:
        """Return the value, which is finite; a comparison's is 1 or 0.

        Raises:
            KeyError: a variable has no value.
            ZeroDivisionError: it divides by 0.
            ValueError: it takes the root or the logarithm of a number below 0, or its value is
                too large.
        """
        names = {"__builtins__": {}, **_FUNCTIONS}
        try:
            value = float(eval(self._code, names, {"variables": variables}))
        except OverflowError:
            raise ValueError("its value is too large") from None
        if not math.isfinite(value):
            raise ValueError("its value is too large")
        return value


@lru_cache(10_000)
def parse(text: str) -> Expression:
    """Return the expression of a text.

    Raises:
        ValueError: the text is not an expression.
    """
    shown = repr(text.strip()[:MAX_SHOWN])
    if len(text) > MAX_LENGTH:
        raise ValueError(
            f"an expression of {len(text)} characters is longer than "
            f"the {MAX_LENGTH} that are read: {shown}"
        )
    python, variables = _translated(text)
    try:
        # The source holds tokens of ``_TOKEN`` alone, so evaluating it only computes.
        tree = ast.parse(python, mode="eval")
        for node in ast.walk(tree):
            if not _is_allowed(node):
                raise SyntaxError
        code = compile(tree, text, "eval")
    # Deep nesting exhausts Python's parser before it exhausts ``MAX_LENGTH``.
    except (SyntaxError, RecursionError, MemoryError):
        raise ValueError(
            f"{shown} is not an expression of numbers, variables, + - * / and parentheses"
        ) from None
    return Expression(text.strip(), variables, code)


def _translated(text: str) -> tuple[str, frozenset[str]]:
    """Return an expression as Python's source, and the variables in it.

    Raises:
        ValueError: a part of the text is no token, or a number is too large.
    """
    python: list[str] = []
    variables: set[str] = set()
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
        token = match[kind]
        if kind == "number":
            python.append(_number(token))
        elif kind == "variable":
            variables.add(token)
            python.append(f"variables[{token!r}]")
        else:
            # Some words of the control have another name in Python.
            python.append(_PYTHON.get(token, token))
    return " ".join(python), frozenset(variables)


def _number(token: str) -> str:
    """Return a number as Python writes it: a control's may begin with zeros."""
    number = float(token)
    if not math.isfinite(number):
        raise ValueError(f"the number {token[:MAX_SHOWN]}... is too large")
    return repr(number)


def _is_allowed(node: ast.AST) -> bool:
    """Return whether a node is one of an expression; a function takes one argument."""
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and len(node.args) == 1
    return isinstance(node, _NODES)


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
