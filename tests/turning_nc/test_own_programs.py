"""Users' programs: what is read, what is named with its line, stocks, tools, cycles and the command."""

import contextlib
import json
import math
import random
import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("shapely")


from examples.adapt_programs import COLLECTION, FOLDER, SCENARIO, path_of, situation_of
from tests.walking import ROOT
from turning_env.__main__ import main
from turning_nc.cutting import Machine, Situation, motion, play
from turning_nc.dialects import DIALECTS
from turning_nc.moves import Moves, run
from turning_nc.stock import guessed_stock, read_stock, remove, tool_shape, volume
from turning_nc.words import NcError, divide, read_program_file

FANUC = """%
O0001 (TEST)
N10 G21 G99 T0101
N20 G50 S2000
N30 G96 S150 M3
N40 G0 X52. Z2.
N50 G1 Z-20. F0.25
N60 G2 X56. Z-22. R2.
N70 G0 X60. Z2.
N80 M98 P7
N90 M30
O0007
N100 G1 X58. Z1.
M99
%
"""
SINUMERIK = """%_N_TEST_MPF
N10 G90 G95 G71 DIAMON T1 D1
N20 G96 S150 LIMS=2000 F0.3 M4
N30 G0 X60 Z2
N40 CYCLE95("KONTUR",2,0.1,0.2,,0.3,,0.15,9)
N50 L5
N60 M30
%_N_KONTUR_SPF
N70 G1 X30 Z0
N80 Z-20
N90 X50 Z-30
N100 M17
%_N_L5_SPF
N110 G1 X62 Z1
N120 RET
"""


def moves(text: str) -> Moves:
    return run(divide(text))


def test_both_dialects_are_told_from_the_text() -> None:
    assert divide(FANUC).dialect.name == "fanuc"
    assert divide(SINUMERIK).dialect.name == "sinumerik"
    assert list(divide(SINUMERIK).parts) == ["TEST", "KONTUR", "L5"]
    assert divide(FANUC, DIALECTS["sinumerik"]).dialect.name == "sinumerik"


@pytest.mark.parametrize("text", [FANUC, SINUMERIK])
@pytest.mark.parametrize("ends", ["\n", "\r\n"])
def test_programs_and_their_sub_programs_are_run(text: str, ends: str) -> None:
    made = run(divide(text.replace("\n", ends)))
    assert made.notes == ()
    assert made.moves[-1].path.end[0] == 1.0
    assert [move.path for move in made.moves] == [move.path for move in moves(text).moves]


