"""Programs on their stock: metal, loads, adapted feeds and speeds, and the command.

The collection runs as in LinuxCNC, where that is installed.
"""

import math
import os
import re
import shlex
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

pytest.importorskip("shapely")

from turning_nc.adapt import adapt
from turning_nc.adaptable_words import Where
from turning_nc.cutting import AssumedMachine, Situation, motion, play
from turning_nc.edges import change_wear, parts_per_edge
from turning_nc.moves import Move, run
from turning_nc.plausibility import implausible
from turning_nc.removal import remove
from turning_nc.report import summary
from turning_nc.stock import guessed_stock, read_stock, volume
from turning_nc.words import NcError, divide
from turning_shop.__main__ import main
from turning_shop.units import INCH

from baselines.models.process import Process
from baselines.two_limits import set_point
from shop.examples.adapt_programs import COLLECTION, FOLDER, SCENARIO, path_of, situation_of
from shop.tests.turning_nc.linuxcnc import INSTALLED, Canonical, canonical, translated
from shop.tests.turning_nc.programs import BAR, moves
from tests.programs import NO_LINUXCNC
from tests.walking import ROOT
from turning_env import Scenario

WITHOUT_CYCLES = [name for name, entry in COLLECTION.items() if not entry.get("cycles")]
QUICK = ("inch_bar", "grooves_in_sub_program", "feed_per_minute", "welle", "gewinde", "abspanen")


def moves_of_linuxcnc(program: str, dialect: str, folder: Path) -> list[Canonical]:
    """Return the moves of a program in LinuxCNC, without those that stay where they are."""
    first, *reference = canonical(translated(program, dialect), folder)
    # The first moves to where our tool stands before the program.
    here = first.end
    moves = []
    for move in reference:
        is_long = math.dist(here, move.end) > 1e-6
        if move.kind == "dwell" or move.centre is not None or is_long:
            moves.append(move)
            here = move.end
    return moves


@pytest.mark.skipif(not INSTALLED, reason=NO_LINUXCNC)
@pytest.mark.parametrize("name", WITHOUT_CYCLES)
def test_moves_feeds_and_speeds_are_those_of_linuxcnc(name: str, tmp_path: Path) -> None:
    made = situation_of(name).moves
    reference = moves_of_linuxcnc(path_of(name).read_text(), made.program.dialect.name, tmp_path)
    assert len(made.moves) == len(reference)
    for move, expected in zip(made.moves, reference, strict=True):
        assert move.path.end == pytest.approx(expected.end, abs=1e-3), move.line
        assert (move.path.centre is None) == (expected.centre is None)
        if expected.centre is not None:
            assert move.path.centre == pytest.approx(expected.centre, abs=1e-3)
            assert move.path.clockwise == expected.clockwise
        assert move.time == pytest.approx(expected.time)
        if expected.kind == "feed":
            assert move.feed.value == pytest.approx(expected.feed, rel=1e-4), move.line
            assert move.speed.value == pytest.approx(expected.speed, rel=1e-4), move.line
            assert move.per_revolution == expected.per_turn
            assert move.constant_cutting_speed == (expected.limit > 0.0)
            if move.constant_cutting_speed:
                # Either may have no limit of its own.
                limit = min(move.max_spindle_speed, 1e9)
                assert limit == pytest.approx(min(expected.limit, 1e9))


@pytest.mark.parametrize("name", COLLECTION)
def test_removed_metal_is_the_difference_of_the_polygons(name: str) -> None:
    removal = situation_of(name).removal
    removed = volume(removal.stock) - volume(removal.part)
    assert removal.slices.volume.sum() == pytest.approx(removed, rel=1e-3)
    assert removal.rapids == {}
    assert removal.gouged == {}
    assert removal.notes == ()


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in COLLECTION],
)
@pytest.mark.parametrize("where", ["words", "blocks"])
def test_an_adapted_program_differs_in_words_of_feed_and_speed_alone(
    name: str, where: Where
) -> None:
    situation = situation_of(name)
    adapted = adapt(situation, where=where)
    old_lines = situation.moves.program.text.split("\n")
    new_lines = adapted.text.split("\n")
    for old, new in zip(old_lines, new_lines, strict=True):
        # In words, numbers change; in blocks, whole words may come and go.
        changing = r"(?<=[FS])\d+\.?\d*" if where == "words" else r" ?[FS]\d+\.?\d*"
        if "CYCLE95" in old:
            # The cycle's feeds are arguments, which only stay in place among words.
            if where == "blocks":
                continue
            changing = r"\d+\.?\d*"
        assert re.sub(changing, "", old) == re.sub(changing, "", new)

    before = play(situation, change_wear(situation))
    after = adapted.played
    if (name, where) == ("flange", "words"):
        # A word that makes the surface also serves the overloaded block.
        assert after.load.max() < before.load.max()
        return
    assert after.load.max() <= 1.001
    # An overload is removed at any price.
    if before.load.max() <= 1.0:
        assert after.used_life.sum() <= before.used_life.sum() * 1.001
    assert after.wear.max() <= before.wear.max() * 1.001


