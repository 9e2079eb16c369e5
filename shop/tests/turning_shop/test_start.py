"""Advice without measured cuts: makers' ranges are kept, and every number says where it is from.

Tests of ``python -m turning_shop advise --material ...``.
"""

import json
import math
import re
import shlex
import shutil
from pathlib import Path
from typing import NamedTuple

import pytest
from turning_shop import WorkshopError
from turning_shop.__main__ import main
from turning_shop.advise import MIN_COST, PartPlan, best_plan, overload_risk, tried_plans
from turning_shop.catalogue.groups import GROUPS
from turning_shop.catalogue.inserts import read_insert
from turning_shop.catalogue.materials import find_material
from turning_shop.catalogue.start_values import read_grade, start_of
from turning_shop.prediction import predict
from turning_shop.start import CatalogueJob, job_of, start_advice
from turning_shop.start_answer import sentence
from turning_shop.start_question import Question, Stock
from turning_shop.units import INCH
from turning_shop.whatif import what_if

from tests.walking import ROOT, blocks, commands
from turning_env import Scenario

MACHINE = """
[spindle]
base_speed = 800.0
max_speed = 4000.0

[limits]
power = 15.0

[economics]
machine_rate = 60.0
insert_price = 12.0
edge_change_time = 1.5
"""
BAR = Stock(diameter=80.0, length=200.0)


class Maker(NamedTuple):
    """A recommendation for turning: cutting speed [m/min] and feed [mm/rev]."""

    material: str
    tool: str
    grade: str
    speeds: tuple[float, float]
    feeds: tuple[float, float]
    source: str


MAKERS = (
    Maker(
        "42CrMo4",
        "CNMG120408-PM",
        "P25",
        speeds=(150, 230),
        feeds=(0.2, 0.5),
        source="Sumitomo 2019-2020, p. 13: AC8025P with GU in S45C, SCM435 and others",
    ),
    Maker(
        "4140",
        "CNMG432-PM",
        "P25",
        speeds=(150, 220),
        feeds=(0.2, 0.45),
        source="Otai Steel: 4140 up to 220 HB, coated carbide",
    ),
    Maker(
        "1.4301",
        "CNMG120408-MM",
        "M15",
        speeds=(100, 180),
        feeds=(0.2, 0.4),
        source="Kyocera 2016-2017, p. 214: CA6515, roughing of stainless steel up to 220 HB",
    ),
    Maker(
        "GG25",
        "CNMG120412-KM",
        "K15",
        speeds=(180, 450),
        feeds=(0.1, 0.5),
        source="Sumitomo 2019-2020, p. 16: AC4015K in FC250",
    ),
    Maker(
        "GG25",
        "CNMG120408-KM",
        "K20",
        speeds=(150, 300),
        feeds=(0.1, 0.6),
        source="Sumitomo 2019-2020, p. 16: AC420K in FC250",
    ),
    Maker(
        "Ti-6Al-4V",
        "CNMG120408-SM",
        "S15",
        speeds=(30, 90),
        feeds=(0.1, 0.3),
        source="Kyocera 2021-2022, p. 301 (30 to 70), Machining Doctor (70 to 90 m/min), "
        "DGI Supply (feeds of S515)",
    ),
    Maker(
        "6061",
        "CCGT120408",
        "N15",
        speeds=(200, 500),
        feeds=(0.1, 0.4),
        source="DGI Supply: N425 in 2024, 6061, 7075, 655 to 1640 ft/min at 0.004 to 0.016 inch",
    ),
)


@pytest.fixture
def machine(tmp_path: Path) -> str:
    """Return a machine's file."""
    path = tmp_path / "machine.toml"
    path.write_text(MACHINE)
    return str(path)


def cheapest(job: CatalogueJob) -> PartPlan:
    """Return the cheapest plan of a job, without the limits that bind it."""
    tried = tried_plans(job.scenario, job.evidence)
    plan = best_plan(job.scenario, job.evidence, tried, aim=MIN_COST)
    assert plan
    return plan


@pytest.mark.parametrize("maker", MAKERS, ids=lambda maker: f"{maker.material}-{maker.grade}")
def test_advice_lies_within_makers_ranges(maker: Maker, machine: str) -> None:
    question = Question(
        maker.material, maker.tool, maker.grade, stock=BAR, depth=2.0, machine=machine
    )
    cuts = cheapest(job_of(question)).cuts
    assert maker.speeds[0] <= cuts.cutting_speed <= maker.speeds[1], maker.source
    assert maker.feeds[0] <= cuts.feed <= maker.feeds[1], maker.source


SUMITOMO = "Sumitomo 2019-2020, p. 13"
DGI = "DGI Supply, turning, p. 5, ft/min over feeds of 0.004 to 0.02 inch"
HANDBOOK = "Carvill, Mechanical Engineer's Data Handbook, p. 191, carbide, rough to fine"
ISCAR = "ISCAR 2022, milling, IC808, as a ratio to that row"


