"""What is written reads back equal, and nothing but the subset is read."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from turning_nc.expression import Expression, Number, Operation, Variable, as_written, parse
from turning_nc.program import Block, NcError, Program
from turning_nc.read import read
from turning_nc.synchronous import (
    LOAD,
    OVERRIDE,
    READABLE,
    WRITABLE,
    Action,
    Assign,
    Condition,
    Evaluate,
    Law,
    Polynomial,
)
from turning_nc.write import WARNING, write

SPEEDS = st.integers(1, 20_000).map(lambda tenths: tenths / 10)
FEEDS = st.integers(1, 10_000).map(lambda thousandths: thousandths / 1000)
COEFFICIENTS = st.floats(-1e6, 1e6).map(as_written)
NUMBERS = st.integers(1, 999)

EXPRESSIONS: st.SearchStrategy[Expression] = st.recursive(
    st.builds(Number, st.floats(0, 1e6).map(as_written)) | st.builds(Variable, st.sampled_from(READABLE)),
    lambda parts: st.builds(Operation, parts, st.sampled_from("+-*/"), parts),
    max_leaves=6,
)
CONDITIONS = st.builds(Condition, st.sampled_from(READABLE), st.sampled_from(("<", ">", "<=", ">=")), EXPRESSIONS)


@st.composite
def laws(draw: st.DrawFn) -> Law:
    polynomials = []
    for number in draw(st.lists(NUMBERS, min_size=1, max_size=3, unique=True)):
        low, high = sorted((draw(COEFFICIENTS), draw(COEFFICIENTS)))
        polynomials.append(Polynomial(number, low, high, draw(st.tuples(*[COEFFICIENTS] * 4))))
    effects = st.builds(
        Evaluate, st.sampled_from([each.number for each in polynomials]), st.sampled_from(WRITABLE), st.just(LOAD)
    ) | st.builds(Assign, st.sampled_from(WRITABLE), EXPRESSIONS)
    numbers = sorted(draw(st.lists(NUMBERS, min_size=1, max_size=3, unique=True)))
    actions = [Action(number, tuple(draw(st.lists(CONDITIONS, max_size=2))), draw(effects)) for number in numbers]
    initial = draw(st.dictionaries(st.sampled_from(WRITABLE[1:]), COEFFICIENTS, max_size=2))
    return Law(tuple(polynomials), tuple(initial.items()), tuple(actions))


@st.composite
def programs(draw: st.DrawFn) -> Program:
    bars = []
    start = draw(st.integers(0, 5000))
    for _ in range(draw(st.integers(1, 3))):
        depth, blocks = start, []
        for step in draw(st.lists(st.integers(1, 100_000), min_size=1, max_size=5)):
            depth -= step
            blocks.append(Block(depth / 1000, draw(SPEEDS), draw(FEEDS), draw(st.text(max_size=10))))
        bars.append(tuple(blocks))
    law = draw(st.none() | laws())
    return Program(draw(FEEDS) * 100, start / 1000, draw(SPEEDS), tuple(bars), law)


@settings(max_examples=40)
@given(programs(), st.text(max_size=200))
def test_what_is_written_reads_back_equal(program: Program, comment: str) -> None:
    program = Program(round(program.diameter, 3), program.start, program.max_spindle_speed, program.bars, program.law)
    text = write(program, [comment])
    assert read(text) == program
    assert text.startswith(f"; {WARNING}\n")
    assert text.isascii()


LAW = Law(
    (Polynomial(1, 1.0, 120.0, (160.0, -2.0, 0.0, 0.0)),),
    (("$AC_PARAM[0]", 100.0),),
    (
        Action(1, (Condition(LOAD, "<", Number(60.0)), Condition(LOAD, ">=", Number(0.0))), Evaluate(1, OVERRIDE, LOAD)),
        Action(2, (), Assign("$AC_PARAM[0]", Operation(Variable("$AC_PARAM[1]"), "+", Number(1.0)))),
    ),
)
PROGRAM = Program(100.0, 3.0, 636.6, ((Block(-10.0, 150.0, 0.3), Block(-20.5, 140.0, 0.3)), (Block(-5.0, 140.0, 0.25),)), LAW)
TEXT = """\
N10 G18 G40 G54 G64 G90 G95 G710 DIAMON
N20 T1 D1
N30 STOPRE
N40 $AC_PARAM[0]=100.0
N50 FCTDEF(1,1.0,120.0,160.0,-2.0,0.0,0.0)
N60 ID=1 WHENEVER ($AA_LOAD[S1]<60.0) AND ($AA_LOAD[S1]>=0.0) DO SYNFCT(1,$AC_OVR,$AA_LOAD[S1])
N70 ID=2 DO $AC_PARAM[0]=$AC_PARAM[1]+1.0
N80 G96 S150.0 F0.300 LIMS=636.6 M03 ; bar 1
N90 G00 X120.000 Z3.000
N100 G00 X100.000
N110 G01 Z-10.000
N120 G01 Z-20.500 S140.0
N130 G00 X120.000
N140 G00 Z3.000
N150 M05
N160 M00 ; the next bar is put in
N170 G96 S140.0 F0.250 M03 ; bar 2
N180 G00 X120.000 Z3.000
N190 G00 X100.000
N200 G01 Z-5.000
N210 G00 X120.000
N220 G00 Z3.000
N230 M05
N240 M30
"""


def test_a_program_is_written_as_it_should_look() -> None:
    lines = write(PROGRAM).splitlines(keepends=True)
    assert "".join(line for line in lines if not line.startswith(";")) == TEXT
    assert read(TEXT) == PROGRAM


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("N20 T1 D1", "N20 T2 D1", "N20: T1 D1 must stand here"),
        ("N20 T1", "N10 T1", "N10: block numbers must rise"),
        ("N20 T1", "T1", "line 2: 'T1 D1' is no block"),
        ("G90 ", "", "N10: a program must begin with G18"),
        ("S150.0 F0.300", "S0.0 F0.300", "N80: S is 0.0, but must be above 0"),
        ("Z-20.500", "Z-9.000", "N120: Z-9.0 must lie below Z-10.0"),
        ("G01 Z-20.500", "G02 Z-20.500", "N120: only G01 to Z"),
        ("Z-20.500 S140.0", "Z-20.500 S1E3", "N120: 'S1E3' is not a word of the subset"),
        ("Z-20.500", "Z-20.5001", "N120: 'Z-20.5001' is finer than the control's resolution, which is 3 decimals"),
        ("N130 G00 X120", "N130 G00 X101", "N130: X101.0 is too near the bar"),
        ("N190 G00 X100", "N190 G00 X90", "N190: every bar must be cut at X100.0, as the first, not at X90.0"),
        ("N100 G00 X100.000\n", "", "N110: Z may not stand"),
        ("N240 M30\n", "", "at the end: the program does not end with M30"),
        ("N240 M30\n", "N240 M30\nN250 M30\n", "N250: nothing may follow M30"),
        ("FCTDEF(1,1.0,120.0", "FCTDEF(1,121.0,120.0", "N50: the lower limit of polynomial 1 is 121.0"),
        ("SYNFCT(1", "SYNFCT(2", "N60: polynomial 2 is not defined"),
        ("SYNFCT(1,$AC_OVR", "SYNFCT(1,$AA_OVR[X]", "N60: '$AA_OVR[X]' cannot be written"),
        ("ID=2", "ID=1", "N70: ID=1 must stand before ID=1"),
        ("$AC_PARAM[1]+1.0", "$AC_PARAM[1]+", "N70: an expression ends"),
        ("$AC_PARAM[1]+1.0", "$AN_SECRET+1.0", "N70: the variable $AN_SECRET cannot be read"),
        ("($AA_LOAD[S1]<60.0) AND", "$AA_LOAD[S1]<60.0 AND", "N60: '$AA_LOAD[S1]<60.0' must stand in parentheses"),
    ],
)
def test_what_is_not_of_the_subset_is_named(old: str, new: str, complaint: str) -> None:
    assert old in TEXT
    with pytest.raises(NcError) as refused:
        read(TEXT.replace(old, new, 1))
    assert str(refused.value).startswith(complaint)


def test_long_lines_and_long_programs_are_refused() -> None:
    with pytest.raises(NcError, match="line 1: has 600 characters"):
        read("N10 " + "G" * 596)
    with pytest.raises(NcError, match="10000000 at most are read"):
        read(";" * 10_000_001)


@pytest.mark.parametrize(
    "text", ["1.0+2.0-3.0*4.0/5.0", "1.0-(2.0-3.0)", "(1.0+2.0)*3.0", "1.0/(2.0*3.0)", "+".join(["1.0"] * 100)]
)
def test_expressions_have_the_parentheses_that_they_need(text: str) -> None:
    assert str(parse(text, READABLE)) == text


@pytest.mark.parametrize(
    ("text", "value"), [("2+3*4", 14), ("(2+3)*4", 20), ("10-4-3", 3), ("8/4/2", 1), ("2*$AC_PARAM[0]", 14), (" 1 + 1 ", 2)]
)
def test_expressions_compute_product_before_sum_from_the_left(text: str, value: float) -> None:
    assert parse(text, READABLE).value({"$AC_PARAM[0]": 7.0}) == value
