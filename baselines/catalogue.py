"""Every rule-based controller by name, ready to play a scenario."""

from collections.abc import Iterable
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType

from baselines import tuned
from baselines.models.edge_changes import as_played
from baselines.rule import Parameters, Rule
from turning_env import Scenario
from turning_env.score.policy import PolicyFactory


def merged(modules: Iterable[ModuleType]) -> dict[str, Rule]:
    """The rules of all modules, each of which declares its own as ``RULES``.

    Raises:
        ValueError: two modules declare a rule of the same name.
    """
    rules: dict[str, Rule] = {}
    for module in modules:
        if twice := rules.keys() & module.RULES.keys():
            raise ValueError(f"{module.__name__} declares {', '.join(sorted(twice))}, as a module before it does")
        rules |= module.RULES
    return rules


FILES = (
    "fixed",
    "grid_search",
    "two_limits",
    "fuzzy_override",
    "load_override",
    "tmac",
    "omative",
    "constant_force",
    "current_limit",
    "optimiser",
    "predictive",
    "part_planning",
)
"""Files that declare rules. A new one is added here."""

RULES = merged(import_module(f"baselines.{name}") for name in FILES)
"""All rules by name."""


@dataclass(frozen=True)
class Entry:
    """A controller with its parameters for one scenario."""

    name: str
    description: str
    parameters: Parameters
    make: PolicyFactory


def names(scenario: Scenario) -> list[str]:
    """Names of the controllers that can play a scenario."""
    return [name for name, rule in RULES.items() if rule.plays(scenario)]


def playable(name: str, scenario: Scenario) -> Rule:
    """The rule of a name, as it plays a scenario.

    Raises:
        KeyError: there is no controller of this name; names those there are.
        ValueError: it cannot play the scenario.
    """
    if name not in RULES:
        raise KeyError(f"no controller is called {name!r}; there are {', '.join(RULES)}")
    rule = RULES[name]
    if not rule.plays(scenario):
        raise ValueError(f"{name} cannot play scenario {scenario.name!r}, which lacks actions, inputs or models that it needs")
    return as_played(rule, scenario)


def entry(name: str, scenario: Scenario, tuned_on: Scenario | None = None) -> Entry:
    """A controller, built with what is told of a scenario, with its tuned parameters where it has any.

    Args:
        name: the controller's.
        scenario: what it is to play.
        tuned_on: the scenario whose tuned parameters it plays with; without, that which it plays.

    Raises:
        KeyError: there is no controller of this name; names those there are.
        ValueError: it cannot play the scenario.
        NotTuned: it has not been tuned on that scenario, or not with the parameters that it has now.
    """
    told = scenario.nominal()
    rule = playable(name, told)
    parameters = rule.fixed | (tuned.setting(name, rule, (tuned_on or scenario).nominal()) if rule.ranges else {})
    return Entry(name, rule.description, parameters, lambda num_envs: rule.build(told, num_envs, parameters))
