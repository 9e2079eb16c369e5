"""Advice keeps the limits, and its numbers are those of a play.

Tests of ``python -m turning_shop advise``.
"""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import pytest
from turning_shop import WorkshopError
from turning_shop.__main__ import main
from turning_shop.advise import (
    MAX_METAL,
    MIN_COST,
    Prices,
    advise,
    best_plan,
    cheapest,
    headline,
    part_volume,
    plan,
    tried_plans,
)
from turning_shop.advise_play import best_rule, clocked, constant, play_all
from turning_shop.prediction import Evidence
from turning_shop.provenance import load
from turning_shop.whatif import CHANGES, what_if

from baselines.models.process import Process
from baselines.two_limits import ECONOMIC_OPTIMUM, set_point
from leaderboard.adapt import as_factory
from leaderboard.play import play
from turning_env import Scenario
from turning_env.scenario import ScenarioError

ROOT = Path(__file__).parents[3]
EVEN = {
    "workpiece": {
        "depth_bar_spread": 0.0,
        "depth_along_spread": 0.0,
        "hardness_bar_spread": 0.0,
        "hardness_along_spread": 0.0,
    },
    "tool": {"wear_factor_spread": 0.0, "edge_strength_spread": 0.0},
    "machine": {"feed_time_constant": 0.0, "spindle_time_constant": 0.0},
}
UNBREAKABLE = {"edge_strength": 1e6}
MONEY = {
    "machine_rate": 60.0,
    "operator_rate": 30.0,
    "insert_price": 12.0,
    "edges_per_insert": 4.0,
    "currency": "CHF",
}


def test_advice_keeps_the_limits_and_names_those_that_bind() -> None:
    scenario = Scenario.load(
        {"economics": MONEY, "workpiece": EVEN["workpiece"], "tool": UNBREAKABLE}
    )
    advice = advise(scenario, Evidence())
    cost, metal = advice
    assert cost.aim == MIN_COST
    assert metal.aim == MAX_METAL
    # The life of the one edge in forty that lasts least, over the nominal life.
    worst = math.exp(-1.96 * scenario.tool.wear_factor_spread / scenario.material.wear.time)
    for entry in advice:
        cuts = entry.plan.cuts
        assert what_if(
            scenario,
            cuts.cutting_speed,
            cuts.feed,
            wear=cuts.wear,
        ).within_limits
        assert entry.plan.parts == int(entry.plan.parts) > 0
        assert entry.plan.minutes <= cuts.time * worst
    assert cheapest(scenario, Evidence()).where == cost.plan.where
    assert cost.plan.cost <= metal.plan.cost
    assert cost.plan.mean_removal_rate <= metal.plan.mean_removal_rate
    limits = [bound.limit for bound in cost.bounds]
    assert limits == ["limits.power, 7 kW", "limits.thrust_force, 1500 N"]
    for bound in cost.bounds:
        assert bound.without.cost < cost.plan.cost
    first, second, *_ = headline(scenario, Evidence(), advice)
    assert first == f"Cut {cost.plan.where}: {cost.plan.cost:.2f} CHF a part"
    assert "its law was not measured" in second


def test_a_limit_that_no_cut_keeps_is_named() -> None:
    scenario = Scenario.load({"limits": {"thrust_force": 10.0}})
    with pytest.raises(WorkshopError, match=r"limits\.thrust_force, 10 N"):
        advise(scenario, Evidence())


