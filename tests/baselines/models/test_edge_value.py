"""The price of edge life."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from baselines.models.edge_value import (
    EXPECTED_LAWS,
    LIVES,
    MAX_TIME_PRICE,
    MIN_TIME_PRICE,
    PRICES,
    SPEEDS,
    best_of,
    compare_speeds,
    life_numbers,
    life_term,
    price_life,
    price_of_time,
)
from baselines.models.load_filter import records
from baselines.optimiser import worth
from tests.turning_env.playing import changed
from turning_env import Scenario

SHIFT = Scenario.load("shift")
ENDLESS = Scenario()


@pytest.mark.parametrize("scenario", [SHIFT, ENDLESS], ids=["shift", "endless"])
def test_life_is_dearer_early(scenario: Scenario) -> None:
    assert (np.diff(worth(scenario).life) <= 0.0).all()


def test_an_edge_that_no_command_changes_must_be_used_up() -> None:
    assert worth(ENDLESS).time == 1.0
    assert worth(ENDLESS).life[-1] < 0.0
    assert worth(SHIFT).life[-1] == 0.0


def test_an_edge_pays_for_itself_and_its_change() -> None:
    prices = worth(SHIFT)
    cost = SHIFT.economics.edge_cost + prices.time * SHIFT.economics.edge_change_time
    assert prices.life.mean() == pytest.approx(60.0 * cost, rel=0.05)


BY_HAND = changed(
    Scenario(),
    material={
        "wear": {
            "coefficient": 0.02,
            "cutting_speed": 0.75,
            "feed": 0.5,
            "depth_of_cut": 0.5,
            "time": 0.25,
            "hardness": 0.5,
        },
        "thrust_force": {
            "coefficient": 3000.0,
            "cutting_speed": -0.25,
            "feed": 0.5,
            "depth_of_cut": 0.8,
            "wear": 1.5,
            "hardness": 0.6,
        },
        "power": {
            "coefficient": 0.05,
            "cutting_speed": 1.0,
            "feed": 0.75,
            "depth_of_cut": 1.0,
            "wear": 0.5,
            "hardness": 0.4,
        },
    },
    tool={"wear_criterion": 0.4, "edge_strength": 3000.0},
    limits={"thrust_force": 1500.0, "power": 6.0},
    economics={
        "reference_removal_rate": 100.0,
        "edge_cost": 3.0,
        "edge_change_time": 2.0,
        "overload_price": 5.0,
    },
    machine={
        "cutting_speed_min": 60.0,
        "cutting_speed_max": 400.0,
        "feed_min": 0.1,
        "feed_max": 0.8,
    },
    spindle={"base_speed": 1000.0 / math.pi, "idle_torque": 30.0},
    workpiece={
        "diameter": 100.0,
        "depth_of_cut": 2.0,
        "depth_bar_spread": 0.3,
        "depth_along_spread": 0.4,
        "hardness_bar_spread": 0.05,
        "hardness_along_spread": 0.12,
    },
    control={"interval": 3.0},
)


def test_the_numbers_of_a_scenario_by_hand() -> None:
    numbers = life_numbers(BY_HAND, severity=1.2)
    depth = 2.0 / 2.5
    # The spreads are those of two triangles: 3, 4 and 5, of 2 mm; and 5, 12 and 13.
    depth_spread = 0.25
    hardness_spread = 0.13
    expected = {
        # Life is used up after (0.4 / 0.02)^4 minutes at 1 m/min and 1 mm/rev.
        "log_life_rate": 4.0 * math.log(0.02 * depth**0.5 / 0.4) - math.log(60.0),
        "life_speed": 3.0,
        "life_feed": 2.0,
        "wear_time": 0.25,
        "log_force_coefficient": math.log(3000.0 * depth**0.8 * 0.4**1.5 / 1500.0),
        "log_power_coefficient": math.log(0.05 * depth * 0.4**0.5 / 6.0),
        "force_spread": math.hypot(0.8 * depth_spread, 0.6 * hardness_spread),
        "power_spread": math.hypot(1.0 * depth_spread, 0.4 * hardness_spread),
        "log_base_speed": math.log(100.0),
        "log_strength": math.log(2.0),
        "overload_price": 6.0,
        "interval": 3.0,
        "min_log_speed": math.log(60.0),
        "max_log_speed": math.log(400.0),
        "min_log_feed": math.log(0.1),
        "max_log_feed": math.log(0.8),
        "metal_value": 0.02,
        # 30 N m at 2 v / d: 120 m/min are 40 rad/s, so 1.2 kW.
        "idle_power": 0.01 / 6.0,
        "edge_cost": 180.0,
        "edge_change_time": 120.0,
        "limits_time": 0.0,
        "min_life_price": -math.inf,
    }
    assert numbers.keys() == expected.keys()
    for name, value in expected.items():
        assert float(numbers[name]) == pytest.approx(value), name


@pytest.mark.parametrize(
    ("edge_changes", "limits_time", "min_price"),
    [("end", 0.0, -math.inf), ("automatic", 1.0, -math.inf), ("commanded", 1.0, 0.0)],
)
def test_time_is_limited_where_edges_are_changed(
    edge_changes: str, limits_time: float, min_price: float
) -> None:
    scenario = changed(BY_HAND, control={"edge_changes": edge_changes})
    numbers = life_numbers(scenario, severity=1.0)
    assert (numbers["limits_time"], numbers["min_life_price"]) == (limits_time, min_price)


def test_without_a_base_speed_all_power_is_available() -> None:
    numbers = life_numbers(changed(BY_HAND, spindle={"base_speed": 0.0}), severity=1.0)
    assert numbers["log_base_speed"] == pytest.approx(math.log(1e-9))


@pytest.mark.parametrize(
    ("growth", "term"),
    [
        # n = 1/2, so a quarter of the life is half of the wear.
        pytest.param(0.0, math.log(0.25), id="power law"),
        pytest.param(4.0, 2.0 * math.log(3.0 / 5.0), id="fresh share"),
        pytest.param(0.5, 2.0 * math.log(1.25 / 1.5), id="large fresh share"),
    ],
)
def test_the_wear_term_is_that_over_a_worn_out_edges(growth: float, term: float) -> None:
    assert life_term(growth, 0.5, math.log(0.25)) == pytest.approx(term)
    assert life_term(growth, 0.5, 0.0) == pytest.approx(0.0)


def expected_laws(scenario: Scenario, **changes: float) -> Any:
    """Return the record of a scenario's own laws."""
    numbers = life_numbers(scenario, severity=1.0)
    material = scenario.material
    laws = np.zeros(1, EXPECTED_LAWS)
    for name in ("log_life_rate", "life_speed", "life_feed"):
        laws[name] = numbers[name]
    for name, law in (("force", material.thrust_force), ("power", material.power)):
        laws[f"log_{name}"] = numbers[f"log_{name}_coefficient"]
        laws[f"{name}_speed"] = law.cutting_speed
        laws[f"{name}_feed"] = law.feed
        laws[f"{name}_life"] = law.wear * material.wear.time
        laws[f"{name}_growth"] = law.wear_growth * scenario.tool.wear_criterion
    for name, value in changes.items():
        laws[name] = value
    return laws