@pytest.mark.parametrize(
    ("text", "old", "new", "line", "named"),
    [
        (FANUC, "G2 X56. Z-22. R2.", "G2 X56. Z-22.", 8, "centre or a radius"),
        (FANUC, "R2.", "R0.5", 8, "radius 0.5"),
        (FANUC, "X56. Z-22. R2.", "X56. Z-22. I5. K0.", 8, "radius"),
        (FANUC, " F0.25", "", 7, "no feed"),
        (FANUC, "S150 ", "", 7, "no speed"),
        (FANUC, "F0.25", "F-0.25", 7, "negative"),
        (FANUC, "G1 Z-20.", "G1 G2 Z-20.", 7, "exclude"),
        (FANUC, "G1 Z-20.", "G76 Z-20.", 7, "two blocks"),
        (FANUC, "G1 Z-20.", "G83 Z-20.", 7, "G83"),
        (FANUC, "G1 Z-20.", "G1 Z-20. R2.", 7, "write ,R"),
        (FANUC, "G1 Z-20.", "G1 Z-20. K2.", 7, "K2. has no meaning"),
        (FANUC, "N90 M30", "M99 P100", 11, "P100 has no meaning"),
        (FANUC, "G1 Z-20.", "G90 Z-20.", 7, "cycle on some controls"),
        (FANUC, "G1 Z-20.", "G1 Z-20. C45.", 7, "address C"),
        (FANUC, "G1 Z-20.", "G1 Z#101", 7, "#101 has no value"),
        (FANUC, "G1 Z-20.", "G1 Z[1.+]", 7, "is not understood"),
        (FANUC, "G1 Z-20.", "G1 Z[1./0.]", 7, "zero"),
        (FANUC, "G1 Z-20.", "IF [#1 EQ 2] GOTO 5", 7, "no word"),
        (FANUC, "G50 S2000", "G50 X100. Z50.", 4, "G50"),
        (FANUC, "S2000", "S0", 4, "limit of the spindle"),
        (FANUC, "M98 P7", "M98 P8", 10, "sub-program 8"),
        (FANUC, "M98 P7", "M98", 10, "needs the sub-program"),
        (FANUC, "M98 P7", "M98 P7 L0", 10, "0 times"),
        (FANUC, "M98 P7", "G71 P100 Q200", 10, "N100 to N200"),
        (FANUC, "M98 P7", "G71 U2. R1.\nG71 P90 Q100", 11, "contour"),
        (FANUC, "M98 P7", "G73 P300 Q301\nN300 G1 X58.\nN301 Z0.", 10, "how often"),
        (FANUC, "M98 P7", "G73 U5. R0.5", 10, "0.5 times"),
        (FANUC, "M98 P7", "M98 P-7", 10, "no sub-program"),
        (FANUC, "M98 P7", "G4", 10, "time"),
        (FANUC, "M98 P7", "G4 P-5", 10, "not be below 0"),
        (FANUC, "M98 P7", "G32 Z-5.", 10, "lead"),
        (SINUMERIK, '"KONTUR"', '"CONTOUR"', 5, "'CONTOUR' is not in this file"),
        (SINUMERIK, '"KONTUR",2,', '"KONTUR",0,', 5, "above 0"),
        (SINUMERIK, '"KONTUR",2,', '"KONTUR",x,', 5, "argument 2"),
        (SINUMERIK, "0.15,9)", "0.15,13)", 5, "1 to 12"),
        (SINUMERIK, "N80 Z-20", "N80 X20 Z2", 5, "turns back"),
        (SINUMERIK, "N50 L5", "N50 L6", 6, "L6"),
        (SINUMERIK, "N50 L5", "N50 G1 X=R1", 6, "R1 has no value"),
        (SINUMERIK, "N50 L5", "N50 R1=SIN(30)", 6, "no word"),
        (SINUMERIK, "N50 L5", "N50 IF R1==2 GOTOF END", 6, "IF"),
        (SINUMERIK, "N50 L5", "N50 CYCLE97(,20,0,-30)", 6, "pitch"),
        (SINUMERIK, "N50 L5", "N50 TRANS Z-10", 6, "TRANS"),
        (SINUMERIK, "N50 L5", "N50 G1 X20 RND=2", 6, "must follow"),
        (SINUMERIK, "N50 L5", "N50 CYCLE93(30)", 6, "CYCLE93"),
        (SINUMERIK, "N80 Z-20", "N80 Z-20 CHF=60", 11, "of line 10"),
    ],
)
def test_what_is_not_understood_is_named_with_its_line(text: str, old: str, new: str, line: int, named: str) -> None:
    assert old in text
    with pytest.raises(NcError) as refused:
        moves(text.replace(old, new, 1))
    assert f"line {line}: " in str(refused.value)
    assert named in str(refused.value)


def test_all_lines_that_are_not_understood_are_named_at_once_or_left_out() -> None:
    text = FANUC.replace("N80 M98 P7", "N80 G76 X5.\nN81 G65 P2\nN82 M77")
    with pytest.raises(NcError, match=r"(?s)line 10: .*line 11: "):
        moves(text)
    made = run(divide(text), go_on=True)
    assert [note.split(":")[0] for note in made.notes] == ["line 10", "line 11", "line 12"]


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("", "no blocks"),
        ("(ONLY A COMMENT)", "no blocks"),
        ("G0 X10. Z5.", "no feed move"),
        ("O1\nG0 X1.\nO2\nM99\nO2\nM99", "line 5"),
        ("O1\nM98 P2\nM30\nO2\nM98 P2\nM99", "more than 8 deep"),
        ("O1\nM98 P2 L9999\nM30\nO2\nM98 P3 L9999\nM99\nO3\nM99", "blocks are run"),
        (SINUMERIK.replace("N80 Z-20", 'N80 CYCLE95("KONTUR",2)'), "more than 8 deep"),
        ("\n" * 200_001, "lines"),
    ],
)
def test_programs_that_are_none_are_refused(text: str, named: str) -> None:
    with pytest.raises(NcError, match=named):
        moves(text)