@pytest.mark.parametrize(
    ("section", "name", "value", "edge_cost"),
    [
        pytest.param("machine", "feed_max", 0.3, 3.0, id="feed_max"),
        pytest.param("machine", "cutting_speed_max", 125.0, 0.1, id="cutting_speed_max"),
        pytest.param("machine", "cutting_speed_min", 125.0, 200.0, id="cutting_speed_min"),
        pytest.param("spindle", "max_speed", 400.0, 0.1, id="max_speed"),
    ],
)
def test_an_end_of_the_machines_range_that_binds_has_the_advice_of_a_wider_one(
    section: str, name: str, value: float, edge_cost: float
) -> None:
    scenario = Scenario.load(
        {
            "limits": {"power": 1e4, "thrust_force": 1e6},
            "tool": UNBREAKABLE,
            section: {name: value},
            "economics": {"edge_cost": edge_cost},
        }
    )
    advice = advise(scenario, Evidence())
    limit = f"{section}.{name}, {value:g} "
    (bound,) = [bound for bound in advice[0].bounds if bound.limit.startswith(limit)]
    assert bound.without.cost < 0.995 * advice[0].plan.cost
    assert "10 % wider" in "\n".join(headline(Scenario(), Evidence(), advice))


def test_two_ends_at_the_same_feed_bind_together() -> None:
    # Neither binds alone: half the nose radius is the highest feed of the machine.
    scenario = Scenario.load(
        {
            "limits": {"power": 1e4, "thrust_force": 1e6},
            "tool": UNBREAKABLE | {"nose_radius": 0.6},
            "machine": {"feed_max": 0.3},
        }
    )
    advice = advise(scenario, Evidence())
    (bound,) = advice[0].bounds
    assert bound.name == "machine.feed_max"
    assert bound.without.cost < 0.995 * advice[0].plan.cost
    text = "\n".join(headline(scenario, Evidence(), advice))
    assert "machine.feed_max, 0.3 mm/rev, with tool.nose_radius, 0.6 mm, rules out" in text


def test_an_edge_that_lasts_no_part_is_changed_within_one() -> None:
    scenario = Scenario.load({"workpiece": {"bar_length": 5000.0}})
    planned = plan(
        scenario,
        Evidence(),
        cutting_speed=150.0,
        feed=0.3,
        wear=0.3,
    )
    assert 0 < planned.parts < 1
    assert "min of cutting" in planned.where


def test_prices_are_money_only_with_a_rate() -> None:
    assert Prices.of(Scenario()) == Prices(
        "min",
        minute=1.0,
        edge=3.0,
        change_time=2.0,
    )
    priced = Scenario.load({"economics": MONEY})
    assert Prices.of(priced) == Prices(
        "CHF",
        minute=1.5,
        edge=3.0,
        change_time=2.0,
    )
    with pytest.raises(WorkshopError, match=r"machine_rate is 0"):
        Prices.of(Scenario.load({"economics": {"insert_price": 3.0}}))
    with pytest.raises(ScenarioError, match="currency"):
        Scenario.load({"economics": {"currency": ""}})


def test_the_economic_optimum_of_metal_costs_more_a_part() -> None:
    """Edges are changed after whole parts, which the least cost of metal leaves out."""
    scenario = Scenario.load("h13_romi")
    evidence = Evidence()
    depth = scenario.workpiece.depth_of_cut
    costs = []
    for wear in CHANGES * scenario.tool.wear_criterion:
        process = replace(Process.of(scenario), wear_criterion=wear)
        speed, feed = set_point(ECONOMIC_OPTIMUM, process, depth, wear=wear)
        costs.append(float(plan(scenario, evidence, speed, feed, wear).cost))
    best = best_plan(scenario, evidence, tried_plans(scenario, evidence), aim=MIN_COST)
    assert best is not None
    assert min(costs) > 1.1 * best.cost


def test_dear_edges_cut_longer() -> None:
    minutes = []
    for price in (12.0, 400.0):
        scenario = Scenario.load({"economics": MONEY | {"insert_price": price}})
        minutes.append(advise(scenario, Evidence())[0].plan.minutes)
    assert minutes[0] < minutes[1]


@pytest.fixture
def priced(tmp_path: Path) -> Path:
    """A scenario that states a power limit, a diameter and a price, in two files."""
    machine = "[limits]\npower = 9.0\n[workpiece]\ndiameter = 80.0\n"
    (tmp_path / "machine.toml").write_text(machine)
    path = tmp_path / "priced.toml"
    path.write_text('base = "machine.toml"\n[economics]\nmachine_rate = 60.0\n')
    return path