def compared(scenario: Scenario, used_life: float) -> tuple[Any, Any]:
    """Return earnings and durations of all speeds and used lives."""
    parameters = records([life_numbers(scenario, severity=1.2)])
    earnings = np.empty((LIVES + 1, SPEEDS))
    durations = np.empty((LIVES + 1, SPEEDS))
    compare_speeds(parameters[0], expected_laws(scenario)[0], used_life, earnings, durations)
    return earnings, durations


FRESH = changed(
    BY_HAND,
    material={
        "thrust_force": BY_HAND.material.thrust_force.model_dump()
        | {"coefficient": 700.0, "wear_growth": 4.0}
    },
)
# Idling takes all power that is available below the base speed.
IDLING = changed(BY_HAND, spindle={"base_speed": 1400.0, "idle_torque": 40.9})


@pytest.mark.parametrize("scenario", [BY_HAND, FRESH, IDLING], ids=["power", "fresh", "idling"])
def test_earnings_are_those_of_the_highest_feed_within_the_limits(scenario: Scenario) -> None:
    """The feed is SciPy's root of the loads by the scenario's own laws, within 0.1..0.8 mm/rev."""
    earnings, durations = compared(scenario, used_life=0.3)
    material = scenario.material
    speeds = np.exp(np.linspace(math.log(60.0), math.log(400.0), SPEEDS))
    base = float(scenario.base_cutting_speed)
    bounds = set()
    for k in range(SPEEDS):
        for j in (0, 3, LIVES):
            life = 0.3 if j == LIVES else (j + 0.5) / LIVES
            wear = 0.4 * life**0.25
            speed = float(speeds[k])
            idle = scenario.spindle.idle_torque * speed * 2.0 / 60.0 / 100.0  # [kW]
            available = max(6.0 * min(speed / base, 1.0) - idle, 6.0 * 1e-3)

            def load(log_feed: float, speed=speed, wear=wear, available=available) -> float:
                feed = math.exp(log_feed)
                force = float(material.thrust_force(speed, feed, 2.0, wear=wear))
                power = float(material.power(speed, feed, 2.0, wear=wear))
                return max(math.log(force / 1500.0), math.log(power / available))

            highest = brentq(load, -30.0, 30.0, xtol=1e-12)
            feed = min(max(math.exp(highest), 0.1), 0.8)
            bounds.add(feed in (0.1, 0.8) and feed)
            minutes = (0.4 / float(material.wear(speed, feed, 2.0))) ** 4
            assert durations[j, k] == pytest.approx(60.0 * minutes)
            excess = max(math.log(feed) - highest, 0.0)
            # An overload price of 5 times the severity 1.2, and 100 cm3/min are worth a minute.
            rate = speed * feed * 2.0 / 100.0 - 6.0 * excess
            assert earnings[j, k] == pytest.approx(rate * 60.0 * minutes)
    if scenario is BY_HAND:
        assert False in bounds
        assert len(bounds) > 1


