import numpy as np
import pytest

from baselines.models.part_program import PartProgram
from tests.baselines.observing import observe, override_of
from turning_env import RoughTurningVectorEnv, Scenario, read

OVERRIDE = Scenario.load("override")


def test_what_is_commanded_comes_back_as_the_present_override() -> None:
    env = RoughTurningVectorEnv(5, OVERRIDE)
    observations, _ = env.reset(seed=0)
    program = PartProgram(OVERRIDE, {})
    overrides = np.array([0.01, 0.1, 0.74, 1.28, 2.0])
    observations, *_ = env.step(program.act(read(observations, OVERRIDE), overrides))
    np.testing.assert_allclose(program.override(read(observations, OVERRIDE)), overrides, rtol=1e-5)


def test_an_override_beyond_its_range_is_clipped() -> None:
    program = PartProgram(OVERRIDE, {})
    actions = program.act(read(observe(OVERRIDE, load=[0.0, 0.0]), OVERRIDE), np.array([-1.0, 9.0]))
    np.testing.assert_allclose(override_of(actions, OVERRIDE), [0.01, 2.0], rtol=1e-5)  # 1 % is the machine's lowest feed


@pytest.mark.parametrize("preset", ["rough_turning", "shift"])
def test_a_program_of_its_own_sets_speed_and_feed(preset: str) -> None:
    scenario = Scenario.load(preset)
    env = RoughTurningVectorEnv(1, scenario)
    observations, infos = env.reset(seed=0)
    program = PartProgram(scenario, {"cutting_speed": 160.0, "feed": 0.2})
    for _ in range(4):
        actions = program.act(read(observations, scenario), np.array([1.5]))
        observations, _, _, _, infos = env.step(actions)
    assert infos["commanded_cutting_speed"][0] == pytest.approx(160.0, rel=1e-5)
    assert infos["commanded_feed"][0] == pytest.approx(0.3, rel=1e-5)
    assert infos["edges_used"][0] < 0.5
