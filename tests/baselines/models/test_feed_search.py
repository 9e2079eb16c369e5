"""The search finds the set point with the greatest gain within reach."""

import math
from itertools import product
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.stats import norm

from baselines.models import edge_value
from baselines.models.feed_search import (
    CORNER,
    ENVIRONMENT,
    FLAT,
    MOMENT,
    POINT,
    SET_POINT,
    Gain,
    LogLoad,
    State,
    charge_breakage,
    charge_overload,
    charge_power,
    force_at,
    newton_step,
    rise_of,
    search,
    step_of_feed_first,
    step_of_speed_first,
    try_set_point,
    with_term,
)
from baselines.models.load_filter import records
from tests.turning_env.playing import changed
from turning_env import Scenario

BASE = Scenario()
KINKED = changed(BASE, machine={"rated_power": 6.0}, spindle={"base_speed": 1500.0})
FRESH_SHARE = changed(
    BASE,
    material={
        "thrust_force": BASE.material.thrust_force.model_dump()
        | {"coefficient": 14000.0, "wear": 1.0, "wear_growth": 6.0},
    },
)
POINTS = 3
NUM_ENVS = 12


class Task(NamedTuple):
    """Arguments of ``search``."""

    parameters: Any
    moments: Any
    environments: Any
    points: Any

    def gain(self, env: int, log_speed: float, log_feed: float) -> float:
        """Return the mean gain of a set point in an environment."""
        trial = try_set_point(
            self.parameters[0],
            self.moments[0],
            self.environments[env],
            self.points[env],
            log_speed,
            log_feed,
        )
        return float(trial.gain)


def random_task(scenario: Scenario, seed: int, **of_points: Any) -> Task:
    """Return the task of random states; ``of_points``: values of all points."""
    random = np.random.default_rng(seed)
    log_speed = np.log(random.uniform(120.0, 300.0, NUM_ENVS))
    log_feed = np.log(random.uniform(0.15, 0.6, NUM_ENVS))
    used_life = random.uniform(0.05, 0.9, NUM_ENVS)
    log_force = random.normal(0.0, 0.15, NUM_ENVS)
    log_power = random.normal(0.0, 0.15, NUM_ENVS)

    moments = np.empty((1, POINTS), MOMENT)
    moments["time"] = np.arange(1.0, POINTS + 1.0) / POINTS
    moments["speed_left"] = np.exp(-moments["time"] / 0.2)
    moments["feed_left"] = np.exp(-moments["time"] / 0.1)

    parameters = records([edge_value.life_numbers(scenario, severity=1.5)])
    environments = np.empty(NUM_ENVS, ENVIRONMENT)
    environments["min_log_speed"] = log_speed - 0.15
    environments["max_log_speed"] = log_speed + 0.15
    environments["min_log_feed"] = log_feed - 0.4
    environments["max_log_feed"] = log_feed + 0.4
    environments["log_speed"] = log_speed
    environments["log_feed"] = log_feed
    environments["used_life"] = used_life
    environments["breakage_price"] = 300.0
    for name in ("log_life_rate", "life_speed", "life_feed"):
        environments[name] = parameters[name]
    laws = {"force": scenario.material.thrust_force, "power": scenario.material.power}
    for name, law in laws.items():
        environments[f"{name}_speed"] = law.cutting_speed
        environments[f"{name}_feed"] = law.feed
        environments[f"{name}_wear"] = law.wear
        environments[f"{name}_growth"] = law.wear_growth * scenario.tool.wear_criterion

    points = np.empty((NUM_ENVS, POINTS), POINT)
    points["log_force"] = log_force[:, np.newaxis]
    points["log_power"] = log_power[:, np.newaxis]
    points["force_spread"] = 0.04
    points["power_spread"] = 0.03
    points["strength_spread"] = 0.15
    points["life_price"] = 1000.0
    points["metal_value"] = parameters["metal_value"]
    points["cutting"] = 1.0
    points["unmeasured"] = 0.0
    for name, value in of_points.items():
        points[name] = value
    return Task(parameters, moments, environments, points)


