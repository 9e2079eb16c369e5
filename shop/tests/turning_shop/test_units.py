"""Inch output is the metric one in other units, everywhere; computing stays metric."""

import json
import re
from pathlib import Path

import pytest
from turning_shop.__main__ import main
from turning_shop.advise import MIN_COST, Advice, best_plan, tried_plans
from turning_shop.page import page_data
from turning_shop.plots import draw_map
from turning_shop.prediction import Evidence
from turning_shop.units import INCH, METRIC, short
from turning_shop.whatif import what_if

from turning_env import Scenario

METRIC_UNITS = re.compile(r"\d (?:mm|m/min|mm/rev|kW|N|um|cm3|cm3/min)\b")
JOB = ["--material", "42CrMo4", "--tool", "CNMG120408-PM", "--grade", "P25", "--depth", "2"]


@pytest.mark.parametrize(
    ("metric", "inch"),
    [
        ("100 m/min", "328 SFM"),
        ("0.4 mm/rev (0.2 to 0.4)", "0.0157 IPR (0.00787 to 0.0157)"),
        ("2 mm deep (1 to 4)", "0.0787 in deep (0.0394 to 0.157)"),
        ("50 to 200 m/min, 7.5 kW", "164 to 656 SFM, 10.1 hp"),
        ("5-10 mm", "0.197-0.394 in"),
        ("limits.thrust_force, 1400 N, rules out", "limits.thrust_force, 315 lbf, rules out"),
        ("16 parts, 3 min, 1.44 EUR", "16 parts, 3 min, 1.44 EUR"),
        ("4 Nuts, 3 mmx", "4 Nuts, 3 mmx"),
    ],
)
def test_quantities_in_sentences_are_rewritten(metric: str, inch: str) -> None:
    assert INCH.text(metric) == inch
    assert METRIC.text(metric) == metric


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (0.015748, "0.0157"), (3.14961, "3.15"), (78.7, "78.7"), (2362.2, "2362")],
)
def test_numbers_are_short(value: float, text: str) -> None:
    assert short(value) == text


@pytest.mark.slow
def test_no_metric_unit_is_left_and_json_is_metric(capsys: pytest.CaptureFixture[str]) -> None:
    command = ["advise", *JOB, "--units", "inch"]
    assert main([*command, "--stock", "80x200"]) == 0
    printed = capsys.readouterr().out
    assert not METRIC_UNITS.search(printed)
    for unit in ("SFM", "IPR", "lbf", "hp", "in3/min"):
        assert unit in printed
    # A length may be stated in inch.
    assert main([*command, "--stock", "3.1496x7.874in", "--json"]) == 0
    inch = json.loads(capsys.readouterr().out)["advice"][0]
    assert main(["advise", *JOB, "--stock", "80x200", "--json"]) == 0
    metric = json.loads(capsys.readouterr().out)["advice"][0]
    assert inch["cutting_speed"] == metric["cutting_speed"]
    assert inch["spindle_speed"] == pytest.approx(metric["spindle_speed"], rel=1e-4)


def test_a_table_has_the_same_cuts(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["rough_turning", "--cutting-speed", "150", "--feed", "0.3", "--wear", "0.2"]
    assert main(["whatif", *words, "--units", "inch"]) == 0
    heads, units, cells = (line.split() for line in capsys.readouterr().out.splitlines()[:3])
    assert units[:3] == ["SFM", "IPR", "in"]
    cut = what_if(Scenario(), 150.0, 0.3, wear=0.2)
    assert cells[:2] == ["492", "0.0118"]
    thrust = cells[units.index("lbf")]
    assert float(thrust) == pytest.approx(float(cut.thrust_force) / 4.448, abs=0.5)
    assert "thrust" in heads


@pytest.mark.slow
def test_the_map_has_inch_axes_and_the_same_best_cut() -> None:
    scenario = Scenario()
    metric = draw_map(scenario, Evidence(), wear=0.2)
    inch = draw_map(scenario, Evidence(), wear=0.2, units=INCH)
    assert inch.axes[0].get_xlabel() == "cutting speed [SFM]"
    assert inch.axes[0].get_ylabel() == "feed [IPR]"
    factors = [
        inch_end / metric_end
        for inch_end, metric_end in zip(
            inch.axes[0].get_xlim(), metric.axes[0].get_xlim(), strict=True
        )
    ]
    assert factors == pytest.approx([1 / 0.3048] * 2)


def test_the_page_knows_its_units_and_computes_in_metric() -> None:
    scenario = Scenario()
    best = best_plan(
        scenario,
        Evidence(),
        tried_plans(scenario, Evidence()),
        aim=MIN_COST,
    )
    assert best
    metric = page_data(scenario, Evidence(), [Advice(MIN_COST, best, ())])
    inch = page_data(scenario, Evidence(), [Advice(MIN_COST, best, ())], INCH)
    assert inch["units"]["mm/rev"]["name"] == "IPR"
    assert metric["units"]["mm/rev"] == {"name": "mm/rev", "factor": 1.0, "decimals": 0}
    del metric["units"], inch["units"]
    assert inch == metric


PRICES = """
base = "rough_turning"
[machine]
return_time = 0.0
[workpiece]
diameter = 60.0
bar_length = 150.0
depth_of_cut = 2.0
approach = 2.0
[economics]
currency = "USD"
machine_rate = 90.0
insert_price = 16.0
"""
PROGRAM = "G21 G99 T0101\nG50 S4000\nG96 S120 M3\nG0 X56. Z2.\nG1 Z-150. F0.3\nM30\n"


def test_a_part_costs_as_much_in_a_program_as_in_advice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("shapely")
    monkeypatch.chdir(tmp_path)
    Path("priced.toml").write_text(PRICES)
    Path("part.nc").write_text(PROGRAM)
    command = [
        "program",
        "part.nc",
        "--scenario",
        "priced.toml",
        "--stock",
        "bar:60x150",
        "--wear",
        "0.3",
    ]
    assert main([*command, "--json"]) == 0
    totals = json.loads(capsys.readouterr().out)["totals"]
    assert totals["cost_unit"] == "USD"
    (parts,) = totals["parts"].values()
    # 90 USD an hour, 2 min to change an edge, 16 USD for 4 edges.
    cost = 1.5 * (totals["time"] / 60.0 + 2.0 / parts) + 4.0 / parts
    assert totals["cost"] == pytest.approx(cost)
    assert main([*command, "--units", "inch"]) == 0
    printed = capsys.readouterr().out
    assert f"cost: {cost:.2f} USD a part" in printed or f"cost: {cost:.3g} USD" in printed
    assert "SFM" in printed
    assert not METRIC_UNITS.search(printed)
