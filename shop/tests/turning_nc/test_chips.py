"""Loads of drills, threads and grooving tools, from the law of power of their tool."""

import math
from typing import Any

import pytest

pytest.importorskip("shapely")

from turning_nc.cutting import AssumedMachine, Laws, Play, Situation, play
from turning_nc.removal import remove
from turning_nc.report import Row, rows, summary
from turning_nc.stock import read_stock

from shop.tests.turning_nc.programs import moves
from turning_env.scenario import Scenario


def with_power(kc11: float, mc: float, **changes: Any) -> Scenario:
    """Return a scenario with Kienzle's law of power, kc1.1 [N/mm2] and mc, of a sharp edge."""
    law = {
        "coefficient": kc11 / 60_000.0,
        "cutting_speed": 1.0,
        "feed": 1.0 - mc,
        "depth_of_cut": 1.0,
        "reference_depth_of_cut": 1.0,
        "wear": 0.0,
    }
    limits = {"power": 10.0}
    return Scenario.load(
        {"name": "kienzle", "material": {"power": law}, "limits": limits, **changes}
    )


def situated(
    text: str, stock: str, scenario: Scenario, tools: dict[str, str], **options: Any
) -> Situation:
    """Return a program on its stock."""
    made = moves(text)
    removal = remove(made, read_stock(stock), tools)
    return Situation(scenario, AssumedMachine(), made, removal, **options)


def played(situation: Situation) -> Play:
    """Return how a program is played, with edges that are changed at 0.2 mm."""
    return play(situation, 0.2)


DRILLING = "G21 G99\nT0202\nG97 S2894 M3\nG0 X0. Z5.\nG83 Z-25. R-3. F0.15\nG80\nG0 Z50.\nM30"


def test_a_drill_has_the_power_and_torque_of_the_makers_example() -> None:
    # ISCAR, rotating tools catalogue 2017, p. 601: D 22 mm, 200 m/min, 0.15 mm/rev, kc 2200 N/mm2.
    # Pc = kc f D vc / 240000 = 6.05 kW without efficiency, and Mc = kc f D^2 / 8000 = 20 N m.
    situation = situated(DRILLING, "bar:60x40", with_power(2200.0, 0.0), {"T0202": "drill:22"})
    drive = summary(situation, played(situation)).drives["T0202"]
    assert drive.power == pytest.approx(6.05, rel=2e-3)
    assert drive.torque == pytest.approx(20.0, rel=5e-3)


def test_the_force_of_a_drill_is_that_of_its_chips_thickness() -> None:
    # h = 0.15 / 2 sin(59 degrees) = 0.06429 mm, and kc = 2200 * 0.06429^-0.25 = 4369 N/mm2.
    situation = situated(DRILLING, "bar:60x40", with_power(2200.0, 0.25), {"T0202": "drill:22"})
    drive = summary(situation, played(situation)).drives["T0202"]
    assert drive.torque == pytest.approx(4369.0 * 0.15 * 22.0**2 / 8000.0, rel=1e-3)


def test_a_drill_in_a_hole_takes_the_power_of_the_ring_alone() -> None:
    # A ring of 22 mm over 11 mm is three quarters of the area.
    law = with_power(2200.0, 0.0)
    whole = situated(DRILLING, "bar:60x40", law, {"T0202": "drill:22"})
    ring = situated(DRILLING, "tube:60x11x40", law, {"T0202": "drill:22"})
    assert played(ring).power.max() == pytest.approx(0.75 * played(whole).power.max(), rel=1e-3)


THREAD = (
    "G21 G99\nT0303\nG97 S500 M3\nG0 X{clear}. Z4.\n"
    "G92 X{first} Z-20. F2.\nX{second}\nX{second}\nG0 Z50.\nM30"
)


@pytest.mark.parametrize(
    ("text", "stock", "radii"),
    [
        pytest.param(
            THREAD.format(clear=44, first=39.0, second=38.0),
            "bar:40x60",
            (19.5, 19.0),
            id="outside",
        ),
        pytest.param(
            THREAD.format(clear=36, first=41.0, second=42.0),
            "tube:60x40x60",
            (20.5, 21.0),
            id="inside",
        ),
    ],
)
def test_passes_of_a_thread_have_the_power_of_their_chips(
    text: str, stock: str, radii: tuple[float, float]
) -> None:
    # By hand, with kc1.1 1775 N/mm2 and mc 0.24, for depths of 0.5 and 1 mm:
    # A = tan(30) (0.5^2) = 0.14434 mm2, h = A / (2 * 0.5 / cos(30)) = 0.125 mm, Fc = 422.0 N;
    # A = tan(30) (1 - 0.25) = 0.43301 mm2, h = A / (2 / cos(30)) = 0.1875 mm, Fc = 1148.6 N.
    situation = situated(text, stock, with_power(1775.0, 0.24), {"T0303": "outside"})
    powers = played(situation).power[situation.kind == "thread"]
    speeds = [2.0 * math.pi * radius * 500.0 / 1000.0 for radius in radii]
    assert powers[0] == pytest.approx(422.0 * speeds[0] / 60_000.0, rel=1e-3)
    assert powers[1] == pytest.approx(1148.6 * speeds[1] / 60_000.0, rel=1e-3)
    assert powers[2] == 0.0  # a spring pass cuts nothing