def test_finishing_keeps_its_feed() -> None:
    assert "F0.12" in adapt(situation_of("stepped_shaft")).text


def test_an_overload_is_removed_and_the_program_is_still_shorter() -> None:
    situation = situation_of("flange")
    before = play(situation, change_wear(situation))
    assert set(situation.line[before.load > 1.0]) == {23}
    after = adapt(situation, where="blocks").played
    assert after.load.max() <= 1.001
    assert after.time.sum() < before.time.sum()


def test_an_adapted_program_uses_no_more_edges() -> None:
    # G97: the spindle speed is constant, not the cutting speed.
    last = "G0 X62.\nZ2.\nG1 X54. F0.1\nZ-40."
    situation = situated(f"{BAR}G1 X56. F0.25\nZ-40.\n{last}", "bar:60x60")
    adapted = adapt(situation)
    assert adapted.changes
    before = parts_per_edge(situation, play(situation, change_wear(situation)))
    after = parts_per_edge(adapted.situation, adapted.played)
    assert after["T0101"] >= before["T0101"] > 1.0


# Stock and tools.


def test_a_turned_cylinder_has_its_volume_and_depth() -> None:
    made = moves("G99 G97 S500 M3\nG0 X46. Z2.\nG1 Z-30. F0.2\nG0 X60.\nZ50.")
    removal = remove(made, read_stock("bar:50x60"))
    cylinder = math.pi * (25.0**2 - 23.0**2) * 30.0
    # A wedge stays beside the edge, which leads by 5 degrees.
    wedge = 2.0 * math.pi * 24.0 * 2.0**2 * math.tan(math.radians(5.0)) / 2.0
    assert removal.slices.volume.sum() == pytest.approx(cylinder - wedge, rel=1e-3)
    depth = removal.slices.depth[removal.slices.move == 1]
    assert depth[5:-2] == pytest.approx(2.0)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_a_stock_is_a_bar_or_a_list_of_points(separator: str, tmp_path: Path) -> None:
    path = tmp_path / "stock.csv"
    points = "z,diameter\n1,0\n1,50\n-60,50\n-60,0\n"
    path.write_text(points.replace(",", separator))
    bar = read_stock("bar:50x60+1")
    assert volume(read_stock(str(path))) == pytest.approx(volume(bar))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param("bar:50", "bar:DIAMETERxLENGTH", id="no length"),
        pytest.param("bar:0x50", "above 0", id="no diameter"),
        pytest.param("tube:50x60x70", "below the outer", id="inner above outer"),
        pytest.param("bar:5.0.1x50", "no bar", id="no number"),
        pytest.param("bar:50,5x60", "a decimal point", id="decimal comma"),
    ],
)
def test_a_stock_that_is_no_bar_is_refused(text: str, message: str) -> None:
    with pytest.raises(NcError, match=message):
        read_stock(text)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        pytest.param("1,2,3\n4,5,6", "line 1|line 2", id="three columns"),
        pytest.param("0,0\n1,-5", "line 2", id="negative diameter"),
        pytest.param("0,10\n", "no area", id="one point"),
        pytest.param("a\nb", "line 2.*-50,100.5; decimals have a point", id="letters"),
        pytest.param("1e9,5", "line 1", id="far away"),
    ],
)
def test_points_that_are_no_stock_are_refused(points: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "stock.csv"
    path.write_text(points)
    with pytest.raises(NcError, match=message):
        read_stock(str(path))


@pytest.fixture
def drawing() -> Any:
    """Return a drawing of a bar of 40 mm, 61 mm long, in mm."""
    drawing = pytest.importorskip("ezdxf").new()
    space = drawing.modelspace()
    space.add_line((1, 0), (1, 20))
    space.add_line((-60, 20), (1, 20))
    space.add_line((-60, 20), (-60, 0))
    drawing.units = 4
    return drawing


def test_a_stock_is_a_drawing(drawing: Any, tmp_path: Path) -> None:
    path = tmp_path / "stock.dxf"
    drawing.saveas(path)
    expected = math.pi * 20.0**2 * 61.0
    assert volume(read_stock(str(path))) == pytest.approx(expected, rel=1e-6)


def test_drawings_with_other_entities_are_refused(drawing: Any, tmp_path: Path) -> None:
    path = tmp_path / "stock.dxf"
    space = drawing.modelspace()
    text = space.add_text("TEXT")
    drawing.saveas(path)
    with pytest.raises(NcError, match="TEXT"):
        read_stock(str(path))
    space.delete_entity(text)

    wrong = [
        space.add_line((0, math.nan), (1, 0)),
        space.add_circle((0, 0), 1e9),
        space.add_arc((0, 0), radius=5, start_angle=math.nan, end_angle=90),
        space.add_lwpolyline([(0, 0, 0, 0, math.nan), (1, 1)]),
    ]
    for entity in wrong:
        drawing.saveas(path)
        with pytest.raises(NcError, match="not finite or above"):
            read_stock(str(path))
        space.delete_entity(entity)


def test_what_is_no_drawing_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("ezdxf")
    path = tmp_path / "stock.dxf"
    path.write_text("nothing")
    with pytest.raises(NcError, match="no DXF"):
        read_stock(str(path))
    os.mkfifo(tmp_path / "pipe.dxf")
    with pytest.raises(OSError, match="a pipe"):
        read_stock(str(tmp_path / "pipe.dxf"))


RAPID_IN_METAL = "G99 G97 S500 M3\nG0 X40. Z2.\nG0 Z-30.\nG1 Z-31. F0.2"


def test_a_rapid_move_through_metal_is_named() -> None:
    assert list(remove(moves(RAPID_IN_METAL), read_stock("bar:50x60")).rapids) == [3]


@pytest.mark.parametrize(
    ("tool", "kind", "message"),
    [
        pytest.param("T9", "inside", "T9", id="not in the program"),
        pytest.param("T0", "reamer", "no kind of tool", id="unknown kind"),
        pytest.param("T0", "groove:0", "no kind of tool", id="no width"),
        pytest.param("T0", "groove:x", "no kind of tool", id="width that is no number"),
    ],
)
def test_unknown_tools_are_refused(tool: str, kind: str, message: str) -> None:
    made = moves(RAPID_IN_METAL)
    stock, _ = guessed_stock(made)
    with pytest.raises(NcError, match=message):
        remove(made, stock, {tool: kind})


# Play.


def situated(text: str, stock: str, tools: dict[str, str] | None = None) -> Situation:
    """Return a program on its stock."""
    made = moves(text)
    removal = remove(made, read_stock(stock), tools or {})
    return Situation(SCENARIO, AssumedMachine(), made, removal)


LIMIT_RADIUS = 150_000.0 / (2.0 * math.pi * 1000.0)
"""Radius at which a spindle of 1000 rev/min still reaches 150 m/min [mm]."""


def facing_time(start: float, end: float) -> float:
    """Return the time to face from one radius [mm] to a smaller one at 150 m/min, 0.2 mm/rev [s].

    The spindle is at its limit, 1000 rev/min, from ``LIMIT_RADIUS`` inwards.
    """
    constant = math.pi * (start**2 - max(end, LIMIT_RADIUS) ** 2) / 150_000.0  # [min mm/rev]
    limited = max(LIMIT_RADIUS - end, 0.0) / 1000.0  # [min mm/rev]
    return 60.0 * (constant + limited) / 0.2


def test_a_constant_cutting_speed_ends_at_the_limit_of_the_spindle() -> None:
    situation = situated("G99 G50 S1000\nG96 S150 M3\nG0 X102. Z0.\nG1 X0. F0.2", "bar:100x60+2")
    moved = motion(situation, situation.feed, situation.speed)
    fed = situation.fed
    assert moved.spindle_speed[fed].max() == 1000.0
    assert moved.cutting_speed[fed][0] == pytest.approx(150.0)
    assert moved.time[fed].sum() == pytest.approx(facing_time(51.0, 0.0), rel=1e-3)


@pytest.mark.parametrize(
    "stock",
    [
        pytest.param("bar:100x60+2", id="through the face"),
        pytest.param("bar:100x60", id="through air before the face"),
    ],
)
@pytest.mark.parametrize("end", [0.0, -1.6, 30.0, 60.0])
def test_the_time_of_a_move_across_the_limit_of_the_spindle_is_exact(
    stock: str, end: float
) -> None:
    situation = situated(f"G99 G50 S1000\nG96 S150 M3\nG0 X102. Z1.\nG1 X{end} F0.2", stock)
    moved = motion(situation, situation.feed, situation.speed)
    fed = situation.fed
    assert moved.time[fed].sum() == pytest.approx(facing_time(51.0, 0.5 * end), rel=1e-5)
    assert moved.spindle_speed[fed].max() <= 1000.0 * (1.0 + 1e-9)
    assert moved.cutting_speed[fed].max() <= 150.0 * (1.0 + 1e-4)


# The command.


def command(program: Path, *options: str) -> list[str]:
    """Return the words of a command that plays a program."""
    return ["program", str(program), "--scenario", "rough_turning", *options]


@pytest.mark.parametrize(
    "options",
    [
        pytest.param("--out welle.simulated.mpf", id="output without --adapt"),
        pytest.param("--adapt words --out welle.mpf", id="output without .simulated"),
        pytest.param("--wear 5", id="wear above the criterion"),
        pytest.param("--tool T9=inside", id="unknown tool"),
        pytest.param("--law-of T9", id="law of an unknown tool"),
        pytest.param("--stock bar:5", id="no stock"),
        pytest.param("--stock missing.dxf", id="missing drawing"),
        pytest.param("--scenario nothing", id="unknown scenario"),
        pytest.param(f"--adapt words --out {FOLDER / 'welle.mpf'}", id="output is the program"),
    ],
)
def test_mistakes_end_in_one_line_and_status_2(
    options: str, capsys: pytest.CaptureFixture[str]
) -> None:
    stock = COLLECTION["welle"]["stock"]
    assert main(command(path_of("welle"), "--stock", stock, *options.split())) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("error: ")
    assert printed.err.count("\n") == 1


@pytest.mark.slow
def test_the_page_prints_what_the_commands_print(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    page = (ROOT / "shop" / "docs" / "your_own_program.md").read_text("utf-8")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shop").symlink_to(ROOT / "shop")
    example = r"```bash\npython -m turning_shop ([^\n]*)\n```\n\n```text\n(.*?)```"
    shown = re.findall(example, page, re.DOTALL)
    assert len(shown) == 2
    for words, output in shown:
        assert main(shlex.split(words)) == 0
        assert set(output.splitlines()) <= {"...", *capsys.readouterr().out.splitlines()}
        for picture in re.findall(r"--figure (\S+)", words):
            assert Path(picture).stat().st_size > 10_000


def test_letters_that_grow_in_capitals_do_not_shift_words(tmp_path: Path) -> None:
    program = path_of("welle").read_bytes()
    path = tmp_path / "a.mpf"
    path.write_bytes(program.replace(b"rougher", "großes Maß, schöner Stahl µ".encode("latin-1")))
    out = tmp_path / "a.simulated.mpf"
    assert main(command(path, "--adapt", "words", "--out", str(out))) == 0
    num_changed = 0
    for old, new in zip(path.read_bytes().split(), out.read_bytes().split(), strict=True):
        if old != new:
            num_changed += 1
            assert old[:1] == new[:1]
            assert old[:1] in b"FS"
    assert num_changed > 0


# Plausibility.


class Implausible(NamedTuple):
    """A program on its stock, and the names of what no machinist would run."""

    text: str
    stock: str
    names: set[str]
    tools: dict[str, str] | None = None


NECK = (
    "G0 X34.\nG71 U1. R0.5\nG71 P1 Q2 U0.3 W0. F0.2\n"
    "N1 G0 X20.\nG1 Z-14.\nX14. Z-18.\nZ-30.\nN2 X34.\nG0 X100."
)
AWAY = "G0 Z-60.\nG1 X50. F0.1\nZ-10. F0.25\nG0 X62."
IMPLAUSIBLE = {
    "cylinder": Implausible(f"{BAR}G1 X56. F0.25\nZ-40.", "bar:60x60", set()),
    "rapid move through metal": Implausible(
        f"{BAR}G0 X50.\nZ-40.\nX62.\nZ2.\nG1 X56. F0.2\nZ-9.",
        "bar:60x60",
        names={"rapid in metal"},
    ),
    "feed of 6 mm": Implausible(
        f"{BAR}G0 X20.\nG1 Z-40. F6",
        "bar:60x60",
        names={"load", "depth of cut", "high feed"},
    ),
    "cutting speed in rev/min": Implausible(
        f"G50 S2500\n{BAR.replace('G97 S800', 'G96 S2000')}G1 X56. F0.25\nZ-40.",
        "bar:60x60",
        names={"cutting speed"},
    ),
    "fast cut of aluminium": Implausible(
        f"{BAR.replace('G97 S800', 'G96 S1000')}G1 X116. F0.1\nZ-40.", "bar:120x60", set()
    ),
    "no M3": Implausible(
        f"{BAR.replace('M3', '')}G1 X56. F0.25\nZ-40.",
        "bar:60x60",
        names={"spindle stands"},
    ),
    "spindle stopped in air": Implausible(
        f"{BAR}M5\nG1 X56. F0.25\nM3\nG1 Z-40.", "bar:60x60", set()
    ),
    "away from the chuck": Implausible(
        BAR + AWAY, "bar:60x80", names={"back of the tool", "gouged contour"}
    ),
    "away from the chuck with a neutral tool": Implausible(
        BAR + AWAY, "bar:60x80", set(), tools={"T0101": "neutral"}
    ),
    "neck": Implausible(BAR + NECK, "bar:32x40", names={"depth of cut", "gouged contour"}),
    "neck with a copying tool": Implausible(
        BAR + NECK, "bar:32x40", set(), tools={"T0101": "copying"}
    ),
    "thin chips": Implausible(f"{BAR}G1 X59.9 F0.02\nZ-0.1", "bar:60x60", names={"edge life"}),
    "numbers in inches": Implausible(
        "G99 G97 S900 M3\nG0 X2.1 Z0.1\nG1 X1.8 F0.02\nZ-2.5 F0.012",
        "bar:2x5",
        names={"unit"},
    ),
}


@pytest.mark.parametrize("name", IMPLAUSIBLE)
def test_programs_that_no_machinist_would_run_are_named_with_their_lines(name: str) -> None:
    example = IMPLAUSIBLE[name]
    situation = situated(example.text, example.stock, example.tools)
    reasons = implausible(situation, play(situation, change_wear(situation)))
    assert set(reasons) == example.names
    for reason in reasons.values():
        assert re.match(r"lines? \d+", reason)


def test_an_implausible_program_is_adapted_by_force_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.nc"
    path.write_text(
        f"{BAR.replace('M3', '')}G1 X56. F0.25\nZ-40.\nG0 X62.\nZ2.\nG1 X54. F0.1\nZ-40.\n"
    )
    words = command(path, "--stock", "bar:60x60", "--adapt", "words")
    assert main(words) == 2
    assert "spindle stands" in capsys.readouterr().err
    assert main([*words, "--force"]) == 0
    assert "need a nose radius" in capsys.readouterr().out
    assert main([*words, "--force", "--nose-radius", "0.6"]) == 0
    assert "F0.25 -> F0.3 (theoretical roughness Rt 13.0 um -> 18.8 um)" in capsys.readouterr().out


# Kinds of tools.

DRILLED_AND_BORED = (
    f"{BAR}G0 X0.\nG1 Z-40. F0.1\nG0 Z5.\n"
    "T0202\nG0 X20. Z2.\nG1 X24. F0.2\nZ-30.\nX22.\nG0 Z2.\nX70.\nG1 Z-5."
)


def test_kinds_of_tools_and_the_stock_follow_from_the_program() -> None:
    made = moves(DRILLED_AND_BORED)
    removal = remove(made, read_stock("tube:60x20x60"))
    assert dict(removal.tools) == {"T0101": "drill", "T0202": "inside"}
    _, description = guessed_stock(made)
    assert description.startswith("tube:")


def test_drilling_removes_metal_and_is_not_in_air() -> None:
    situation = situated(DRILLED_AND_BORED, "bar:60x60", {"T0101": "drill:20"})
    removal = situation.removal
    removed = volume(removal.stock) - volume(removal.part)
    assert removed > math.pi * 10.0**2 * 40.0
    totals = summary(situation, play(situation, change_wear(situation)))
    drilling_time = 60.0 * 42.0 / (0.1 * 800.0)
    assert totals.time_of_threads_and_drills == pytest.approx(drilling_time)


def test_a_tool_beyond_the_axis_removes_as_much() -> None:
    removed = []
    for diameter in ("54.", "-54."):
        made = moves(f"{BAR}G0 X{diameter}\nG1 Z-30. F0.2")
        removed.append(remove(made, read_stock("bar:60x60")).slices.volume.sum())
    assert removed[0] == removed[1] > 0.0


@pytest.mark.parametrize(
    ("cuts", "kind"),
    [
        pytest.param(
            "X62. Z-20.\nG1 X50. F0.1\nG4 X0.5\nX61.\nG0 Z-26.\nG1 X50.\nG0 X61.",
            "groove:3",
            id="grooves",
        ),
        pytest.param(
            "X20. Z-20.\nG1 X30. F0.1\nG0 X20.\nZ5.",
            "groove:3-inside",
            id="groove in a bore",
        ),
        pytest.param(
            "X-20. Z2.\nG1 Z-10. F0.1\nG0 Z1.\nG1 Z-20.\nG0 Z5.",
            "drill:20",
            id="pecks",
        ),
        pytest.param(
            "X62. Z0.\nG1 X-1. F0.1\nG0 Z2.\nX56.\nG1 Z-30.",
            "outside",
            id="face and cylinder",
        ),
        pytest.param(
            "X62. Z-5.\nG1 X50. F3.\nG0 X62.\nZ0.\nX56.\nG1 Z-30. F0.2",
            "outside",
            id="first feed only places the tool",
        ),
    ],
)
def test_kinds_of_tools_follow_from_how_they_cut(cuts: str, kind: str) -> None:
    made = moves(f"G21 G99 T0101\nG97 S800 M3\nG0 {cuts}")
    stock, _ = guessed_stock(made)
    if kind.endswith("-inside"):
        stock = read_stock("tube:60x20x60")
    removal = remove(made, stock)
    assert removal.tools["T0101"] == kind
    assert removal.slices.volume.sum() > 0.0


@pytest.mark.parametrize(
    "text",
    [
        pytest.param(
            f"{BAR}G0 X18.\nG71 U1. R0.5\nG71 P1 Q2 U-0.3 W0. F0.2\n"
            "N1 G0 X40.\nG1 Z-14.\nX20.\nN2 Z-30.\nG0 X18.",
            id="G71",
        ),
        pytest.param(
            'DIAMON T1\nG96 S150 M4\nG0 X16 Z2\n\n\nCYCLE95("A",2,,0.2,,0.3,,0.15,7)\nM30\n'
            "PROC A\nG1 X40 Z0\nZ-14\nX20\nZ-30\nRET",
            id="CYCLE95",
        ),
    ],
)
def test_a_side_without_metal_is_refused(text: str) -> None:
    with pytest.raises(NcError, match=r"line 6: .*no hole"):
        remove(moves(text), read_stock("bar:60x60"))
    assert remove(moves(text), read_stock("tube:60x18x60")).slices.volume.sum() > 0.0


def test_a_speed_that_cuts_nothing_stays() -> None:
    text = "G21 G99 T0101\nG96 S120 M3\nG0 X70. Z2.\nG1 X62. F0.5\nG96 S160\nG0 X54.\nG1 Z-40. F0.2"
    text += "\nG0 X70.\nZ2.\nG1 X53. F0.1\nZ-40."
    changes = adapt(situated(text, "bar:60x60")).changes
    assert 2 not in {change.line for change in changes}
    assert "F0.2" in {change.before for change in changes}


class Slides(NamedTuple):
    """The program of the paper's slides on a blank that was measured."""

    diameter: float  # of the blank [mm]
    passes: int  # at the first cylinder
    situation: Situation

    @property
    def cuts(self) -> list[Move]:
        """The passes along the first cylinder, up to Z-60."""
        cuts = []
        for move in self.situation.moves.moves:
            end = (-60.0, move.path.start.x)
            if move.kind == "feed" and move.path.end == end:
                cuts.append(move)
        return cuts


BATCH = Scenario.load("batch_casting")
# Radius of the first cylinder [mm].
FIRST_RADIUS = 45.0
PASSES = {97.6: 2, 100.8: 3, 103.0: 3, 106.0: 4}
"""Number of passes by the diameter of the blank [mm]."""


@pytest.fixture(scope="module", params=PASSES, ids="{} mm".format)
def slides(request: pytest.FixtureRequest) -> Slides:
    diameter: float = request.param
    program = (ROOT / "research/papers/data/stho_stcl.mpf").read_text("utf-8")
    made = run(divide(program.replace("R42=103", f"R42={diameter}")))
    removal = remove(made, read_stock(f"bar:{diameter}x150+1.5"), {"T2": "groove:4"})
    situation = Situation(BATCH, AssumedMachine(), made, removal)
    return Slides(diameter, PASSES[diameter], situation)


def test_the_cycles_of_the_slides_are_plausible_and_make_the_part(slides: Slides) -> None:
    situation = slides.situation
    played = play(situation, Process.of(BATCH).mean_wear)
    assert implausible(situation, played) == {}

    # Lengths and radii of the part's cylinders [mm].
    cylinders = [(90.0, 0.5 * slides.diameter), (20.0, FIRST_RADIUS), (34.0, 40.0), (6.0, 30.0)]
    part = sum(math.pi * length * radius**2 for length, radius in cylinders)
    groove = math.pi * 17.0 * (40.0**2 - 36.0**2)
    # Edges of 85 degrees leave ridges.
    assert volume(situation.removal.part) == pytest.approx(part - groove, rel=2e-4)


def test_the_cycles_of_the_slides_divide_the_measured_blank(slides: Slides) -> None:
    _, *radii = np.linspace(0.5 * slides.diameter, FIRST_RADIUS, slides.passes + 1)
    assert [move.path.end.x for move in slides.cuts] == pytest.approx(radii)


def test_the_cycles_of_the_slides_cut_by_the_rule(slides: Slides) -> None:
    depth = (0.5 * slides.diameter - FIRST_RADIUS) / slides.passes
    speed, feed = set_point("PN", Process.of(BATCH).rescaled(1.25, 1.25), depth)
    assert slides.cuts
    for move in slides.cuts:
        assert move.speed.value == pytest.approx(speed, rel=1e-3)
        assert move.feed.value == pytest.approx(feed, rel=1e-3)


def test_the_cycles_of_the_slides_have_their_patterns(slides: Slides) -> None:
    # In the slides, F is a fast move and f one at feed.
    letters = {"rapid": "F", "feed": "f"}
    motions = "".join(letters[move.kind] for move in slides.situation.moves.moves)
    assert motions.count("FfFF") == 1 + slides.passes + 2
    assert motions.count("FffF") == 2 + 3


def test_the_figure_is_in_the_units_of_the_output() -> None:
    pytest.importorskip("matplotlib")
    from turning_nc.picture import draw

    situation = situated(f"{BAR}G1 X56. F0.2\nZ-20.\nG0 X70.", "bar:60x40")
    played = play(situation, 0.2)
    metric = draw(situation, played, title="part").axes[0]
    inch = draw(situation, played, title="part", units=INCH).axes[0]
    assert inch.get_xlabel() == "Z [in]"
    assert 25.4 * np.array(inch.get_xlim()) == pytest.approx(np.array(metric.get_xlim()))
    assert 25.4 * np.array(inch.get_ylim()) == pytest.approx(np.array(metric.get_ylim()))
    passes, _ = metric.collections
    inch_passes, _ = inch.collections
    segments = passes.get_segments()
    inch_segments = inch_passes.get_segments()
    assert segments
    for segment, inch_segment in zip(segments, inch_segments, strict=True):
        assert 25.4 * inch_segment == pytest.approx(segment)
