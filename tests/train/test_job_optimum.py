"""Prices and expected gains that a network computes, against search over a fine grid and numerical derivatives."""

from typing import Any

import numpy as np
import pytest
import torch

from baselines.models.edge_value import worth_of_lots
from train import job_optimum
from train.job_optimum import Ahead, ExpectedGain, JobOptimum, LifeRate, Load, log_over_half
from train.newton_search import search
from turning_env import Family, Scenario
from turning_env.physics.spindle import capacity_at, idle_power_at
from turning_env.scenario.plan import MIDDLE, Plan, columns_of, features, plan_of

FAMILY = Family.load("shop")
JOBS = [FAMILY.job(number).scenario.nominal() for number in range(6)]
POINTS = 4


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
    by_speed, by_feed = (told[f"wear_{name}_exponent"] / told["wear_time_exponent"] for name in ("cutting_speed", "feed"))
    rate = LifeRate(float(np.log(lot)) - told["log_life"], by_speed + error, by_feed)
    overload_price = torch.full_like(by_speed, JOBS[0].economics.overload_price)
    return JobOptimum(told, (laws[0], laws[1]), rate, overload_price), plan


def gain_of(optimum: JobOptimum, used: torch.Tensor, price: torch.Tensor, spread: float = 0.002, **changes: Any) -> ExpectedGain:
    """Return the expected gain in the expected bar, if nothing lags; ``changes``: of what lies ahead."""
    one = torch.ones(len(JOBS), POINTS).double()
    loads = [load.log_load + load.used_life * log_over_half(used)[:, None, None] for load in optimum._loads]
    ahead = Ahead(
        *(torch.zeros(len(JOBS), 1).double(),) * 2,
        *(0.0 * one,) * 2,
        one,
        *(0.0 * one,) * 2,
        torch.cat(loads, dim=1).expand(-1, 2, POINTS),
        spread * torch.ones(len(JOBS), 2, POINTS).double(),
        0.15 * one,
        0.0 * one,
    )
    return optimum.gain(ahead._replace(**changes), price)


def outcome(
    job: Scenario, reference: float, used: float, speed: Any = None, feed: Any = None, limit: float = 1.001
) -> tuple[Any, Any]:
    """Return the value of metal [-] and the life used [1/min] within the limits, for set points or a grid of them."""
    if speed is None:
        speed = np.geomspace(job.machine.cutting_speed_min, job.cutting_speed_max, 150)[:, None]
        feed = np.geomspace(*job.feed_range, 200)
    depth, law = job.workpiece.depth_of_cut, job.material
    wear = job.tool.wear_criterion * used**law.wear.time
    force = law.thrust_force(speed, feed, depth, wear=wear) / job.limits.thrust_force
    power = law.power(speed, feed, depth, wear=wear) + idle_power_at(job, speed)
    within = (force <= limit) & (power <= limit * job.limits.power * capacity_at(job, speed))
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


def test_the_best_commands_are_those_of_a_search_over_a_grid() -> None:
    optimum, plan = optimum_of()
    used, price = torch.linspace(0.1, 0.9, len(JOBS)).double(), torch.linspace(2.0, 0.0, len(JOBS)).double()
    gain = gain_of(optimum, used, price)
    ends = [job.machine.cutting_speed_min for job in JOBS], [job.cutting_speed_max for job in JOBS]
    feeds = zip(*(job.feed_range for job in JOBS), strict=True)
    middle = plan.speed[:, MIDDLE], plan.feed[:, MIDDLE]
    (slowest, fastest), (lowest, highest) = (
        [torch.tensor(np.log(np.array(end) / best)) for end in both]
        for both, best in zip((ends, tuple(feeds)), middle, strict=True)
    )
    found = search(gain, gain.start(), (slowest, lowest), (fastest, highest))
    for _ in range(5):  # an agent searches in every step, from where it is
        found = search(gain, found[:2], (slowest, lowest), (fastest, highest))
    for i, job in enumerate(JOBS):
        given = job, float(plan.removal_rate[i]), float(used[i])
        speed, feed = float(found.x[i].exp()) * middle[0][i], float(found.y[i].exp()) * middle[1][i]
        (gained, used_up), (metal, rate) = outcome(*given, speed, feed, 1.01), outcome(*given)
        best = (metal - float(price[i]) * rate).max()
        assert gained - float(price[i]) * used_up > 0.98 * best - 0.02


