"""All rule-based controllers by name, and their edge changes, if a task commands them."""

from collections.abc import Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any

import numpy as np

from baselines import tuned
from baselines.policy_spec import PolicySpec, ScenarioId
from baselines.rule import Mask, Parameters, Rule, TuningRange
from turning_env import Scenario, read
from turning_env.policy import Actions, Observations, Policy
from turning_env.scenario.section import names_instead

_FILES = (  # files that declare rules; a new one is added here
    "trivial",
    "fixed",
    "grid_search",
    "two_limits",
    "fuzzy_override",
    "load_override",
    "load_loop",
    "constant_force",
    "lead_control",
    "current_limit",
    "optimiser",
    "predictive",
    "self_tuning",
    "reactive",
    "part_planning",
)
RULES: dict[str, Rule] = {}  # all rules by name
for _file in _FILES:
    RULES |= import_module(f"baselines.{_file}").RULES

CHANGE_AT = "change_at"
"""Parameter of rules that change no edges: nominal wear over the criterion at the change [-]."""
CHANGE_RANGE = TuningRange(0.5, 1.3)  # within which it is tuned


class TimelyChanges(Policy):
    """A policy that adds edge changes at a nominal wear, as tool-life management does.

    Args:
        policy: the policy that sets cutting speed and feed.
        scenario: nominal model.
        change_at: wear at the change over the criterion [-]. It is tuned: inserts wear faster or
            slower than nominal, and an edge that wears out without a command costs more time.
    """

    def __init__(self, policy: Policy, scenario: Scenario, change_at: float) -> None:
        self._policy = policy
        self._scenario = scenario
        self._wear = change_at * scenario.tool.wear_criterion

    def reset(self, mask: Mask) -> None:
        self._policy.reset(mask)

    def act(self, observations: Observations) -> Actions:
        actions = self._policy.act(observations).copy()
        nominal_wear = read(observations, self._scenario).nominal_wear
        actions[:, -1] = np.where(nominal_wear >= self._wear, 1.0, -1.0)
        return actions


def names(scenario: Scenario) -> list[str]:
    """Return the names of the controllers that can play a scenario."""
    return [name for name, rule in RULES.items() if rule.plays(scenario)]


def playable(name: str, scenario: Scenario) -> Rule:
    """Return the rule of a name as it plays a scenario, perhaps with timely edge changes.

    Raises:
        KeyError: there is no controller of this name.
        ValueError: it cannot play the scenario.
    """
    if name not in RULES:
        instead = names_instead(name, RULES, max_listed=len(RULES))
        raise KeyError(f"no controller is called {name!r}; {instead}")
    rule = RULES[name]
    if not rule.plays(scenario):
        raise ValueError(
            f"{name} cannot play scenario {scenario.name!r}, "
            "which lacks actions, inputs or models that it needs"
        )
    if scenario.control.edge_changes != "commanded" or rule.changes_edges:
        return rule

    def build(
        scenario: Scenario, num_envs: int, change_at: float, **parameters: float
    ) -> TimelyChanges:
        policy = rule.controller(scenario, num_envs, **parameters)
        return TimelyChanges(policy, scenario, change_at=change_at)

    parameters = {**rule.parameters, CHANGE_AT: CHANGE_RANGE}
    return replace(rule, controller=build, parameters=parameters)


def spec(
    name: str,
    scenario: Scenario | Sequence[Scenario],
    tuned_on: Scenario | None = None,
) -> PolicySpec:
    """Return a controller built with a scenario's nominal model and its tuned parameters, if any.

    Args:
        name: name of the controller.
        scenario: one to play, or one for each environment if the rule plays them ``together``.
        tuned_on: scenario on which its parameters were tuned; None: the one that it plays, or the
            first.

    Raises:
        KeyError: there is no controller of this name.
        NotTuned: it has not been tuned on that scenario, in this version and these parameters.
        ValueError: it cannot play the scenario, or a file of tuned parameters is damaged.
    """
    nominal: Any
    if isinstance(scenario, Scenario):
        first = scenario
        nominal = scenario.nominal()
    else:
        first = scenario[0]
        nominal = [model.nominal() for model in scenario]
    rule = playable(name, first.nominal())
    if isinstance(nominal, list) and not rule.together:
        raise ValueError(f"{name} plays one scenario at a time, got {len(nominal)}")
    tuned_parameters: Parameters = {}
    command = None
    if rule.ranges:
        tuned_parameters, command = tuned.setting(name, rule, (tuned_on or first).nominal())
    parameters = rule.fixed | tuned_parameters
    return PolicySpec(
        name=name,
        version=rule.version,
        description=rule.description,
        parameters=dict(parameters),
        command=command,
        tuned_for=None if tuned_on is None else ScenarioId.of(tuned_on),
        make=lambda num_envs: rule.controller(nominal, num_envs, **parameters),
    )