def test_a_load_that_hardly_depends_on_feed_counts_with_a_tenth() -> None:
    parameters = records([life_numbers(BY_HAND, severity=1.0)])
    earnings = np.empty((3, LIVES + 1, SPEEDS))
    durations = np.empty((3, LIVES + 1, SPEEDS))
    for place, exponent in enumerate((0.02, 0.1, 0.15)):
        laws = expected_laws(BY_HAND, force_feed=exponent, log_force=-2.0, power_feed=exponent)
        compare_speeds(parameters[0], laws[0], 0.3, earnings[place], durations[place])
    assert earnings[0] == pytest.approx(earnings[1])
    assert not np.allclose(earnings[1], earnings[2])


def test_the_best_is_the_first_with_the_highest_worth() -> None:
    gain = np.array([1.0, 5.0, 9.0, 7.0])
    rate = np.array([0.0, 1.0, 6.0, 3.0])
    assert best_of(gain, rate, 0.0) == 2
    assert best_of(gain, rate, 1.0) == 1  # 1, 4, 3 and 4
    assert best_of(gain, rate, 9.0) == 0
    assert best_of(-gain, rate, 0.0) == 0


def edge(cost: float = 180.0, change: float = 120.0) -> Any:
    return SimpleNamespace(edge_cost=cost, edge_change_time=change)


def lives_of(earnings: list[float], durations: list[float]) -> tuple[Any, Any]:
    """Return arrays in which every used life has these set points."""
    return np.tile(earnings, (LIVES + 1, 1)), np.tile(durations, (LIVES + 1, 1))


