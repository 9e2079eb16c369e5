"""``python -m turning_env advise``: what it recommends keeps the limits, and its numbers are those of a play."""

import json
from pathlib import Path

import numpy as np
import pytest
from turning_shop import WorkshopError
from turning_shop.advise import AIMS, Prices, advise, headline, part_volume, plan
from turning_shop.advise_play import best_rule, clocked, constant, play_all
from turning_shop.prediction import Evidence
from turning_shop.provenance import load
from turning_shop.whatif import what_if

from turning_env import Scenario
from turning_env.__main__ import main
from turning_env.scenario import ScenarioError
from turning_env.scoring.adapt import as_factory
from turning_env.scoring.play import play

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
    cost, metal = advise(scenario, Evidence())
    assert (cost.aim, metal.aim) == (AIMS[0], AIMS[2])
    for _, best, _ in (cost, metal):
        cut = best.cuts
        assert what_if(scenario, cut.cutting_speed, cut.feed, wear=cut.wear).within_limits
        assert best.parts == int(best.parts) > 0
        # nearly all edges last: the life of the one edge in forty
        assert best.minutes <= cut.time * np.exp(
            -1.96 * scenario.tool.wear_factor_spread / scenario.material.wear.time
        )
    assert cost.plan.cost <= metal.plan.cost
    assert cost.plan.mean_removal_rate <= metal.plan.mean_removal_rate
    assert [bound.limit for bound in cost.bounds] == [
        "limits.power, 7 kW",
        "limits.thrust_force, 1500 N",
    ]
    assert all(bound.without.cost < cost.plan.cost for bound in cost.bounds)
    first, *others = headline(scenario, Evidence(), [cost, metal])
    assert first == f"Cut {cost.plan.where}: {cost.plan.cost:.2f} CHF a part"
    assert "its law was not measured" in others[0]
    with pytest.raises(WorkshopError, match=r"limits\.thrust_force, 10 N"):
        advise(Scenario.load({"limits": {"thrust_force": 10.0}}), Evidence())


RANGES = (
    ("feed_max", 0.3, 3.0),
    ("cutting_speed_max", 125.0, 0.1),
    ("cutting_speed_min", 125.0, 200.0),
    ("max_speed", 400.0, 0.1),
)


@pytest.mark.parametrize(("name", "value", "edge_cost"), RANGES)
def test_an_end_of_the_machines_range_that_binds_has_the_advice_of_a_wider_one(
    name: str, value: float, edge_cost: float
) -> None:
    section, off = (
        "spindle" if name == "max_speed" else "machine",
        {"power": 1e4, "thrust_force": 1e6},
    )
    changes = {
        "limits": off,
        "tool": UNBREAKABLE,
        section: {name: value},
        "economics": {"edge_cost": edge_cost},
    }
    found = advise(Scenario.load(changes), Evidence())
    bound = next(
        bound
        for bound in found[0].bounds
        if bound.limit.startswith(f"{section}.{name}, {value:g} ")
    )
    assert bound.without.cost < 0.995 * found[0].plan.cost
    assert any("10 % wider" in line for line in headline(Scenario(), Evidence(), found))


def test_an_edge_that_lasts_no_part_is_changed_within_one() -> None:
    found = plan(Scenario.load({"workpiece": {"bar_length": 5000.0}}), Evidence(), 150.0, 0.3, 0.3)
    assert 0 < found.parts < 1
    assert "min of cutting" in found.where


def test_prices_are_money_only_with_a_rate() -> None:
    assert Prices.of(Scenario()) == ("min", 1.0, 3.0, 2.0)
    assert Prices.of(Scenario.load({"economics": MONEY})) == ("CHF", 1.5, 3.0, 2.0)
    with pytest.raises(WorkshopError, match=r"machine_rate is 0"):
        Prices.of(Scenario.load({"economics": {"insert_price": 3.0}}))
    with pytest.raises(ScenarioError, match="currency"):
        Scenario.load({"economics": {"currency": ""}})
    dear, cheap = (
        Scenario.load({"economics": MONEY | {"insert_price": price}}) for price in (400.0, 12.0)
    )
    assert advise(dear, Evidence())[0].plan.minutes > advise(cheap, Evidence())[0].plan.minutes


def test_what_a_file_does_not_state_is_said_and_its_limits_are_off(tmp_path: Path) -> None:
    (tmp_path / "machine.toml").write_text("[limits]\npower = 9.0\n[workpiece]\ndiameter = 80.0\n")
    (tmp_path / "priced.toml").write_text(
        'base = "machine.toml"\n[economics]\nmachine_rate = 60.0\n'
    )
    scenario, evidence = load(tmp_path / "priced.toml")
    assert (scenario.limits.power, scenario.limits.thrust_force) == (9.0, 1e6)
    said = "\n".join(evidence.warnings)
    assert "limits.thrust_force is off" in said
    assert "workpiece.depth_of_cut 2.5" in said
    assert "diameter" not in said
    assert "power: the law was not measured" in said
    wear, preset = scenario.material.wear, Scenario().material.wear
    assert wear.time / wear.cutting_speed == pytest.approx(0.25)
    assert wear(125, 0.3, 2.5, time=10) == pytest.approx(preset(125, 0.3, 2.5, time=10))
    assert load(Scenario()) == (Scenario(), Evidence())
    assert "not measured" in load("rough_turning")[1].warnings[0]