def best_set_points(task: Task) -> NDArray[Any]:
    """Return the set points that the search finds."""
    best = np.empty(NUM_ENVS, SET_POINT)
    search(*task, best)
    return best


@pytest.mark.parametrize("scenario", [BASE, KINKED, FRESH_SHARE], ids=["power", "base", "fresh"])
def test_the_slope_of_the_gain_leads_uphill(scenario: Scenario) -> None:
    """A small part of the step from a set point raises the gain."""
    task = random_task(scenario, seed=1)
    for i in range(NUM_ENVS):
        env = task.environments[i]
        start = (env.log_speed, env.log_feed)
        trial = try_set_point(task.parameters[0], task.moments[0], env, task.points[i], *start)
        share = 1e-4
        gain = task.gain(
            i, start[0] + share * trial.step.log_speed, start[1] + share * trial.step.log_feed
        )
        assert gain >= trial.gain


@pytest.mark.slow
@pytest.mark.compiled
@pytest.mark.parametrize(
    ("scenario", "of_points"),
    [
        pytest.param(BASE, {}, id="metal"),
        pytest.param(KINKED, {}, id="base speed"),
        pytest.param(FRESH_SHARE, {}, id="fresh edge's share"),
        pytest.param(BASE, {"unmeasured": 1.0}, id="unmeasured bar"),
        pytest.param(BASE, {"cutting": 0.0, "log_force": 9.0}, id="air"),
    ],
)
def test_no_set_point_of_a_grid_within_reach_gains_more(
    scenario: Scenario, of_points: dict[str, float]
) -> None:
    task = random_task(scenario, seed=0, **of_points)
    best = best_set_points(task)
    for i in range(4):
        env = task.environments[i]
        assert env.min_log_speed - 1e-12 <= best[i].log_speed <= env.max_log_speed + 1e-12
        assert env.min_log_feed - 1e-12 <= best[i].log_feed <= env.max_log_feed + 1e-12
        speeds = np.linspace(env.min_log_speed, env.max_log_speed, 13)
        feeds = np.linspace(env.min_log_feed, env.max_log_feed, 13)
        gains = [task.gain(i, speed, feed) for speed, feed in product(speeds, feeds)]
        assert task.gain(i, best[i].log_speed, best[i].log_feed) >= max(gains) - 1e-4


