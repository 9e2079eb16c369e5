"""Programs and files that no machinist would write.

Each ends in an error that names its place, and none takes long.
"""

import math
import time
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("shapely")

from turning_nc.cutting import AssumedMachine, Situation, play
from turning_nc.edges import change_wear
from turning_nc.expression import parse
from turning_nc.removal import remove
from turning_nc.report import rows
from turning_nc.stock import read_stock
from turning_nc.words import MAX_CHARACTERS, NcError, divide
from turning_shop.__main__ import main

from shop.examples.adapt_programs import SCENARIO
from shop.tests.turning_nc.programs import BAR, DREH, moves

NINES = "9" * 400


BLOCKS = {
    "many digits": f"G1 X{NINES} F0.2",
    "many decimals": f"G1 X.{'0' * 400}1 F0.2",
    "many digits after a comment": f"G1 X10. F0.2 (X)\nG1 Z-{NINES}",
    "beyond the reach": "G1 X1000000. F0.2",
    "tiny feed": "G1 X20. F0.0000000001",
    "large feed": "G1 X20. F99999999.",
    "feed of 0": "G1 X20. F0",
    "large speed": "S99999999 G1 X20. F0.2",
    "sub-program": f"M98 P{NINES}",
    "contour": f"G71 P{NINES} Q{NINES} U0.4 F0.2",
    "long dwell": f"G4 X{NINES}",
    "negative dwell": f"G4 P-{NINES}",
    "large radius": "G2 X58. Z-2. R9999999. F0.2",
    "distant centre": "G2 X58. Z-2. I9999999. K0. F0.2",
    "angle along X": "G1 Z-2. A90. F0.2",
    "jump": f"N5 GOTO {NINES}",
    "endless loop": "WHILE [1 EQ 1] DO1",
    "large variable": f"#1={NINES}\nG1 X#1 F0.2",
    "millions of pecks": "G75 R0.\nG75 X1. Z-200. P10 Q10 F0.1",
    "division by 0 in a corner": "G1 X60. Z-9. F0.2\n" + "G1 U0. ,R[1/0]",
    "difference of large numbers": f"#1={'9' * 300}\nG1 X[#1-#1*#1] F0.2",
}


@pytest.mark.parametrize("name", BLOCKS)
def test_numbers_beyond_all_measure_are_refused_with_their_line(name: str) -> None:
    with pytest.raises(NcError, match=r"line \d: "):
        moves(f"{BAR}{BLOCKS[name]}\nG1 Z-5. F0.2\nM30")


EXPRESSIONS = {
    "nothing in brackets": "ABS[]",
    "two functions": "ABS[1]ABS[2]",
    "root of a negative number": "SQRT[-1]",
    "logarithm of 0": "LN[0]",
    "large function": "EXP[1000]",
    "large product": "EXP[700]*EXP[700]",
    "difference of large products": "EXP[700]*EXP[700]-EXP[700]*EXP[700]",
    "division by 0": "1/0",
    "remainder by 0": "5 MOD 0",
    "unknown function": "ACOS[2]",
    "large number rounded": "ROUND[EXP[700]*EXP[700]]",
    "comma": "1,2",
    "large number": NINES,
    "deep brackets": "[" * 300 + "1" + "]" * 300,
    "many signs": "-" * 5000 + "1",
    "many terms": "9+" * 20_000 + "9",
    "function without argument": "TAN",
    "other function without argument": "ABS",
    "two arguments": "SIN[1,2]",
    "variable without value": "#1",
    "open bracket": "[1",
    "closed bracket": "1]",
}


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_expressions_without_a_finite_value_raise_their_own_errors(name: str) -> None:
    expression = EXPRESSIONS[name]
    with pytest.raises((ValueError, KeyError, ZeroDivisionError)):
        parse(expression).value({})
    with pytest.raises(NcError, match="line 4: "):
        moves(f"{BAR}G1 X[{expression}] F0.2"[:900])


REST = "G1 Z-5\nM30\n%_N_C_SPF\nG1 X10 Z0\nZ-20\nX30\nM17\n"
SINUMERIK_BLOCKS = {
    "large depth": f'CYCLE95("C",{NINES},0.1,0.2,,0.3,,0.15,9)',
    "depth that is no number": 'CYCLE95("C",nan,0.1,0.2,,0.3,,0.15,9)',
    "tiny depth": 'CYCLE95("C",0.0000000001,0.1,0.2,,0.3,,0.15,9)',
    "angle of a thread": "CYCLE97(1.5,,0,-32,30,30,6,2,1,0.1,90,0,2,1,1,1)",
    "many starts": "CYCLE97(1.5,,0,-32,30,30,6,2,1,0.1,30,0,2,1,1,999999999)",
    "pitch that is no number": "CYCLE97(inf,,0,-32,30,30,6,2,1,0.1,30,0,2,1,1,1)",
    "division of variables without value": "G1 X=R1/R2",
    "beyond the reach": "G1 X20 Z=IC(99999999)",
    "large parameter": f"R1={NINES}",
    "endless loop": "WHILE 1==1",
}