def test_limits_that_no_file_states_are_off(priced: Path) -> None:
    scenario, _ = load(priced)
    assert scenario.limits.power == 9.0
    assert scenario.limits.thrust_force == 1e6


def test_values_that_no_file_states_are_named(priced: Path) -> None:
    _, evidence = load(priced)
    warnings = "\n".join(evidence.warnings)
    assert "limits.thrust_force is off" in warnings
    assert "workpiece.depth_of_cut 2.5" in warnings
    assert "workpiece.diameter" not in warnings
    assert "power: the law was not measured" in warnings


def test_wear_that_was_not_measured_has_taylors_exponent(priced: Path) -> None:
    scenario, _ = load(priced)
    wear = scenario.material.wear
    # Taylor's n of coated carbide; the wear at the preset's start stays as it is.
    assert wear.time / wear.cutting_speed == pytest.approx(0.25)
    preset = Scenario().material.wear
    assert wear(
        125,
        0.3,
        2.5,
        time=10,
    ) == pytest.approx(
        preset(
            125,
            0.3,
            2.5,
            time=10,
        )
    )


def test_values_of_a_preset_count_as_stated() -> None:
    assert load(Scenario()) == (Scenario(), Evidence())
    _, evidence = load("rough_turning")
    assert "not measured" in evidence.warnings[0]


class Recommended(NamedTuple):
    """A material, and cuts that makers of inserts recommend for it."""

    unit_force: float  # kc1.1 [N/mm2]
    chip_exponent: float  # mc [-]
    start_speed: float  # [m/min]
    max_feed: float  # [mm/rev]
    speeds: tuple[float, float]  # lowest and highest [m/min]


RECOMMENDED = {
    # Alloy steel, AC8025P, Sumitomo 2019-2020, p. 13.
    "42CrMo4 (P6)": Recommended(
        unit_force=1775.0,
        chip_exponent=0.24,
        start_speed=200.0,
        max_feed=0.4,
        speeds=(150, 230),
    ),
    # Roughing, CA6515, Kyocera 2016-2017, p. 214.
    "304 (M14)": Recommended(
        unit_force=2150.0,
        chip_exponent=0.20,
        start_speed=150.0,
        max_feed=0.4,
        speeds=(100, 180),
    ),
    # 200 at 0.5 and 270 at 0.3 mm/rev, K325, DGI Supply, turning, p. 5.
    "GG25 (K15)": Recommended(
        unit_force=1150.0,
        chip_exponent=0.20,
        start_speed=200.0,
        max_feed=0.5,
        speeds=(190, 270),
    ),
}


@pytest.mark.parametrize("material", RECOMMENDED)
def test_with_catalogue_laws_the_advice_lies_in_the_makers_range(material: str) -> None:
    recommended = RECOMMENDED[material]
    time_exponent = 0.5
    speed_exponent = time_exponent / 0.25  # Taylor's n is 0.25
    # A life of 15 min at the start speed, 0.25 mm/rev and 2.5 mm.
    growth = recommended.start_speed**speed_exponent * 0.25**0.3 * 15**time_exponent
    wear = {
        "coefficient": 0.3 / growth,
        "cutting_speed": speed_exponent,
        "feed": 0.3,
        "depth_of_cut": 0.15,
        "time": time_exponent,
    }
    power = {
        "coefficient": recommended.unit_force * 2.5 / 60e3,
        "cutting_speed": 1.0,
        "feed": 1 - recommended.chip_exponent,
        "depth_of_cut": 1.0,
        "wear": 0.0,
    }
    scenario = Scenario.load(
        {
            "machine": {
                "cutting_speed_min": 60.0,
                "cutting_speed_max": 450.0,
                "feed_min": 0.1,
                "feed_max": recommended.max_feed,
            },
            "limits": {"power": 20.0, "thrust_force": 1e6},
            "tool": UNBREAKABLE,
            "workpiece": {"diameter": 80.0, "bar_length": 150.0, "depth_of_cut": 2.0},
            "economics": {
                "machine_rate": 55.0,
                "operator_rate": 30.0,
                "insert_price": 9.5,
                "edge_change_time": 1.5,
            },
            "material": {"wear": wear, "power": power},
        }
    )
    cuts = advise(scenario, Evidence())[0].plan.cuts
    low, high = recommended.speeds
    assert low <= cuts.cutting_speed <= high
    assert cuts.feed == recommended.max_feed


