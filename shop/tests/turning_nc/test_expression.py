"""Expressions compute as a control does; what controls differ in is refused."""

import itertools
import re
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from turning_nc.expression import parse
from turning_nc.words import NcError

from shop.tests.turning_nc.programs import BAR, moves

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
        ("[2 LT 3] AND [#100 EQ 4] AND [R1 NE 4]", 1.0),
        ("[2 GT 3] OR [3 GE 3]", 1.0),
        ("[3 GT 2] GT 1", 0.0),
        ("1+1 GT 2-1", 1.0),
        ("0.1+0.2 EQ 0.3", 1.0),
        ("0.1+0.2 LE 0.3", 1.0),
        ("0.1+0.2 GT 0.3", 0.0),
        ("17 MOD 5 * 2", 4.0),
        ("FIX[7.9]+FUP[7.1]", 15.0),
        ("TRUNC(-1.5)", -1.0),
        ("ROUND[-2.5]", -3.0),
        (" 007 + 1. ", 8.0),
    ],
)
def test_expressions_compute_as_on_a_control(text: str, value: float) -> None:
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
        "[1)",
        "NOT 1",
    ],
)
def test_other_texts_are_no_expressions(text: str) -> None:
    with pytest.raises(ValueError, match=r"expression|neither"):
        parse(text)


# What controls differ in.

NUMBERS = (0, 1, 2, 3, 5, 12, -1, 0.5)
"""Operands of AND and OR; only the first two are truth values."""


@pytest.mark.parametrize("name", ["AND", "OR"])
def test_and_and_or_have_a_value_only_of_truth_values(name: str) -> None:
    for first, second in itertools.product(NUMBERS, repeat=2):
        expression = parse(f"[{first}] {name} [{second}]")
        if {first, second} <= {0, 1}:
            # Bits and truth values agree here.
            bits = first & second if name == "AND" else first | second  # type: ignore[operator]
            assert expression.value({}) == bits
        else:
            with pytest.raises(ValueError, match="differs between controls"):
                expression.value({})


COMPARISONS = ("EQ", "NE", "GT", "GE", "LT", "LE", "<", ">", "==", "<>", "<=", ">=")


@pytest.mark.parametrize(
    ("first", "second"), list(itertools.product(COMPARISONS[:6], COMPARISONS[6:]))
)
def test_chains_of_comparisons_are_refused(first: str, second: str) -> None:
    for text in (f"3 {first} 2 {second} 1", f"1+[3 {second} 2 {first} 1]"):
        with pytest.raises(ValueError, match="chains of comparisons"):
            parse(text)
    assert parse(f"[3 {first} 2] {second} 1").value({}) in (0.0, 1.0)


@pytest.mark.parametrize(
    "text",
    [
        "1 AND 0 OR 1",
        "1 OR 1 AND 0",
        "2 GT 1 AND 1",
        "1 AND 2 GT 1",
        "1 EQ 1 AND 2 EQ 2",
        "1 + 0 AND 1",
        "1 AND 1 + 0",
        "1 AND 1 * 0",
        "1 OR 0 MOD 2",
        "2 * 0 OR 1",
        "[1 AND 0] OR 1 GT 2",
    ],
)
def test_operands_of_and_and_or_need_brackets(text: str) -> None:
    with pytest.raises(ValueError, match="in brackets"):
        parse(text)


@pytest.mark.parametrize("text", ["7.5 MOD 2", "-7 MOD 2", "7 MOD [0-2]", "FIX[-1.5]", "FUP[-1.2]"])
def test_numbers_below_0_are_refused_where_controls_differ(text: str) -> None:
    with pytest.raises(ValueError, match="differs between controls"):
        parse(text).value({})


@pytest.mark.slow
@given(st.recursive(st.sampled_from(["0", "1", "#1"]), lambda inner: st.tuples(inner, inner)))
def test_conjunctions_in_brackets_agree_with_bits(tree: object) -> None:
    text, bits = written(tree, "AND", "&")
    assert parse(text).value({"#1": 1.0}) == eval(bits)
    text, bits = written(tree, "OR", "|")
    assert parse(text).value({"#1": 1.0}) == eval(bits)


def written(tree: object, name: str, bits: str) -> tuple[str, str]:
    """Return a tree of operands as a control writes it, and as Python's operation on bits."""
    if isinstance(tree, str):
        return tree, tree.replace("#1", "1")
    assert isinstance(tree, tuple)
    (first, first_bits), (second, second_bits) = (written(part, name, bits) for part in tree)
    return f"[{first} {name} {second}]", f"({first_bits} {bits} {second_bits})"


@given(st.integers(0, 10**9), st.integers(1, 10**6), st.integers(0, 10**6))
def test_whole_numbers_compute_as_in_python(first: int, second: int, third: int) -> None:
    for text in (f"{first}+{second}*{third}-{second}", f"[{first}-{third}]*{second}"):
        python = re.sub(r"\[(.*?)\]", r"(\1)", text)
        assert parse(text).value({}) == eval(python)
    assert parse(f"{first} MOD {second}").value({}) == first % second


def test_nested_conjunctions_are_read_at_once() -> None:
    text = "1"
    while len(text) < 480:
        text = f"[{text} AND 1]"
    begin = time.process_time()
    assert parse(text).value({}) == 1.0
    assert time.process_time() - begin < 0.5


# The same in programs.


@pytest.mark.parametrize(
    "value", ["[12 OR 3]", "[5 AND 3]", "[3 GT 2 GT 1]", "[1 EQ 1 AND 2 EQ 2]"]
)
def test_a_program_with_an_unclear_value_is_refused_with_its_line(value: str) -> None:
    line = BAR.count("\n") + 1
    with pytest.raises(NcError, match=f"line {line}: .*controls"):
        moves(f"{BAR}#1={value}\nG1 Z[0-#1] F0.2")


def test_a_program_may_join_conditions_in_brackets() -> None:
    loop = "#1=0\nWHILE [[#1 LT 0.3] AND [#1 GE 0]] DO1\nG1 U-0.2 F0.2\n#1=#1+0.1\nEND1"
    assert len([move for move in moves(f"{BAR}{loop}").moves if move.kind == "feed"]) == 3