@pytest.mark.parametrize("name", SINUMERIK_BLOCKS)
def test_cycles_and_parameters_beyond_all_measure_are_refused_with_their_line(name: str) -> None:
    with pytest.raises(NcError, match="line 5: "):
        moves(f"{DREH}{SINUMERIK_BLOCKS[name]}\n{REST}")


ENDLESS = {
    "loop": f"{BAR}WHILE [1 EQ 1] DO1\nEND1",
    "jump of a Fanuc": f"{BAR}N5 GOTO 5",
    "jump of a SINUMERIK": f"{DREH}A: GOTOB A",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ENDLESS)
def test_endless_programs_end(name: str) -> None:
    with pytest.raises(NcError, match=r"line \d+: more than"):
        moves(ENDLESS[name])


CONTENTS = {
    "empty.nc": b"",
    "picture.png": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0",
    "utf_16.nc": "G21 G99\nG1 X20. F0.2".encode("utf-16"),
    "utf_16_without_mark.nc": "G21 G99\nG1 X20. F0.2".encode("utf-16-le"),
    "zeros.nc": b"G21\0G99",
    "one_line.nc": b"G1 X1. " * 150_000,
    "brackets.nc": b"G1 X" + b"[" * 900,
    "noise.nc": bytes(range(1, 256)) * 50,
}


@pytest.mark.parametrize("name", [*CONTENTS, "archive.zip", "folder.nc", "missing.nc"])
def test_files_of_the_wrong_kind_end_in_one_error_that_names_them(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / name
    if name in CONTENTS:
        path.write_bytes(CONTENTS[name])
    elif name == "archive.zip":
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("program.nc", "G1 X20. F0.2\n" * 100)
    elif name == "folder.nc":
        path.mkdir()
    assert main(["program", str(path), "--scenario", "rough_turning"]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert name in captured.err


STOCKS = {
    "no diameter": "bar:0x10",
    "no length": "bar:10x0",
    "many digits": f"bar:{NINES}x10",
    "long face": f"bar:10x10+{NINES}",
    "tube without a wall": "tube:10x10x10",
    "negative diameter": "bar:-5x10",
    "exponent": "bar:1e3x10",
    "no number": "bar:nanx10",
}


@pytest.mark.parametrize("name", STOCKS)
def test_stocks_without_a_size_are_refused(name: str) -> None:
    with pytest.raises(NcError, match="stock"):
        read_stock(STOCKS[name])


@pytest.mark.slow
def test_a_drawing_that_is_damaged_or_in_too_large_units_is_refused(tmp_path: Path) -> None:
    drawing = pytest.importorskip("ezdxf").new()
    path = tmp_path / "stock.dxf"
    drawing.modelspace().add_circle((0, 200), 100)
    drawing.units = 6  # m
    drawing.saveas(path)
    with pytest.raises(NcError, match=r"stock\.dxf"):
        read_stock(str(path))
    whole = path.read_bytes()
    for place in range(0, len(whole), len(whole) // 40):
        path.write_bytes(whole[:place] + b"\n  0\nCIRCLE\n 40\n" + whole[place + 30 :])
        with pytest.raises(NcError, match=r"stock\.dxf"):
            read_stock(str(path))


def test_a_dwell_of_years_and_a_slow_feed_have_finite_times() -> None:
    made = moves(f"{BAR}G4 X99999999.\nG1 X50. F0.000002\nZ-40.\nM30")
    removal = remove(made, read_stock("bar:60x60"))
    situation = Situation(SCENARIO, AssumedMachine(), made, removal)
    played = play(situation, change_wear(situation))
    assert math.isfinite(played.time.sum())
    blocks = rows(situation, played)
    assert blocks
    for block in blocks:
        assert math.isfinite(block.used_life or 0.0)


BLANKS = " " * (MAX_CHARACTERS - 50)
MAX_READING = 10.0  # processor time for any of these texts [s]; each takes below 2 s


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "G59 X1.\n" * 20_000,  # half of the sign of an old SINUMERIK
        f"G{BLANKS}G\n" * 1000,
        f"R1=1\nG1 X{'1' * (MAX_CHARACTERS - 50)}=\n" * 1000,
    ],
    ids=["zero offsets", "blanks", "digits"],
)
def test_the_time_of_reading_grows_with_the_text_alone(text: str) -> None:
    begin = time.process_time()
    divide(text)
    assert time.process_time() - begin < MAX_READING


def test_a_condition_of_many_blanks_is_refused_at_once() -> None:
    begin = time.process_time()
    with pytest.raises(NcError, match="line 2: synchronized actions"):
        moves(
            f"R1=1\nID=1 WHENEVER {BLANKS}X\n"
            + f"ID=1 WHENEVER {BLANKS}X\n" * 20
            + "G1 X5 F0.1 S100 M3"
        )
    assert time.process_time() - begin < MAX_READING


def test_a_line_that_is_too_long_is_refused_before_it_is_searched() -> None:
    with pytest.raises(NcError, match="line 2: has 3,000,000 characters"):
        divide("G0 X60. Z2.\n" + "G71 " * 750_000)
