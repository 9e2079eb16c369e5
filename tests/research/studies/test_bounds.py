"""Bounds lie between the best policies and the bounds of those that know more."""

import numpy as np
import pytest

from baselines.oracles import clairvoyant
from leaderboard.seeds import tuning_seeds
from research.studies import belief_bound, headroom
from turning_env import Scenario

SCENARIO = Scenario.load("rough_turning")


@pytest.mark.slow
def test_the_bound_on_beliefs_is_below_the_clairvoyant_bound() -> None:
    seeds = tuning_seeds(1)
    grid = clairvoyant.StateGrid(cell=10.0, lives=60, speeds=8)
    clairvoyant_bounds = clairvoyant.bounds(SCENARIO, seeds, grid)
    belief_bounds = np.array([belief_bound.bound(SCENARIO, seed, 10.0, 40) for seed in seeds])
    assert len(belief_bounds) == 1
    assert (belief_bounds < clairvoyant_bounds).all()
    assert (belief_bounds > clairvoyant_bounds - 400.0).all()


@pytest.mark.slow
def test_headroom_is_between_the_best_agent_and_the_bounds(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert headroom.main(["--seeds", "1"]) == 0
    _, first, _, agent, rule = capsys.readouterr().out.splitlines()
    assert first.startswith("clairvoyant bound")
    assert agent.startswith("best agent")
    assert agent.endswith("0.0 (0.0 to 0.0)")
    assert rule.startswith("best rule")
