"""Settings of a machine that a program does not state, and numbers that look like others."""

from pathlib import Path

import pytest

pytest.importorskip("shapely")

from turning_nc.cutting import AssumedMachine, Situation, play
from turning_nc.moves import Moves, ReadingChoices, run
from turning_nc.plausibility import implausible
from turning_nc.removal import remove
from turning_nc.stock import guessed_stock, read_stock
from turning_nc.words import NcError, divide
from turning_shop.__main__ import main

from shop.tests.turning_nc.programs import BAR, moves
from turning_env import Scenario


def warnings(
    made: Moves, stock: str | None = "bar:60x60", tools: dict[str, str] | None = None
) -> set[str]:
    """Return the names of what is implausible, on a stock or on the one that the moves show."""
    polygon = guessed_stock(made)[0] if stock is None else read_stock(stock)
    removal = remove(made, polygon, tools or {})
    situation = Situation(Scenario.load("rough_turning"), AssumedMachine(), made, removal)
    return set(implausible(situation, play(situation, 0.1)))


# Steps.

START = "G21 G99 T0101\nG97 S800 M3\n"
WITH_POINTS = (
    f"{START}G0 X62. Z2.\nG1 X56. F0.25\nG4 X1.\nZ-20. ,C1.5\nX60. Z-30.\n"
    "G2 X64. Z-32. R2.\nG1 U2. W-1."
)
IN_STEPS = (
    f"{START}G0 X62000 Z2000\nG1 X56000 F0.25\nG4 X1000\nZ-20000 ,C1500\nX60000 Z-30000\n"
    "G2 X64000 Z-32000 R2000\nG1 U2000 W-1000"
)
CYLINDER = f"{START}G0 X62000 Z2000\nG1 X56000 F0.25\nZ-40000"
STEPS = ReadingChoices(steps=True)


def test_numbers_without_a_point_count_steps_if_the_user_says_so() -> None:
    made = run(divide(IN_STEPS), STEPS).moves
    expected = moves(WITH_POINTS).moves
    assert [move.kind for move in made] == [move.kind for move in expected]
    assert [move.time for move in made] == [move.time for move in expected]
    ends = [move.path.end for move in made]
    assert ends == [pytest.approx(move.path.end) for move in expected]


def test_numbers_with_a_point_are_never_steps() -> None:
    assert run(divide(WITH_POINTS), STEPS).moves == moves(WITH_POINTS).moves


def test_steps_of_inches_are_a_tenth_of_a_thousandth() -> None:
    text = "G20 G99 G97 S800 M3\nG0 X24000 Z1000\nG1 Z-15000 F.01"
    last = run(divide(text), STEPS).moves[-1]
    assert last.path.end == pytest.approx((-1.5 * 25.4, 1.2 * 25.4))


def test_numbers_that_look_like_steps_are_warned_of() -> None:
    assert warnings(moves(CYLINDER)) == {"steps", "nothing cut"}
    assert "steps" in warnings(moves(CYLINDER), stock=None)
    with pytest.raises(NcError, match="--steps"):
        moves(CYLINDER.replace("Z-40000", "Z-400000"))


def test_numbers_that_are_read_right_are_not_warned_of() -> None:
    assert warnings(run(divide(CYLINDER), STEPS)) == set()
    assert "steps" not in warnings(moves(f"{BAR}G1 X56. F0.25\nZ-40."))
    # Only a rapid move has a large number.
    assert warnings(moves(f"{START}G0 X1000 Z1000\nX62 Z2\nG1 X56 F0.25\nZ-40")) == set()


def test_a_program_that_cuts_nothing_is_warned_of() -> None:
    assert warnings(moves(f"{BAR}G1 X62. F0.25\nZ-40.")) == {"nothing cut"}
    # A drill's metal is not computed.
    assert warnings(moves(f"{BAR}G0 X0.\nG83 Z-15. Q5. F0.1")) == set()


# X as a radius.

IN_RADII = (
    "G21 G18 G99\nG97 S1000 M3\nG0 X32. Z2.\nG1 X20. Z0. F0.2\nG3 X22. Z-2. I0. K-2.\n"
    "G1 Z-20.\nG0 X40. Z20."
)
RADIUS = ReadingChoices(radius=True)


def test_an_arc_that_closes_with_radii_has_a_hint() -> None:
    with pytest.raises(NcError, match=r"line 5: .*--radius"):
        moves(IN_RADII)
    with pytest.raises(NcError, match=r"^(?s:(?!.*--radius))"):
        moves(IN_RADII.replace("K-2.", "K-3."))


def test_the_user_may_have_x_read_as_a_radius() -> None:
    cuts = [move for move in run(divide(IN_RADII), RADIUS).moves if move.kind == "feed"]
    assert [move.path.end for move in cuts] == [(0.0, 20.0), (-2.0, 22.0), (-20.0, 22.0)]


