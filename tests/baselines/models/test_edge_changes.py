"""Edges changed in time."""

import numpy as np
import pytest

from baselines.fixed import FixedParameters
from baselines.models.edge_changes import CHANGE_AT, TimelyChanges, as_played
from baselines.rule import Range, Rule
from tests.turning_env.playing import changed
from turning_env import RoughTurningEnv, Scenario, read

SHIFT = changed(Scenario.load("shift"), control={"time_limit": 90.0})
RULE = Rule("fixed", lambda scenario, num_envs, p: FixedParameters(scenario, 150.0, 0.3), lambda scenario: True, {"margin": 1.0})


@pytest.mark.slow
def test_the_edge_is_changed_when_the_nominal_wear_says_so():
    change_at = 0.7
    env = RoughTurningEnv(changed(SHIFT, tool={"wear_factor_spread": 0.0, "edge_strength": 1e6}))
    policy = TimelyChanges(FixedParameters(env.scenario, 180.0, 0.3), env.scenario, change_at)
    observation, _ = env.reset(seed=0)
    policy.reset(np.ones(1, np.bool_))
    worn, stops = [], []
    ended = False
    while not ended:
        worn.append(read(observation[np.newaxis], env.scenario).nominal_wear[0])
        observation, _, _, ended, info = env.step(policy.act(observation[np.newaxis])[0])
        stops.append(info["stopped_time"])
    stopped = np.flatnonzero(stops)
    assert len(stopped) > 1
    assert np.array(stops)[stopped][:-1] == pytest.approx(60 * SHIFT.economics.edge_change_time)
    assert np.array(worn)[stopped] == pytest.approx(change_at * SHIFT.tool.wear_criterion, rel=0.01)


def test_only_shifts_and_only_rules_that_do_not_change_edges_get_the_parameter():
    assert as_played(RULE, Scenario()) is RULE
    assert as_played(RULE, SHIFT).parameters.keys() == {"margin", CHANGE_AT}
    assert isinstance(as_played(RULE, SHIFT).parameters[CHANGE_AT], Range)
    itself = Rule(RULE.description, RULE.build, RULE.plays, RULE.parameters, changes_edges=True)
    assert as_played(itself, SHIFT) is itself
