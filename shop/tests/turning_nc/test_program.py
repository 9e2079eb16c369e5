"""Programs of the project: written, they read back equal; damaged, they are refused.

An error names the line and the reason.
"""

from typing import NamedTuple

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from turning_nc.expression import parse
from turning_nc.law import LOAD, Law
from turning_nc.program import WARNING, Program, read, write
from turning_nc.words import NcError

# In the control's resolution.
SPEEDS = st.integers(1, 20_000).map(lambda tenths: tenths / 10)
FEEDS = st.integers(1, 10_000).map(lambda thousandths: thousandths / 1000)
LENGTHS = st.integers(1, 300_000).map(lambda microns: microns / 1000)
ONE_LINE = ["FCTDEF(1,1.0,120.0,160.0,-2.0,0.0,0.0)", "ID=1 DO SYNFCT(1,$AC_OVR,$AA_LOAD[S1])"]
PROGRAMS = st.builds(
    Program,
    diameter=LENGTHS,
    start=LENGTHS,
    end=LENGTHS.map(lambda length: -length),
    max_spindle_speed=SPEEDS,
    cutting_speed=SPEEDS,
    feed=FEEDS,
    law=st.sampled_from(([], ONE_LINE, ["$AC_PARAM[2]=-0.5", *ONE_LINE])).map(Law),
)


@pytest.mark.slow
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
        "ID=1 WHENEVER ($AA_LOAD[S1]<60.0) AND ($AA_LOAD[S1]>=0.0) "
        "DO SYNFCT(1,$AC_OVR,$AA_LOAD[S1])",
        "ID=2 DO $AC_PARAM[0]=$AC_PARAM[1]+1.0",
    ]
)
PROGRAM = Program(
    diameter=100.0,
    start=3.0,
    end=-20.5,
    max_spindle_speed=636.6,
    cutting_speed=150.0,
    feed=0.3,
    law=LAW,
)
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


class Damage(NamedTuple):
    """A change of the program, and how it is refused."""

    old: str
    new: str
    line: int
    complaint: str


CUT = "G01 Z-20.500"
DAMAGES = {
    "cut away from the chuck": Damage("Z-20.500", "Z9.000", 11, "towards the chuck"),
    "cut along a cone": Damage(CUT, "G01 X99.000 Z-20.500", 11, "towards the chuck"),
    "two cuts": Damage("Z-20.500", f"Z-10.0\n{CUT}", 12, "one block, that of line 11"),
    "arc": Damage(CUT, "G02 Z-20.500", 11, "needs a centre or a radius"),
    "finer than the resolution": Damage(
        "Z-20.500",
        "Z-20.5001",
        11,
        "Z-20.5001 is finer than the control's resolution, which is 3 decimals",
    ),
    "word without meaning": Damage("Z-20.500", "Z-20.500 I5", 11, "I5 has no meaning"),
    "rapid move near the bar": Damage("N120 G00 X120", "N120 G00 X101", 13, "keep to X120.0"),
    "no end": Damage("N150 M30\n", "", 14, "must end with M30"),
    "feed per minute": Damage("G95 ", "G94 ", 11, "no feed"),
    "spindle speed": Damage("G96", "G97", 11, "G95 and G96"),
    "no limit of the spindle": Damage(" LIMS=636.6", "", 11, "with LIMS"),
    "limits of a polynomial": Damage(
        "FCTDEF(1,1.0,120.0",
        "FCTDEF(1,121.0,120.0",
        5,
        "the lower limit of polynomial 1 is 121.0",
    ),
    "missing polynomial": Damage("SYNFCT(1", "SYNFCT(2", 6, "polynomial 2 is not defined"),
    "order of actions": Damage("ID=2", "ID=1", 7, "ID=1 must precede ID=1"),
    "first action": Damage("ID=1", "ID=0", 6, "ID=0 must precede ID=0"),
    "unknown variable": Damage(
        "$AC_PARAM[1]+1.0", "$AN_SECRET+1.0", 7, "$AN_SECRET cannot be read"
    ),
    "output": Damage("DO $AC_PARAM[0]", "DO M8 $AC_PARAM[0]", 7, "cannot be written"),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_program_is_refused_with_its_line(name: str) -> None:
    damage = DAMAGES[name]
    assert damage.old in TEXT
    with pytest.raises(NcError) as refused:
        read(TEXT.replace(damage.old, damage.new, 1))
    assert f"line {damage.line}: " in str(refused.value)
    assert damage.complaint in str(refused.value)


@pytest.mark.parametrize(
    ("load", "override"), [(10.0, 120.0), (30.0, 100.0), (59.0, 42.0), (60.0, 100.0)]
)
def test_a_law_acts_by_its_conditions(load: float, override: float) -> None:
    assert LAW.cycle(LAW.variables() | {LOAD: load}) == override


def test_a_law_keeps_its_variables_from_cycle_to_cycle() -> None:
    variables = LAW.variables()
    LAW.cycle(variables)
    assert variables["$AC_PARAM[0]"] == 1.0


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
