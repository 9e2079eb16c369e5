"""Programs and files that no machinist would write: each ends in an error that names its place, and none takes long."""

import math
import time
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("shapely")

from turning_nc.cutting import Machine, Situation, play
from turning_nc.edges import change_wear
from turning_nc.expression import parse
from turning_nc.removal import remove
from turning_nc.report import rows
from turning_nc.stock import read_stock
from turning_nc.words import MAX_CHARACTERS, NcError, divide

from shop.examples.adapt_programs import SCENARIO
from shop.tests.turning_nc.test_moves import BAR, DREH, moves
from turning_env.__main__ import main

NINES = "9" * 400


@pytest.mark.parametrize(
    "block",
    [
        f"G1 X{NINES} F0.2",
        f"G1 X.{'0' * 400}1 F0.2",
        f"G1 X10. F0.2 (X)\nG1 Z-{NINES}",
        "G1 X1000000. F0.2",
        "G1 X20. F0.0000000001",
        "G1 X20. F99999999.",
        "G1 X20. F0",
        "S99999999 G1 X20. F0.2",
        f"M98 P{NINES}",
        f"G71 P{NINES} Q{NINES} U0.4 F0.2",
        f"G4 X{NINES}",
        f"G4 P-{NINES}",
        "G2 X58. Z-2. R9999999. F0.2",
        "G2 X58. Z-2. I9999999. K0. F0.2",
        "G1 Z-2. A90. F0.2",
        f"N5 GOTO {NINES}",
        "WHILE [1 EQ 1] DO1",
        f"#1={NINES}\nG1 X#1 F0.2",
        "G75 R0.\nG75 X1. Z-200. P10 Q10 F0.1",  # millions of pecks
        "G1 X60. Z-9. F0.2\n" + "G1 U0. ,R[1/0]",
        f"#1={'9' * 300}\nG1 X[#1-#1*#1] F0.2",
    ],
)
def test_numbers_beyond_all_measure_are_refused_with_their_line(block: str) -> None:
    with pytest.raises(NcError, match=r"line \d: "):
        moves(f"{BAR}{block}\nG1 Z-5. F0.2\nM30")


EXPRESSIONS = (
    *(
        "ABS[]",
        "ABS[1]ABS[2]",
        "SQRT[-1]",
        "LN[0]",
        "EXP[1000]",
        "EXP[700]*EXP[700]",
        "EXP[700]*EXP[700]-EXP[700]*EXP[700]",
    ),
    *(
        "1/0",
        "5 MOD 0",
        "ACOS[2]",
        "ROUND[EXP[700]*EXP[700]]",
        "1,2",
        NINES,
        "[" * 300 + "1" + "]" * 300,
        "-" * 5000 + "1",
    ),
    *("9+" * 20_000 + "9", "TAN", "ABS", "SIN[1,2]", "#1", "[1", "1]"),
)


@pytest.mark.parametrize("expression", EXPRESSIONS, ids=range(len(EXPRESSIONS)))
def test_expressions_without_a_finite_value_raise_their_own_errors(expression: str) -> None:
    with pytest.raises((ValueError, KeyError, ZeroDivisionError)):
        parse(expression).value({})
    with pytest.raises(NcError, match="line 4: "):
        moves(f"{BAR}G1 X[{expression}] F0.2"[:900])


@pytest.mark.parametrize(
    "block",
    [
        f'CYCLE95("C",{NINES},0.1,0.2,,0.3,,0.15,9)',
        'CYCLE95("C",nan,0.1,0.2,,0.3,,0.15,9)',
        'CYCLE95("C",0.0000000001,0.1,0.2,,0.3,,0.15,9)',
        "CYCLE97(1.5,,0,-32,30,30,6,2,1,0.1,90,0,2,1,1,1)",
        "CYCLE97(1.5,,0,-32,30,30,6,2,1,0.1,30,0,2,1,1,999999999)",
        "CYCLE97(inf,,0,-32,30,30,6,2,1,0.1,30,0,2,1,1,1)",
        "G1 X=R1/R2",
        "G1 X20 Z=IC(99999999)",
        f"R1={NINES}",
        "WHILE 1==1",
    ],
)
def test_cycles_and_parameters_beyond_all_measure_are_refused_with_their_line(block: str) -> None:
    with pytest.raises(NcError, match="line 5: "):
        moves(f"{DREH}{block}\nG1 Z-5\nM30\n%_N_C_SPF\nG1 X10 Z0\nZ-20\nX30\nM17\n")


@pytest.mark.parametrize(
    "text",
    [
        f"{BAR}WHILE [1 EQ 1] DO1\nEND1",
        f"{BAR}N5 GOTO 5",
        f"{DREH}A: GOTOB A",
    ],
)
def test_endless_programs_end(text: str) -> None:
    with pytest.raises(NcError, match=r"line \d+: more than"):
        moves(text)


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


@pytest.mark.parametrize(
    "stock",
    [
        "bar:0x10",
        "bar:10x0",
        f"bar:{NINES}x10",
        f"bar:10x10+{NINES}",
        "tube:10x10x10",
        "bar:-5x10",
        "bar:1e3x10",
        "bar:nanx10",
    ],
)
def test_stocks_without_a_size_are_refused(stock: str) -> None:
    with pytest.raises(NcError, match="stock"):
        read_stock(stock)


def test_a_drawing_that_is_damaged_or_in_too_large_units_is_refused(tmp_path: Path) -> None:
    drawing, path = pytest.importorskip("ezdxf").new(), tmp_path / "stock.dxf"
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
    situation = Situation(SCENARIO, Machine(), made, removal)
    played = play(situation, change_wear(situation))
    assert math.isfinite(played.time.sum())
    assert all(math.isfinite(row.used_life) for row in rows(situation, played))


BLANKS = " " * (MAX_CHARACTERS - 50)
MAX_READING = 10.0  # processor time for any of these texts [s]; each takes below 2 s


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
    with pytest.raises(NcError, match="line 2: 'ID=1 WHENEVER"):
        moves(
            f"R1=1\nID=1 WHENEVER {BLANKS}X\n"
            + f"ID=1 WHENEVER {BLANKS}X\n" * 20
            + "G1 X5 F0.1 S100 M3"
        )
    assert time.process_time() - begin < MAX_READING


def test_a_line_that_is_too_long_is_refused_before_it_is_searched() -> None:
    with pytest.raises(NcError, match="line 2: has 3,000,000 characters"):
        divide("G0 X60. Z2.\n" + "G71 " * 750_000)