@pytest.mark.parametrize(
    ("earnings", "durations", "price"),
    [
        # E - c T = 180 + 120 c.
        pytest.param([1200.0], [560.0], 1.5, id="one set point"),
        # Above c = 2, the second is better: 1000 - 200 c = 180 + 120 c.
        pytest.param([1600.0, 1000.0], [500.0, 200.0], 820.0 / 320.0, id="dear time"),
        pytest.param([1e6], [1.0], MAX_TIME_PRICE, id="at most 10"),
        pytest.param([190.0], [1000.0], MIN_TIME_PRICE, id="at least a tenth"),
    ],
)
def test_at_the_price_of_time_an_edge_pays_for_itself(
    earnings: list[float], durations: list[float], price: float
) -> None:
    assert price_of_time(edge(), *lives_of(earnings, durations)) == pytest.approx(price)
    assert (MIN_TIME_PRICE, MAX_TIME_PRICE) == (0.1, 10.0)


def test_a_part_of_the_life_that_is_worth_nothing_is_not_used() -> None:
    earnings, durations = lives_of([3000.0], [600.0])
    earnings[LIVES // 2 :] = 60.0
    # Half of the life pays for the edge: (3000 - 600 c) / 2 = 180 + 120 c.
    assert price_of_time(edge(), earnings, durations) == pytest.approx(1320.0 / 420.0)


@pytest.mark.parametrize("edge_changes", ["end", "automatic", "commanded"])
def test_the_price_of_life_is_what_the_best_set_point_earns_with_it(edge_changes: str) -> None:
    scenario = changed(BY_HAND, control={"edge_changes": edge_changes})
    parameters = records([life_numbers(scenario, severity=1.2)])
    lives = np.array([0.001, 0.01, 0.3, 1.0, 1.4])
    prices = np.zeros(len(lives), PRICES)
    price_life(parameters, np.tile(expected_laws(scenario), len(lives)), lives, prices)
    earnings, durations = compared(scenario, 0.3)
    time = 1.0
    if edge_changes != "end":
        time = price_of_time(parameters[0], earnings, durations)
    assert prices["time"] == pytest.approx(time)
    # Lives are kept within 0.01..1.
    for life, price in zip((0.01, 0.01, 0.3, 1.0, 1.0), prices["life"], strict=True):
        earnings, durations = compared(scenario, life)
        best = float((earnings[LIVES] - time * durations[LIVES]).max())
        assert price == pytest.approx(max(best, 0.0 if edge_changes == "commanded" else -math.inf))
    assert prices["life"][2] > 0.0


def test_used_lives_are_kept_within_a_hundredth_and_1() -> None:
    """The force is so high that it limits the feed all along the life."""
    parameters = records([life_numbers(BY_HAND, severity=1.2)])
    heavy = expected_laws(BY_HAND)
    heavy["log_force"] += math.log(100.0)
    lives = np.array([0.001, 0.01, 0.02, 0.9, 1.0, 1.4])
    prices = np.zeros(len(lives), PRICES)
    price_life(parameters, np.tile(heavy, len(lives)), lives, prices)
    fresh, at_least, later, late, at_most, over = prices["life"]
    assert fresh == at_least > later > late > at_most == over


def test_a_change_that_takes_longer_than_the_edge_costs_is_paid_for() -> None:
    # 1260 - 200 c = 60 + 600 c at c = 1.5.
    assert price_of_time(edge(60.0, 600.0), *lives_of([1260.0], [200.0])) == pytest.approx(1.5)


def test_life_that_is_worth_less_than_a_second_counts() -> None:
    # 200.2 - 99.9 c = 0.2 + 0.1 c at c = 2, where the life is worth 0.4 s.
    assert price_of_time(edge(0.2, 0.1), *lives_of([200.2], [99.9])) == pytest.approx(2.0)


def test_worthless_life_need_not_be_used_if_edges_are_changed_on_command() -> None:
    """Where metal pays next to nothing, the best set point loses time."""
    poor = changed(BY_HAND, economics={"reference_removal_rate": 1e4})
    lowest = []
    for edge_changes in ("end", "commanded"):
        scenario = changed(poor, control={"edge_changes": edge_changes})
        prices = np.zeros(2, PRICES)
        parameters = records([life_numbers(scenario, severity=1.0)] * 2)
        price_life(parameters, np.tile(expected_laws(scenario), 2), np.array([0.5, 0.9]), prices)
        lowest.append(prices["life"].min())
    assert lowest[0] < 0.0
    assert lowest[1] == 0.0