def test_damaged_programs_are_read_or_refused() -> None:
    rng = random.Random(7)
    pieces = (
        "G71",
        "P100",
        "M98 P7",
        "Z-1e5",
        "S0",
        "R1e9",
        "I0 K0",
        "G2",
        "(",
        ";",
        "-",
        "0",
        "CYCLE95(",
        '"',
        "U-5.",
        "AC(",
        "PROC A",
        "R1=",
        "#1=",
        "X=R1",
        "Z#1",
        ",R2.",
        "RND=1",
        "CYCLE97(2,",
        "G76 P1",
        "G73 P1 Q2",
        "U0 W0 R3",
        "ß",
    )
    for _ in range(150):
        text = path_of(rng.choice(list(COLLECTION))).read_text()
        for _ in range(rng.randint(1, 5)):
            place = rng.randrange(len(text))
            text = text[:place] + rng.choice(pieces) + text[place + rng.randrange(6) :]
        with contextlib.suppress(NcError):
            run(divide(text), go_on=rng.random() < 0.5)


def test_files_that_are_no_text_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.nc").write_bytes(b"G0\0X1")
    with pytest.raises(NcError, match="not text"):
        read_program_file(tmp_path / "a.nc")


def test_the_same_word_means_what_its_dialect_says() -> None:
    inch = moves("G21 G99\nG20\nG97 S500 M3\nG0 X2. Z0.\nG1 Z-1. F0.01")
    assert inch.moves[-1].path.end == (-25.4, 25.4)
    assert inch.moves[-1].feed.value == pytest.approx(0.254)
    siemens = moves("DIAMON G70 G95 G97 S500 M3\nG0 X2 Z0\nG1 Z-1 F0.1")
    assert siemens.moves[-1].path.end == (-25.4, 25.4)
    assert siemens.moves[-1].feed.value == pytest.approx(0.1)  # G70 changes lengths alone, G700 all
    assert moves("DIAMON G700 G95 G97 S500\nG0 X2 Z0\nG1 Z-1 F0.01").moves[-1].feed.value == pytest.approx(0.254)


def test_an_offset_that_is_cancelled_changes_no_tool() -> None:
    made = moves(FANUC.replace("N90 M30", "N81 G0 X100. T0100\nN82 T0200\nG0 X101.\nN90 M30"))
    assert [move.tool for move in made.moves[-2:]] == ["T0101", "T0200"]


def test_a_compensated_nose_radius_and_the_clash_of_g71_are_named() -> None:
    assert "nose radius" in moves(FANUC.replace("G1 Z-20.", "G42 G1 Z-20.")).notes[0]
    with pytest.raises(NcError, match="--dialect sinumerik"):
        moves("G90 G71\nG0 X50. Z2.")


@pytest.mark.parametrize(
    ("line", "end"),
    [
        ("G1 X=IC(2) Z=IC(-3)", (-3.0, 11.0)),
        ("G91 G1 X2 Z-3", (-3.0, 11.0)),
        ("DIAM90 G91 G1 X2 Z-3", (-3.0, 12.0)),
        ("DIAMOF G1 X15 Z-3", (-3.0, 15.0)),
        ("G91 G1 X=AC(30) Z-3", (-3.0, 15.0)),
    ],
)
def test_coordinates_of_sinumerik(line: str, end: tuple[float, float]) -> None:
    assert moves(f"DIAMON G90 G95 G97 S500 F0.2\nG0 X20 Z0\n{line}").moves[-1].path.end == pytest.approx(end)


# Cycles.


def test_passes_of_a_cycle_leave_the_contour_and_its_allowance() -> None:
    for name in ("roughing_g71", "facing_g72", "abspanen", "bohrung_labels"):
        removal, moves_of = situation_of(name).removal, situation_of(name).moves.moves
        rough = [move for move in moves_of if move.cycle_pass > 0]
        assert max(move.cycle_pass for move in rough) > 3
        depths = removal.slices.depth[np.isin(removal.slices.move, [k for k, m in enumerate(moves_of) if m.cycle_pass])]
        told = 2.5 if name in ("roughing_g71", "abspanen") else 2.0
        assert depths.max() <= told * 1.02 + 0.35  # along the contour a corner stands a little higher
    part = situation_of("roughing_g71").removal.part
    assert part.bounds[3] == 50.0
    radii = {-15.0: 25.0, -50.0: 30.0, -70.0: 35.0}
    import shapely

    for z, radius in radii.items():
        assert part.intersection(shapely.box(z - 0.01, 0.0, z + 0.01, 100.0)).bounds[3] == pytest.approx(radius, abs=0.02)


# Stock and tools.


