"""Settings of a machine that a program does not state, and warnings at numbers that speak for others."""

import pytest

pytest.importorskip("shapely")

from turning_nc.cutting import Machine, Situation, play
from turning_nc.moves import Moves, Reading, run
from turning_nc.plausibility import implausible
from turning_nc.removal import remove
from turning_nc.stock import guessed_stock, read_stock
from turning_nc.words import NcError, divide

from shop.tests.turning_nc.test_moves import BAR, moves
from shop.tests.turning_nc.test_play import situated
from turning_env import Scenario
from turning_env.__main__ import main


def warnings(
    made: Moves, stock: str = "bar:60x60", tools: dict[str, str] | None = None
) -> set[str]:
    """Return the names of what is implausible."""
    polygon = read_stock(stock) if stock else guessed_stock(made)[0]
    situation = Situation(
        Scenario.load("rough_turning"), Machine(), made, remove(made, polygon, tools or {})
    )
    return set(implausible(situation, play(situation, 0.1)))


# Steps.

START = "G21 G99 T0101\nG97 S800 M3\n"
WITH_POINTS = f"{START}G0 X62. Z2.\nG1 X56. F0.25\nG4 X1.\nZ-20. ,C1.5\nX60. Z-30.\nG2 X64. Z-32. R2.\nG1 U2. W-1."
CYLINDER = f"{START}G0 X62000 Z2000\nG1 X56000 F0.25\nZ-40000"
IN_STEPS = f"{START}G0 X62000 Z2000\nG1 X56000 F0.25\nG4 X1000\nZ-20000 ,C1500\nX60000 Z-30000\nG2 X64000 Z-32000 R2000\n"
IN_STEPS += "G1 U2000 W-1000"


def test_numbers_without_a_point_count_steps_if_the_user_says_so() -> None:
    made, expected = run(divide(IN_STEPS), Reading(steps=True)).moves, moves(WITH_POINTS).moves
    assert [(move.kind, move.time) for move in made] == [
        (move.kind, move.time) for move in expected
    ]
    for ours, theirs in zip(made, expected, strict=True):
        assert ours.path.end == pytest.approx(theirs.path.end)
    assert (
        run(divide(WITH_POINTS), Reading(steps=True)).moves == expected
    )  # numbers with a point stay
    inch = run(
        divide("G20 G99 G97 S800 M3\nG0 X24000 Z1000\nG1 Z-15000 F.01"), Reading(steps=True)
    ).moves[-1]
    assert inch.path.end == pytest.approx((-1.5 * 25.4, 1.2 * 25.4))


def test_numbers_that_look_like_steps_are_warned_of() -> None:
    assert warnings(moves(CYLINDER)) == {"steps", "nothing cut"}
    assert "steps" in warnings(moves(CYLINDER), stock="")
    assert warnings(run(divide(CYLINDER), Reading(steps=True))) == set()
    assert (
        warnings(moves("G21 G99 G97 S800 M3\nG0 X1000 Z1000\nX62 Z2\nG1 X56 F0.25\nZ-40")) == set()
    )  # only a rapid move
    assert "steps" not in warnings(moves(f"{BAR}G1 X56. F0.25\nZ-40."))
    with pytest.raises(NcError, match="--steps"):
        moves(CYLINDER.replace("Z-40000", "Z-400000"))


def test_a_program_that_cuts_nothing_is_warned_of() -> None:
    assert warnings(moves(f"{BAR}G1 X62. F0.25\nZ-40.")) == {"nothing cut"}
    assert (
        warnings(moves(f"{BAR}G0 X0.\nG83 Z-15. Q5. F0.1")) == set()
    )  # a drill's metal is not computed


# X as a radius.

IN_RADII = "G21 G18 G99\nG97 S1000 M3\nG0 X32. Z2.\nG1 X20. Z0. F0.2\nG3 X22. Z-2. I0. K-2.\nG1 Z-20.\nG0 X40. Z20."


def test_an_arc_that_closes_with_radii_has_a_hint_and_an_option(
    capsys: pytest.CaptureFixture[str], tmp_path
) -> None:
    with pytest.raises(NcError, match=r"line 5: .*--radius"):
        moves(IN_RADII)
    made = run(divide(IN_RADII), Reading(radius=True)).moves
    assert [move.path.end for move in made if move.kind == "feed"] == [
        (0.0, 20.0),
        (-2.0, 22.0),
        (-20.0, 22.0),
    ]
    with pytest.raises(NcError) as refused:
        moves(IN_RADII.replace("K-2.", "K-3."))
    assert "--radius" not in str(refused.value)
    path = tmp_path / "radii.nc"
    path.write_text(IN_RADII)
    assert (
        main(
            [
                "program",
                str(path),
                "--scenario",
                "rough_turning",
                "--stock",
                "bar:48x40",
                "--radius",
            ]
        )
        == 0
    )
    assert "44" in capsys.readouterr().out


def test_what_the_program_states_of_x_goes_before_the_option() -> None:
    stated = "DIAMON G71 G90 G95 G97 S500 M3 F0.2\nG0 X20 Z2\nG1 Z-5"
    assert run(divide(stated), Reading(radius=True)).moves[-1].path.end == (-5.0, 10.0)
    assert run(divide(stated.replace("DIAMON", "G18 LIMS=3000")), Reading(radius=True)).moves[
        -1
    ].path.end == (-5.0, 20.0)
    stated = "G7 G21 G95 G97 S500 M3 F0.2\nG0 X20 Z2\nG1 Z-5"
    assert run(divide(stated), Reading(radius=True)).moves[-1].path.end == (-5.0, 10.0)


# Compensation of the nose radius.

CONE = "G0 X40. Z2.\n{side} G1 Z0. F0.2\nX56. Z-8.\nZ-40.\nG40 G0 X70."
FACE = "G0 X64. Z0.\n{side} G1 X20. F0.2\nG40 G0 Z5."
BORE = "G0 X30. Z2.\n{side} G1 Z0. F0.2\nX24. Z-6.\nZ-30.\nG40 G0 X18.\nZ5."
HUB = "G0 X64. Z-15.\n{side} G1 X30. F0.1\nZ-1.\nX28. Z0.\nG40 G0 X64. Z2."


@pytest.mark.parametrize(
    ("cut", "right", "stock", "tools"),
    [
        (CONE, 42, "bar:60x60", {}),
        (FACE, 41, "bar:60x60+1", {}),
        (BORE, 41, "tube:60x20x60", {"T0101": "inside"}),
        (HUB, 41, "bar:31x60", {}),  # from the back to the face
        (CONE, 42, "bar:60x60", {"T0101": "copying"}),
    ],
)
def test_a_nose_radius_that_is_compensated_to_the_wrong_side_is_warned_of(
    cut: str, right: int, stock: str, tools
) -> None:
    names = {}
    for side in (40, 41, 42):
        situation = situated(BAR + cut.format(side=f"G{side}"), stock, tools)
        names[side] = "compensation" in implausible(situation, play(situation, 0.1))
    assert names == {40: False, right: False, 83 - right: True}


def test_cycles_that_rough_do_not_compensate_but_finishing_does() -> None:
    text = f"{BAR}G71 U2. R1.\nG71 P1 Q2 U0.4 W0.1 F0.25\nN1 G0 {{side}} X40.\nG1 Z0.\nX56. Z-8.\nN2 G40 Z-40.\nG70 P1 Q2"
    assert "compensation" not in warnings(moves(text.format(side="G42")))
    assert "compensation" in warnings(moves(text.format(side="G41")))
    assert "compensation" not in warnings(moves(text.format(side="G41").replace("\nG70 P1 Q2", "")))
