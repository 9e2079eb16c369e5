"""Beliefs are as uncertain as they say, and bounds lie where they must."""

import numpy as np
import pytest

from baselines.oracles import clairvoyant
from baselines.oracles.cells import start_episode_of, survey
from studies import belief_bound, headroom
from turning_env import Scenario
from turning_env.physics.records import block_records
from turning_env.scoring.seeds import tuning_seeds

SCENARIO = Scenario.load("rough_turning")
BARS, CELLS = 40, 94


@pytest.mark.slow
def test_beliefs_are_as_uncertain_as_they_say() -> None:
    states, parameters, scratch = block_records(SCENARIO)
    states["seed"][0, 0] = tuning_seeds(1)[0]
    start_episode_of(states, parameters, scratch)
    fields, between = np.empty((3, BARS * CELLS)), np.empty((3, BARS * 2 * CELLS))
    survey(states, parameters, scratch, fields, CELLS)
    survey(states, parameters, scratch, between, 2 * CELLS)  # a quarter and three quarters along the stretches
    _, beliefs = belief_bound.beliefs(SCENARIO, fields[:2].reshape(2, BARS, CELLS), np.random.default_rng(0))
    depth, hardness = between[:2].reshape(2, BARS, 2 * CELLS)[:, :, 1:-1].reshape(2, BARS, CELLS - 1, 2)
    depth -= np.log(SCENARIO.workpiece.depth_of_cut)
    for law, mean, spread in ((SCENARIO.material.thrust_force, 2, 4), (SCENARIO.material.power, 3, 5)):
        truth = law.depth_of_cut * depth + law.hardness * hardness
        error = (truth - beliefs[mean, :, 1:-1]) / beliefs[spread, :, 1:-1]
        assert abs(error.mean()) < 0.1
        assert 0.9 < error.std() < 1.1
        assert beliefs[spread, :, 5:].mean() < 0.5 * beliefs[spread, :, 0].mean()


@pytest.mark.slow
def test_a_bound_on_beliefs_is_below_the_one_that_knows_the_bars() -> None:
    seeds = tuning_seeds(1)
    knows = clairvoyant.bounds(SCENARIO, seeds, clairvoyant.Grid(10.0, 60, 8))
    believes = np.array([belief_bound.bound(SCENARIO, seed, 10.0, 40) for seed in seeds])
    assert (believes < knows).all()
    assert (believes > knows - 400.0).all()


@pytest.mark.slow
def test_headroom_is_between_the_best_agent_and_the_bounds(capsys: pytest.CaptureFixture[str]) -> None:
    assert headroom.main(["--seeds", "2"]) == 0
    _, first, _, agent, rule = capsys.readouterr().out.splitlines()
    assert first.startswith("clairvoyant bound")
    assert agent.startswith("best agent")
    assert agent.endswith("0.0 (0.0 to 0.0)")
    assert rule.startswith("best rule")
