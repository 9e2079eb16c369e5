"""The differentiable gain against what the lathes themselves report."""

from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from train.commands import Commands
from train.hindsight import HindsightVecEnv
from train.model_gain import ModelGain, Truth
from train.vec_env import of_interval
from turning_env import Scenario

BASE = Scenario.load("rough_turning")
LANES, INTERVALS = 16, 240


class Told(HindsightVecEnv):
    """Keeps what the vector environment reports, too."""

    infos: dict[str, Any]

    def learned_rewards(self, rewards: NDArray[np.float64], infos: dict[str, Any]) -> NDArray[np.float64]:
        self.infos = {name: of_interval(infos, name) for name in ("reward_overload", "time", "engaged_time", "used_life")}
        return super().learned_rewards(rewards, infos)


@pytest.fixture(scope="module")
def played() -> dict[str, Any]:
    """Random set points, held for a while each."""
    env, commands = Told(BASE, LANES), Commands(BASE)
    env.seed(5)
    observations = env.reset()
    random = np.random.default_rng(1)
    kept: dict[str, list[Any]] = {name: [] for name in ("seen", "wanted", "before", "after", "changed", "failed", "overload")}
    for interval in range(INTERVALS):
        if interval % 15 == 0:
            wanted = torch.tensor(random.uniform([0.2, -0.2], [0.9, 0.6], (LANES, 2)), dtype=torch.float32)
        seen = torch.from_numpy(observations)
        observations, _, _, _ = env.step(commands.action(wanted, seen).numpy())
        values = (seen, wanted, env.before, env.after, env.changed, env.failed, -env.infos["reward_overload"])
        for name, value in zip(kept, values, strict=True):
            kept[name].append(value)
    return {name: torch.stack(rows) if torch.is_tensor(rows[0]) else np.stack(rows) for name, rows in kept.items()}


def gains(played: dict[str, Any], scenario: Scenario, wanted: torch.Tensor | None = None) -> torch.Tensor:
    commands = Commands(scenario)
    truth = Truth(scenario, *(played[name] for name in ("before", "after", "changed", "failed")))
    log_speed, log_feed = commands.commanded(played["wanted"] if wanted is None else wanted, played["seen"])
    return ModelGain(scenario)(log_speed, log_feed, *commands.actual(played["seen"]), truth)[0]


def without(**economics: float) -> Scenario:
    return BASE.model_copy(update={"economics": BASE.economics.model_copy(update=economics)})


def test_overload_is_charged_as_the_lathe_charges_it(played: dict[str, Any]) -> None:
    free = without(overload_price=0.0)
    # The price of life depends on that of overload, so both are computed with the same.
    difference = ModelGain(BASE)
    difference._scenario, priced = free, gains(played, BASE)
    commands = Commands(BASE)
    truth = Truth(BASE, *(played[name] for name in ("before", "after", "changed", "failed")))
    log_speed, log_feed = commands.commanded(played["wanted"], played["seen"])
    charged = (difference(log_speed, log_feed, *commands.actual(played["seen"]), truth)[0] - priced).numpy()
    reported = played["overload"]
    assert reported.max() > 1.0
    inside = (played["before"][:, 1] > 0) & (played["after"][:, 1] > 0)  # entries and exits are known to a fifth of an interval
    np.testing.assert_allclose(charged[inside], reported[inside], atol=0.25)
    assert abs(charged.sum() / reported.sum() - 1.0) < 0.05


def test_life_is_charged_at_its_price(played: dict[str, Any]) -> None:
    expensive = ModelGain(BASE)
    expensive._prices = expensive._prices + 1000.0
    commands = Commands(BASE)
    truth = Truth(BASE, *(played[name] for name in ("before", "after", "changed", "failed")))
    log_speed, log_feed = commands.commanded(played["wanted"], played["seen"])
    charged = gains(played, BASE) - expensive(log_speed, log_feed, *commands.actual(played["seen"]), truth)[0]
    used = played["after"][:, 3] - played["before"][:, 3]
    # Inserts wear more or less than the nominal, at which life is priced.
    ratio = charged.sum(0).numpy() / 1000.0 / used.sum(0)
    assert 0.7 < np.median(ratio) < 1.4


