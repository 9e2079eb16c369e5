"""``python -m turning_env advise``: what it recommends keeps the limits, and its numbers are those of a play."""

import json
from functools import partial
from pathlib import Path

import pytest

from baselines import catalogue
from turning_env import Scenario
from turning_env.__main__ import main
from turning_env.scenario import ScenarioError
from turning_env.scoring.play import play
from turning_shop import WorkshopError
from turning_shop.advise import AIMS, Prices, advise, part_volume, summary
from turning_shop.advise_play import Clock, best_rule, clocked, play_all
from turning_shop.prediction import Evidence
from turning_shop.whatif import what_if

ROOT = Path(__file__).parents[2]
EVEN = {
    "workpiece": {"depth_bar_spread": 0.0, "depth_along_spread": 0.0, "hardness_bar_spread": 0.0, "hardness_along_spread": 0.0},
    "tool": {"wear_factor_spread": 0.0, "edge_strength_spread": 0.0},
    "machine": {"feed_time_constant": 0.0, "spindle_time_constant": 0.0},
}
MONEY = {"machine_rate": 60.0, "operator_rate": 30.0, "insert_price": 12.0, "edges_per_insert": 4.0, "currency": "CHF"}


def test_recommendations_keep_the_limits() -> None:
    scenario = Scenario()
    found = advise(scenario, Evidence())
    assert [(each.aim, len(each.steps) > 1) for each in found] == [(aim, kind) for aim in AIMS for kind in (False, True)]
    for each in found:
        for step in each.steps:
            assert what_if(scenario, step.cutting_speed, step.feed, wear=step.wear * (1 - 1e-9)).within_limits
        assert each.parts[1] < each.parts[0] < each.parts[2]
    metal, cost, run = found[::2], found[2:4], found[4:]
    assert metal[0].removal_rate == max(each.removal_rate for each in metal)
    assert cost[0].cost <= min(each.cost for each in metal)
    assert run[0].life[0] == max(each.life[0] for each in metal)
    assert cost[1].cost <= cost[0].cost + 1e-9
    with pytest.raises(WorkshopError, match=r"limits\.thrust_force, 10 N"):
        advise(Scenario.load({"limits": {"thrust_force": 10.0}}), Evidence())


def test_prices_are_money_only_with_a_rate() -> None:
    assert Prices.of(Scenario()) == ("min", 1.0, 3.0, 2.0)
    assert Prices.of(Scenario.load({"economics": MONEY})) == ("CHF", 1.5, 3.0, 2.0)
    with pytest.raises(WorkshopError, match=r"machine_rate is 0"):
        Prices.of(Scenario.load({"economics": {"insert_price": 3.0}}))
    with pytest.raises(ScenarioError, match="currency"):
        Scenario.load({"economics": {"currency": ""}})
    dear = Scenario.load({"economics": MONEY | {"insert_price": 400.0}})
    cheap = Scenario.load({"economics": MONEY})
    assert advise(dear, Evidence())[2].life[0] > advise(cheap, Evidence())[2].life[0]
    assert "CHF" in "\n".join(summary(cheap, advise(cheap, Evidence())))


@pytest.mark.slow
def test_every_number_is_that_of_a_play() -> None:
    scenario = Scenario.load(EVEN | {"economics": MONEY})
    prices = Prices.of(scenario)
    for advice in advise(scenario, Evidence()):
        episodes = play(partial(Clock, scenario, advice.steps, 1.0), clocked(scenario, advice), [1], tell=True)
        cutting, time, removed = (float(episodes[name][0]) for name in ("engaged_time", "time", "removed"))
        parts = removed / part_volume(scenario)
        cycle = time / 60.0 / parts + scenario.machine.return_time  # plain bars have no return between them
        minutes = cycle + prices.change_time / parts
        found = (advice.life[0], advice.parts[0], advice.part_time, advice.cycle_time, advice.removal_rate, advice.cost)
        expected = (cutting / 60.0, parts, cutting / 60.0 / parts, cycle, part_volume(scenario) / minutes)
        assert found == pytest.approx((*expected, prices.minute * minutes + prices.edge / parts), rel=0.03)
        assert episodes["wear"][0] == pytest.approx(advice.steps[-1].wear, rel=0.03)
        assert episodes["severe_overload_time"][0] == 0.0