class Row(NamedTuple):
    """A row of a source for material groups and a grade."""

    groups: str
    grade: str
    speeds: tuple[float, float]  # [m/min]
    feeds: tuple[float, float]  # [mm/rev]
    source: str


ROWS = (
    Row("P1", "P25", (200, 320), (0.2, 0.5), f"{SUMITOMO}: SS400"),
    Row("P2 P4 P6", "P25", (150, 230), (0.2, 0.5), f"{SUMITOMO}: S45C, SCM435"),
    Row("P3 P5 P7 P8 P9", "P25", (100, 200), (0.2, 0.5), f"{SUMITOMO}: at most hard steel's"),
    Row("P10", "P25", (120, 184), (0.2, 0.5), f"{SUMITOMO}: S45C; {ISCAR}, 0.80"),
    Row("P12", "P25", (139, 214), (0.2, 0.5), f"{SUMITOMO}: S45C; {ISCAR}, 0.93"),
    Row("P11 P13", "P25", (80, 200), (0.2, 0.5), f"{SUMITOMO}: at most hard steel's"),
    Row("M14", "M15", (100, 200), (0.1, 0.4), "Kyocera 2016-2017, p. 214, up to 220 HB"),
    Row("M14", "M25", (80, 180), (0.1, 0.4), "Kyocera 2016-2017, p. 214, up to 220 HB"),
    Row("M14D", "M15", (80, 150), (0.1, 0.2), "Kyocera 2016-2017, p. 214, up to 300 HB"),
    Row("M14D", "M25", (80, 120), (0.1, 0.2), "Kyocera 2016-2017, p. 214, up to 300 HB"),
    # At most as fast as stainless steel of 300 HB.
    Row("M14P", "M15", (75, 150), (0.1, 0.2), "Kyocera 2016-2017, p. 214, up to 300 HB"),
    Row("M14P", "M25", (75, 120), (0.1, 0.2), "Kyocera 2016-2017, p. 214, up to 300 HB"),
    Row("K15 K16", "K15", (180, 450), (0.1, 0.5), "Sumitomo 2019-2020, p. 16: AC4015K"),
    Row("K15 K16", "K20", (150, 300), (0.1, 0.6), "Sumitomo 2019-2020, p. 16: AC420K"),
    Row("K17", "K25", (149, 270), (0.1, 0.5), f"{DGI}: K2, 885 to 490"),
    Row("K18", "K25", (122, 200), (0.1, 0.5), f"{DGI}: K3, 655 to 400"),
    Row("K19", "K25", (173, 313), (0.1, 0.5), f"{DGI}: K2; {ISCAR}, 1.16"),
    Row("K20", "K25", (156, 284), (0.1, 0.5), f"{DGI}: K2; {ISCAR}, 1.05"),
    Row("N21 N22 N23 N24", "N15", (200, 500), (0.1, 0.4), f"{DGI}: N2, 1640 to 655"),
    Row("N25", "N15", (122, 300), (0.1, 0.4), f"{DGI}: N3, 985 to 400"),
    Row("N26", "N15", (270, 390), (0.1, 0.4), f"{DGI}: N4, 1280 to 885"),
    Row("N27", "N15", (120, 360), (0.1, 0.4), f"{HANDBOOK}: brass"),
    Row("N28", "N15", (120, 300), (0.1, 0.4), f"{HANDBOOK}: bronze"),
    Row("S31 S32", "S15", (70, 101), (0.1, 0.3), f"{DGI}: S1, 330 to 230"),
    Row("S33 S34 S35", "S15", (35, 61), (0.1, 0.3), f"{DGI}: S3, 200 to 115"),
    Row("S36 S37", "S15", (30, 90), (0.1, 0.3), "Kyocera 2021-2022, p. 301; Machining Doctor"),
)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.groups}-{row.grade}")
def test_the_advice_for_a_group_lies_in_its_sources_window(row: Row) -> None:
    for group in row.groups.split():
        question = Question(group, "CNMG120408-PM", row.grade, BAR, depth=2.0, support="rigid")
        cuts = cheapest(job_of(question)).cuts
        assert row.speeds[0] <= cuts.cutting_speed <= row.speeds[1], (group, row.source)
        assert row.feeds[0] <= cuts.feed <= row.feeds[1], (group, row.source)


def test_every_group_is_compared_with_its_source() -> None:
    compared = {group for row in ROWS for group in row.groups.split()}
    assert compared == set(GROUPS)


