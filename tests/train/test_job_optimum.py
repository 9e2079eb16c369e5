"""Prices and set points that a network computes, against search over a fine grid."""

from typing import Any

import numpy as np
import pytest
import torch

from baselines.models.edge_value import worth_of_lots
from train import job_optimum
from train.job_optimum import Bar, JobOptimum, Load, log_over_half
from turning_env import Family, Scenario
from turning_env.physics.spindle import capacity_at, idle_power_at
from turning_env.scenario.plan import MIDDLE, Plan, columns_of, features, plan_of

FAMILY = Family.load("shop")
JOBS = [FAMILY.job(number).scenario.nominal() for number in range(6)]
EXPECTED = Bar((torch.zeros(len(JOBS)), torch.zeros(len(JOBS))), torch.zeros(len(JOBS)), torch.zeros(len(JOBS)))


def optimum_of(lot: float = 1.0, load: float = 1.0, error: float = 0.0, told_error: float = 0.0) -> tuple[JobOptimum, Plan]:
    """Return the optimum of the jobs for known laws, loads so many times as high, and a lot that wears so many times as fast.

    ``error``, ``told_error``: of the exponent of speed of the rate of wear, estimated and in what is told.
    """
    columns = columns_of(JOBS)
    plan = plan_of(columns, len(JOBS))
    told = {name: torch.tensor(value.copy()) for name, value in features(columns, plan).items()}
    laws = []
    for name in ("thrust_force", "power"):
        speed, feed, wear = (told[f"{name}_{factor}_exponent"] for factor in ("cutting_speed", "feed", "wear"))
        laws.append(Load(told[f"log_{name}_load"] + float(np.log(load)), speed, feed, wear * told["wear_time_exponent"]))
    told["wear_cutting_speed_exponent"] += told_error * told["wear_time_exponent"]
    rate, errors = torch.full_like(told["log_life"], float(np.log(lot))), torch.full_like(told["log_life"], error)
    return JobOptimum(told, (laws[0], laws[1]), rate, errors, JOBS[0].economics.overload_price), plan


def outcome(job: Scenario, reference: float, used: float, speed: Any = None, feed: Any = None) -> tuple[Any, Any]:
    """Return the value of metal [-] and the life used [1/min] within the limits, for set points or a grid of them."""
    if speed is None:
        speed = np.geomspace(job.machine.cutting_speed_min, job.cutting_speed_max, 150)[:, None]
        feed = np.geomspace(*job.feed_range, 200)
    depth, law = job.workpiece.depth_of_cut, job.material
    wear = job.tool.wear_criterion * used**law.wear.time
    force = law.thrust_force(speed, feed, depth, wear=wear) / job.limits.thrust_force
    power = law.power(speed, feed, depth, wear=wear) + idle_power_at(job, speed)
    within = (force <= 1.001) & (power <= 1.001 * job.limits.power * capacity_at(job, speed))
    rate = (law.wear(speed, feed, depth) / job.tool.wear_criterion) ** (1.0 / law.wear.time)
    return np.where(within, speed * feed * depth / reference, -1e3), rate


def test_life_has_the_price_at_which_the_job_earns_nothing() -> None:
    for lot in (0.7, 1.0, 1.5):
        optimum, plan = optimum_of(lot)
        for used in (0.1, 0.5, 0.9):
            time, price = (each.numpy() for each in optimum.prices(torch.full((len(JOBS),), used)))
            for i, job in enumerate(JOBS):
                metal, rate = outcome(job, float(plan.removal_rate[i]), used)
                expected = max(float(((metal - time[i]) / (lot * rate)).max()), 0.0)
                assert price[i] == pytest.approx(expected, rel=0.05, abs=0.5)


def test_time_has_the_price_at_which_an_edge_pays_for_itself() -> None:
    lots = (0.7, 1.0, 1.5)
    expected = [worth_of_lots(job, job.economics.overload_price, lots) for job in JOBS]
    for k, lot in enumerate(lots):
        time, _ = optimum_of(lot)[0].prices(torch.full((len(JOBS),), 0.5))
        np.testing.assert_allclose(time, [each[k].time for each in expected], rtol=0.1)


def test_the_price_of_time_is_found_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    used = torch.full((len(JOBS),), 0.3)
    for lot in (0.3, 2.0, 5.0):
        for load in (0.75, 1.0, 1.3):
            time, _ = optimum_of(lot, load)[0].prices(used)
            with monkeypatch.context() as patch:
                patch.setattr(job_optimum, "_NEWTON_STEPS", 50)
                expected, _ = optimum_of(lot, load)[0].prices(used)
            np.testing.assert_allclose(time, expected, atol=1e-6)


def test_the_best_set_point_is_that_of_a_search() -> None:
    optimum, plan = optimum_of()
    used, price = torch.linspace(0.1, 0.9, len(JOBS)), torch.linspace(2.0, 0.0, len(JOBS))
    speeds = optimum.best_speed(log_over_half(used), price, EXPECTED)
    feeds = optimum.feed(speeds, log_over_half(used), EXPECTED.loads)
    for i, job in enumerate(JOBS):
        given = job, float(plan.removal_rate[i]), float(used[i])
        speed, feed = float(speeds[i].exp()) * plan.speed[i, MIDDLE], float(feeds[i].exp()) * plan.feed[i, MIDDLE]
        (found, used_up), (metal, rate) = outcome(*given, speed, feed), outcome(*given)
        best = (metal - float(price[i]) * rate).max()
        assert found - float(price[i]) * used_up > 0.98 * best - 0.01


def test_an_estimated_exponent_of_speed_counts_as_if_it_were_told() -> None:
    used, price = torch.full((len(JOBS),), 0.4), torch.full((len(JOBS),), 1.0)
    found, expected, nominal = (
        (*optimum.prices(used), optimum.best_speed(log_over_half(used), price, EXPECTED))
        for optimum, _ in (optimum_of(error=0.8), optimum_of(told_error=0.8), optimum_of())
    )
    for mine, its, without in zip(found, expected, nominal, strict=True):
        torch.testing.assert_close(mine, its)
        assert (mine - without).abs().max() > 1e-3


def test_more_feed_pays_up_to_the_bearable_chance_of_overload() -> None:
    optimum, plan = optimum_of()
    price, step = 2.0, 1e-3
    speed, feed = torch.zeros(len(JOBS)), torch.full((len(JOBS),), -0.3)
    chances = optimum.bearable_chances(speed, feed, torch.full((len(JOBS),), price), speed, speed)
    for i, job in enumerate(JOBS):
        at = [float(plan.feed[i, MIDDLE]) * float(np.exp(-0.3 + end)) for end in (-step, step)]
        (metal, rate), (more, faster) = (
            outcome(job, float(plan.removal_rate[i]), 0.1, plan.speed[i, MIDDLE], each) for each in at
        )
        gain = (more - metal - price * (faster - rate)) / (2.0 * step)
        for chance, law in zip(chances, (job.material.thrust_force, job.material.power), strict=True):
            expected = np.clip(gain / (job.economics.overload_price * law.feed), 0.02, 0.5)
            assert float(chance[i]) == pytest.approx(expected, rel=0.02)