@pytest.mark.slow
def test_every_number_is_that_of_a_play() -> None:
    scenario = Scenario.load(EVEN | {"economics": MONEY})
    prices = Prices.of(scenario)
    for advice in advise(scenario, Evidence()):
        best = advice.plan
        episodes = play(as_factory(constant(scenario, best)), clocked(scenario, best), [1])
        episode = {name: float(values[0]) for name, values in episodes.items()}
        assert episode["wear"] <= best.cuts.wear
        assert episode["severe_overload_time"] == 0.0

        parts = episode["removed"] / part_volume(scenario)
        # Plain bars have no return between them in the simulation.
        cycle_time = episode["time"] / 60.0 / parts + scenario.machine.return_time
        minutes_per_part = cycle_time + prices.change_time / parts
        removal_rate = part_volume(scenario) / minutes_per_part
        cost = prices.minute * minutes_per_part + prices.edge / parts
        assert best.minutes == pytest.approx(episode["engaged_time"] / 60.0, rel=0.03)
        assert best.parts == pytest.approx(parts, rel=0.03)
        assert best.cycle_time == pytest.approx(cycle_time, rel=0.03)
        assert best.mean_removal_rate == pytest.approx(removal_rate, rel=0.03)
        assert best.cost == pytest.approx(cost, rel=0.03)


def shipped_agent(env_id: str, scenario: str) -> str:
    """Return the path of an agent that ships."""
    return str(ROOT / "agents" / env_id / scenario / "ppo-seed0.onnx")


@pytest.mark.slow
def test_the_best_rule_and_an_agent_are_compared_with_fixed_parameters() -> None:
    weaker = Scenario.load({"limits": {"power": 6.5}, "economics": MONEY})
    best = advise(weaker, Evidence())[0].plan

    agent = shipped_agent("RoughTurning-v0", "rough_turning")
    fixed, rule, learned = play_all(
        weaker,
        best,
        agents=[agent],
        edges=2,
    ).results
    assert rule.name == "rule predictive"
    assert learned.name == "agent ppo-seed0"
    assert fixed.saved.value == 0
    for result in (rule, learned):
        saved = fixed.cost.value - result.cost.value
        assert result.saved.value == pytest.approx(saved)
    assert rule.saved.low > 0

    misplaced = shipped_agent("RoughTurning-Override-v1", "override")
    with pytest.raises(WorkshopError, match=r"--agent .*ppo-seed0"):
        play_all(weaker, best, agents=[misplaced], edges=2)


def test_an_override_gets_the_best_rule_that_is_tuned() -> None:
    shipped = Scenario.load("override")
    assert best_rule(shipped, shipped).name == "constant_power_lead"
    # Other rules are not tuned for a limit of the user's own.
    changed = Scenario.load({"base": "override", "limits": {"power": 6.0}})
    assert best_rule(changed, changed).name == "modified_fuzzy_override"


COMMAND = ["advise", "rough_turning", "--seeds", "0"]


def test_the_command_prints_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*COMMAND, "--json"]) == 0
    first = json.loads(capsys.readouterr().out)["advice"][0]
    assert first["aim"] == "least cost"
    assert first["bounds"][0]["without"]["cost"] < first["cost"]


def test_the_command_keeps_files_and_folders(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    page.write_text("mine")
    assert main([*COMMAND, "--page", str(page)]) == 2
    assert page.read_text() == "mine"
    assert main([*COMMAND, "--page", str(tmp_path), "--overwrite"]) == 2
