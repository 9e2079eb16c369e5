"""Expressions compute as a control does."""

import pytest
from turning_nc.expression import parse

VARIABLES = {"$AC_PARAM[0]": 7.0, "#100": 4.0, "R1": 5.0}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2+3*4", 14.0),
        ("(2+3)*4", 20.0),
        ("10-4-3", 3.0),
        ("8/4/2", 1.0),
        ("2*$AC_PARAM[0]", 14.0),
        ("[#100+.5]*-R1", -22.5),
        ("(2<3) AND (3<=2)", 0.0),
        (" 007 + 1. ", 8.0),
    ],
)
def test_expressions_compute_product_before_sum_from_the_left(text: str, value: float) -> None:
    assert parse(text).value(VARIABLES) == value


@pytest.mark.parametrize(
    "text",
    [
        pytest.param("", id="empty"),
        "1+",
        "2**3",
        "7//2",
        "()",
        "1(2)",
        "(1,2)",
        "1e3",
        "R1R2",
        "print",
        pytest.param("(" * 300, id="deep"),
        "1 2",
    ],
)
def test_other_texts_are_no_expressions(text: str) -> None:
    with pytest.raises(ValueError, match=r"expression|neither"):
        parse(text)
