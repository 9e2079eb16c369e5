"""The optimiser holds limits and saves the edge."""

import numpy as np

from baselines.optimiser import Optimiser
from tests.baselines.models.test_load_filter import QUIET
from tests.turning_env.playing import changed
from turning_env import RoughTurningVectorEnv, Scenario

TIGHT = changed(QUIET, limits={"power": 4.5})
EXACT = changed(TIGHT, sensors={"force_noise": 0.0, "power_noise": 0.0})


def driven(scenario: Scenario, policy: Optimiser, steps: int) -> list[dict[str, np.ndarray]]:
    env = RoughTurningVectorEnv(2, scenario)
    observations, _ = env.reset(seed=0)
    policy.reset(np.ones(2, np.bool_))
    infos = []
    for _ in range(steps):
        observations, _, _, _, info = env.step(policy.act(observations))
        infos.append(info)
    return infos


def test_on_a_known_bar_it_works_at_a_limit() -> None:
    infos = driven(EXACT, Optimiser(EXACT, 2, 2.0, 1.0), 60)
    loads = np.array([[i["thrust_force"][0] / 1500.0, i["power"][0] / 4.5] for i in infos[15:] if i["cutting"].all()])
    assert loads.max() < 1.02
    assert 0.9 < np.median(loads.max(axis=1)) <= 1.0
