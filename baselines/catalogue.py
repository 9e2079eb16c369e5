"""Every rule-based controller by name, ready to play a scenario."""

from collections.abc import Callable
from dataclasses import dataclass

from baselines import tuned
from baselines.fixed import HANDBOOK_CUTTING_SPEED, HANDBOOK_FEED, FixedParameters
from baselines.grid_search import GridSearch, RescaledGridSearch
from baselines.policy import Policy, PolicyFactory
from turning_env import Scenario

Parameters = dict[str, float]


@dataclass(frozen=True)
class Rule:
    """A kind of controller."""

    description: str
    build: Callable[[Scenario, int, Parameters], Policy]
    """Makes the policy for a scenario, a number of lanes and its parameters."""
    fixed_parameters: Parameters | None = None
    """Its parameters, or None where they are tuned."""


RULES: dict[str, Rule] = {
    "fixed_handbook": Rule(
        "one handbook speed and feed for the edge's whole life",
        lambda scenario, lanes, p: FixedParameters(scenario, p["cutting_speed"], p["feed"]),
        {"cutting_speed": HANDBOOK_CUTTING_SPEED, "feed": HANDBOOK_FEED},
    ),
    "fixed_tuned": Rule(
        "the best one speed and feed, found on tuning draws",
        lambda scenario, lanes, p: FixedParameters(scenario, p["cutting_speed"], p["feed"]),
    ),
    "grid_search": Rule(
        "the grid search of Alaskari and Oraby (2018) on nominal models",
        lambda scenario, lanes, p: GridSearch(scenario, lanes),
        {},
    ),
    "rescaled_grid_search": Rule(
        "the grid search on models rescaled by measured force and power, with a margin, both tuned on tuning draws",
        lambda scenario, lanes, p: RescaledGridSearch(scenario, lanes, p["margin"], p["smoothing"]),
    ),
}


@dataclass(frozen=True)
class Entry:
    """A controller with its parameters for one scenario."""

    name: str
    description: str
    parameters: Parameters
    make: PolicyFactory


def names(scenario: Scenario) -> list[str]:
    """Names of the controllers that can play a scenario."""
    return list(RULES)


def entry(name: str, scenario: Scenario) -> Entry:
    """A controller, with its tuned parameters where it has any.

    Raises:
        KeyError: there is no controller of this name; names those there are.
        NotTuned: it has not been tuned for this scenario.
    """
    if name not in RULES:
        raise KeyError(f"no controller is called {name!r}; there are {', '.join(RULES)}")
    rule = RULES[name]
    parameters = tuned.parameters(scenario)[name] if rule.fixed_parameters is None else rule.fixed_parameters
    return Entry(name, rule.description, parameters, lambda lanes: rule.build(scenario, lanes, parameters))