def test_every_hardness_of_an_alloy_has_one_law() -> None:
    """kc1.1 hardly depends on the hardness of steel, the life strongly."""
    question = Question("42CrMo4", "CNMG120408-PM", "P25", BAR, depth=2.0)
    annealed = job_of(question)
    tempered = job_of(question._replace(hardness=350.0))
    assert tempered.material.group.name == "P9"
    with_state = question._replace(material="42CrMo4+QT", hardness=350.0)
    assert job_of(with_state).material.group == tempered.material.group
    # 1.75 times the hardness, by the law of the annealed bar and by the group of the tempered one.
    by_law = what_if(annealed.scenario, 120.0, 0.3, hardness=350.0 / 200.0, wear=0.1)
    by_group = what_if(tempered.scenario, 120.0, 0.3, wear=0.1)
    nominal = what_if(annealed.scenario, 120.0, 0.3, wear=0.1)
    assert by_law.tool_life == pytest.approx(by_group.tool_life, rel=1e-6)
    assert by_law.power == pytest.approx(by_group.power, rel=0.15)
    assert by_law.power / nominal.power < 1.2
    # Ingersoll 2011, p. 1353: the speed for the same life falls to 0.67 from 200 to 350 HB.
    assert by_law.tool_life / nominal.tool_life == pytest.approx(0.67**4, rel=0.1)


@pytest.mark.slow
def test_hardness_is_read_in_hb_and_hrc(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "start.toml"
    words = "--material 42CrMo4 --tool CNMG120408-PM --grade P25 --stock 80x200 --depth 2"
    assert main(["advise", *words.split(), "--hardness", "30HRC", "--out", str(out)]) == 0
    assert "is P7, low-alloy steel, quenched and tempered, about 286 HB" in capsys.readouterr().out
    cut = "--cutting-speed 150 --feed 0.3 --wear 0.2 --csv"
    printed = []
    for hardness in ("1.0", "30HRC", "286HB"):
        assert main(["whatif", str(out), *cut.split(), "--hardness", hardness]) == 0
        printed.append(capsys.readouterr().out)
    assert printed[0] == printed[1] == printed[2]
    assert main(["advise", *words.split(), "--hardness", "60HRC"]) == 2
    assert "CBN" in capsys.readouterr().err
    assert main(["whatif", "rough_turning", *cut.split(), "--hardness", "286HB"]) == 2
    assert "no file states the hardness" in capsys.readouterr().err


@pytest.mark.slow
def test_the_condition_is_asked_for_where_it_decides(capsys: pytest.CaptureFixture[str]) -> None:
    words = "--tool CNMG120408-PM --grade P25 --stock 80x200 --depth 2"
    assert main(["advise", "--material", "42CrMo4", *words.split()]) == 0
    assert "is the bar annealed, 200 HB?" in capsys.readouterr().out
    assert main(["advise", "--material", "42CrMo4", *words.split(), "--hardness", "200HB"]) == 0
    assert "is the bar annealed" not in capsys.readouterr().out


@pytest.mark.parametrize(
    ("material", "modulus"),
    [
        ("42CrMo4", 210e3),
        ("1.4301", 200e3),
        ("GG25", 110e3),
        ("GGG50", 170e3),
        ("6061", 70e3),
        ("brass", 100e3),
        ("Inconel718", 200e3),
        ("TiAl6V4", 110e3),
    ],
)
def test_a_bar_has_the_modulus_of_its_material(material: str, modulus: float) -> None:
    group = find_material(material).group
    job = job_of(Question(material, "CNMG120408-PM", f"{group.letter}15", BAR, depth=1.0))
    assert job.scenario.workpiece.elastic_modulus == modulus


class Cut(NamedTuple):
    """A measured cut with a fresh edge."""

    group: str
    speed: float  # [m/min]
    feed: float  # [mm/rev]
    depth: float  # [mm]
    force: float  # cutting force [N]
    thrust: float  # resultant of feed and passive force [N]


# Of sets like those of Chinchanikar (4340, 45 HRC), of Borsos (C45) and of 6351-T6.
MEASURED = (
    Cut("P9", 80.0, 0.1, 0.5, force=201.0, thrust=149.0),
    Cut("P9", 120.0, 0.3, 1.0, force=910.0, thrust=720.0),
    Cut("P2", 200.0, 0.3, 1.5, force=969.0, thrust=652.0),
    Cut("N22", 300.0, 0.1, 1.0, force=82.0, thrust=12.0),
    Cut("N22", 500.0, 0.3, 2.0, force=387.0, thrust=51.0),
)


@pytest.mark.parametrize("cut", MEASURED, ids=lambda cut: f"{cut.group}-{cut.force:.0f}N")
def test_measured_forces_lie_in_the_catalogues_intervals(cut: Cut) -> None:
    question = Question(cut.group, "CNMG120408-PM", f"{cut.group[0]}25", BAR, depth=cut.depth)
    job = job_of(question)
    cuts = what_if(job.scenario, cut.speed, cut.feed, wear=0.0)
    prediction = predict(job.scenario, job.evidence, cuts, of_wear=True)
    assert prediction.low["thrust_force"] <= cut.thrust <= prediction.high["thrust_force"]
    power = cut.force * cut.speed / 60_000.0
    assert prediction.low["power"] <= power <= prediction.high["power"]


@pytest.mark.parametrize(
    ("text", "group"),
    [
        ("P6", "P6"),
        ("1.7225", "P6"),
        ("42crmo4", "P6"),
        ("AISI 4140", "P6"),
        ("SUS 304", "M14"),
        ("x5crni18-10", "M14"),
        ("EN-GJL-250", "K15"),
        ("ti 6al 4v", "S37"),
        ("6061", "N22"),
        ("Cast Iron", "K15"),
        ("brass", "N27"),
        ("17-4PH", "M14P"),
    ],
)
def test_a_material_is_found_by_group_number_and_name(text: str, group: str) -> None:
    assert find_material(text).group.name == group


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("4141", "did you mean .*4140"),
        ("42CrMo5", "did you mean 42CRMO4"),
        ("P14", "P1, P2"),
        ("H38", "measure a cut"),
        ("42CrMo4+QT", r"annealed it is P6, quenched and tempered it is P7 \(275 HB\)"),
        ("cheese", "give its group"),
    ],
)
def test_an_unknown_material_says_what_is_near(text: str, message: str) -> None:
    with pytest.raises(WorkshopError, match=message):
        find_material(text)


