import numpy as np
import pytest

from baselines.load_override import LOWEST_OVERRIDE, RULES, constant_load, towards_load
from baselines.models.part_program import PartProgram
from papers.stepped_bar import play_bar, stepped_bar
from tests.baselines.observing import observe, override_of
from turning_env import RoughTurningVectorEnv, Scenario

OVERRIDE = Scenario.load("override")


def test_the_integrating_law() -> None:
    overrides, loads = np.array([1.0, 1.0, 0.5, 2.0, 0.02]), np.array([0.6, 0.3, 0.9, 0.0, 9.0])
    np.testing.assert_allclose(towards_load(overrides, loads, 0.6, 0.2), [1.0, 1.1, 0.45, 2.4, LOWEST_OVERRIDE])


def test_the_load_is_held_at_the_target_at_2_and_at_3_mm() -> None:
    scenario, target = stepped_bar(), 0.8
    run = play_bar(lambda num_envs: constant_load(PartProgram(scenario, {}), num_envs, target, 5.0), scenario)
    for depth in (2.0, 3.0):
        np.testing.assert_allclose(run.at_depth(depth, 2.0).load, 0.6 * target, rtol=0.01)
    assert run.at_depth(1.0, 1.0).override.min() > 1.99


@pytest.mark.parametrize(
    ("load", "override"), [(0.0, 1.2), (0.2, 1.2), (0.25, 1.1), (0.6, 0.4), (0.79, 0.02), (0.8, 0.01), (3.0, 0.01)]
)
def test_160_minus_2_load(load: float, override: float) -> None:
    policy = RULES["one_line_law"].build(OVERRIDE, 1, {})
    assert override_of(policy.act(observe(OVERRIDE, load=load)), OVERRIDE)[0] == pytest.approx(override, rel=1e-3)


@pytest.mark.parametrize("preset", ["override", "surface", "rough_turning"])
def test_the_programmed_feed_is_what_an_episode_starts_with(preset: str) -> None:
    env = RoughTurningVectorEnv(2, preset)
    observations, start = env.reset(seed=1)
    policy = RULES["programmed_feed"].build(env.scenario, 2, {})
    for _ in range(5):
        observations, _, _, _, infos = env.step(policy.act(observations))
    for name in ("commanded_feed", "commanded_cutting_speed"):
        np.testing.assert_allclose(infos[name], start[name], rtol=1e-5)
