"""Beliefs are as uncertain as they say, and bounds lie where they must."""

import numpy as np
import pytest

from baselines.oracles import clairvoyant
from research.studies import belief_bound, headroom
from turning_env import Scenario
from turning_env.scoring.seeds import tuning_seeds

SCENARIO = Scenario.load("rough_turning")
BARS, CELLS = 40, 94


@pytest.mark.slow
def test_a_bound_on_beliefs_is_below_the_one_that_knows_the_bars() -> None:
    seeds = tuning_seeds(1)
    knows = clairvoyant.bounds(SCENARIO, seeds, clairvoyant.Grid(10.0, 60, 8))
    believes = np.array([belief_bound.bound(SCENARIO, seed, 10.0, 40) for seed in seeds])
    assert (believes < knows).all()
    assert (believes > knows - 400.0).all()


@pytest.mark.slow
def test_headroom_is_between_the_best_agent_and_the_bounds(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert headroom.main(["--seeds", "2"]) == 0
    _, first, _, agent, rule = capsys.readouterr().out.splitlines()
    assert first.startswith("clairvoyant bound")
    assert agent.startswith("best agent")
    assert agent.endswith("0.0 (0.0 to 0.0)")
    assert rule.startswith("best rule")
