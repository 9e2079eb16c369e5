"""Add edge changes on command to rules that only set speed and feed.

As in the tool-life management of CNC controls, the edge is changed when the nominal wear reaches a share of the criterion. The
share is tuned, because inserts wear faster or slower than nominal, and an edge that wears out without a command costs more time.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from baselines.rule import Parameters, Range, Rule
from turning_env import Scenario, read
from turning_env.scoring.policy import Actions, Observations, Policy

CHANGE_AT = "change_at"
"""Name of the parameter: nominal wear over the wear criterion at which the edge is changed [-]."""


class TimelyChanges:
    """A policy that adds edge changes at a nominal wear to another policy's cutting speed and feed.

    Args:
        policy: policy that sets cutting speed and feed.
        scenario: task.
        change_at: nominal wear over the criterion at which the edge is changed [-].
    """

    def __init__(self, policy: Policy, scenario: Scenario, change_at: float) -> None:
        self._policy, self._scenario = policy, scenario
        self._wear = change_at * scenario.tool.wear_criterion

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Reset the policy."""
        self._policy.reset(mask)

    def act(self, observations: Observations) -> Actions:
        """Return the policy's actions, with the edge change in the last column."""
        actions = self._policy.act(observations).copy()
        actions[:, -1] = np.where(read(observations, self._scenario).nominal_wear >= self._wear, 1.0, -1.0)
        return actions


def as_played(rule: Rule, scenario: Scenario) -> Rule:
    """Return the rule for a scenario, with timely edge changes if the scenario takes such commands and the rule gives none."""
    if scenario.control.edge_changes != "commanded" or rule.changes_edges:
        return rule

    def build(scenario: Scenario, num_envs: int, parameters: Parameters) -> TimelyChanges:
        own = {name: value for name, value in parameters.items() if name != CHANGE_AT}
        return TimelyChanges(rule.build(scenario, num_envs, own), scenario, parameters[CHANGE_AT])

    return replace(rule, build=build, parameters={**rule.parameters, CHANGE_AT: Range(0.5, 1.3)})
