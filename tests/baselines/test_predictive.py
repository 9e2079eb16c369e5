"""Foresight: gentler into a bar that is not known, and up again."""

import numpy as np
import pytest

from baselines.optimiser import Optimiser
from baselines.predictive import Predictive
from tests.turning_env.playing import changed
from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.scoring.seeds import tuning_seeds

LENGTH = 100.0
ROW = changed(Scenario(), workpiece={"bar_length": LENGTH}, tool={"edge_strength": 1e6})
NUM_ENVS = 16


def trajectory(policy: Optimiser) -> dict[str, np.ndarray]:
    """Position on the bar [mm], feed [mm/rev] and relative excess after the first bar, (steps, environments)."""
    env = RoughTurningVectorEnv(NUM_ENVS, ROW)
    seen, _ = env.reset(seed=tuning_seeds(NUM_ENVS))
    policy.reset(np.ones(NUM_ENVS, np.bool_))
    rows = []
    for _ in range(250):
        seen, _, _, _, infos = env.step(policy.act(seen))
        rows.append({"place": infos["path"] % (LENGTH + 3.0) - 3.0, "feed": infos["feed"], "excess": infos["cost"]})
    return {name: np.array([row[name] for row in rows[30:]]) for name in rows[0]}


@pytest.mark.slow
def test_it_overloads_less_at_entry_and_cuts_the_bar_as_fast() -> None:
    greedy, foreseeing = (trajectory(kind(ROW, NUM_ENVS, severity=2.0, caution=1.0)) for kind in (Optimiser, Predictive))

    def mean(found: dict[str, np.ndarray], name: str, low: float, high: float) -> float:
        return float(found[name][(found["place"] >= low) & (found["place"] < high)].mean())

    assert mean(foreseeing, "excess", 0.0, 8.0) < 0.7 * mean(greedy, "excess", 0.0, 8.0)
    assert mean(foreseeing, "feed", 0.0, 5.0) < mean(greedy, "feed", 0.0, 5.0)
    assert mean(foreseeing, "feed", 20.0, 90.0) > 0.97 * mean(greedy, "feed", 20.0, 90.0)