def test_a_turned_cylinder_has_its_volume_and_depth() -> None:
    made = moves("G99 G97 S500 M3\nG0 X46. Z2.\nG1 Z-30. F0.2\nG0 X60.\nZ50.")
    removal = remove(made, read_stock("bar:50x60"))
    expected = math.pi * (25.0**2 - 23.0**2) * 30.0
    wedge = 2.0 * math.pi * 24.0 * 2.0**2 * math.tan(math.radians(5.0)) / 2.0  # beside the edge, which leads by 5 degrees
    assert removal.slices.volume.sum() == pytest.approx(expected - wedge, rel=1e-3)
    inner = removal.slices.depth[(removal.slices.move == 1)][5:-2]
    assert inner == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("bar:50", "bar:DIAMETERxLENGTH"),
        ("bar:0x50", "above 0"),
        ("tube:50x60x70", "below the outer"),
        ("bar:5.0.1x50", "numbers"),
        ("cube:5", "no bar"),
        ("a.step", "no bar"),
    ],
)
def test_stocks_that_are_none_are_refused(text: str, named: str) -> None:
    with pytest.raises(NcError, match=named):
        read_stock(text)


def test_a_stock_is_a_list_of_points(tmp_path: Path) -> None:
    path = tmp_path / "stock.csv"
    path.write_text("z,diameter\n1,0\n1,50\n-60,50\n-60,0\n")
    assert volume(read_stock(str(path))) == pytest.approx(math.pi * 25.0**2 * 61.0)
    for wrong, named in (("1,2,3\n4,5,6", "line 1|line 2"), ("0,0\n1,-5", "line 2"), ("0,10\n", "no area"), ("a\nb", "line 2")):
        path.write_text(wrong)
        with pytest.raises(NcError, match=named):
            read_stock(str(path))


def test_a_stock_is_a_drawing(tmp_path: Path) -> None:
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.new()
    space = drawing.modelspace()
    space.add_line((1, 0), (1, 20))
    space.add_line((-60, 20), (1, 20))
    space.add_line((-60, 20), (-60, 0))
    drawing.units = 4
    drawing.saveas(tmp_path / "stock.dxf")
    assert volume(read_stock(str(tmp_path / "stock.dxf"))) == pytest.approx(math.pi * 20.0**2 * 61.0, rel=1e-6)
    space.add_text("TEXT")
    drawing.saveas(tmp_path / "stock.dxf")
    with pytest.raises(NcError, match="TEXT"):
        read_stock(str(tmp_path / "stock.dxf"))
    (tmp_path / "stock.dxf").write_text("nothing")
    with pytest.raises(NcError, match="no DXF"):
        read_stock(str(tmp_path / "stock.dxf"))


def test_unknown_tools_are_refused() -> None:
    made = moves(FANUC)
    with pytest.raises(NcError, match="T9"):
        remove(made, guessed_stock(made)[0], {"T9": "inside"})
    for kind in ("drill", "groove:0", "groove:x"):
        with pytest.raises(NcError, match="no kind of tool"):
            tool_shape(kind)


def test_a_rapid_move_through_metal_is_named() -> None:
    made = moves("G99 G97 S500 M3\nG0 X40. Z2.\nG0 Z-30.\nG1 Z-31. F0.2")
    assert "line 3" in remove(made, read_stock("bar:50x60")).notes[0]


# Play.


def test_a_constant_cutting_speed_ends_at_the_limit_of_the_spindle() -> None:
    made = moves("G99 G50 S1000\nG96 S150 M3\nG0 X102. Z0.\nG1 X0. F0.2")
    situation = Situation(SCENARIO, Machine(), made, remove(made, read_stock("bar:100x60+2")))
    time, speed, _, turns = motion(situation, situation.feed, situation.speed)
    fed = situation.fed
    assert turns[fed].max() == 1000.0
    assert speed[fed][0] == pytest.approx(150.0)
    reached = 150_000.0 / (2.0 * math.pi * 1000.0)  # radius [mm]
    exact = math.pi * (51.0**2 - reached**2) / (150_000.0 * 0.2) * 60.0 + reached / (0.2 * 1000.0) * 60.0
    assert time[fed].sum() == pytest.approx(exact, rel=1e-3)


