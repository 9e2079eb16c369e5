"""Laws that hold on every lathe that a scenario can describe."""

import itertools
import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.soundness.acting import SEEDS, action, tried
from tests.soundness.scenarios import scenarios
from tests.turning_env.playing import UNDISTURBED, changed, infos
from turning_env import RoughTurningEnv, Scenario
from turning_env.rendering.fields import Fields

TERMS = ("metal", "time", "edge", "overload", "breakage", "roughness")
FACTORS = st.floats(-1.0, 1.0)
ACTIONS = st.lists(st.tuples(FACTORS, FACTORS), min_size=1, max_size=6)


class Step(NamedTuple):
    """The outcome of a step; the reward of a reset is 0."""

    reward: float
    info: dict[str, Any]


def first_steps(data: st.DataObject, scenario: Scenario, seed: int) -> list[Step]:
    """Return the reset of an episode and its first steps."""
    env = RoughTurningEnv(scenario)
    _, info = env.reset(seed=seed)
    steps = [Step(0.0, info)]
    for chosen in data.draw(st.lists(action(scenario), min_size=1, max_size=8)):
        _, reward, terminated, truncated, info = env.step(chosen)
        steps.append(Step(reward, info))
        if terminated or truncated:
            break
    return steps


def assert_info_adds_up(step: Step, scenario: Scenario) -> None:
    """Assert that the reward is the sum of its terms, and that power, torque and speed agree."""
    info = step.info
    terms = [info[f"reward_{term}"] for term in TERMS]
    largest_term = max(map(abs, terms))
    assert step.reward == pytest.approx(math.fsum(terms), rel=0, abs=1e-12 * largest_term)

    speed = info["spindle_speed"]
    torque = 30_000.0 * info["power"] / (math.pi * speed)
    circumference = math.pi * scenario.workpiece.diameter / 1000.0  # [m]
    assert info["torque"] == pytest.approx(torque, rel=1e-12)
    assert speed == pytest.approx(info["cutting_speed"] / circumference, rel=1e-12)
    assert info["feed_velocity"] == pytest.approx(speed * info["feed"], rel=1e-12)
    assert info["excess"] == info["excess_force"] + info["excess_power"]
    allowed_time = scenario.limits.overload_allowance * info["engaged_time"]
    assert info["cost"] == pytest.approx(info["severe_overload_time"] - allowed_time)
    assert info["removed"] >= 0.0


def assert_no_part_exceeds_its_whole(info: dict[str, Any]) -> None:
    """Assert the order of the times of a step but for rounding."""
    engaged_time = info["engaged_time"]
    moving_time = info["time"] - info["stopped_time"]
    assert 0.0 <= info["severe_overload_time"] <= info["overload_time"]
    assert info["overload_time"] <= engaged_time * (1 + 1e-9)
    assert engaged_time <= moving_time * (1 + 1e-9) + 1e-12 * info["time"]


@pytest.mark.slow
@tried(short=150, soak=15_000)
@given(st.data(), scenarios(), SEEDS)
def test_the_info_of_a_step_adds_up_and_wear_never_falls(
    data: st.DataObject, scenario: Scenario, seed: int
) -> None:
    steps = first_steps(data, scenario, seed)
    for step in steps:
        assert_info_adds_up(step, scenario)
        assert_no_part_exceeds_its_whole(step.info)
    for step in steps[1:]:
        paid = scenario.economics.reference_removal_rate * step.info["reward_metal"] / 60.0
        assert paid == pytest.approx(step.info["removed"], rel=1e-12)
        assert step.info["reward_time"] == -step.info["time"]
    for previous, step in itertools.pairwise(steps):
        before = previous.info
        after = step.info
        engaged_minutes = after["engaged_time"] / 60.0 * (1 - 1e-9)
        same_edge = after["cutting_time"] >= before["cutting_time"] + engaged_minutes
        if scenario.control.edge_changes == "end" or same_edge:
            for name in ("wear", "used_life", "cutting_time"):
                assert after[name] >= before[name], name


@tried(short=50, soak=10_000)
@given(
    SEEDS,
    st.integers(1, 200),
    st.lists(st.tuples(FACTORS, FACTORS), min_size=1, max_size=6),
    st.floats(0, 1),
    st.floats(0, 1),
)
def test_removed_volume_is_the_allowance_over_the_way_cut(
    seed, sub_steps, actions, along, offset
) -> None:
    """Compared with an integral over the bar's own fields, in finer steps."""
    scenario = changed(
        Scenario(),
        workpiece={
            "depth_along_spread": along,
            "depth_bar_spread": offset,
            "bar_length": 1e5,
            "depth_of_cut": 5.0,
        },
        control={"sub_steps": sub_steps},
        tool={"edge_strength": 1e6},
    )
    workpiece = scenario.workpiece
    steps = infos(scenario, actions, seed)
    removed = sum(info["removed"] for info in steps)
    length = max(steps[-1]["path"] - workpiece.approach, 0.0)  # [mm]
    count = 20_000
    places = (np.arange(count) + 0.5) * length / count
    _, depth = Fields(scenario).along((seed, 0), 0, places)
    volume = math.pi * workpiece.diameter * depth.mean() * length / 1000.0  # [cm3]
    # The middle of a sub-step stands for all of it: the error is of second order in its length, 4
    # mm at most here.
    sub_step = length / (sub_steps * len(actions))
    tolerance = 2.0 * along * min(sub_step / workpiece.depth_correlation_length, 1.0)
    assert removed == pytest.approx(volume, rel=1e-6 + tolerance)