NOTHING = Gain(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_term_adds_its_value_and_derivatives_by_the_chain_rule() -> None:
    """A term g(2 s - 3 f) with the value 5, the slope 7 and the curvature 11."""
    gain = with_term(Gain(1.0, 2.0, 3.0, 4.0, 5.0, 6.0), 5.0, 7.0, 11.0, 2.0, -3.0)
    assert gain == (6.0, 16.0, -18.0, 48.0, -61.0, 105.0)


def expected_excess(log_mean: float, spread: float) -> float:
    """Return E max(X - 1, 0) of a log-normal X (Black and Scholes 1973), with SciPy's normal."""
    ratio = log_mean / spread
    mean_above = math.exp(log_mean + 0.5 * spread**2) * float(norm.cdf(ratio + spread))
    return mean_above - float(norm.cdf(ratio))


def laws(**values: float) -> Any:
    """Return exponents of an environment, all of them different."""
    exponents = {
        "force_speed": -0.25,
        "force_feed": 0.5,
        "force_wear": 1.5,
        "force_growth": 0.0,
        "power_speed": 0.75,
        "power_feed": 0.625,
        "power_wear": 0.5,
        "power_growth": 0.0,
        "breakage_price": 300.0,
    }
    return SimpleNamespace(**(exponents | values))


NUMBERS = SimpleNamespace(
    log_force_coefficient=1.0,
    log_power_coefficient=-2.0,
    log_base_speed=4.0,
    overload_price=6.0,
    interval=3.0,
)
POINT_AHEAD = SimpleNamespace(log_force=0.1, log_power=0.2, force_spread=0.05, power_spread=0.05)


def state(speed: float = 5.0, feed: float = -1.0, wear: float = -0.5) -> State:
    """Return a state in which half of a command is reached, and wear grows with both."""
    return State(
        speed=speed,
        feed=feed,
        wear=wear,
        speed_by_speed=0.5,
        feed_by_feed=0.25,
        wear_by_speed=0.2,
        wear_by_feed=0.1,
    )


@pytest.mark.parametrize(
    ("growth", "term", "slope"),
    [
        pytest.param(0.0, -0.5, 1.0, id="power law"),
        # U = 1 + 4 exp(-0.5) over 1 + 4.
        pytest.param(
            4.0,
            math.log((1.0 + 4.0 * math.exp(-0.5)) / 5.0),
            4.0 * math.exp(-0.5) / (1.0 + 4.0 * math.exp(-0.5)),
            id="fresh share",
        ),
    ],
)
def test_the_force_over_its_limit_by_hand(growth: float, term: float, slope: float) -> None:
    load = force_at(NUMBERS, laws(force_growth=growth), POINT_AHEAD, state())
    assert load.value == pytest.approx(1.0 - 0.25 * 5.0 - 0.5 + 1.5 * term + 0.1)
    assert load.by_speed == pytest.approx(-0.25 * 0.5 + 1.5 * slope * 0.2)
    assert load.by_feed == pytest.approx(0.5 * 0.25 + 1.5 * slope * 0.1)


@pytest.mark.parametrize("value", [-0.1, 0.02, 0.3])
def test_overload_costs_its_expected_excess(value: float) -> None:
    gain = charge_overload(NUMBERS, NOTHING, LogLoad(value, 2.0, -3.0), 0.05)
    step = 1e-4

    def worth(by: float) -> float:
        return -6.0 * expected_excess(value + by, 0.05)

    slope = (worth(step) - worth(-step)) / (2.0 * step)
    curvature = (worth(step) - 2.0 * worth(0.0) + worth(-step)) / step**2
    assert gain.value == pytest.approx(worth(0.0), abs=1e-5)
    assert (gain.by_speed, gain.by_feed) == pytest.approx((2.0 * slope, -3.0 * slope), abs=1e-4)
    assert gain.by_speed_speed == pytest.approx(4.0 * curvature, rel=1e-3, abs=1e-3)
    assert gain.by_speed_feed == pytest.approx(-6.0 * curvature, rel=1e-3, abs=1e-3)
    assert gain.by_feed_feed == pytest.approx(9.0 * curvature, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize(("deviations", "counts"), [(-6.0, False), (-5.99, True)])
def test_a_load_six_deviations_below_its_limit_costs_nothing(
    deviations: float, counts: bool
) -> None:
    load = LogLoad(deviations * 0.5, 1.0, 1.0)
    assert (charge_overload(NUMBERS, NOTHING, load, 0.5) != NOTHING) == counts
    point = SimpleNamespace(log_power=0.0, power_spread=0.5)
    # Far above the base speed the corner vanishes: the value is all coefficient.
    numbers = SimpleNamespace(
        log_power_coefficient=deviations * 0.5, log_base_speed=-1e9, overload_price=6.0
    )
    still = laws(power_speed=0.0, power_feed=0.0, power_wear=0.0)
    assert (charge_power(numbers, NOTHING, still, point, state()) != NOTHING) == counts


@pytest.mark.parametrize(
    "speed",
    [
        pytest.param(4.5, id="above the base speed"),
        pytest.param(3.5, id="below"),
        pytest.param(4.0, id="at"),
        pytest.param(4.0 + CORNER, id="on the corner"),
        pytest.param(4.0 - 2.0 * CORNER, id="below the corner"),
    ],
)
@pytest.mark.parametrize("growth", [0.0, 4.0])
def test_power_costs_its_expected_excess_over_a_limit_that_falls_with_speed(
    speed: float, growth: float
) -> None:
    """Derivatives are differences of the value: by the speed alone, and by the feed alone."""
    log_power = 0.6 - 0.75 * (speed - 4.0)
    point = SimpleNamespace(log_power=log_power, power_spread=0.05)
    numbers = SimpleNamespace(**vars(NUMBERS) | {"log_power_coefficient": -2.5})
    env = laws(power_growth=growth)

    def charged(by_speed: float = 0.0, by_feed: float = 0.0) -> Gain:
        # No wear, whose second derivatives are left out.
        moved = state(speed + 0.5 * by_speed, -1.0 + 0.25 * by_feed)
        still = moved._replace(wear_by_speed=0.0, wear_by_feed=0.0)
        return charge_power(numbers, NOTHING, env, point, still)

    gain = charged()
    above = speed - 4.0
    limit = 0.5 * (math.hypot(above, CORNER) - above)
    term = math.log((1.0 + growth * math.exp(-0.5)) / (1.0 + growth)) if growth else -0.5
    log_load = -2.5 + 0.75 * speed - 0.625 + 0.5 * term + log_power + limit
    assert gain.value == pytest.approx(-6.0 * expected_excess(log_load, 0.05), abs=1e-5)
    step = 2e-5
    by_speed = (charged(by_speed=step).value - charged(by_speed=-step).value) / (2.0 * step)
    by_feed = (charged(by_feed=step).value - charged(by_feed=-step).value) / (2.0 * step)
    assert (gain.by_speed, gain.by_feed) == pytest.approx((by_speed, by_feed), rel=1e-3, abs=1e-3)
    # Second derivatives are differences of the first.
    right = charged(by_speed=step)
    left = charged(by_speed=-step)
    speed_speed = (right.by_speed - left.by_speed) / (2.0 * step)
    speed_feed = (right.by_feed - left.by_feed) / (2.0 * step)
    up = charged(by_feed=step)
    down = charged(by_feed=-step)
    feed_feed = (up.by_feed - down.by_feed) / (2.0 * step)
    assert gain.by_speed_speed == pytest.approx(speed_speed, rel=1e-3, abs=1e-3)
    assert gain.by_speed_feed == pytest.approx(speed_feed, rel=1e-3, abs=1e-3)
    assert gain.by_feed_feed == pytest.approx(feed_feed, rel=1e-3, abs=1e-3)


@pytest.mark.parametrize(
    ("growth", "slope_of_term"),
    [(0.0, 1.0), (4.0, 4.0 * math.exp(-0.5) / (1.0 + 4.0 * math.exp(-0.5)))],
    ids=["power law", "fresh share"],
)
def test_wear_that_grows_with_the_set_point_counts_in_the_slopes_of_power(
    growth: float, slope_of_term: float
) -> None:
    point = SimpleNamespace(log_power=-1.0, power_spread=0.05)
    env = laws(power_growth=growth)
    with_wear = charge_power(NUMBERS, NOTHING, env, point, state())
    without = charge_power(
        NUMBERS, NOTHING, env, point, state()._replace(wear_by_speed=0.0, wear_by_feed=0.0)
    )
    # Slopes by the log load: 0.5 * 0.2 by the speed, 0.5 * 0.1 by the feed, for U = W.
    slope = slope_of_term * without.by_feed / (0.625 * 0.25)
    assert with_wear.by_speed - without.by_speed == pytest.approx(0.1 * slope)
    assert with_wear.by_feed - without.by_feed == pytest.approx(0.05 * slope)


@pytest.mark.parametrize("deviation", [-1.5, 0.0, 0.7])
def test_the_risk_of_breakage_is_a_normal_probability(deviation: float) -> None:
    gain = charge_breakage(NUMBERS, NOTHING, laws(), LogLoad(deviation, 2.0, -3.0), 4)
    # 300 s in a step of 3 s, for four points.
    price = -400.0
    density = float(norm.pdf(deviation))
    assert gain.value == pytest.approx(price * float(norm.cdf(deviation)), abs=1e-4)
    assert (gain.by_speed, gain.by_feed) == pytest.approx(
        (2.0 * price * density, -3.0 * price * density)
    )
    curvature = -price * deviation * density
    curvatures = (gain.by_speed_speed, gain.by_speed_feed, gain.by_feed_feed)
    assert curvatures == pytest.approx((4.0 * curvature, -6.0 * curvature, 9.0 * curvature))


@pytest.mark.parametrize("seed", range(40))
def test_a_step_goes_to_the_top_of_the_parabola_within_reach(seed: int) -> None:
    """Compared with SciPy's minimum, with the magnitudes of NumPy's eigenvalues."""
    random = np.random.default_rng(seed)
    slopes = random.normal(0.0, 1.0, 2)
    hessian = random.normal(0.0, 4.0, (2, 2))
    hessian += hessian.T
    values, vectors = np.linalg.eigh(hessian)
    magnitude = vectors @ np.diag(np.abs(values)) @ vectors.T + FLAT * np.eye(2)
    at = random.normal(0.0, 1.0, 2)
    below = at - random.uniform(0.01, 0.6, 2)
    above = at + random.uniform(0.01, 0.6, 2)
    env = SimpleNamespace(
        min_log_speed=below[0],
        max_log_speed=above[0],
        min_log_feed=below[1],
        max_log_feed=above[1],
    )
    gain = Gain(9.0, *slopes, hessian[0, 0], hessian[0, 1], hessian[1, 1])
    step = newton_step(env, gain, *at)

    def loss(move: Any) -> float:
        return float(0.5 * move @ magnitude @ move - slopes @ move)

    best = minimize(loss, np.zeros(2), bounds=list(zip(below - at, above - at, strict=True)))
    assert (step.log_speed, step.log_feed) == pytest.approx(tuple(best.x), abs=2e-4)
    assert step.rise == pytest.approx(-best.fun, abs=1e-5)


def test_without_curvature_the_step_is_as_long_as_the_reach() -> None:
    env = SimpleNamespace(
        min_log_speed=-1.0, max_log_speed=2.0, min_log_feed=-3.0, max_log_feed=4.0
    )
    step = newton_step(env, Gain(0.0, 1.0, -1.0, 0.0, 0.0, 0.0), 0.0, 0.0)
    assert (step.log_speed, step.log_feed) == (2.0, -3.0)


def gain_by_scipy(task: Task, i: int, log_speed: float, log_feed: float) -> float:
    """Return the mean gain of a set point, from the equations of the module's docstrings."""
    p = task.parameters[0]
    env = task.environments[i]
    total = 0.0
    worst = -math.inf
    for moment, point in zip(task.moments[0], task.points[i], strict=True):
        speed = log_speed + moment.speed_left * (env.log_speed - log_speed)
        feed = log_feed + moment.feed_left * (env.log_feed - log_feed)
        total += point.metal_value * math.exp(speed + feed)
        if point.cutting == 0.0:
            continue
        rate = math.exp(env.log_life_rate + env.life_speed * speed + env.life_feed * feed)
        total -= point.life_price * rate
        wear = (env.used_life + rate * moment.time) ** p.wear_time
        logs = {}
        for name in ("force", "power"):
            growth = env[f"{name}_growth"]
            term = (1.0 + growth * wear) / (1.0 + growth) if growth else wear
            logs[name] = (
                p[f"log_{name}_coefficient"]
                + env[f"{name}_speed"] * speed
                + env[f"{name}_feed"] * feed
                + env[f"{name}_wear"] * math.log(term)
                + point[f"log_{name}"]
            )
        logs["power"] += max(p.log_base_speed - speed, 0.0)
        for name, log_load in logs.items():
            total -= p.overload_price * expected_excess(log_load, point[f"{name}_spread"])
        if point.unmeasured:
            deviation = (logs["force"] - p.log_strength) / point.strength_spread
            worst = max(worst, deviation)
    points = len(task.points[i])
    risk = env.breakage_price / p.interval * float(norm.cdf(worst))
    return total / points - risk


MIXED = {"unmeasured": np.array([0.0, 1.0, 1.0]), "cutting": np.array([1.0, 1.0, 0.0])}
WORST_FIRST = {"unmeasured": 1.0, "log_force": np.array([0.4, 0.1, 0.2])}
TASKS = pytest.mark.parametrize(
    ("scenario", "of_points"),
    [
        pytest.param(BASE, {}, id="metal"),
        pytest.param(KINKED, {}, id="base speed"),
        pytest.param(FRESH_SHARE, {}, id="fresh edge's share"),
        pytest.param(BASE, {"unmeasured": 1.0}, id="unmeasured bar"),
        pytest.param(BASE, WORST_FIRST, id="the first point is the worst"),
        pytest.param(BASE, MIXED, id="partly in air"),
        pytest.param(BASE, {"cutting": 0.0}, id="air"),
    ],
)


@TASKS
def test_the_gain_of_a_set_point_is_that_by_scipys_normal_distribution(
    scenario: Scenario, of_points: dict[str, Any]
) -> None:
    task = random_task(scenario, seed=2, **of_points)
    for i in range(NUM_ENVS):
        env = task.environments[i]
        for log_speed in (env.log_speed, env.max_log_speed):
            for log_feed in (env.log_feed, env.min_log_feed):
                expected = gain_by_scipy(task, i, log_speed, log_feed)
                found = task.gain(i, log_speed, log_feed)
                assert found == pytest.approx(expected, rel=1e-4, abs=1e-4)


@TASKS
def test_the_slopes_of_the_gain_are_its_differences(
    scenario: Scenario, of_points: dict[str, Any]
) -> None:
    """Within a tiny reach in one direction, the rise is the slope times the reach."""
    reach = 1e-7
    task = random_task(scenario, seed=3, **of_points)
    for i in range(NUM_ENVS):
        env = task.environments[i]
        at = (float(env.log_speed), float(env.log_feed))
        for direction in ("speed", "feed"):
            for name in ("speed", "feed"):
                here = env[f"log_{name}"]
                span = reach if name == direction else 0.0
                env[f"min_log_{name}"] = here - span
                env[f"max_log_{name}"] = here + span
            trial = try_set_point(task.parameters[0], task.moments[0], env, task.points[i], *at)
            step = 1e-5
            moves = (step, 0.0) if direction == "speed" else (0.0, step)
            above = gain_by_scipy(task, i, at[0] + moves[0], at[1] + moves[1])
            below = gain_by_scipy(task, i, at[0] - moves[0], at[1] - moves[1])
            slope = (above - below) / (2.0 * step)
            assert trial.step.rise / reach == pytest.approx(abs(slope), rel=1e-3, abs=1e-3)
            taken = trial.step.log_speed if direction == "speed" else trial.step.log_feed
            if abs(slope) > 1e-3:
                assert math.copysign(1.0, taken) == math.copysign(1.0, slope)


def test_one_record_of_numbers_and_moments_serves_all_environments() -> None:
    task = random_task(BASE, seed=4)
    shared = best_set_points(task)
    each = Task(
        np.tile(task.parameters, NUM_ENVS),
        np.tile(task.moments, (NUM_ENVS, 1)),
        task.environments,
        task.points,
    )
    assert best_set_points(each).tobytes() == shared.tobytes()


def test_a_search_starts_within_reach_and_ends_at_scipys_maximum() -> None:
    task = random_task(BASE, seed=5)
    task.environments["min_log_speed"] += 0.2  # the actual speed is below the reach
    task.environments["max_log_speed"] += 0.2
    best = best_set_points(task)
    for i in range(4):
        env = task.environments[i]
        bounds = [(env.min_log_speed, env.max_log_speed), (env.min_log_feed, env.max_log_feed)]
        middle = [0.5 * (low + high) for low, high in bounds]

        def loss(at: Any, i: int = i) -> float:
            return -gain_by_scipy(task, i, *at)

        expected = minimize(loss, middle, bounds=bounds, method="L-BFGS-B")
        found = task.gain(i, best[i].log_speed, best[i].log_feed)
        assert found >= -expected.fun - 2e-5
        assert bounds[0][0] - 1e-9 <= best[i].log_speed <= bounds[0][1] + 1e-9


@pytest.mark.parametrize(
    ("reach", "speed_first", "feed_first"),
    [
        # H = (2 1; 1 3) and g = (4, 6): the top is at (6 / 5, 8 / 5).
        pytest.param((-9.0, 9.0, -9.0, 9.0), (1.2, 1.6), (1.2, 1.6), id="top within reach"),
        pytest.param((-9.0, 9.0, -9.0, 1.0), (1.2, 1.0), (1.5, 1.0), id="feed out of reach"),
        pytest.param((-9.0, 1.0, -9.0, 9.0), (1.0, 5.0 / 3.0), (1.0, 1.6), id="speed out of reach"),
        pytest.param((2.0, 9.0, 3.0, 9.0), (2.0, 3.0), (2.0, 3.0), id="both out of reach, below"),
    ],
)
def test_a_step_takes_one_direction_first_and_the_best_of_the_other_for_it(
    reach: tuple[float, float, float, float],
    speed_first: tuple[float, float],
    feed_first: tuple[float, float],
) -> None:
    at = (5.0, -1.0)
    env = SimpleNamespace(
        min_log_speed=at[0] + reach[0],
        max_log_speed=at[0] + reach[1],
        min_log_feed=at[1] + reach[2],
        max_log_feed=at[1] + reach[3],
    )
    parabola = Gain(0.0, 4.0, 6.0, 2.0, 1.0, 3.0)
    for step, expected in (
        (step_of_speed_first(env, parabola, *at), speed_first),
        (step_of_feed_first(env, parabola, *at), feed_first),
    ):
        assert (step.log_speed, step.log_feed) == pytest.approx(expected)
        speed, feed = expected
        rise = 4.0 * speed + 6.0 * feed - speed**2 - speed * feed - 1.5 * feed**2
        assert step.rise == pytest.approx(rise)
        assert rise_of(parabola, speed, feed) == pytest.approx(rise)


def test_where_nothing_is_gained_the_command_stays_within_reach() -> None:
    task = random_task(BASE, seed=6, metal_value=0.0, cutting=0.0)
    for name in ("log_speed", "log_feed"):
        actual = task.environments[name]
        task.environments[f"min_{name}"] = actual - np.resize([0.1, -0.2, 0.3], NUM_ENVS)
        task.environments[f"max_{name}"] = actual + np.resize([0.1, 0.3, -0.2], NUM_ENVS)
    best = best_set_points(task)
    moves = np.resize([0.0, 0.2, -0.2], NUM_ENVS)
    assert best["log_speed"] - task.environments["log_speed"] == pytest.approx(moves)
    assert best["log_feed"] - task.environments["log_feed"] == pytest.approx(moves)


@pytest.mark.parametrize("spread", [0.04, 0.01])
def test_steps_that_overshoot_are_shortened_in_both_directions(spread: float) -> None:
    """Far from the top, the parabola is wrong; a search that ended early could still rise."""
    task = random_task(BASE, seed=2, force_spread=spread, power_spread=spread)
    for name in ("log_speed", "log_feed"):
        task.environments[f"min_{name}"] -= 0.5
        task.environments[f"max_{name}"] += 0.5
    best = best_set_points(task)
    for i in range(4):
        env = task.environments[i]
        bounds = [(env.min_log_speed, env.max_log_speed), (env.min_log_feed, env.max_log_feed)]

        def loss(at: Any, i: int = i) -> float:
            return -gain_by_scipy(task, i, *at)

        found = np.array([best[i].log_speed, best[i].log_feed])
        better = minimize(loss, found, bounds=bounds, method="Nelder-Mead")
        assert -better.fun <= task.gain(i, *found) + 2e-3
