"""Programs on their stock: metal, loads, adapted feeds and speeds, and the command.

The collection runs as in LinuxCNC, where that is installed.
"""

import math
import os
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("shapely")

from turning_nc.adapt import adapt
from turning_nc.adaptable_words import Where
from turning_nc.cutting import Machine, Situation, motion, play
from turning_nc.edges import change_wear, parts_per_edge
from turning_nc.moves import run
from turning_nc.plausibility import implausible
from turning_nc.removal import remove
from turning_nc.report import summary
from turning_nc.stock import guessed_stock, read_stock, volume
from turning_nc.words import NcError, divide
from turning_shop import WorkshopError

from baselines.models.process import Process
from baselines.two_limits import set_point
from shop.examples.adapt_programs import COLLECTION, FOLDER, SCENARIO, path_of, situation_of
from shop.tests.turning_nc.linuxcnc import INSTALLED, Canonical, canonical, translated
from shop.tests.turning_nc.programs import BAR, moves
from tests.programs import NO_LINUXCNC
from tests.walking import ROOT
from turning_env import Scenario
from turning_env.__main__ import main

WITHOUT_CYCLES = [name for name, entry in COLLECTION.items() if not entry.get("cycles")]
QUICK = ("inch_bar", "grooves_in_sub_program", "feed_per_minute", "welle", "gewinde", "abspanen")


@pytest.mark.skipif(not INSTALLED, reason=NO_LINUXCNC)
@pytest.mark.parametrize("name", WITHOUT_CYCLES)
def test_moves_feeds_and_speeds_are_those_of_linuxcnc(name: str, tmp_path: Path) -> None:
    moves = situation_of(name).moves
    reference = canonical(
        translated(path_of(name).read_text(), moves.program.dialect.name), tmp_path
    )
    expected: list[Canonical] = []
    here = reference[0].end  # the first moves to where our tool stands before the program
    for move in reference[1:]:
        if move.kind == "dwell" or move.centre is not None or math.dist(here, move.end) > 1e-6:
            expected.append(move)
            here = move.end
    assert len(moves.moves) == len(expected)
    for ours, theirs in zip(moves.moves, expected, strict=True):
        assert ours.path.end == pytest.approx(theirs.end, abs=1e-3), ours.line
        assert (ours.path.centre is None) == (theirs.centre is None)
        if theirs.centre is not None:
            assert ours.path.centre == pytest.approx(theirs.centre, abs=1e-3)
            assert ours.path.clockwise == theirs.clockwise
        assert ours.time == pytest.approx(theirs.time)
        if theirs.kind == "feed":
            values = ours.feed.value, ours.speed.value
            assert values == pytest.approx((theirs.feed, theirs.speed), rel=1e-4), ours.line
            assert (ours.per_revolution, ours.constant_cutting_speed) == (
                theirs.per_turn,
                theirs.limit > 0.0,
            )
            if ours.constant_cutting_speed:
                assert min(ours.max_spindle_speed, 1e9) == pytest.approx(min(theirs.limit, 1e9))


@pytest.mark.parametrize("name", COLLECTION)
def test_removed_metal_is_the_difference_of_the_polygons(name: str) -> None:
    removal = situation_of(name).removal
    assert removal.slices.volume.sum() == pytest.approx(
        volume(removal.stock) - volume(removal.part), rel=1e-3
    )
    assert (removal.rapids, removal.gouged, removal.notes) == ({}, {}, ())


