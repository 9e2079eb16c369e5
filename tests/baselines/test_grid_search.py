import numpy as np

from baselines.grid_search import GridSearch, RescaledGridSearch
from tests.baselines.observing import seen
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.observation import MAX_RATIO


def observation(**entries: float) -> np.ndarray:
    """An observation in metal, half worn, with measurements as predicted but for ``entries``."""
    middle = dict.fromkeys(("power", "thrust_force", "cutting_speed", "feed", "commanded_cutting_speed", "commanded_feed"), 0.5)
    return seen(**middle | {"cutting_time": 0.5, "nominal_wear": 0.5} | entries)


def removal_rate(policy: GridSearch, observed: np.ndarray, scenario: Scenario) -> float:
    env = RoughTurningVectorEnv(1, scenario)
    env.reset(seed=0)
    _, _, _, _, infos = env.step(policy.act(observed))
    return float(infos["commanded_cutting_speed"][0] * infos["commanded_feed"][0])


def test_rescaling_heeds_measured_force_and_power() -> None:
    scenario = Scenario.load("paper")
    policy = RescaledGridSearch(scenario, 1, margin=1.0, smoothing=0.5)
    nominal = removal_rate(GridSearch(scenario, 1), observation(), scenario)
    assert removal_rate(policy, observation(), scenario) == nominal
    harder = [removal_rate(policy, observation(power_ratio=2.0, force_ratio=2.0), scenario) for _ in range(4)]
    assert nominal > harder[0] > harder[1] > harder[3]
    in_air = observation(cutting=0.0, power_ratio=-5.0, force_ratio=-5.0)
    assert removal_rate(policy, in_air, scenario) == harder[3]


def test_without_any_feasible_pair_the_thrust_force_is_least() -> None:
    scenario = Scenario.load("paper")
    action = RescaledGridSearch(scenario, 1, 0.01, 1.0).act(observation(nominal_wear=MAX_RATIO))
    np.testing.assert_array_equal(action, [[1.0, -1.0]])
