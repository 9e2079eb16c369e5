"""The exact filter is calibrated, the planner sees only what it is told, and the bound lies where it must."""

import numpy as np
import pytest

from baselines.oracles import clairvoyant
from baselines.oracles.cells import start_episode_of, survey
from studies import belief_bound, headroom
from studies.exact_filter import HIDDEN
from turning_env import Scenario
from turning_env.physics.records import STATE, new_records, scratch_records
from turning_env.scoring.seeds import tuning_seeds

SCENARIO = Scenario.load("rough_turning")
BARS, CELLS = 40, 94


@pytest.mark.slow
def test_beliefs_are_as_uncertain_as_they_say() -> None:
    scratch, states = scratch_records(SCENARIO), new_records(STATE, 1)
    states["seed"][0, 0] = tuning_seeds(1)[0]
    start_episode_of(states, scratch)
    fields = np.empty((3, BARS * CELLS))
    survey(states, scratch, fields, CELLS)
    between = np.empty((3, BARS * 2 * CELLS))  # a quarter and three quarters along the stretches
    survey(states, scratch, between, 2 * CELLS)
    _, beliefs = belief_bound._beliefs(SCENARIO, fields, BARS, np.random.default_rng(0))
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


def test_the_planner_acts_on_what_it_is_told() -> None:
    short = SCENARIO.model_copy(update={"control": SCENARIO.control.model_copy(update={"time_limit": 0.2})})
    seeds = tuning_seeds(2)
    played = {told: headroom.planned(short, seeds, *told) for told in ((), tuple(HIDDEN))}
    assert (played[()] != played[tuple(HIDDEN)]).all()
    assert headroom.without_lags(short).machine.feed_time_constant == 0.0


@pytest.mark.slow
def test_shipped_rows_are_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert headroom.main(["--seeds", "2", "--rows", "clairvoyant", "agent"]) == 0
    _, above, same = capsys.readouterr().out.splitlines()
    assert above.startswith("clairvoyant bound")
    assert same.split("  ")[-1] == "0.0 (0.0 to 0.0)"