@pytest.mark.parametrize(
    ("kc", "mc", "start", "feed", "makers"),
    [
        (
            1775.0,
            0.24,
            200.0,
            0.4,
            (150, 230),
        ),  # 42CrMo4 (P6): alloy steel, AC8025P, Sumitomo 2019-2020, p. 13
        (
            2150.0,
            0.20,
            150.0,
            0.4,
            (100, 180),
        ),  # 304 (M14): roughing, CA6515, Kyocera 2016-2017, p. 214
        (
            1350.0,
            0.28,
            200.0,
            0.5,
            (190, 270),
        ),  # GG25 (K16): 200 at 0.5 and 270 at 0.3 mm/rev, K325, DGI Supply, turning, p. 5
    ],
)
def test_with_catalogue_laws_the_advice_lies_in_the_makers_range(
    kc, mc, start, feed, makers
) -> None:
    time, taylor = 0.5, 0.25  # a life of 15 min at the start value, 0.25 mm/rev and 2.5 mm
    wear = {"cutting_speed": time / taylor, "feed": 0.3, "depth_of_cut": 0.15, "time": time}
    wear |= {"coefficient": 0.3 / (start ** (time / taylor) * 0.25**0.3 * 15**time)}
    power = {
        "coefficient": kc * 2.5 / 60e3,
        "cutting_speed": 1.0,
        "feed": 1 - mc,
        "depth_of_cut": 1.0,
        "wear": 0.0,
    }
    scenario = Scenario.load({
        "machine": {"cutting_speed_min": 60.0, "cutting_speed_max": 450.0, "feed_min": 0.1, "feed_max": feed},
        "limits": {"power": 20.0, "thrust_force": 1e6},
        "tool": UNBREAKABLE,
        "workpiece": {"diameter": 80.0, "bar_length": 150.0, "depth_of_cut": 2.0},
        "economics": {"machine_rate": 55.0, "operator_rate": 30.0, "insert_price": 9.5, "edge_change_time": 1.5},
        "material": {"wear": wear, "power": power},
    })  # fmt: skip
    cut = advise(scenario, Evidence())[0].plan.cuts
    assert makers[0] <= cut.cutting_speed <= makers[1]
    assert cut.feed == feed


@pytest.mark.slow
def test_every_number_is_that_of_a_play() -> None:
    scenario = Scenario.load(EVEN | {"economics": MONEY})
    prices = Prices.of(scenario)
    for _, best, _ in advise(scenario, Evidence()):
        episodes = play(as_factory(constant(scenario, best)), clocked(scenario, best), [1])
        cutting, time, removed = (
            float(episodes[name][0]) for name in ("engaged_time", "time", "removed")
        )
        parts = removed / part_volume(scenario)
        cycle = (
            time / 60.0 / parts + scenario.machine.return_time
        )  # plain bars have no return between them
        minutes = cycle + prices.change_time / parts
        found = (best.minutes, best.parts, best.cycle_time, best.mean_removal_rate, best.cost)
        expected = (cutting / 60.0, parts, cycle, part_volume(scenario) / minutes)
        assert found == pytest.approx(
            (*expected, prices.minute * minutes + prices.edge / parts), rel=0.03
        )
        assert episodes["wear"][0] <= best.cuts.wear
        assert episodes["severe_overload_time"][0] == 0.0


@pytest.mark.slow
def test_the_best_rule_and_an_agent_are_compared_with_fixed_parameters() -> None:
    weaker = Scenario.load({"limits": {"power": 6.5}, "economics": MONEY})
    best = advise(weaker, Evidence())[0].plan

    agent = str(ROOT / "agents" / "RoughTurning-v0" / "rough_turning" / "ppo-seed0.onnx")
    fixed, *others = play_all(weaker, best, [agent], 2).results
    assert [each.name for each in others] == ["rule predictive", "agent ppo-seed0"]
    assert fixed.saved.value == 0
    for each in others:
        assert each.saved.value == pytest.approx(fixed.cost.value - each.cost.value)
    assert others[0].saved.low > 0
    other = str(ROOT / "agents" / "RoughTurning-Override-v1" / "override" / "ppo-seed0.onnx")
    with pytest.raises(WorkshopError, match=r"--agent .*ppo-seed0"):
        play_all(weaker, best, [other], 2)


def test_an_override_gets_the_best_rule_that_is_tuned() -> None:
    same, other = (
        Scenario.load("override"),
        Scenario.load({"base": "override", "limits": {"power": 6.0}}),
    )
    assert best_rule(same, same).name == "constant_power_lead"
    assert (
        best_rule(other, other).name == "modified_fuzzy_override"
    )  # the others are not tuned for it


def test_the_command_prints_json_and_keeps_files(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["advise", "rough_turning", "--seeds", "0", "--json"]) == 0
    first, *_ = json.loads(capsys.readouterr().out)["advice"]
    assert first["aim"] == "least cost"
    assert first["bounds"][0]["without"]["cost"] < first["cost"]
    (tmp_path / "page.html").write_text("mine")
    assert (
        main(["advise", "rough_turning", "--seeds", "0", "--page", str(tmp_path / "page.html")])
        == 2
    )
    assert (tmp_path / "page.html").read_text() == "mine"
    assert (
        main(["advise", "rough_turning", "--seeds", "0", "--page", str(tmp_path), "--overwrite"])
        == 2
    )