@pytest.mark.parametrize(
    ("text", "edge_length", "nose_radius", "edges"),
    [
        ("CNMG120408-PM", 12.9, 0.8, 4),
        ("CNMG 12 04 08-PM", 12.9, 0.8, 4),
        ("CNMG432", 12.9, 0.8, 4),
        ("CNMM190616-PR", 19.3, 1.6, 2),
        ("WNMG080412", 8.7, 1.2, 6),
        ("DCMT11T304-PF", 11.6, 0.4, 2),
        ("CCMT32.51", 9.7, 0.4, 2),
        ("TNMG160404", 16.5, 0.4, 6),
        ("SNMG120408", 12.7, 0.8, 8),
        ("VNMG160404", 16.6, 0.4, 4),
    ],
)
def test_a_designation_gives_edge_nose_radius_and_number_of_edges(
    text: str, edge_length: float, nose_radius: float, edges: int
) -> None:
    """Lengths are in mm."""
    insert = read_insert(text)
    assert insert.edge_length == pytest.approx(edge_length, abs=0.06)
    assert insert.nose_radius == nose_radius
    assert insert.edges == edges


@pytest.mark.parametrize(
    ("finishing", "medium", "roughing"),
    [
        ("-PF", "-PM", "-PR"),
        ("FN", "-MN", "-RN"),
        ("-F3P", "-M3P", "-R3P"),
        ("-FP5", "-MP5", "-RP5"),
    ],
)
def test_a_makers_name_of_a_breaker_gives_the_window(
    finishing: str, medium: str, roughing: str
) -> None:
    """The letter that names the cut stands last at Sandvik, first at Kennametal and ISCAR."""
    names = [read_insert(f"CNMG120408{name}").cut.name for name in (finishing, medium, roughing)]
    assert names == ["finishing", "medium cuts", "roughing"]


def test_an_unknown_breaker_is_named_as_unknown() -> None:
    unknown = read_insert("CNMG120412-XYZ")
    assert "XYZ is unknown" in unknown.assumptions[0]
    assert unknown.feeds[1] < read_insert("CNMG120412-PM").feeds[1]


def test_the_window_scales_with_size_nose_radius_and_clearance() -> None:
    usual = read_insert("CNMG120408-PM")
    assert usual.feeds == (0.2, 0.5)
    assert usual.depths == (1.0, 4.0)
    small = read_insert("CCMT060204-PM")
    # Kyocera 2021-2022, p. 301: small positive inserts of 0.4 mm, medium cuts.
    assert small.depths == pytest.approx((0.5, 2.0))
    assert small.feeds == pytest.approx((0.1, 0.25), abs=0.01)
    large = read_insert("SNMG190616-PR")
    assert large.depths == pytest.approx((2.25, 9.0))


@pytest.mark.parametrize(
    ("text", "edge", "breaker"),
    [
        ("CNGA120408S01030", "S", ""),
        ("CNGA120408-S01030", "S", ""),
        ("CNMG120408E-PM", "E", "PM"),
        ("CNMG120408EN", "E", ""),
        ("TNGA160408T02020", "T", ""),
        ("CNMG120408-PM", "", "PM"),
        ("CNMG120408FN", "", "FN"),
    ],
)
def test_edge_preparations_are_read(text: str, edge: str, breaker: str) -> None:
    insert = read_insert(text)
    assert insert.edge.letter == edge
    assert insert.breaker == breaker


def test_a_chamfer_has_width_and_angle() -> None:
    """S01030 of ISO 1832: 0.10 mm by 30 degrees."""
    edge = read_insert("CNGA120408S01030").edge
    assert edge.chamfer == pytest.approx(0.10)
    assert edge.angle == 30.0