@pytest.mark.parametrize(
    "name",
    [name if name in QUICK else pytest.param(name, marks=pytest.mark.slow) for name in COLLECTION],
)
@pytest.mark.parametrize("where", ["words", "blocks"])
def test_an_adapted_program_differs_in_words_of_feed_and_speed_alone(
    name: str, where: Where
) -> None:
    situation = situation_of(name)
    adapted = adapt(situation, None, where)
    word = (
        r"(?<=[FS])\d+\.?\d*" if where == "words" else r" ?[FS]\d+\.?\d*"
    )  # numbers, or whole words
    for old, new in zip(
        situation.moves.program.text.split("\n"), adapted.text.split("\n"), strict=True
    ):
        blank = r"\d+\.?\d*" if "CYCLE95" in old else word
        if where == "words" or "CYCLE95" not in old:
            assert re.sub(blank, "", old) == re.sub(blank, "", new)
    first, second = play(situation, change_wear(situation)), adapted.played
    assert second.load.max() <= 1.001
    if first.load.max() <= 1.0:  # an overload is removed at any price
        assert second.used_life.sum() <= first.used_life.sum() * 1.001
    assert second.wear.max() <= first.wear.max() * 1.001


def test_finishing_keeps_its_feed_and_an_overload_is_removed() -> None:
    assert "F0.12" in adapt(situation_of("stepped_shaft")).text
    situation = situation_of("flange")
    first = play(situation, change_wear(situation))
    assert set(situation.line[first.load > 1.0]) == {23}
    assert adapt(situation, None, "blocks").played.time.sum() < first.time.sum()


def test_an_adapted_program_uses_no_more_edges() -> None:
    situation = situated(f"{BAR}G1 X56. F0.25\nZ-40.", "bar:60x60")  # at a spindle speed that stays
    adapted = adapt(situation)
    assert adapted.changes
    before = parts_per_edge(situation, play(situation, change_wear(situation)))
    assert parts_per_edge(adapted.situation, adapted.played)["T0101"] >= before["T0101"] > 1.0


# Stock and tools.


def test_a_turned_cylinder_has_its_volume_and_depth() -> None:
    made = moves("G99 G97 S500 M3\nG0 X46. Z2.\nG1 Z-30. F0.2\nG0 X60.\nZ50.")
    removal = remove(made, read_stock("bar:50x60"))
    expected = math.pi * (25.0**2 - 23.0**2) * 30.0
    wedge = (
        2.0 * math.pi * 24.0 * 2.0**2 * math.tan(math.radians(5.0)) / 2.0
    )  # beside the edge, which leads by 5 degrees
    assert removal.slices.volume.sum() == pytest.approx(expected - wedge, rel=1e-3)
    inner = removal.slices.depth[(removal.slices.move == 1)][5:-2]
    assert inner == pytest.approx(2.0)


STOCKS = {
    "bar:50": "bar:DIAMETERxLENGTH",
    "bar:0x50": "above 0",
    "tube:50x60x70": "below the outer",
    "bar:5.0.1x50": "no bar",
}
POINTS = {
    "1,2,3\n4,5,6": "line 1|line 2",
    "0,0\n1,-5": "line 2",
    "0,10\n": "no area",
    "a\nb": "line 2",
    "1e9,5": "line 1",
}


def test_a_stock_is_a_bar_or_a_list_of_points(tmp_path: Path) -> None:
    path = tmp_path / "stock.csv"
    path.write_text("z,diameter\n1,0\n1,50\n-60,50\n-60,0\n")
    assert volume(read_stock(str(path))) == pytest.approx(volume(read_stock("bar:50x60+1")))
    for text, named in STOCKS.items():
        with pytest.raises(NcError, match=named):
            read_stock(text)
    for text, named in POINTS.items():
        path.write_text(text)
        with pytest.raises(NcError, match=named):
            read_stock(str(path))