def test_a_clock_needs_no_shorter_interval_than_a_second() -> None:
    quick = Scenario.load(EVEN | {"control": {"interval": 0.02, "sub_steps": 2}})
    advice = advise(quick, Evidence())[0]
    slow = clocked(quick, advice)
    assert slow.control.interval == pytest.approx(1.0)
    assert slow.control.interval / slow.control.sub_steps == pytest.approx(0.01)
    short = slow.model_copy(update={"control": slow.control.model_copy(update={"time_limit": 0.2})})
    at_once = short.model_copy(update={"control": short.control.model_copy(update={"interval": 0.02, "sub_steps": 2})})
    one, other = (play(partial(Clock, quick, advice.steps, 1.0), each, [1], tell=True) for each in (short, at_once))
    assert one["steps"][0] * 50 == other["steps"][0]
    assert [one[name][0] for name in ("removed", "wear", "time")] == pytest.approx(
        [other[name][0] for name in ("removed", "wear", "time")]
    )


@pytest.mark.slow
def test_a_year_is_compared() -> None:
    scenario = Scenario.load({"economics": MONEY})
    found = advise(scenario, Evidence())
    fixed, *others = play_all(scenario, found, [], "fixed_handbook", 1000.0, 2).years
    assert [year.name for year in others] == ["schedule by time", "rule fixed_handbook"]
    assert fixed.saved.value == 0
    assert fixed.cost.value > 1000 * 90  # the hours, and edges
    for year in others:
        assert year.saved.value == pytest.approx(fixed.cost.value - year.cost.value)
    with pytest.raises(WorkshopError, match="--rule nothing"):
        play_all(scenario, found, [], "nothing", 1000.0, 2)


@pytest.mark.slow
def test_of_an_edge_that_lasts_too_long_to_play_its_used_share_counts() -> None:
    scenario = Scenario.load(EVEN | {"economics": MONEY})
    found = advise(scenario, Evidence())[2:4]
    whole, part = (play_all(scenario, found, [], "fixed_handbook", 1000.0, 2, max_steps=n).years[2] for n in (50_000, 200))
    assert part.cost.value == pytest.approx(whole.cost.value, rel=0.05)


@pytest.mark.slow
def test_the_best_rule_and_an_agent_save() -> None:
    weaker = Scenario.load({"limits": {"power": 6.5}})
    agent = ROOT / "agents" / "RoughTurning-v0" / "rough_turning" / "ppo-seed0.onnx"
    years = play_all(weaker, advise(weaker, Evidence()), [str(agent)], None, 1000.0, 2).years
    assert [year.name for year in years[2:]] == ["rule predictive", "agent ppo-seed0"]
    assert years[2].saved.low > 0
    other = ROOT / "agents" / "RoughTurning-Override-v0" / "override" / "ppo-seed0.onnx"
    with pytest.raises(WorkshopError, match=r"--agent .*ppo-seed0"):
        play_all(weaker, advise(weaker, Evidence())[2:3], [str(other)], "fixed_handbook", 1000.0, 2)


def test_an_override_gets_the_best_rule_that_is_tuned() -> None:
    same, other = Scenario.load("override"), Scenario.load({"base": "override", "limits": {"power": 6.0}})
    assert best_rule(catalogue, same, same)[0] == "omative"
    assert best_rule(catalogue, other, other)[0] == "modified_fuzzy_override"  # omative is not tuned for it


def test_the_command_prints_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["advise", "rough_turning", "--seeds", "0", "--json"]) == 0
    assert len(json.loads(capsys.readouterr().out)["advice"]) == 2 * len(AIMS)
    assert main(["advise", "batch_casting", "--seeds", "0"]) == 2
