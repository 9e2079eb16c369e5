"""Expressions in programs, such as ``-R1*2`` or ``[#100+5.]``, and numbers as they are written."""

import ast
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from types import CodeType

DECIMALS = (
    12  # decimals of written numbers: at a load of 200 %, the error of a cubic term is at most 4e-6
)
MAX_LENGTH = 500  # characters of an expression; a block of a control has fewer
MAX_SHOWN = 40  # characters of an expression that a message shows
_TOKEN = re.compile(
    r"""\s*(?:(?P<number>\d+\.?\d*|\.\d+)(?![\w.]) | (?P<variable>[\#R]\d+|\#<\w+>|\$[A-Z_]+(?:\[[A-Z0-9]+\])?)(?![_\d]) |
    (?P<other><=|>=|<>|==|[-+*/<>()[\]]|(?:AND|OR|EQ|NE|GT|GE|LT|LE|MOD)(?![A-Z]) |
    (?:ABS|SIN|COS|TAN|SQRT|EXP|LN|FIX|FUP|ROUND|TRUNC)(?=\s*[\[(])))\s*""",
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
}
_PYTHON |= {"LE": "<=", "MOD": "%"}
_FUNCTIONS = {
    **{
        "ABS": abs,
        "SQRT": math.sqrt,
        "FIX": math.trunc,
        "TRUNC": math.trunc,
        "FUP": math.ceil,
        "ROUND": round,
    },
    **{
        "SIN": lambda degrees: math.sin(math.radians(degrees)),
        "COS": lambda degrees: math.cos(math.radians(degrees)),
    },
    **{"TAN": lambda degrees: math.tan(math.radians(degrees)), "EXP": math.exp, "LN": math.log},
}
_NODES = (
    *(
        ast.Expression,
        ast.BinOp,
        ast.UnaryOp,
        ast.Compare,
        ast.BoolOp,
        ast.Constant,
        ast.Subscript,
        ast.Name,
        ast.Call,
    ),
    *(ast.operator, ast.unaryop, ast.cmpop, ast.boolop, ast.expr_context),
)


@dataclass(frozen=True)
class Expression:
    """A sum, product, function, comparison or conjunction of numbers and variables of the control."""

    text: str
    variables: frozenset[str]
    _code: CodeType = field(repr=False, compare=False)

    def value(self, variables: Mapping[str, float]) -> float:
        """Return the value, which is finite; a comparison's is 1 or 0.

        Raises:
            KeyError: a variable has no value.
            ZeroDivisionError: it divides by 0.
            ValueError: it takes the root or the logarithm of a number below 0, or its value is too large.
        """
        try:
            value = float(
                eval(self._code, {"__builtins__": {}, **_FUNCTIONS}, {"variables": variables})
            )
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
            f"an expression of {len(text)} characters is longer than the {MAX_LENGTH} that are read: {shown}"
        )
    place = 0
    python: list[str] = []
    variables: set[str] = set()
    while place < len(text):
        match = _TOKEN.match(text, place)
        if match is None:
            raise ValueError(
                f"{text[place:].strip()[:MAX_SHOWN]!r} is neither number, variable, operator nor parenthesis"
            )
        place = match.end()
        token = match[match.lastgroup or 0]
        if match.lastgroup == "number":
            number = float(token)
            if not math.isfinite(number):
                raise ValueError(f"the number {token[:MAX_SHOWN]}... is too large")
            token = repr(number)
        elif match.lastgroup == "variable":
            variables.add(token)
            token = f"variables[{token!r}]"
        python.append(_PYTHON.get(token, token))
    try:
        tree = ast.parse(" ".join(python), mode="eval")  # made of the tokens above alone
        if not all(_is_allowed(node) for node in ast.walk(tree)):
            raise SyntaxError
        return Expression(text.strip(), frozenset(variables), compile(tree, text, "eval"))
    except (SyntaxError, RecursionError, MemoryError):
        raise ValueError(
            f"{shown} is not an expression of numbers, variables, + - * / and parentheses"
        ) from None


def _is_allowed(node: ast.AST) -> bool:
    """Return whether a node is one of an expression; a function takes one argument."""
    if isinstance(node, ast.Call):
        return isinstance(node.func, ast.Name) and len(node.args) == 1
    return isinstance(node, _NODES)


def number_text(value: float, decimals: int = DECIMALS) -> str:
    """Return a number as a decimal with 1 to ``decimals`` decimals, without needless zeros and without exponent."""
    whole, _, digits = f"{value:.{decimals}f}".partition(".")
    text = f"{whole}.{digits.rstrip('0') or '0'}"
    return text.removeprefix("-") if float(text) == 0.0 else text