@pytest.mark.parametrize(
    ("material", "grade", "message"),
    [
        ("100Cr6", "H10", "made for hardened material"),
        ("42CrMo4", "N10", "made for N, and not for P"),
        ("6061", "P25", "made for P, and not for N"),
        ("GG25", "BH-K10", "B is CBN"),
        ("42CrMo4", "CC-P10", "C ceramics"),
    ],
)
def test_a_grade_for_something_else_is_refused(material: str, grade: str, message: str) -> None:
    question = Question(material, "CNGA120408S01030", grade, BAR, depth=0.5)
    with pytest.raises(WorkshopError, match=message):
        job_of(question)


def test_the_speed_of_the_box_makes_any_grade_of_the_table_usable() -> None:
    question = Question("42CrMo4", "CNGA120408S01030", "H10", BAR, depth=0.5, start_speed=150.0)
    speeds = job_of(question).window.speeds
    assert speeds == pytest.approx((112.5, 187.5))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("CNMG1204", "CNMG120408-PM"),
        ("CNMG130408", "did you mean 12"),
        ("XNMG120408", "shape X is not known"),
        ("CNMG120400", "nose radius is 0"),
    ],
)
def test_a_wrong_designation_says_what_is_right(text: str, message: str) -> None:
    with pytest.raises(WorkshopError, match=message):
        read_insert(text)


@pytest.mark.parametrize("text", ["GC4325", "P", "X25", "P60", "25"])
def test_a_makers_grade_asks_for_the_application(text: str) -> None:
    with pytest.raises(WorkshopError, match="P25"):
        read_grade(text)


def test_a_tougher_grade_cuts_slower_between_its_neighbours() -> None:
    group = find_material("42CrMo4").group
    speeds = [start_of(group, read_grade(f"P{number}")).speed for number in (15, 20, 25, 35)]
    assert speeds == sorted(speeds, reverse=True)
    assert start_of(group, read_grade("K10")).assumptions
    (assumed,) = start_of(group, read_grade("K20")).assumptions
    assert "that of P20" in assumed


def test_the_start_speed_of_a_box_is_that_of_the_middle_of_its_feeds() -> None:
    question = Question(
        "P6", "CNMG120408-PM", "P25", BAR, depth=2.0, start_speed=200.0, feeds=(0.1, 0.3)
    )
    scenario = job_of(question).scenario
    cuts = what_if(scenario, 200.0, 0.2, wear=0.1)
    assert cuts.tool_life == pytest.approx(15.0)


@pytest.mark.slow
def test_a_cut_beyond_the_catalogue_is_marked_and_explained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "slow.toml"
    path.write_text("[spindle]\nmax_speed = 2500.0\n")
    words = "--material C45 --tool TNMG160404-MF --grade P15 --stock 12x50 --depth 1 --units inch"
    assert main(["advise", *words.split(), "--machine", str(path)]) == 0
    printed = capsys.readouterr().out
    answer, *_ = printed.splitlines()
    assert " *; " in answer
    assert "* outside what was in the catalogue: cutting_speed 309 SFM, but" in printed


@pytest.mark.slow
def test_conditions_of_the_cut_lower_its_speed(capsys: pytest.CaptureFixture[str]) -> None:
    """Dormer Pramet 2024, p. 76: skin 0.70, interrupted 0.80, unstable 0.85."""
    question = Question("42CrMo4", "CNMG120408-PM", "P25", BAR, depth=2.0)
    smooth = job_of(question).start.speed
    rough = job_of(question._replace(conditions=("interrupted", "skin"))).start
    assert rough.speed == pytest.approx(0.8 * 0.7 * smooth)
    # The maker's row of M25 is that of interrupted cuts, and cast iron is cut dry.
    for material, grade, condition in (("1.4301", "M25", "interrupted"), ("GG25", "K15", "dry")):
        question = Question(material, "CNMG120408-MM", grade, BAR, depth=2.0)
        stated = job_of(question._replace(conditions=(condition,))).start
        assert stated.speed == job_of(question).start.speed
    words = "--material P6 --tool CNMG120408-PM --grade P25 --stock 80x200 --cut skin unstable"
    assert main(["advise", *words.split()]) == 0
    assert "times 0.85 for --cut unstable" in capsys.readouterr().out


def test_a_leaning_edge_makes_the_chip_thinner() -> None:
    """Kienzle: at 45 degrees the force grows by sin(45)^-mc, the thickness falls by sin(45)."""
    question = Question("42CrMo4", "SNMG120408-PM", "P25", BAR, depth=2.0)
    upright = job_of(question)
    leaning = job_of(question._replace(entering_angle=45.0))
    cut = (150.0, 0.3)
    powers = [what_if(job.scenario, *cut, wear=0.0).power for job in (upright, leaning)]
    assert powers[1] / powers[0] == pytest.approx(0.5**-0.12)
    lives = [what_if(job.scenario, *cut, wear=0.1).tool_life for job in (upright, leaning)]
    # V f^0.35 ap^0.15 = constant, with n = 0.25: the thin chip counts more than the long edge.
    assert lives[1] / lives[0] == pytest.approx(0.5 ** (-0.5 * (0.35 - 0.15) / 0.25))
    assert leaning.window.feeds[0] == pytest.approx(0.2 * math.sqrt(2.0))
    assert leaning.scenario.workpiece.radial_share == pytest.approx(0.707, abs=0.01)


