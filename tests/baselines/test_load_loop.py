"""The rules that hold a load target."""

import numpy as np
import pytest

from baselines.catalogue import spec
from baselines.load_loop import TUNED_ON_JOBS, JobLoop, LoadLoop, LoopNumbers
from leaderboard.play import play, play_family
from tests.turning_env.playing import NO_SPREAD
from turning_env import Family, RoughTurningEnv, Scenario

STEADY = Scenario.load(
    {
        "workpiece": NO_SPREAD | {"bar_length": 5000.0},
        "sensors": {"power_noise": 0.0, "force_noise": 0.0},
        "tool": {"edge_strength": 1e6, "wear_factor_spread": 0.0},
        "control": {"edge_changes": "commanded"},
    }
)
"""One long bar of one metal, measured without noise."""


def played(scenario, policy, steps):
    """Return the infos of some steps of a policy of one environment."""
    env = RoughTurningEnv(scenario)
    observation, _ = env.reset(seed=0)
    policy.reset(np.ones(1, bool))
    infos = []
    for _ in range(steps):
        observation, *_, info = env.step(policy.act(observation[np.newaxis])[0])
        infos.append(info)
    return infos


def changed_numbers(**values):
    """Return the numbers of a loop that only holds a load, with some of them changed."""
    neutral = dict.fromkeys(LoopNumbers._fields, 0.0)
    return LoopNumbers(**(neutral | {"gain_up": 0.5, "gain_down": 0.8} | values))


def highest_load(info):
    """Return the higher of force and power over their limits of 1500 N and 7 kW."""
    return max(info["thrust_force"] / 1500.0, info["power"] / 7.0)


def test_the_loop_holds_its_target_at_a_speed_relative_to_the_nominal_optimum():
    scenario = STEADY.model_copy(
        update={"control": STEADY.control.model_copy(update={"edge_changes": "end"})}
    )
    numbers = changed_numbers(target=np.log(0.8), speed=np.log(0.75))
    info = played(scenario, LoadLoop(scenario, 1, numbers), steps=40)[-1]
    assert highest_load(info) == pytest.approx(0.8, rel=0.02)
    faster = changed_numbers(target=np.log(0.8), speed=np.log(0.75 * 1.1))
    info_when_faster = played(scenario, LoadLoop(scenario, 1, faster), steps=40)[-1]
    ratio = info_when_faster["commanded_cutting_speed"] / info["commanded_cutting_speed"]
    assert ratio == pytest.approx(1.1)


@pytest.mark.slow
def test_edges_are_changed_at_the_wear_that_the_edges_before_showed():
    """Edges that wear 1.25 times as fast as the nominal model says are soon changed in time."""
    values = STEADY.model_dump()
    values["mismatch"]["wear_factor"] = 1.25
    values["sensors"]["inspects_edges"] = True
    scenario = Scenario.model_validate(values)
    numbers = TUNED_ON_JOBS._replace(
        change_at=0.8, change_by_price=0.0, learning=1.0, speed_by_learned=0.0
    )
    infos = played(scenario, JobLoop(scenario.nominal(), 1, numbers), steps=1500)
    wear = np.array([info["wear"] / 0.3 for info in infos])
    cutting_time = np.array([info["cutting_time"] for info in infos])
    # The wear of the edges that are replaced in the next step.
    replaced = wear[:-1][np.diff(cutting_time) < 0.0]
    assert len(replaced) >= 3
    assert replaced[0] == pytest.approx(1.0, abs=0.03)
    np.testing.assert_allclose(replaced[1:], 0.8, atol=0.03)


def test_where_power_binds_above_the_base_speed_the_speed_falls_instead_of_the_feed():
    values = STEADY.model_dump()
    values["spindle"]["base_speed"] = 200.0  # 63 m/min
    values["limits"] |= {"power": 2.0, "thrust_force": 1e4}
    scenario = Scenario.model_validate(values)
    numbers = TUNED_ON_JOBS._replace(speed=0.7, lowest_feed=0.0, brake=0.3, target=-0.1)
    policy = JobLoop(scenario, 1, numbers)
    infos = played(scenario, policy, steps=120)
    without_brake = JobLoop(scenario, 1, numbers._replace(brake=0.0))
    unbraked = played(scenario, without_brake, steps=120)
    assert infos[-1]["cutting_speed"] < 0.9 * unbraked[-1]["cutting_speed"]
    assert infos[-1]["power"] < 2.0 < unbraked[-1]["power"]


@pytest.mark.slow
def test_on_training_jobs_of_shop_it_returns_far_more_than_the_nominal_optimum_within_limits():
    family = Family.load("shop")
    seeds = list(range(4))
    models = [family.job(seed).scenario.nominal() for seed in seeds]
    loop = spec("load_loop_jobs", models)
    episodes = play_family(family, "train", seeds, loop.make, context="hidden")
    severe = episodes["severe_overload_time"].sum() / episodes["engaged_time"].sum()
    assert severe < 0.05
    assert episodes["return"].mean() > -1500.0


@pytest.mark.slow
def test_on_one_edge_it_returns_more_than_any_fixed_speed_and_feed():
    scenario = Scenario.load("rough_turning")
    seeds = list(range(8))
    loop = play(spec("load_loop", scenario).make, scenario, seeds)
    fixed = play(spec("fixed_tuned", scenario).make, scenario, seeds)
    assert loop["return"].mean() > fixed["return"].mean() + 200.0