def test_the_command_reads_x_as_a_radius(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "radii.nc"
    path.write_text(IN_RADII)
    options = ["--scenario", "rough_turning", "--stock", "bar:48x40", "--radius"]
    assert main(["program", str(path), *options]) == 0
    assert "44" in capsys.readouterr().out


SIEMENS_START = "G71 G90 G95 G97 S500 M3 F0.2\nG0 X20 Z2\nG1 Z-5"


@pytest.mark.parametrize(
    ("text", "radius"),
    [
        pytest.param(f"DIAMON {SIEMENS_START}", 10.0, id="DIAMON"),
        pytest.param(f"G18 LIMS=3000 {SIEMENS_START}", 20.0, id="nothing stated"),
        pytest.param("G7 G21 G95 G97 S500 M3 F0.2\nG0 X20 Z2\nG1 Z-5", 10.0, id="G7"),
    ],
)
def test_a_statement_of_the_program_overrides_the_option(text: str, radius: float) -> None:
    assert run(divide(text), RADIUS).moves[-1].path.end == (-5.0, radius)


# Units.

INCHES = "{unit} G99\nT0101\nG50 S2500\nG96 S{speed} M3\nG0 X2.1 Z.1\nG1 X1.8 F.012\nZ-2.5"
METRIC = "{unit} G99\nT0101\nG97 S800 M3\nG0 X62. Z2.\nG1 X56. F.25\nZ-40."


@pytest.mark.parametrize(
    ("text", "is_warned"),
    [
        pytest.param(INCHES.format(unit="G21", speed=500), True, id="inches stated as mm"),
        pytest.param(INCHES.format(unit="G20", speed=500), False, id="inches"),
        pytest.param(INCHES.format(unit="", speed=60), True, id="inches without a unit"),
        pytest.param(INCHES.format(unit="G21", speed=60), False, id="small part in mm"),
        pytest.param(METRIC.format(unit="G20"), True, id="mm stated as inches"),
        pytest.param(METRIC.format(unit="G21"), False, id="mm"),
        pytest.param(METRIC.format(unit=""), False, id="mm without a unit"),
    ],
)
@pytest.mark.parametrize("stock", [None, "bar:60x70"])
def test_numbers_of_the_other_unit_are_warned_of(
    text: str, is_warned: bool, stock: str | None
) -> None:
    assert ("unit" in warnings(moves(text), stock)) == is_warned


# Compensation of the nose radius.

CONE = "G0 X40. Z2.\n{side} G1 Z0. F0.2\nX56. Z-8.\nZ-40.\nG40 G0 X70."
FACE = "G0 X64. Z0.\n{side} G1 X20. F0.2\nG40 G0 Z5."
BORE = "G0 X30. Z2.\n{side} G1 Z0. F0.2\nX24. Z-6.\nZ-30.\nG40 G0 X18.\nZ5."
HUB = "G0 X64. Z-15.\n{side} G1 X30. F0.1\nZ-1.\nX28. Z0.\nG40 G0 X64. Z2."


@pytest.mark.parametrize(
    ("cut", "right", "stock", "tools"),
    [
        pytest.param(CONE, 42, "bar:60x60", {}, id="cone"),
        pytest.param(FACE, 41, "bar:60x60+1", {}, id="face"),
        pytest.param(BORE, 41, "tube:60x20x60", {"T0101": "inside"}, id="bore"),
        pytest.param(HUB, 41, "bar:31x60", {}, id="hub from the back to the face"),
        pytest.param(CONE, 42, "bar:60x60", {"T0101": "copying"}, id="copying tool"),
    ],
)
def test_a_nose_radius_that_is_compensated_to_the_wrong_side_is_warned_of(
    cut: str, right: int, stock: str, tools: dict[str, str]
) -> None:
    is_warned = {}
    for side in (40, 41, 42):
        made = moves(BAR + cut.format(side=f"G{side}"))
        is_warned[side] = "compensation" in warnings(made, stock, tools)
    wrong = 41 if right == 42 else 42
    assert is_warned == {40: False, right: False, wrong: True}


FINISHED = (
    f"{BAR}G71 U2. R1.\nG71 P1 Q2 U0.4 W0.1 F0.25\n"
    "N1 G0 {side} X40.\nG1 Z0.\nX56. Z-8.\nN2 G40 Z-40."
)


def test_cycles_that_rough_do_not_compensate() -> None:
    assert "compensation" not in warnings(moves(FINISHED.format(side="G41")))


@pytest.mark.parametrize(("side", "is_warned"), [("G41", True), ("G42", False)])
def test_cycles_that_finish_compensate(side: str, is_warned: bool) -> None:
    text = f"{FINISHED.format(side=side)}\nG70 P1 Q2"
    assert ("compensation" in warnings(moves(text))) == is_warned
