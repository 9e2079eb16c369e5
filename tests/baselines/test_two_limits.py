"""Rules that hold two limits, and the economic optimum within all of them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from baselines.models.process import Limit, Process
from baselines.two_limits import ECONOMIC_OPTIMUM, RULES, TWO_LIMITS, limits, set_point
from turning_env import PowerLaw, Scenario

STEEL = Process.of(Scenario())
CASE = Process.of(Scenario.load("batch_p20"))
DEPTHS = np.array([0.0, 1e-3, 0.3, 1.0, 2.5, 4.0, 8.0, 50.0])
ALL_RULES = [*TWO_LIMITS, ECONOMIC_OPTIMUM]
ROUNDING = 1.0 + 1e-9

# Laws for ranges so wide that only a rule's two limits hold.
FORCE_LAW = PowerLaw(
    coefficient=1.0, cutting_speed=-0.1, feed=0.6, depth_of_cut=0.9, wear=0.5, hardness=0.7
)
POWER_LAW = PowerLaw(
    coefficient=1.0, cutting_speed=0.9, feed=0.7, depth_of_cut=0.9, wear=0.3, hardness=0.7
)
TORQUE_LAW = PowerLaw(
    coefficient=1.0,
    cutting_speed=-0.1,
    feed=0.7,
    wear=0.3,
    hardness=0.7,
)


@pytest.mark.parametrize("rule", TWO_LIMITS)
def test_a_rule_reaches_both_its_limits_at_any_hardness_and_wear(rule: str) -> None:
    process = replace(
        STEEL,
        thrust_force=Limit(FORCE_LAW, most=0.5 if "P" in rule else np.inf),
        power=Limit(POWER_LAW, most=50.0 if "N" in rule else np.inf),
        torque=Limit(TORQUE_LAW, most=0.4),
        cutting_speed_range=(1e-9, 1e9),
        feed_range=(1e-9, 1e9),
    )
    depth = np.array([1.0, 2.0, 3.0])
    hardness = np.array([0.8, 1.0, 1.4])
    wear = np.array([0.1, 0.2, 0.25])
    speed, feed = set_point(
        rule,
        process,
        depth,
        hardness=hardness,
        wear=wear,
    )
    for limit in limits(rule, process):
        response = limit.law(
            speed,
            feed,
            depth,
            time=limit.time,
            wear=wear,
            hardness=hardness,
        )
        np.testing.assert_allclose(response, limit.most)


@pytest.mark.parametrize("rule", ALL_RULES)
@pytest.mark.parametrize(
    ("wear", "hardness"),
    [
        pytest.param(1e-6, 0.3, id="fresh edge, soft bar"),
        pytest.param(0.2, 1.0, id="worn edge, nominal bar"),
        pytest.param(1.2, 3.0, id="edge worn beyond its life, hard bar"),
    ],
)
def test_set_points_lie_within_the_ranges_and_keep_force_and_power(
    rule: str, wear: float, hardness: float
) -> None:
    speed, feed = set_point(
        rule,
        STEEL,
        DEPTHS,
        hardness=hardness,
        wear=wear,
    )
    assert ((speed >= 50.0) & (speed <= 200.0)).all()
    assert ((feed >= 0.06) & (feed <= 0.6)).all()
    depth = np.maximum(DEPTHS, 1e-6)
    power = STEEL.power.law(
        speed,
        feed,
        depth,
        wear=wear,
        hardness=hardness,
    )
    force = STEEL.thrust_force.law(
        speed,
        feed,
        depth,
        wear=wear,
        hardness=hardness,
    )
    lowest_feed = feed == 0.06
    lowest_speed = speed == 50.0
    assert ((power <= 7.0 * ROUNDING) | (lowest_speed & lowest_feed)).all()
    assert ((force <= 1500.0 * ROUNDING) | lowest_feed).all()


@pytest.mark.parametrize("rule", ALL_RULES)
def test_set_points_keep_further_limits(rule: str) -> None:
    depth, hardness = np.meshgrid([0.5, 1.5, 2.5, 3.5], [0.6, 1.0])
    _, feed = set_point(rule, CASE, depth, hardness=hardness)
    assert len(CASE.further) > 0
    for limit in CASE.further.values():
        response = limit.law(1.0, feed, depth, hardness=hardness)
        assert (response <= limit.most * ROUNDING).all()


@pytest.mark.parametrize(
    ("rule", "name", "exponents"),
    [
        ("PV", "thrust_force", {"cutting_speed": 0.3, "feed": 0.0}),
        ("SN", "power", {"cutting_speed": 0.0, "feed": 0.7}),
        # Twice those of the thrust force.
        ("PN", "power", {"cutting_speed": -0.968, "feed": 0.472}),
        ("PT", "wear", {"cutting_speed": -0.242, "feed": 0.118}),
    ],
)
def test_limits_that_run_parallel_fix_no_point(
    rule: str, name: str, exponents: dict[str, float]
) -> None:
    material = Scenario().material
    law = getattr(material, name).model_copy(update=exponents)
    material = material.model_copy(update={name: law})
    scenario = Scenario().model_copy(update={"material": material})
    with pytest.raises(ValueError, match=rf"\[{rule}\] fixes no point"):
        set_point(rule, Process.of(scenario), 2.5)
    if rule != "PT":  # the catalogue has no such rule
        assert not RULES[f"rule_{rule.lower()}"].plays(scenario)
        assert not RULES[f"adaptive_{rule.lower()}"].plays(scenario)
    speed, feed = set_point(ECONOMIC_OPTIMUM, Process.of(scenario), DEPTHS)
    assert np.isfinite(speed).all()
    assert np.isfinite(feed).all()


@pytest.mark.parametrize("depth", [0.5, 1.5, 2.5])
@pytest.mark.parametrize(
    ("price", "wear"),
    [
        pytest.param(0.0, 0.15, id="edges for nothing"),
        pytest.param(5.0, 0.05, id="fresh edge"),
        pytest.param(5.0, 0.29, id="worn edge"),
        pytest.param(1000.0, 0.15, id="dear edges"),
    ],
)
def test_the_economic_optimum_is_the_cheapest_feasible_point(
    price: float, wear: float, depth: float
) -> None:
    process = replace(STEEL, edge_price=price)

    def log_cost(speed: Any, feed: Any) -> Any:
        return process.log_cost(
            np.log(speed),
            np.log(feed),
            depth_of_cut=depth,
            hardness=1.0,
        )

    speeds, feeds = np.meshgrid(
        np.geomspace(50.0, 200.0, num=400), np.geomspace(0.06, 0.6, num=400)
    )
    force = process.thrust_force.law(
        speeds,
        feeds,
        depth_of_cut=depth,
        wear=wear,
    )
    power = process.power.law(
        speeds,
        feeds,
        depth_of_cut=depth,
        wear=wear,
    )
    feasible = (force <= 1500.0) & (power <= 7.0)
    cheapest = log_cost(speeds, feeds)[feasible].min()

    speed, feed = set_point(ECONOMIC_OPTIMUM, process, depth, wear=wear)
    # The best point lies between those of the grid, so it may cost a little less.
    assert cheapest - 0.02 < log_cost(speed, feed) < cheapest + 1e-6