def test_a_round_insert_has_the_mean_angle_of_its_arc() -> None:
    """A depth of half the radius: 60 degrees of arc, so that the sine is 0.5 / (pi / 3)."""
    insert = read_insert("RCMT1204M0")
    assert insert.nose_radius == 6.0
    assert insert.entering_sine(90.0, depth=3.0) == pytest.approx(0.5 / (math.pi / 3.0))
    question = Question("42CrMo4", "RCMT1204M0", "P25", BAR, depth=2.0)
    assert job_of(question).scenario.workpiece.radial_share > 0.9
    with pytest.raises(WorkshopError, match=r"cuts up to 3\.0 mm"):
        job_of(question._replace(depth=4.0))


@pytest.mark.slow
def test_a_wiper_halves_the_roughness(capsys: pytest.CaptureFixture[str]) -> None:
    words = "--material 42CrMo4 --grade P25 --stock 80x200 --depth 2 --roughness 10 --tool"
    feeds = []
    for tool in ("CNMG120408-PM", "CNMG120408-WMX"):
        assert main(["advise", *words.split(), tool]) == 0
        printed = capsys.readouterr().out
        feeds.append(float(printed.split(" mm/rev")[0].split()[-1]))
    # Rt = f^2 / (8 r), so that half of it allows a feed greater by the root of 2.
    assert feeds[1] / feeds[0] == pytest.approx(math.sqrt(2.0), rel=0.01)
    assert "a wiper leave a roughness of about 10.0 um" in printed


@pytest.mark.slow
def test_a_tube_bends_more_and_has_a_wall(capsys: pytest.CaptureFixture[str]) -> None:
    """The second moment of area of a tube is 1 - (d / D)^4 that of a bar."""
    question = Question("42CrMo4", "CNMG120408-PM", "P25", BAR, depth=2.0)
    tube = question._replace(stock=BAR._replace(bore=60.0))
    moduli = [job_of(each).scenario.workpiece.elastic_modulus for each in (question, tube)]
    assert moduli[1] / moduli[0] == pytest.approx(1.0 - 0.75**4)
    with pytest.raises(WorkshopError, match="wall of 2 mm"):
        job_of(question._replace(stock=BAR._replace(bore=76.0)))
    words = "--material 42CrMo4 --tool CNMG120408-PM --grade P25 --depth 2 --stock"
    assert main(["advise", *words.split(), "tube:80x60x200"]) == 0
    assert "a tube of 60 mm inner diameter" in capsys.readouterr().out
    for stock in ("tube:60x80x200", "tube:80x200", "80x60x200"):
        with pytest.raises(SystemExit):
            main(["advise", *words.split(), stock])
        assert "inner" in capsys.readouterr().err.lower()


