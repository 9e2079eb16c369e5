"""Laws that hold on every lathe that a scenario can describe."""

import itertools
import math
from typing import Any

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


def intervals(
    data: st.DataObject, scenario: Scenario, seed: int
) -> list[tuple[float, dict[str, Any]]]:
    """Reward and info of a few intervals of one episode, the reset's first."""
    env = RoughTurningEnv(scenario)
    told: list[tuple[float, dict[str, Any]]] = [(0.0, env.reset(seed=seed)[1])]
    for chosen in data.draw(st.lists(action(scenario), min_size=1, max_size=8)):
        _, reward, terminated, truncated, info = env.step(chosen)
        told.append((reward, info))
        if terminated or truncated:
            break
    return told


@pytest.mark.slow
@tried(short=150, soak=15_000)
@given(st.data(), scenarios(), SEEDS)
def test_the_info_of_a_step_adds_up_and_wear_never_falls(
    data: st.DataObject, scenario: Scenario, seed: int
) -> None:
    """The reward is the sum of its terms; power, torque and speed agree.

    No share is more than its whole.
    """
    told = intervals(data, scenario, seed)
    for number, (reward, info) in enumerate(told):
        terms = [info[f"reward_{term}"] for term in TERMS]
        assert reward == pytest.approx(math.fsum(terms), rel=0, abs=1e-12 * max(map(abs, terms)))
        speed = info["spindle_speed"]
        assert info["torque"] == pytest.approx(
            30_000.0 * info["power"] / (math.pi * speed), rel=1e-12
        )
        assert speed == pytest.approx(
            1000.0 * info["cutting_speed"] / (math.pi * scenario.workpiece.diameter), rel=1e-12
        )
        assert info["feed_velocity"] == pytest.approx(speed * info["feed"], rel=1e-12)
        assert info["cost"] == info["cost_force"] + info["cost_power"]
        assert (
            0.0
            <= info["severe_overload_time"]
            <= info["overload_time"]
            <= info["engaged_time"] * (1 + 1e-9)
        )
        assert (
            info["engaged_time"]
            <= (info["time"] - info["stopped_time"]) * (1 + 1e-9) + 1e-12 * info["time"]
        )
        assert info["removed"] >= 0.0
        if number > 0:
            paid = scenario.economics.reference_removal_rate * info["reward_metal"] / 60.0
            assert paid == pytest.approx(info["removed"], rel=1e-12)
            assert info["reward_time"] == -info["time"]
    for (_, before), (_, after) in itertools.pairwise(told):
        cut = after["engaged_time"] / 60.0 * (1 - 1e-9)
        if (
            scenario.control.edge_changes == "end"
            or after["cutting_time"] >= before["cutting_time"] + cut
        ):
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
    told = infos(scenario, actions, seed)
    removed, cut = (
        sum(info["removed"] for info in told),
        max(told[-1]["path"] - scenario.workpiece.approach, 0.0),
    )
    steps = 20_000
    places = (np.arange(steps) + 0.5) * cut / steps
    _, depth = Fields(scenario).along((seed, 0), 0, places)
    volume = math.pi * scenario.workpiece.diameter * depth.mean() * cut / 1000.0  # [cm3]
    # The middle of a sub-step stands for all of it: the error is of second order in its length, 4
    # mm at most here.
    correlated = scenario.workpiece.depth_correlation_length
    step = cut / (sub_steps * len(actions))
    assert removed == pytest.approx(volume, rel=1e-6 + 2.0 * along * min(step / correlated, 1.0))


STEADY = changed(UNDISTURBED, control={"interval": 6.0}, tool={"wear_criterion": 5.0})
"""A lathe with one metal, one depth and no lags; six seconds of constant speed and feed."""


@tried(short=50, soak=10_000)
@given(FACTORS, FACTORS, FACTORS, st.floats(0.05, 50.0), st.floats(0.0, 10.0))
def test_more_feed_never_removes_less_metal_per_minute(
    speed: float, one: float, other: float, depth: float, lag: float
) -> None:
    scenario = changed(
        STEADY, workpiece={"depth_of_cut": depth}, machine={"feed_time_constant": lag}
    )
    rates = [infos(scenario, [(speed, feed)], 3)[0] for feed in sorted((one, other))]
    less, more = (info["removed"] / info["time"] for info in rates)
    assert less <= more * (1 + 1e-12)


@tried(short=50, soak=10_000)
@given(
    FACTORS,
    FACTORS,
    st.sampled_from(("initial_wear", "hardness_factor")),
    st.floats(0.1, 4.9),
    st.floats(0.1, 4.9),
)
def test_force_and_power_rise_with_wear_and_hardness(
    speed: float, feed: float, what: str, one: float, other: float
) -> None:
    told = [
        infos(changed(STEADY, mismatch={what: value}), [(speed, feed)], 3)[0]
        for value in sorted((one, other))
    ]
    less, more = told
    for name in ("thrust_force", "power", "mean_thrust_force", "mean_power", "torque"):
        assert 0.0 < less[name] <= more[name] * (1 + 1e-12), name


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
    done = []
    for parts in (1, pieces):
        control = {"interval": 6.0 / parts, "sub_steps": sub_steps * pieces // parts}
        told = infos(
            changed(VARIED, control=control),
            [chosen for chosen in set_points for _ in range(parts)],
            seed,
        )
        work = sum(info["mean_power"] * info["engaged_time"] for info in told)
        impulse = sum(info["mean_thrust_force"] * info["engaged_time"] for info in told)
        sums = [sum(info[name] for info in told) for name in ("engaged_time", "removed")]
        done.append((work, impulse, *sums, told[-1]["used_life"]))
    assert done[0] == pytest.approx(done[1], rel=1e-9, abs=1e-9)
