from dataclasses import replace

import numpy as np
import pytest

from baselines.models.process import Limit, Process
from baselines.two_limits import ECONOMIC_OPTIMUM, RULES, TWO_LIMITS, limits, set_point
from turning_env import PowerLaw, Scenario

STEEL = Process.of(Scenario())
CASE = Process.of(Scenario.load("batch_p20"))
DEPTHS = np.array([0.0, 1e-3, 0.3, 1.0, 2.5, 4.0, 8.0, 50.0])


@pytest.mark.parametrize("rule", TWO_LIMITS)
def test_a_rule_reaches_both_its_limits_at_any_hardness_and_wear(rule: str) -> None:
    soft = {
        "law": PowerLaw(
            coefficient=1.0, cutting_speed=-0.1, feed=0.6, depth_of_cut=0.9, wear=0.5, hardness=0.7
        )
    }
    power = PowerLaw(
        coefficient=1.0, cutting_speed=0.9, feed=0.7, depth_of_cut=0.9, wear=0.3, hardness=0.7
    )
    process = replace(
        STEEL,
        thrust_force=Limit(**soft, most=0.5 if "P" in rule else np.inf),
        power=Limit(power, most=50.0 if "N" in rule else np.inf),
        torque=Limit(
            PowerLaw(coefficient=1.0, cutting_speed=-0.1, feed=0.7, wear=0.3, hardness=0.7),
            most=0.4,
        ),
        cutting_speed_range=(1e-9, 1e9),
        feed_range=(1e-9, 1e9),
    )
    depth, hardness, wear = (
        np.array([1.0, 2.0, 3.0]),
        np.array([0.8, 1.0, 1.4]),
        np.array([0.1, 0.2, 0.25]),
    )
    speed, feed = set_point(rule, process, depth, hardness, wear)
    for limit in limits(rule, process):
        np.testing.assert_allclose(
            limit.law(speed, feed, depth, limit.time, wear, hardness), limit.most
        )


@pytest.mark.parametrize("rule", [*TWO_LIMITS, ECONOMIC_OPTIMUM])
def test_set_points_lie_within_the_ranges_and_keep_power_and_further_limits(rule: str) -> None:
    for wear, hardness in ((1e-6, 0.3), (0.2, 1.0), (1.2, 3.0)):
        speed, feed = set_point(rule, STEEL, DEPTHS, hardness, wear)
        assert np.all((speed >= 50.0) & (speed <= 200.0) & (feed >= 0.06) & (feed <= 0.6))
        cut = {"wear": wear, "hardness": hardness}
        power = STEEL.power.law(speed, feed, np.maximum(DEPTHS, 1e-6), **cut)
        assert np.all((power <= 7.0 * (1 + 1e-9)) | ((speed == 50.0) & (feed == 0.06)))
        force = STEEL.thrust_force.law(speed, feed, np.maximum(DEPTHS, 1e-6), **cut)
        assert np.all((force <= 1500.0 * (1 + 1e-9)) | (feed == 0.06))
    depth, hardness = np.meshgrid([0.5, 1.5, 2.5, 3.5], [0.6, 1.0])
    _, feed = set_point(rule, CASE, depth, hardness)
    for limit in CASE.further.values():
        assert np.all(limit.law(1.0, feed, depth, hardness=hardness) <= limit.most * (1 + 1e-9))


@pytest.mark.parametrize(
    ("rule", "name", "exponents"),
    [
        ("PV", "thrust_force", {"cutting_speed": 0.3, "feed": 0.0}),
        ("SN", "power", {"cutting_speed": 0.0, "feed": 0.7}),
        (
            "PN",
            "power",
            {"cutting_speed": -0.968, "feed": 0.472},
        ),  # twice those of the thrust force
        ("PT", "wear", {"cutting_speed": -0.242, "feed": 0.118}),
    ],
)
def test_limits_that_run_parallel_fix_no_point(
    rule: str, name: str, exponents: dict[str, float]
) -> None:
    material = Scenario().material
    odd = material.model_copy(update={name: getattr(material, name).model_copy(update=exponents)})
    scenario = Scenario().model_copy(update={"material": odd})
    with pytest.raises(ValueError, match=rf"\[{rule}\] fixes no point"):
        set_point(rule, Process.of(scenario), 2.5)
    for kind in ("rule", "adaptive"):
        assert rule == "PT" or not RULES[f"{kind}_{rule.lower()}"].plays(scenario)
    speed, feed = set_point(ECONOMIC_OPTIMUM, Process.of(scenario), DEPTHS)
    assert np.all(np.isfinite(speed) & np.isfinite(feed))


@pytest.mark.parametrize(("price", "wear"), [(0.0, 0.15), (5.0, 0.05), (5.0, 0.29), (1000.0, 0.15)])
def test_the_economic_optimum_is_the_cheapest_feasible_point(price: float, wear: float) -> None:
    process = replace(STEEL, edge_price=price)
    speeds, feeds = np.meshgrid(np.geomspace(50.0, 200.0, 400), np.geomspace(0.06, 0.6, 400))
    for depth in (0.5, 1.5, 2.5):
        feasible = process.thrust_force.law(speeds, feeds, depth, wear=wear) <= 1500.0
        feasible &= process.power.law(speeds, feeds, depth, wear=wear) <= 7.0
        cheapest = float(
            np.min(process.log_cost(np.log(speeds), np.log(feeds), depth, 1.0)[feasible])
        )
        speed, feed = set_point(ECONOMIC_OPTIMUM, process, depth, wear=wear)
        assert (
            cheapest - 0.02
            < float(process.log_cost(np.log(speed), np.log(feed), depth, 1.0))
            < cheapest + 1e-6
        )
