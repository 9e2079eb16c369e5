"""The differentiable gain against its formula, written out for single steps, and against what the environment charges."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from scipy.stats import norm

from baselines.models.edge_value import USED_LIVES, worth
from train.analytic_actor import ACTUAL, TargetCommands
from train.analytic_gradient import HindsightVecEnv
from train.model_gain import FIELDS, WINDOW_EDGE, ModelGain, Truth, flat_prices
from turning_env import Scenario
from turning_env.vector_env import info_at_end_of_step

BASE, SHIFT, OVERRIDE = (Scenario.load(preset) for preset in ("rough_turning", "shift", "override"))
JOB = BASE.model_copy(update={"workpiece": BASE.workpiece.model_copy(update={"bars": 1})})
TANGLING = Scenario.load({"swarf": {"tangle_rate": 0.5, "tangle_time": 2.0, "chip_feed_min": 0.2, "chip_feed_max": 0.4}})
PATH, DEPTH, HARDNESS, USED_LIFE, FORCE = range(len(FIELDS))


def state(path: float, depth: float = 3.0, hardness: float = 1.0, used_life: float = 0.5, force: float = 0.0) -> list[float]:
    return [path, depth, hardness, used_life, force]


def truth_of(first: list[float], last: list[float], changed: bool = False, failed: bool = False) -> Truth:
    """The truth of one step of one environment."""
    before, after = (np.array(each).reshape(1, len(FIELDS), 1) for each in (first, last))
    return Truth(BASE, before, after, np.array([[changed]]), np.array([[failed]]))


PRICES = {each.digest(): worth(each, each.economics.overload_price) for each in (BASE, SHIFT, OVERRIDE, TANGLING)}
PRICES[JOB.digest()] = flat_prices(JOB)


def gain_of(scenario: Scenario) -> ModelGain:
    """The gain on a scenario's machine with drives that do not lag."""
    machine = scenario.machine.model_copy(update={"spindle_time_constant": 0.0, "feed_time_constant": 0.0})
    return ModelGain(scenario.model_copy(update={"machine": machine}), PRICES[scenario.digest()])


def expected_gain(scenario: Scenario, speed: float, feed: float, depth: float, hardness: float, used: float) -> Any:
    """The gain in two parts, its derivatives by log speed and log feed, and what going on earned: the formula, without lags."""
    material, limits, tool, economics = scenario.material, scenario.limits, scenario.tool, scenario.economics
    time_price, life_prices = PRICES[scenario.digest()]
    life_price = float(np.interp(used, [0.0, *USED_LIVES], [life_prices[0], *life_prices]))

    def cost(v: float, f: float) -> tuple[float, float, float]:
        """Cost per time, expected cost of breakage, and earnings per time."""
        wear = tool.wear_criterion * used**material.wear.time
        force = material.thrust_force(v, f, depth, wear=wear, hardness=hardness) / limits.thrust_force
        power = material.power(v, f, depth, wear=wear, hardness=hardness) / limits.power
        per_minute = (material.wear(v, f, depth, hardness=hardness) / tool.wear_criterion) ** (1.0 / material.wear.time)
        overload = economics.overload_price * (max(force - 1.0, 0.0) + max(power - 1.0, 0.0))
        strength = math.log(tool.edge_strength / limits.thrust_force)
        risk = norm.cdf((math.log(force) - strength) / tool.edge_strength_spread)
        edge = 60.0 * (economics.edge_cost + economics.edge_change_time)
        lost = 60.0 * economics.breakage_downtime + edge * (1.0 - used)
        life = life_price * per_minute / 60.0
        metal = v * f * depth / economics.reference_removal_rate - overload - time_price
        # Outside the chip breaker's window, the cost grows to that of tangled chips.
        outside = max(math.log(scenario.feed_range[0] / f), math.log(f / scenario.feed_range[1]), 0.0) / WINDOW_EDGE
        tangle = scenario.swarf.tangle_rate * scenario.swarf.tangle_time * time_price * outside
        return time_price + overload + life + tangle, risk * lost, life if life_price > 0.0 else metal

    rate, breakage, earned = cost(speed, feed)
    interval, h = scenario.control.interval, 1e-4

    def travelling(v: float, f: float) -> float:
        """Gain of covering the step's distance at other speeds and feeds."""
        rate, breakage, _ = cost(v, f)
        return -interval * rate * speed * feed / (v * f) - breakage

    slopes = [
        (travelling(speed * math.exp(a), feed * math.exp(b)) - travelling(speed * math.exp(-a), feed * math.exp(-b))) / (2 * h)
        for a, b in ((h, 0.0), (0.0, h))
    ]
    return -interval * rate, -breakage, *slopes, interval * earned