@pytest.mark.slow
def test_a_life_beyond_the_catalogues_data_is_not_limited_by_wear(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A thin bar turns so slowly that the law of wear would let an edge last for days."""
    machine = tmp_path / "machine.toml"
    machine.write_text("[spindle]\nmax_speed = 3500.0\n")
    out = tmp_path / "start.toml"
    words = "--material 42CrMo4 --tool CNMG120408-PM --grade P25 --stock 8x20 --depth 2"
    assert main(["advise", *words.split(), "--machine", str(machine), "--out", str(out)]) == 0
    answer, *_ = capsys.readouterr().out.splitlines()
    # 60 min at 3500 rev/min and 0.4 mm/rev, 20 mm a part.
    assert "4200 (60 min; not limited by wear here) parts an edge" in answer
    words = "--cutting-speed 60 --feed 0.3 --wear 0.2"
    assert main(["whatif", str(out), *words.split()]) == 0
    printed = capsys.readouterr().out
    assert ">60" in printed
    assert ">60->60" not in printed


@pytest.mark.parametrize("words", ["--stock 80,5x200 --depth 2", "--stock 80x200 --depth 2,5"])
def test_a_decimal_comma_asks_for_a_point(words: str, capsys: pytest.CaptureFixture[str]) -> None:
    question = "--material P6 --tool CNMG120408 --grade P25"
    with pytest.raises(SystemExit):
        main(["advise", *question.split(), *words.split()])
    assert "decimals have a point" in capsys.readouterr().err


@pytest.mark.slow
def test_the_answer_has_intervals_a_limit_and_what_to_measure(machine: str) -> None:
    question = Question(
        "42CrMo4",
        "CNMG120408-PM",
        "P25",
        stock=BAR,
        depth=2.0,
        machine=machine,
    )
    job = job_of(question)
    advice = start_advice(job)
    best = advice[0].plan
    assert best.parts_low < best.parts < best.parts_high
    assert best.cost_low < best.cost < best.cost_high
    # A life is known within the width of the maker's speeds, 150 to 230 m/min.
    assert best.prediction.high["tool_life"] / best.prediction.low["tool_life"] > 4.0
    text = sentence(job, advice)
    assert "(150 to 230)" in text
    assert "the nose radius binds" in text
    assert "catalogue, not measured" in text
    # With Student's t of 9 degrees of freedom, ten edges tell the level of wear to within
    # 2.262 * 0.34 / sqrt(10); the life deviates by twice that, as W ~ t^0.5.
    half_width = 2.0 * 2.262 * 0.34 / math.sqrt(10.0)
    low, high = best.parts * math.exp(-half_width), best.parts * math.exp(half_width)
    found = re.search(r"the flank wear of 10 edges, .* narrows the parts an edge to (\d+) to", text)
    assert found
    assert int(found[1]) == pytest.approx(low, abs=1.0)
    assert float(text.split()[-1]) == pytest.approx(high, abs=2.0)


def test_the_advised_feed_lies_in_the_range_as_printed() -> None:
    job = job_of(Question("6061", "CCGT120408", "N15", BAR, depth=2.0))
    found = re.search(r"([\d.]+) mm/rev \(([\d.]+) to ([\d.]+)\)", sentence(job, start_advice(job)))
    assert found
    feed, low, high = map(float, found.groups())
    assert low <= feed <= high


@pytest.mark.slow
def test_edges_that_are_stated_to_differ_less_need_fewer_readings(tmp_path: Path) -> None:
    path = tmp_path / "alike.toml"
    path.write_text("[tool]\nwear_factor_spread = 0.05\n")
    question = Question("42CrMo4", "CNMG120408-PM", "P25", BAR, depth=2.0, machine=str(path))
    job = job_of(question)
    assert "the flank wear of 4 edges" in sentence(job, start_advice(job))


@pytest.mark.slow
def test_on_a_weak_machine_the_power_is_what_to_measure(tmp_path: Path) -> None:
    path = tmp_path / "weak.toml"
    path.write_text(MACHINE.replace("15.0", "5.0"))
    question = Question(
        "42CrMo4",
        "CNMG120408-PM",
        "P25",
        BAR,
        depth=2.0,
        machine=str(path),
    )
    job = job_of(question)
    advice = start_advice(job)
    assert advice[0].plan.cuts.power <= 4.0
    assert "the spindle's power binds" in sentence(job, advice)
    assert "the spindle's power in one cut" in sentence(job, advice)


@pytest.mark.slow
def test_the_nameplates_power_is_not_that_of_the_cut(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "machine.toml"
    question = Question("42CrMo4", "CNMG120408-PM", "P25", BAR, depth=4.0, machine=str(path))
    path.write_text(MACHINE.replace("15.0", "11.0"))
    assert job_of(question).scenario.limits.power == pytest.approx(0.8 * 11.0)
    path.write_text(
        MACHINE.replace("15.0", "11.0").replace("[spindle]", "[spindle]\nefficiency = 0.9")
    )
    assert job_of(question).scenario.limits.power == pytest.approx(0.9 * 11.0)
    path.write_text(MACHINE.replace("15.0", "11.0"))
    words = "--material 42CrMo4 --tool CNMG120408-PM --grade P25 --stock 80x200 --depth 4"
    assert main(["advise", *words.split(), "--machine", str(path)]) == 0
    printed = capsys.readouterr().out
    assert "on the nameplate? spindle.efficiency states what share" in printed
    assert "limits.power, 11 kW, leaves" in printed


@pytest.mark.slow
def test_the_probability_of_overload_is_told_where_power_binds(tmp_path: Path) -> None:
    """At its limit, half of the machines of a law without bias are overloaded."""
    path = tmp_path / "machine.toml"
    path.write_text(MACHINE.replace("15.0", "11.0"))
    question = Question("42CrMo4", "CNMG120408-PM", "P25", BAR, depth=4.0, machine=str(path))
    job = job_of(question)
    (sentence,) = overload_risk(job.scenario, job.evidence, start_advice(job)[0])
    probability = float(sentence.split()[-2])
    assert 35.0 <= probability <= 50.0
    assert "interval" in sentence
    assert re.search(r"binds at [\d.]+ hp of [\d.]+ hp, interval", INCH.text(sentence))


def test_a_refusal_names_what_binds_and_what_the_user_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "machine.toml"
    path.write_text("[spindle]\nbase_speed = 800.0\n\n[limits]\npower = 11.0\n")
    words = "--material 42CrMo4 --tool CNMG120408-PM --grade P25 --stock 600x200 --depth 4"
    assert main(["advise", *words.split(), "--machine", str(path)]) == 2
    refused = capsys.readouterr().err
    # At 98 rev/min of 800, with the efficiency: 0.8 * 11 * 98 / 800 kW.
    assert "leaves 1.08 kW for the cut (98 rev/min, below spindle.base_speed" in refused
    assert "limits.thrust_force" not in refused
    path.write_text("[machine]\ncutting_speed_min = 200.0\n")
    assert main(["advise", *words.split(), "--machine", str(path)]) == 2
    refused = capsys.readouterr().err
    assert "machine.cutting_speed_min must be below machine.cutting_speed_max" in refused
    assert "initial_cutting_speed" not in refused


def test_a_depth_that_the_spindle_can_turn_is_named(tmp_path: Path) -> None:
    path = tmp_path / "weak.toml"
    path.write_text(MACHINE.replace("15.0", "2.5"))
    question = Question(
        "42CrMo4",
        "CNMG120408-PM",
        "P25",
        BAR,
        depth=4.0,
        machine=str(path),
    )
    job = job_of(question)
    with pytest.raises(WorkshopError, match=r"depth_of_cut to about (1\.\d) mm") as refused:
        start_advice(job)
    depth = float(refused.value.args[0].split("about ")[1].split()[0])
    cheapest(job_of(question._replace(depth=0.95 * depth)))


def test_the_machine_and_the_box_come_before_the_catalogue(tmp_path: Path) -> None:
    path = tmp_path / "slow.toml"
    path.write_text("[machine]\ncutting_speed_max = 160.0\nfeed_max = 0.3\n")
    question = Question(
        "P6",
        "CNMG120408-PM",
        "P25",
        BAR,
        depth=2.0,
        machine=str(path),
    )
    job = job_of(question)
    cuts = cheapest(job).cuts
    assert cuts.cutting_speed <= 160.0
    assert cuts.feed <= 0.3
    question = question._replace(machine="rough_turning")
    faster = cheapest(job_of(question._replace(start_speed=300.0)))
    assert faster.cuts.cutting_speed > 230.0
    finer = cheapest(job_of(question._replace(feeds=(0.1, 0.25))))
    assert finer.cuts.feed == 0.25
    assert any("limits.power is off" in text for text in job.assumptions)


def test_a_depth_beyond_the_edge_is_refused_and_one_beyond_the_breaker_is_named() -> None:
    question = Question("P6", "CNMG120408-PM", "P25", BAR, depth=12.0)
    with pytest.raises(WorkshopError, match=r"cuts up to 8\.6 mm"):
        job_of(question)
    with pytest.raises(WorkshopError, match="reaches the axis"):
        job_of(question._replace(stock=Stock(diameter=4.0, length=20.0), depth=2.0))
    shallow = job_of(question._replace(depth=0.4))
    assert any("chips may not break" in text for text in shallow.assumptions)


@pytest.mark.slow
def test_the_written_scenario_gives_the_same_advice(
    machine: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "start.toml"
    words = "--material 42CrMo4 --tool CNMG120408-PM --grade P25 --stock 80x200 --depth 2 --json"
    assert main(["advise", *words.split(), "--machine", machine, "--out", str(out)]) == 0
    asked = json.loads(capsys.readouterr().out)
    assert main(["advise", str(out), "--seeds", "0", "--json"]) == 0
    loaded = json.loads(capsys.readouterr().out)
    assert asked["advice"] == loaded["advice"]
    assert asked["answer"]
    assert asked["sources"]
    assert asked["assumptions"]
    assert Scenario.load(out).tool.nose_radius == 0.8


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("", "give a SCENARIO"),
        ("--material P6 --grade P25", "missing: --tool, --stock"),
        ("rough_turning --material P6", "laws of its own"),
        (
            "--material P6 --tool CNMG120408 --grade P25 --stock 80x200 --out a.toml "
            "--machine ./a.toml",
            "must not be the file of --machine",
        ),
    ],
)
def test_missing_and_contradicting_options_are_named(
    words: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["advise", *words.split()]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_the_readme_and_the_page_behind_it_work_as_printed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("shapely")
    page = ""
    for name in ("README.md", "docs/start_values.md"):
        page += (ROOT / "shop" / name).read_text("utf-8")
    shutil.copytree(ROOT / "shop" / "examples", tmp_path / "shop" / "examples")
    monkeypatch.chdir(tmp_path)
    for block in blocks(page):
        if block.language == "toml":
            Path(str(block.title)).write_text(block.text)
            continue
        for line in commands(block):
            if line.startswith("pip "):
                continue
            assert main(shlex.split(line)[3:]) == 0, line
    printed = [" ".join(line.split()) for line in capsys.readouterr().out.splitlines()]
    quoted = []
    for line in page.splitlines():
        if line.startswith(("    ", "> ")):
            quoted.append(" ".join(line.removeprefix("> ").split()))
    assert quoted
    assert set(quoted) <= set(printed)