def test_more_feed_pays_far_from_the_limits_and_not_beyond_them(played: dict[str, Any]) -> None:
    wanted = played["wanted"].clone().requires_grad_()
    gains(played, BASE, wanted).sum().backward()
    assert wanted.grad is not None
    by_feed = wanted.grad[:, :, 1].numpy()
    inside = (played["before"][:, 1] > 0) & (played["after"][:, 1] > 0)
    idle, overloaded = inside & (played["overload"] == 0.0), inside & (played["overload"] > 2.0)
    assert (by_feed[idle] > 0).mean() > 0.9
    assert (by_feed[overloaded] < 0).mean() > 0.9


def test_a_command_counts_as_long_as_the_drives_lag() -> None:
    gain = ModelGain(BASE)
    commanded = torch.full((3, 1), 100.0, requires_grad=True)
    followed = gain._follow(commanded, torch.full((3, 1), 80.0), 0)
    (slope,) = torch.autograd.grad(followed[2].sum(), commanded)
    lag = BASE.machine.spindle_time_constant
    assert slope[0] > 0
    assert slope[1] / slope[0] == pytest.approx(np.exp(1.0 / lag), rel=1e-4)


def test_a_job_pays_the_flat_price_of_life() -> None:
    override = Scenario.load("override")
    price = 60.0 * (override.economics.edge_cost + override.economics.edge_change_time)
    assert ModelGain(override).price(torch.tensor([0.0, 0.3, 1.0])).tolist() == pytest.approx([price] * 3)


def test_going_on_earns_what_life_is_worth_or_else_what_the_metal_leaves_and_a_failure_costs_the_stop() -> None:
    shift = Scenario.load("shift")
    gain = ModelGain(shift)
    depth, pitch = shift.workpiece.depth_of_cut, shift.workpiece.bar_length + shift.workpiece.approach
    # Lanes: in a bar with life left; without; the same and the edge changed; found worn out; in the air.
    before = np.array([[pitch - 100.0] * 4 + [1.0], [depth] * 4 + [0.0], [1.0] * 4 + [0.0], [0.5, 0.95, 0.95, 0.999, 0.95]])
    after = before + np.array([[1.0], [0.0], [0.0], [0.0]])
    after[3, :4] = [0.501, 0.951, 0.0, 0.0]
    changed, failed = np.array([[False, False, True, True, False]]), np.array([[False, False, False, True, False]])
    truth = Truth(shift, before[np.newaxis], after[np.newaxis], changed, failed)
    speed, feed = torch.full((1, 5), 160.0), torch.full((1, 5), 0.12)
    _, (going_on,) = gain(speed.log(), feed.log(), speed, feed, truth)

    wear = shift.material.wear(160.0, 0.12, depth) / shift.tool.wear_criterion
    life_rate = wear ** (1.0 / shift.material.wear.time) / 60.0
    assert gain.price(torch.tensor(0.95)) == 0.0
    assert going_on[0] == pytest.approx(float(gain.price(torch.tensor(0.5005))) * life_rate, rel=1e-3)
    assert going_on[1] == pytest.approx(
        160.0 * 0.12 * depth / shift.economics.reference_removal_rate - gain._time_price, rel=1e-3
    )
    assert going_on[1] < 0.0
    assert going_on[2] == pytest.approx(float(going_on[1]), rel=1e-3)
    assert going_on[3] == pytest.approx(-gain._stop)
    assert going_on[4] == 0.0


def test_an_edge_is_changed_where_going_on_loses_in_the_mean() -> None:
    gain = ModelGain(Scenario.load("shift"))
    # The best leaning for what going on may earn, all alike likely.
    for outcomes in ([0.2, 0.1, -0.2], [0.2, -0.1, -0.2]):
        leaning = torch.zeros(1, requires_grad=True)
        gain.of_changing(leaning, torch.tensor(outcomes)).sum().backward()
        assert leaning.grad is not None
        assert np.sign(leaning.grad.item()) == -np.sign(sum(outcomes))