@pytest.mark.parametrize(
    ("scenario", "speed", "feed", "depth", "hardness", "used"),
    [
        pytest.param(BASE, 120.0, 0.3, 3.0, 1.0, 0.3, id="within the limits"),
        pytest.param(BASE, 190.0, 0.6, 4.0, 1.3, 0.8, id="over both limits and near breakage"),
        pytest.param(BASE, 80.0, 0.6, 4.5, 1.4, 0.2, id="over the force limit"),
        pytest.param(SHIFT, 160.0, 0.12, 3.0, 1.0, 0.5, id="shift, life has a price"),
        pytest.param(SHIFT, 160.0, 0.5, 3.0, 1.2, 0.97, id="shift, life has none"),
        pytest.param(OVERRIDE, 120.0, 0.5, 3.0, 1.3, 0.4, id="override, short steps"),
        pytest.param(JOB, 120.0, 0.3, 3.0, 1.0, 0.6, id="a job pays the flat price"),
        pytest.param(TANGLING, 120.0, 0.3, 3.0, 1.0, 0.3, id="chips break"),
        pytest.param(TANGLING, 120.0, 0.2 * math.exp(-WINDOW_EDGE / 2), 3.0, 1.0, 0.3, id="chips tangle at half the cost"),
        pytest.param(TANGLING, 120.0, 0.4 * math.exp(WINDOW_EDGE), 3.0, 1.0, 0.3, id="chips tangle"),
    ],
)
def test_gain_is_its_formula(scenario: Scenario, speed: float, feed: float, depth: float, hardness: float, used: float) -> None:
    gain = gain_of(scenario)
    commands = torch.tensor([[[math.log(speed)]], [[math.log(feed)]]], requires_grad=True)
    ends = state(100.0, depth, hardness, used)
    found, going_on = gain(commands[0], commands[1], torch.full((1, 1), 50.0), torch.full((1, 1), 0.1), truth_of(ends, ends))
    found.sum().backward()  # type: ignore[no-untyped-call]
    assert commands.grad is not None
    assert not going_on.requires_grad
    numbers = found.item(), *commands.grad.flatten().tolist(), going_on.item()
    cost, breakage, *others = expected_gain(scenario, speed, feed, depth, hardness, used)
    assert numbers == pytest.approx((cost + breakage, *others), rel=2e-3, abs=2e-3)


def test_overload_and_life_are_charged_as_the_environment_charges_them() -> None:
    """Random set points, held for a while each, on lagging drives."""

    class Reporting(HindsightVecEnv):
        overload: Any

        def training_rewards(self, rewards: Any, infos: dict[str, Any]) -> Any:
            self.overload = -info_at_end_of_step(infos, "reward_overload")
            return super().training_rewards(rewards, infos)

    num_envs = 16
    env, commands, random = Reporting(BASE, num_envs), TargetCommands(BASE), np.random.default_rng(1)
    env.seed(5)
    observations = env.reset()
    steps: list[tuple[Any, ...]] = []
    last, ends = np.zeros((len(FIELDS), num_envs)), 0
    for step in range(240):
        if step % 15 == 0:
            target = torch.tensor(random.uniform([0.2, -0.2], [0.9, 0.6], (num_envs, 2)), dtype=torch.float32)
        seen = torch.from_numpy(observations)
        observations, _, ended, _ = env.step(commands.action(target, seen).numpy())
        np.testing.assert_array_equal(env.before, last)  # a step starts where the one before has ended
        last, ends = np.where(ended, 0.0, env.after), ends + ended.sum()
        steps.append((seen, target, env.before, env.after, env.changed, env.failed, env.overload))
    *tensors, before, after, changed, failed, overload = zip(*steps, strict=True)
    seen, target = (torch.stack(each) for each in tensors)
    before, after, reported = np.stack(before), np.stack(after), np.stack(overload)
    truth = Truth(BASE, before, after, np.stack(changed), np.stack(failed))
    log_speed, log_feed = commands.commanded(target, seen)
    given = log_speed, log_feed, *commands.speed_and_feed(seen, ACTUAL), truth
    prices = PRICES[BASE.digest()]
    unpriced = BASE.model_copy(update={"economics": BASE.economics.model_copy(update={"overload_price": 0.0})})
    gain, free = ModelGain(BASE, prices), ModelGain(unpriced, prices)
    dear = ModelGain(BASE, prices._replace(life=prices.life + 1000.0))
    charged = (free(*given)[0] - gain(*given)[0]).numpy()
    assert reported.max() > 1.0
    inside = (before[:, DEPTH] > 0) & (after[:, DEPTH] > 0)  # entries and exits are known to a fifth of a step
    np.testing.assert_allclose(charged[inside], reported[inside], atol=0.25)
    assert abs(charged.sum() / reported.sum() - 1.0) < 0.05
    life = (gain(*given)[0] - dear(*given)[0]).sum(0).numpy() / 1000.0
    used = (after[:, USED_LIFE] - before[:, USED_LIFE]).sum(0)
    assert 0.7 < np.median(life / used) < 1.4  # inserts wear more or less than the nominal one
