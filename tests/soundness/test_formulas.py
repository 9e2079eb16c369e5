"""A family's formula has a finite value, which Python agrees with, or is refused with its place."""

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from tests.soundness.acting import tried
from turning_env.scenario.formula import FormulaError, evaluate

PLACE = "fields.limits.power"
VARIABLES = {
    "speed": np.array([80.0, 120.0, 300.0]),
    "worn": np.array([-1.0, 0.0, 1.5]),
    "count": 3,
    "härte": 0.5,
}
PYTHON = {
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "minimum": lambda x, y: np.minimum(x, y),
    "maximum": lambda x, y: np.maximum(x, y),
}

NUMBERS = st.sampled_from(
    (
        "0",
        "1",
        "2",
        "-1",
        "0.5",
        "1e-300",
        "1e300",
        "9" * 400,
        "1e999",
        "0x1F",
        "1_0",
        "007",
        "1j",
        "True",
    )
)
NUMBERS |= st.floats(0.0, 1e3).map(repr) | st.integers(0, 10**20).map(str)
NAMES = st.sampled_from((*VARIABLES, *PYTHON, "x", "__import__", "speed.real", "None"))


OPERATORS = st.sampled_from(
    (
        " + ",
        " - ",
        " * ",
        " / ",
        " ** ",
        "**",
        "//",
        "%",
        " @ ",
        " and ",
        " < ",
        ", ",
        " if ",
    )
)
CALLED = st.sampled_from((*PYTHON, "abs", "speed"))


def _call(function: str, arguments: list[str]) -> str:
    return f"{function}({', '.join(arguments)})"


def _negated(part: str, times: int) -> str:
    return "-" * times + part


def _summed(part: str, times: int) -> str:
    times = min(times, 20_000 // len(part))
    return " + ".join([part] * times)


def _in_parentheses(part: str, depth: int) -> str:
    return "(" * depth + part + ")" * depth


def _larger(part: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    """Return formulas that hold a formula; some are long or deep."""
    return st.one_of(
        st.tuples(part, OPERATORS, part).map("".join),
        part.map("({})".format),
        part.map("-{}".format),
        part.map("+{}".format),
        st.builds(_call, CALLED, st.lists(part, max_size=3)),
        st.builds(_negated, part, st.integers(1, 3000)),
        st.builds(_summed, part, st.integers(1, 3000)),
        st.builds(_in_parentheses, part, st.integers(1, 300)),
    )


FORMULAS = st.recursive(NUMBERS | NAMES, _larger, max_leaves=12) | st.text(max_size=40)


def value_of(formula: Any, variables: dict[str, Any]) -> Any:
    """Return a formula's value, or None where it is refused with its place."""
    refusal = ""
    try:
        return evaluate(PLACE, formula, variables)
    except FormulaError as error:
        refusal = str(error)
    assert refusal.startswith(f"{PLACE}: ")
    assert len(refusal) < 1000
    return None


@pytest.mark.slow
@tried(short=250, soak=60_000)
@example("minimum(1.0, speed, speed)")
@example("1/0")
@example("sqrt()")
@example("-" * 20_000 + "1")
@example("1" + "+1" * 20_000)
@given(FORMULAS)
def test_a_formula_has_a_finite_value_or_is_refused(formula: str) -> None:
    variables = {
        name: np.copy(value) if isinstance(value, np.ndarray) else value
        for name, value in VARIABLES.items()
    }
    value = value_of(formula, variables)
    for name, before in VARIABLES.items():
        np.testing.assert_array_equal(variables[name], before)
    if value is None:
        return
    assert np.isfinite(value).all()
    with np.errstate(all="ignore"):
        expected = eval(formula.strip(), {"__builtins__": {}}, PYTHON | VARIABLES)
    # Sums that cancel keep few digits, so that the difference is seen beside the largest number of
    # the formula.
    np.testing.assert_allclose(
        value,
        np.asarray(expected, np.float64),
        rtol=1e-6,
        atol=1e-6,
    )