def test_wear_follows_the_law_of_a_constant_cut() -> None:
    made = moves("G99 G97 S500 M3\nG0 X95. Z0.\nG1 Z-100. F0.3")
    situation = Situation(SCENARIO, Machine(), made, remove(made, read_stock("bar:100x120")))
    played = play(situation, 0.0)
    minutes = played.time[situation.engaged].sum() / 60.0
    expected = SCENARIO.material.wear(math.pi * 95.0 * 0.5, 0.3, 2.5, time=minutes)
    assert played.wear[-1] == pytest.approx(expected, rel=2e-3)
    force = SCENARIO.material.thrust_force(math.pi * 95.0 * 0.5, 0.3, 2.5, wear=played.wear[-1])
    assert played.thrust_force.max() == pytest.approx(force, rel=2e-2)


# The command.


def options(name: str, *more: str) -> list[str]:
    entry = COLLECTION[name]
    tools = [f"--tool={tool}={kind}" for tool, kind in entry.get("tools", {}).items()]
    return ["program", str(path_of(name)), "--scenario", "rough_turning", "--stock", entry["stock"], *tools, *more]


@pytest.mark.slow
def test_the_command_draws(tmp_path: Path) -> None:
    figure = tmp_path / "welle.png"
    assert main(options("welle", "--figure", str(figure))) == 0
    assert figure.stat().st_size > 10_000


def test_the_command_plays_and_adapts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "welle.simulated.mpf"
    assert main(options("welle", "--adapt", "words", "--out", str(out), "--json")) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["adapted"]["totals"]["time"] < 0.9 * found["totals"]["time"]
    again = run(read_program_file(out))
    assert [move.path for move in again.moves] == [move.path for move in situation_of("welle").moves.moves]
    table = tmp_path / "welle.simulated.csv"
    assert main(options("welle", "--adapt", "positions", "--out", str(table), "--json")) == 0
    sections = json.loads(capsys.readouterr().out)["adapted"]["sections"]
    assert len(table.read_text().splitlines()) == 1 + len(sections)
    assert main(options("welle")) == 0
    printed = capsys.readouterr().out
    assert f"cycle time: {found['totals']['time']:.1f} s" in printed
    assert printed.count("\n") > len(found["blocks"])


@pytest.mark.parametrize(
    "more",
    [
        ["--out", "welle.simulated.mpf"],
        ["--adapt", "words", "--out", "welle.mpf"],
        ["--adapt", "words", "--out", str(FOLDER / "welle.mpf")],
        ["--wear", "5"],
        ["--tool", "T9=inside"],
        ["--stock", "bar:5"],
        ["--stock", "missing.dxf"],
        ["--scenario", "nothing"],
    ],
)
def test_mistakes_end_in_one_line_and_status_2(more: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(options("welle", *more)) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: ")
    assert captured.err.count("\n") == 1


def test_the_page_prints_what_the_commands_print(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "docs" / "your_own_program.md").read_text("utf-8")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    played = 0
    for command, printed in re.findall(r"```bash\npython -m turning_env ([^\n]*)\n```\n\n```text\n(.*?)```", page, re.DOTALL):
        assert main(shlex.split(command.partition(" --figure")[0])) == 0
        found = capsys.readouterr().out.splitlines()
        played += 1
        for line in printed.splitlines():
            assert line == "..." or line in found
    assert played == 3


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, "shapely", None)
    for module in ("adapt", "cutting", "report", "stock"):
        monkeypatch.delitem(sys.modules, f"turning_nc.{module}", raising=False)
        monkeypatch.delattr(f"turning_nc.{module}", raising=False)
    assert main(options("welle")) == 2
    assert "pip install" in capsys.readouterr().err


def test_letters_that_grow_in_capitals_do_not_shift_words(tmp_path: Path) -> None:
    path, out = tmp_path / "a.mpf", tmp_path / "a.simulated.mpf"
    path.write_bytes(path_of("welle").read_bytes().replace(b"rougher", "großes Maß, schöner Stahl µ".encode("latin-1")))
    assert main(["program", str(path), "--scenario", "rough_turning", "--adapt", "words", "--out", str(out)]) == 0
    changed = [(old, new) for old, new in zip(path.read_bytes().split(), out.read_bytes().split(), strict=True) if old != new]
    assert changed
    assert all(old[:1] == new[:1] and old[:1] in b"FS" for old, new in changed)


def test_without_words_to_change_nothing_is_adapted(tmp_path: Path) -> None:
    path = tmp_path / "a.nc"
    path.write_text("G98 G97 S500 M3\nG0 X46. Z2.\nG1 Z-30. F100.\n")
    assert main(["program", str(path), "--scenario", "rough_turning", "--adapt", "words"]) == 2