def test_a_stock_is_a_drawing(tmp_path: Path) -> None:
    drawing, path = pytest.importorskip("ezdxf").new(), tmp_path / "stock.dxf"
    space = drawing.modelspace()
    for start, end in (((1, 0), (1, 20)), ((-60, 20), (1, 20)), ((-60, 20), (-60, 0))):
        space.add_line(start, end)
    drawing.units = 4
    drawing.saveas(path)
    assert volume(read_stock(str(path))) == pytest.approx(math.pi * 20.0**2 * 61.0, rel=1e-6)
    wrong = [
        space.add_text("TEXT"),
        space.add_line((0, math.nan), (1, 0)),
        space.add_circle((0, 0), 1e9),
    ]
    wrong += [
        space.add_arc((0, 0), 5, math.nan, 90),
        space.add_lwpolyline([(0, 0, 0, 0, math.nan), (1, 1)]),
    ]
    for entity in wrong:
        drawing.saveas(path)
        with pytest.raises(NcError, match="TEXT" if entity is wrong[0] else "not finite or above"):
            read_stock(str(path))
        space.delete_entity(entity)
    path.write_text("nothing")
    with pytest.raises(NcError, match="no DXF"):
        read_stock(str(path))
    os.mkfifo(tmp_path / "pipe.dxf")
    with pytest.raises(WorkshopError, match="a pipe"):
        read_stock(str(tmp_path / "pipe.dxf"))


def test_unknown_tools_are_refused_and_a_rapid_move_through_metal_is_named() -> None:
    made = moves("G99 G97 S500 M3\nG0 X40. Z2.\nG0 Z-30.\nG1 Z-31. F0.2")
    assert list(remove(made, read_stock("bar:50x60")).rapids) == [3]
    for name, kind in (("T9", "inside"), ("T0", "reamer"), ("T0", "groove:0"), ("T0", "groove:x")):
        with pytest.raises(NcError, match=r"T9|no kind of tool"):
            remove(made, guessed_stock(made)[0], {name: kind})


# Play.


def situated(text: str, stock: str, tools: Any = None) -> Situation:
    """Return a program on its stock."""
    made = moves(text)
    return Situation(SCENARIO, Machine(), made, remove(made, read_stock(stock), tools or {}))


def test_a_constant_cutting_speed_ends_at_the_limit_of_the_spindle() -> None:
    situation = situated("G99 G50 S1000\nG96 S150 M3\nG0 X102. Z0.\nG1 X0. F0.2", "bar:100x60+2")
    time, speed, _, turns = motion(situation, situation.feed, situation.speed)
    fed = situation.fed
    assert turns[fed].max() == 1000.0
    assert speed[fed][0] == pytest.approx(150.0)
    reached = 150_000.0 / (2.0 * math.pi * 1000.0)  # radius [mm]
    exact = (
        math.pi * (51.0**2 - reached**2) / (150_000.0 * 0.2) * 60.0
        + reached / (0.2 * 1000.0) * 60.0
    )
    assert time[fed].sum() == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize(
    "stock", ["bar:100x60+2", "bar:100x60"]
)  # through the face, and through air before it
@pytest.mark.parametrize("end", [0.0, -1.6, 30.0, 60.0])
def test_the_time_of_a_move_across_the_limit_of_the_spindle_is_exact(
    stock: str, end: float
) -> None:
    situation = situated(f"G99 G50 S1000\nG96 S150 M3\nG0 X102. Z1.\nG1 X{end} F0.2", stock)
    time, speed, _, turns = motion(situation, situation.feed, situation.speed)
    fed = situation.fed
    reached = 150_000.0 / (
        2.0 * math.pi * 1000.0
    )  # radius at which the spindle is at its limit [mm]
    least = 0.5 * end
    constant = (
        math.pi * (51.0**2 - max(least, reached) ** 2) / 150_000.0
    )  # turns at 150 m/min [min mm]
    limited = max(reached - least, 0.0) / 1000.0
    assert time[fed].sum() == pytest.approx(60.0 * (constant + limited) / 0.2, rel=1e-5)
    assert turns[fed].max() <= 1000.0 * (1.0 + 1e-9)
    assert speed[fed].max() <= 150.0 * (1.0 + 1e-4)


# The command.


