"""When to change the edge: what a rule that only thinks of speed and feed lacks where edges are changed on command.

As tool life management on controls does it: the edge is changed when the wear that the nominal model predicts reaches a share of
the criterion. The share is tuned: inserts wear more or less than the nominal, and one that is found worn out costs more time.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from baselines.rule import Parameters, Range, Rule
from turning_env import Scenario, read
from turning_env.score.policy import Actions, Observations, Policy

CHANGE_AT = "change_at"
"""The parameter: share of the wear criterion [-]."""


class TimelyChanges:
    """Another policy's cutting speed and feed, and the edge changed in time.

    Args:
        policy: decides cutting speed and feed.
        scenario: what is played.
        change_at: nominal wear over the criterion at which the edge is changed [-].
    """

    def __init__(self, policy: Policy, scenario: Scenario, change_at: float) -> None:
        self._policy, self._scenario = policy, scenario
        self._wear = change_at * scenario.tool.wear_criterion

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Have the policy forget these lanes."""
        self._policy.reset(mask)

    def act(self, observations: Observations) -> Actions:
        """The policy's actions, and in the last column whether the edge is changed."""
        actions = self._policy.act(observations).copy()
        actions[:, -1] = np.where(read(observations, self._scenario).nominal_wear >= self._wear, 1.0, -1.0)
        return actions


def timely(rule: Rule) -> Rule:
    """The rule with its edges changed in time, and one parameter more."""

    def build(scenario: Scenario, num_envs: int, parameters: Parameters) -> TimelyChanges:
        own = {name: value for name, value in parameters.items() if name != CHANGE_AT}
        return TimelyChanges(rule.build(scenario, num_envs, own), scenario, parameters[CHANGE_AT])

    return replace(rule, build=build, parameters={**rule.parameters, CHANGE_AT: Range(0.5, 1.3)})


def as_played(rule: Rule, scenario: Scenario) -> Rule:
    """The rule as it plays a scenario: where edges are changed on command and it does not do so itself, with timely changes."""
    return timely(rule) if scenario.control.edge_changes == "commanded" and not rule.changes_edges else rule