STEADY = changed(UNDISTURBED, control={"interval": 6.0}, tool={"wear_criterion": 5.0})
"""A lathe with one metal, one depth and no lags; six seconds of constant speed and feed."""


@tried(short=50, soak=10_000)
@given(FACTORS, FACTORS, FACTORS, st.floats(0.05, 50.0), st.floats(0.0, 10.0))
def test_more_feed_never_removes_less_metal_per_minute(
    speed: float, feed: float, other_feed: float, depth: float, lag: float
) -> None:
    scenario = changed(
        STEADY,
        workpiece={"depth_of_cut": depth},
        machine={"feed_time_constant": lag},
    )
    low_feed, high_feed = sorted((feed, other_feed))
    (slow,) = infos(scenario, [(speed, low_feed)], 3)
    (fast,) = infos(scenario, [(speed, high_feed)], 3)
    slow_rate = slow["removed"] / slow["time"]
    fast_rate = fast["removed"] / fast["time"]
    assert slow_rate <= fast_rate * (1 + 1e-12)


@tried(short=50, soak=10_000)
@given(
    FACTORS,
    FACTORS,
    st.sampled_from(("initial_wear", "hardness_factor")),
    st.floats(0.1, 4.9),
    st.floats(0.1, 4.9),
)
def test_force_and_power_rise_with_wear_and_hardness(
    speed: float, feed: float, quantity: str, value: float, other_value: float
) -> None:
    low, high = sorted((value, other_value))
    action = (speed, feed)
    (less,) = infos(changed(STEADY, mismatch={quantity: low}), [action], 3)
    (more,) = infos(changed(STEADY, mismatch={quantity: high}), [action], 3)
    # Loads that stayed the same would not rise.
    rise = (high / low) ** 0.1 if high > 1.001 * low else 1.0 - 1e-12
    for name in ("thrust_force", "power", "mean_thrust_force", "mean_power", "torque"):
        assert 0.0 < less[name] * rise <= more[name], name


VARIED = changed(
    Scenario(),
    control={"action": "set_point"},
    tool={"edge_strength": 1e6, "wear_criterion": 5.0},
)
"""Bars of varied hardness and depth, air between them, and all lags."""


@tried(short=40, soak=5_000)
@given(
    SEEDS,
    st.lists(st.tuples(FACTORS, FACTORS), min_size=1, max_size=5),
    st.integers(2, 12),
    st.integers(1, 10),
)
def test_energy_impulse_and_used_life_do_not_depend_on_how_time_is_split(
    seed, set_points, pieces, sub_steps
) -> None:
    """Mean power over the time in metal is the work done.

    It adds up over one interval as over its pieces; so does wear.
    """

    def sums(parts: int) -> dict[str, float]:
        """Return what is done if each interval is split into parts of equal length."""
        control = {"interval": 6.0 / parts, "sub_steps": sub_steps * pieces // parts}
        actions = [set_point for set_point in set_points for _ in range(parts)]
        steps = infos(changed(VARIED, control=control), actions, seed)
        return {
            "work": sum(info["mean_power"] * info["engaged_time"] for info in steps),
            "impulse": sum(info["mean_thrust_force"] * info["engaged_time"] for info in steps),
            "engaged_time": sum(info["engaged_time"] for info in steps),
            "removed": sum(info["removed"] for info in steps),
            "used_life": steps[-1]["used_life"],
        }

    assert sums(1) == pytest.approx(sums(pieces), rel=1e-9, abs=1e-9)


@tried(short=20, soak=5_000)
@given(SEEDS, st.lists(st.tuples(FACTORS, FACTORS), min_size=1, max_size=5))
def test_the_mean_over_one_sub_step_is_the_force_and_power_of_its_end(seed, set_points) -> None:
    """So the means are those of force and power themselves, and not only of one another."""
    single = changed(VARIED, control={"interval": 0.5, "sub_steps": 1}, workpiece={"approach": 0.0})
    for info in infos(single, set_points, seed):
        assert info["cutting"]
        assert info["mean_thrust_force"] == pytest.approx(info["thrust_force"], rel=1e-9)
        assert info["mean_power"] == pytest.approx(info["power"], rel=1e-9)