# Two starts of a lead of 4 mm, each in passes of 0.5 and 1 mm; then a spring pass of each.
BY_ANGLE = "G92 X39. Z-20. F4.{0}\nX39.{1}\nX38.{0}\nX38.{1}\nX38.{0}\nX38.{1}\n"
BY_PLACE = (
    "G92 X39. Z-20. F4.\nG0 Z6.\nG92 X39. Z-20.\nG0 Z4.\nG92 X38. Z-20.\nG0 Z6.\n"
    "G92 X38. Z-20.\nG0 Z4.\nG92 X38. Z-20.\nG0 Z6.\nG92 X38. Z-20.\n"
)
START_BY_START = "G92 X39. Z-20. F4.\nX38.\nX38.\nG0 Z6.\nG92 X39. Z-20.\nX38.\nX38.\n"


@pytest.mark.parametrize(
    ("passes", "depths"),
    [
        pytest.param(BY_ANGLE.format("", " Q180000"), [0.5, 0.5, 1, 1, 0, 0], id="by Q"),
        pytest.param(BY_PLACE, [0.5, 0.5, 1, 1, 0, 0], id="by Z"),
        pytest.param(START_BY_START, [0.5, 1, 0, 0.5, 1, 0], id="one after the other"),
    ],
)
def test_each_start_of_a_thread_cuts_its_own_chips(passes: str, depths: list[float]) -> None:
    text = f"G21 G99\nT0303\nG97 S500 M3\nG0 X44. Z4.\n{passes}G0 Z50.\nM30"
    situation = situated(text, "bar:40x60", with_power(1775.0, 0.24), {"T0303": "outside"})
    powers = played(situation).power[situation.kind == "thread"]
    # The forces of passes of 0.5 and 1 mm are those of the single thread above.
    by_depth = {0: 0.0, 0.5: 422.0 * 0.0195, 1: 1148.6 * 0.019}
    expected = [by_depth[depth] * 2.0 * math.pi * 500.0 / 60_000.0 for depth in depths]
    assert powers == pytest.approx(expected, rel=1e-3)


def test_passes_along_a_flank_are_of_one_start() -> None:
    text = (
        "G21 G99\nT0303\nG97 S500 M3\nG0 X44. Z4.\nG76 P020060 Q50 R0.02\n"
        "G76 X38. Z-20. P1000 Q400 F2.\nG0 Z50.\nM30"
    )
    situation = situated(text, "bar:40x60", with_power(2000.0, 0.0), {"T0303": "outside"})
    # With mc 0, the areas of all passes add up to that of the profile, tan(30) 1^2.
    powers = played(situation).power[situation.kind == "thread"]
    diameters = situation.diameter[situation.kind == "thread"]
    areas = powers * 60_000.0 / (2000.0 * math.pi * diameters * 0.5)
    assert areas.sum() == pytest.approx(math.tan(math.radians(30.0)), rel=1e-3)


def test_a_groove_has_the_power_of_its_width() -> None:
    # Fc = kc w f = 2000 * 3 * 0.1 = 600 N. The first slice has a mean diameter of 49 mm: at 600
    # rev/min 92.36 m/min, so 0.9236 kW.
    text = "G21 G99\nT0404\nG97 S600 M3\nG0 X54. Z-20.\nG1 X40. F0.1\nG0 X54.\nM30"
    situation = situated(text, "bar:50x60", with_power(2000.0, 0.0), {"T0404": "groove:3"})
    assert played(situation).power.max() == pytest.approx(0.9236, rel=1e-3)


def row_at(situation: Situation, line: int) -> Row:
    """Return the first row of a line."""
    return next(row for row in rows(situation, played(situation)) if row.line == line)


@pytest.mark.parametrize(
    ("text", "stock", "line", "reason"),
    [
        pytest.param(DRILLING, "bar:60x40", 5, "T0202=drill:DIAMETER", id="drill without diameter"),
        pytest.param(
            DRILLING.replace("G83", "G84").replace("F0.15", "F1.5"),
            "bar:60x40",
            5,
            "taps have no law",
            id="tap",
        ),
        pytest.param(
            THREAD.format(clear=44, first=39.0, second=38.0),
            "bar:30x60",
            5,
            "give --stock",
            id="thread beside the stock",
        ),
    ],
)
def test_a_load_that_is_not_known_is_not_taken_as_none(
    text: str, stock: str, line: int, reason: str
) -> None:
    row = row_at(situated(text, stock, with_power(2200.0, 0.0), {}), line)
    assert row.power_share is None
    assert "load unknown" in row.remark
    assert reason in row.remark


def test_a_drill_with_laws_of_its_own_has_their_power() -> None:
    general = with_power(2200.0, 0.0)
    tools = {"T0202": "drill:22"}
    own_laws = {"T0202": Laws(with_power(3300.0, 0.0))}
    usual = situated(DRILLING, "bar:60x40", general, tools)
    own = situated(DRILLING, "bar:60x40", general, tools, own_laws=own_laws)
    assert played(own).power.max() == pytest.approx(1.5 * played(usual).power.max(), rel=1e-9)