def test_derivatives_of_the_gain_are_those_of_its_values() -> None:
    optimum, _ = optimum_of()
    random = torch.Generator().manual_seed(0)

    def some(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=random).double()

    shape, count = (len(JOBS), POINTS), len(JOBS)
    changes = {
        "slow": some(*shape),
        "late": some(*shape),
        "cutting": (some(*shape) > 0.3).double(),
        "metal": 0.2 * some(*shape),
        "wear": 0.2 * some(*shape),
        "strength_spread": 0.1 + 0.2 * some(*shape),
        "breakage_price": 500.0 * some(*shape),
    }
    gain = gain_of(optimum, some(count), 2.0 * some(count), spread=0.05, **changes)
    for shift in (-0.3, 0.0, 0.3):
        x, y = (shift + 0.2 * some(count) for _ in range(2))
        x.requires_grad_()
        y.requires_grad_()
        found = gain(x, y)
        by_x, by_y = torch.autograd.grad(found.gain.sum(), (x, y), create_graph=True)
        (by_xx, by_xy), (by_yy,) = (
            torch.autograd.grad(by_x.sum(), (x, y), retain_graph=True),
            torch.autograd.grad(by_y.sum(), (y,)),
        )
        for mine, its in zip(found[1:], (by_x, by_y, by_xx, by_xy, by_yy), strict=True):
            torch.testing.assert_close(mine, its, rtol=1e-6, atol=1e-6)


def test_a_bar_that_may_break_the_edge_is_entered_more_slowly() -> None:
    optimum, _ = optimum_of()
    used, price, zero = (torch.full((len(JOBS),), value).double() for value in (0.3, 1.0, 0.0))
    spreads = torch.full((len(JOBS), 2, POINTS), 0.3).double()
    feeds = []
    for cost in (0.0, 900.0):
        breakage = torch.full((len(JOBS), POINTS), cost).double()
        gain = gain_of(optimum, used, price, spreads=spreads, breakage_price=breakage, strength_spread=0.0 * breakage + 0.3)
        feeds.append(search(gain, (zero, zero), (zero, zero - 1.0), (zero, zero + 1.0)).y)
    assert (feeds[1] < feeds[0] - 1e-3).all()


def test_overload_far_beyond_a_limit_costs_its_price() -> None:
    optimum, _ = optimum_of()
    used, zero = (torch.full((len(JOBS),), value).double() for value in (0.5, 0.0))
    gain = gain_of(optimum, used, zero)
    at = torch.full_like(zero, 1.5)
    loads = gain.log_loads(zero, at)
    excess = torch.relu(loads.exp() - 1.0).sum(dim=-1)
    assert (excess > 0.5).all()
    metal = torch.exp(optimum._log_metal[:, 0, 0] + at)
    torch.testing.assert_close(metal - gain(zero, at).gain, JOBS[0].economics.overload_price * excess, rtol=1e-3, atol=1e-2)


def test_an_estimated_exponent_of_speed_counts_as_if_it_were_told() -> None:
    used, price = torch.full((len(JOBS),), 0.4), torch.full((len(JOBS),), 1.0).double()
    at = torch.full((len(JOBS),), 0.2).double()
    found, expected, nominal = (
        (*optimum.prices(used), gain_of(optimum, used.double(), price)(at, -at).gain)
        for optimum, _ in (optimum_of(error=0.8), optimum_of(told_error=0.8), optimum_of())
    )
    for mine, its, without in zip(found, expected, nominal, strict=True):
        torch.testing.assert_close(mine, its)
        assert (mine - without).abs().max() > 1e-3