def options(name: str, *more: str) -> list[str]:
    entry = COLLECTION[name]
    tools = [f"--tool={tool}={kind}" for tool, kind in entry.get("tools", {}).items()]
    return [
        "program",
        str(path_of(name)),
        "--scenario",
        "rough_turning",
        "--stock",
        entry["stock"],
        *tools,
        *more,
    ]


MISTAKES = (
    "--out welle.simulated.mpf|--adapt words --out welle.mpf|--wear 5|--tool T9=inside|"
    "--stock bar:5|--stock missing.dxf|"
    f"--scenario nothing|--adapt words --out {FOLDER / 'welle.mpf'}"
)


@pytest.mark.parametrize("more", MISTAKES.split("|"))
def test_mistakes_end_in_one_line_and_status_2(
    more: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(options("welle", *more.split(" "))) == 2
    captured = capsys.readouterr()
    assert (captured.out, captured.err.count("\n"), captured.err[:7]) == ("", 1, "error: ")


def test_the_page_prints_what_the_commands_print(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    page = (ROOT / "shop" / "docs" / "your_own_program.md").read_text("utf-8")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shop").symlink_to(ROOT / "shop")
    shown = re.findall(
        r"```bash\npython -m turning_env ([^\n]*)\n```\n\n```text\n(.*?)```", page, re.DOTALL
    )
    assert len(shown) == 2
    for command, printed in shown:
        assert main(shlex.split(command)) == 0
        assert set(printed.splitlines()) <= {"...", *capsys.readouterr().out.splitlines()}
        for picture in re.findall(r"--figure (\S+)", command):
            assert Path(picture).stat().st_size > 10_000


def test_letters_that_grow_in_capitals_do_not_shift_words(tmp_path: Path) -> None:
    path, out = tmp_path / "a.mpf", tmp_path / "a.simulated.mpf"
    path.write_bytes(
        path_of("welle")
        .read_bytes()
        .replace(b"rougher", "großes Maß, schöner Stahl µ".encode("latin-1"))
    )
    assert (
        main(
            [
                "program",
                str(path),
                "--scenario",
                "rough_turning",
                "--adapt",
                "words",
                "--out",
                str(out),
            ]
        )
        == 0
    )
    changed = [
        (old, new)
        for old, new in zip(path.read_bytes().split(), out.read_bytes().split(), strict=True)
        if old != new
    ]
    assert changed
    assert all(old[:1] == new[:1] and old[:1] in b"FS" for old, new in changed)


# Plausibility.

NECK = (
    "G71 U1. R0.5\nG71 P1 Q2 U0.3 W0. F0.2\n"
    "N1 G0 X20.\nG1 Z-14.\nX14. Z-18.\nZ-30.\nN2 X34.\nG0 X100."
)
AWAY = "G0 Z-60.\nG1 X50. F0.1\nZ-10. F0.25\nG0 X62."
IMPLAUSIBLE: list[tuple[str, str, dict[str, str], set[str]]] = [
    (f"{BAR}G1 X56. F0.25\nZ-40.", "bar:60x60", {}, set()),
    (f"{BAR}G0 X50.\nZ-40.\nX62.\nZ2.\nG1 X56. F0.2\nZ-9.", "bar:60x60", {}, {"rapid in metal"}),
    (f"{BAR}G0 X20.\nG1 Z-40. F6", "bar:60x60", {}, {"load", "depth of cut", "high feed"}),
    (f"{BAR.replace('M3', '')}G1 X56. F0.25\nZ-40.", "bar:60x60", {}, {"spindle stands"}),
    (f"{BAR}M5\nG1 X56. F0.25\nM3\nG1 Z-40.", "bar:60x60", {}, set()),
    (BAR + AWAY, "bar:60x80", {}, {"back of the tool", "gouged contour"}),
    (BAR + AWAY, "bar:60x80", {"T0101": "neutral"}, set()),
    (f"{BAR}G0 X34.\n{NECK}", "bar:32x40", {}, {"depth of cut", "gouged contour"}),
    (f"{BAR}G0 X34.\n{NECK}", "bar:32x40", {"T0101": "copying"}, set()),
    (f"{BAR}G1 X59.9 F0.02\nZ-0.1", "bar:60x60", {}, {"edge life"}),
    (
        "G99 G97 S900 M3\nG0 X2.1 Z0.1\nG1 X1.8 F0.02\nZ-2.5 F0.012",
        "bar:2x5",
        {},
        {"edge life", "unit"},
    ),
]


@pytest.mark.parametrize(("text", "stock", "tools", "names"), IMPLAUSIBLE)
def test_what_no_machinist_would_run_is_named_with_its_lines(
    text: str, stock: str, tools: Any, names: set[str]
) -> None:
    situation = situated(text, stock, tools)
    found = implausible(situation, play(situation, change_wear(situation)))
    assert set(found) == names
    assert all(re.match(r"lines? \d+", reason) for reason in found.values())


def test_an_implausible_program_is_adapted_by_force_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.nc"
    path.write_text(f"{BAR.replace('M3', '')}G1 X56. F0.25\nZ-40.\n")
    command = [
        "program",
        str(path),
        "--scenario",
        "rough_turning",
        "--stock",
        "bar:60x60",
        "--adapt",
        "words",
    ]
    assert main(command) == 2
    assert "spindle stands" in capsys.readouterr().err
    assert main([*command, "--force"]) == 0
    assert "need a nose radius" in capsys.readouterr().out
    assert main([*command, "--force", "--nose-radius", "0.6"]) == 0
    assert "F0.25 -> F0.3 (theoretical roughness Rt 13.0 -> 18.8 um)" in capsys.readouterr().out


def test_kinds_of_tools_and_the_stock_follow_from_the_program() -> None:
    bored = moves(
        f"{BAR}G0 X0.\nG1 Z-40. F0.1\nG0 Z5.\n"
        "T0202\nG0 X20. Z2.\nG1 X24. F0.2\nZ-30.\nX22.\nG0 Z2.\nX70.\nG1 Z-5."
    )
    removal = remove(bored, read_stock("tube:60x20x60"))
    assert dict(removal.tools) == {"T0101": "drill", "T0202": "inside"}
    assert guessed_stock(bored)[1].startswith("tube:")
    drilled = remove(bored, read_stock("bar:60x60"), {"T0101": "drill:20"})
    assert volume(drilled.stock) - volume(drilled.part) > math.pi * 10.0**2 * 40.0
    situation = Situation(SCENARIO, Machine(), bored, drilled)
    totals = summary(situation, play(situation, change_wear(situation)))
    assert totals.time_of_threads_and_drills == pytest.approx(
        60.0 * 42.0 / (0.1 * 800.0)
    )  # not in air
    mirrored, plain = (
        remove(moves(f"{BAR}G0 X{x}\nG1 Z-30. F0.2"), read_stock("bar:60x60"))
        for x in ("-54.", "54.")
    )
    assert mirrored.slices.volume.sum() == plain.slices.volume.sum() > 0.0


@pytest.mark.parametrize(
    ("cuts", "kind"),
    [
        ("X62. Z-20.\nG1 X50. F0.1\nG4 X0.5\nX61.\nG0 Z-26.\nG1 X50.\nG0 X61.", "groove:3"),
        ("X20. Z-20.\nG1 X30. F0.1\nG0 X20.\nZ5.", "groove:3-inside"),
        ("X-20. Z2.\nG1 Z-10. F0.1\nG0 Z1.\nG1 Z-20.\nG0 Z5.", "drill:20"),
        ("X62. Z0.\nG1 X-1. F0.1\nG0 Z2.\nX56.\nG1 Z-30.", "outside"),
        (
            "X62. Z-5.\nG1 X50. F3.\nG0 X62.\nZ0.\nX56.\nG1 Z-30. F0.2",
            "outside",
        ),  # the first feed only places the tool
    ],
)
def test_kinds_of_tools_follow_from_how_they_cut(cuts: str, kind: str) -> None:
    made = moves(f"G21 G99 T0101\nG97 S800 M3\nG0 {cuts}")
    stock = guessed_stock(made)[0] if "-inside" not in kind else read_stock("tube:60x20x60")
    removal = remove(made, stock)
    assert removal.tools["T0101"] == kind
    assert removal.slices.volume.sum() > 0.0


@pytest.mark.parametrize(
    "text",
    [
        (
            f"{BAR}G0 X18.\nG71 U1. R0.5\nG71 P1 Q2 U-0.3 W0. F0.2\n"
            "N1 G0 X40.\nG1 Z-14.\nX20.\nN2 Z-30.\nG0 X18."
        ),
        (
            'DIAMON T1\nG96 S150 M4\nG0 X16 Z2\n\n\nCYCLE95("A",2,,0.2,,0.3,,0.15,7)\nM30\n'
            "PROC A\nG1 X40 Z0\nZ-14\nX20\nZ-30\nRET"
        ),
    ],
)
def test_a_side_without_metal_is_refused(text: str) -> None:
    with pytest.raises(NcError, match=r"line 6: .*no hole"):
        remove(moves(text), read_stock("bar:60x60"))
    assert remove(moves(text), read_stock("tube:60x18x60")).slices.volume.sum() > 0.0


def test_a_speed_that_cuts_nothing_stays() -> None:
    text = "G21 G99 T0101\nG96 S120 M3\nG0 X70. Z2.\nG1 X62. F0.5\nG96 S160\nG0 X54.\nG1 Z-40. F0.2"
    changed = {change.line: change.before for change in adapt(situated(text, "bar:60x60")).changes}
    assert 2 not in changed
    assert "F0.2" in changed.values()


@pytest.mark.parametrize(("diameter", "passes"), [(97.6, 2), (100.8, 3), (103.0, 3), (106.0, 4)])
def test_the_cycles_of_the_slides_divide_the_measured_blank_and_cut_by_the_rule(
    diameter: float, passes: int
) -> None:
    text = (
        (ROOT / "research/papers/data/stho_stcl.mpf")
        .read_text("utf-8")
        .replace("R42=103", f"R42={diameter}")
    )
    made, scenario = run(divide(text)), Scenario.load("batch_casting")
    removal = remove(made, read_stock(f"bar:{diameter}x150+1.5"), {"T2": "groove:4"})
    situation = Situation(scenario, Machine(), made, removal)
    played = play(situation, Process.of(scenario).mean_wear)
    assert implausible(situation, played) == {}
    left = (
        90.0 * (0.5 * diameter) ** 2
        + 20.0 * 45.0**2
        + 34.0 * 40.0**2
        + 6.0 * 30.0**2
        - 17.0 * (40.0**2 - 36.0**2)
    )
    assert volume(removal.part) == pytest.approx(
        math.pi * left, rel=2e-4
    )  # edges of 85 degrees leave ridges
    cuts = [
        move
        for move in made.moves
        if move.kind == "feed" and move.path.end == (-60.0, move.path.start[1])
    ]
    assert [move.path.end[1] for move in cuts] == pytest.approx(
        np.linspace(0.5 * diameter, 45.0, passes + 1)[1:]
    )
    depth = (0.5 * diameter - 45.0) / passes
    speed, feed = set_point("PN", Process.of(scenario).rescaled(1.25, 1.25), depth)
    assert all(
        (move.speed.value, move.feed.value) == pytest.approx((speed, feed), rel=1e-3)
        for move in cuts
    )
    motions = "".join(
        {"rapid": "F", "feed": "f"}[move.kind] for move in made.moves
    )  # fast and feedrate
    assert motions.count("FfFF") == 1 + passes + 2
    assert motions.count("FffF") == 2 + 3
