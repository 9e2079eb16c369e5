"""Programs of the project: written, they read back equal; damaged, they are refused with the line and the reason."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from turning_nc.expression import parse
from turning_nc.law import LOAD, Law
from turning_nc.program import WARNING, Program, read, write
from turning_nc.words import NcError

SPEEDS = st.integers(1, 20_000).map(lambda tenths: tenths / 10)
FEEDS = st.integers(1, 10_000).map(lambda thousandths: thousandths / 1000)
ONE_LINE = ["FCTDEF(1,1.0,120.0,160.0,-2.0,0.0,0.0)", "ID=1 DO SYNFCT(1,$AC_OVR,$AA_LOAD[S1])"]


LENGTHS = st.integers(1, 300_000).map(lambda microns: microns / 1000)
PROGRAMS = st.builds(
    Program,
    *(LENGTHS, LENGTHS, LENGTHS.map(lambda length: -length), SPEEDS, SPEEDS, FEEDS),
    st.sampled_from(([], ONE_LINE, ["$AC_PARAM[2]=-0.5", *ONE_LINE])).map(Law),
)


@settings(max_examples=40)
@given(PROGRAMS, st.text(max_size=200))
def test_a_written_program_reads_back_equal(program: Program, comment: str) -> None:
    text = write(program, [comment])
    assert read(text) == program
    assert text.startswith(f"; {WARNING}\n")
    assert text.isascii()


LAW = Law(
    [
        "$AC_PARAM[0]=100.0",
        "FCTDEF(1,1.0,120.0,160.0,-2.0,0.0,0.0)",
        "ID=1 WHENEVER ($AA_LOAD[S1]<60.0) AND ($AA_LOAD[S1]>=0.0) DO SYNFCT(1,$AC_OVR,$AA_LOAD[S1])",
        "ID=2 DO $AC_PARAM[0]=$AC_PARAM[1]+1.0",
    ]
)
PROGRAM = Program(100.0, 3.0, -20.5, 636.6, 150.0, 0.3, LAW)
TEXT = """\
N10 G18 G40 G54 G64 G90 G95 G710 DIAMON
N20 T1 D1
N30 STOPRE
N40 $AC_PARAM[0]=100.0
N50 FCTDEF(1,1.0,120.0,160.0,-2.0,0.0,0.0)
N60 ID=1 WHENEVER ($AA_LOAD[S1]<60.0) AND ($AA_LOAD[S1]>=0.0) DO SYNFCT(1,$AC_OVR,$AA_LOAD[S1])
N70 ID=2 DO $AC_PARAM[0]=$AC_PARAM[1]+1.0
N80 G96 S150.0 F0.300 LIMS=636.6 M03
N90 G00 X120.000 Z3.000
N100 G00 X100.000
N110 G01 Z-20.500
N120 G00 X120.000
N130 G00 Z3.000
N140 M05
N150 M30
"""


def test_a_program_is_written_as_it_should_look() -> None:
    lines = write(PROGRAM).splitlines(keepends=True)
    assert "".join(line for line in lines if not line.startswith(";")) == TEXT
    assert read(TEXT) == PROGRAM


@pytest.mark.parametrize(
    ("old", "new", "line", "complaint"),
    [
        ("Z-20.500", "Z9.000", 11, "towards the chuck"),
        ("G01 Z-20.500", "G01 X99.000 Z-20.500", 11, "towards the chuck"),
        ("Z-20.500", "Z-10.0\nG01 Z-20.500", 12, "one block, that of line 11"),
        ("G01 Z-20.500", "G02 Z-20.500", 11, "needs a centre or a radius"),
        (
            "Z-20.500",
            "Z-20.5001",
            11,
            "Z-20.5001 is finer than the control's resolution, which is 3 decimals",
        ),
        ("Z-20.500", "Z-20.500 I5", 11, "I5 has no meaning"),
        ("N120 G00 X120", "N120 G00 X101", 13, "keep to X120.0"),
        ("N150 M30\n", "", 14, "must end with M30"),
        ("G95 ", "G94 ", 11, "no feed"),
        ("G96", "G97", 11, "G95 and G96"),
        (" LIMS=636.6", "", 11, "with LIMS"),
        (
            "FCTDEF(1,1.0,120.0",
            "FCTDEF(1,121.0,120.0",
            5,
            "the lower limit of polynomial 1 is 121.0",
        ),
        ("SYNFCT(1", "SYNFCT(2", 6, "polynomial 2 is not defined"),
        ("ID=2", "ID=1", 7, "ID=1 must precede ID=1"),
        ("$AC_PARAM[1]+1.0", "$AN_SECRET+1.0", 7, "$AN_SECRET cannot be read"),
        ("DO $AC_PARAM[0]", "DO M8 $AC_PARAM[0]", 7, "cannot be written"),
    ],
)
def test_a_damaged_program_is_refused_with_its_line(
    old: str, new: str, line: int, complaint: str
) -> None:
    assert old in TEXT
    with pytest.raises(NcError) as refused:
        read(TEXT.replace(old, new, 1))
    assert f"line {line}: " in str(refused.value)
    assert complaint in str(refused.value)


def test_a_law_acts_by_conditions_in_the_order_of_its_actions() -> None:
    variables = LAW.variables()
    for load, override in ((10.0, 120.0), (30.0, 100.0), (59.0, 42.0), (60.0, 100.0)):
        assert LAW.cycle(variables | {LOAD: load}) == override
    LAW.cycle(variables)
    assert variables["$AC_PARAM[0]"] == 1.0


EXPRESSIONS = {
    "2+3*4": 14.0,
    "(2+3)*4": 20.0,
    "10-4-3": 3.0,
    "8/4/2": 1.0,
    "2*$AC_PARAM[0]": 14.0,
    "[#100+.5]*-R1": -22.5,
    "(2<3) AND (3<=2)": 0.0,
    " 007 + 1. ": 8.0,
}


def test_expressions_compute_product_before_sum_from_the_left() -> None:
    variables = {"$AC_PARAM[0]": 7.0, "#100": 4.0, "R1": 5.0}
    assert {text: parse(text).value(variables) for text in EXPRESSIONS} == EXPRESSIONS
    for text in (
        "",
        "1+",
        "2**3",
        "7//2",
        "()",
        "1(2)",
        "(1,2)",
        "1e3",
        "R1R2",
        "print",
        "(" * 300,
        "1 2",
    ):
        with pytest.raises(ValueError, match=r"expression|neither"):
            parse(text)
