"""What the tunable rules were tuned to, kept as data: one JSON file per scenario's name."""

import json
from itertools import chain
from pathlib import Path
from typing import Any

from baselines.rule import Parameters, Rule
from turning_env import Scenario

FOLDER = Path(__file__).parent / "tuned"
_COMMAND = "python -m baselines.tune --scenario PRESET_OR_TOML"


class NotTuned(ValueError):
    """A rule has not been tuned for this scenario."""


def path(scenario: Scenario) -> Path:
    """The file of a scenario's tuned parameters."""
    return FOLDER / f"{scenario.name}.json"


def contents(scenario: Scenario) -> dict[str, Any]:
    """All that the scenario's file says; nothing where there is no file.

    Raises:
        NotTuned: the file cannot be understood.
    """
    try:
        return _read(path(scenario))
    except FileNotFoundError:
        return {}


def _read(file: Path) -> dict[str, Any]:
    try:
        values: dict[str, Any] = json.loads(file.read_text("utf-8"))
        for rule in values["rules"].values():
            dict(rule["parameters"])
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise NotTuned(f"{file} holds no tuned parameters ({error!r}): delete it and run `{_COMMAND}`") from error
    return values


def parameters(scenario: Scenario) -> dict[str, Parameters]:
    """Tuned parameters by rule and name, of the rules that have been tuned for this scenario by whatever name.

    Raises:
        NotTuned: there are none for this scenario; says which command makes them.
    """
    own = contents(scenario)
    others = map(_read, sorted(FOLDER.glob("*.json")))
    for values in chain([own], others):
        if values.get("scenario_digest") == scenario.digest():
            return {name: rule["parameters"] for name, rule in values["rules"].items()}
    found = "were tuned for other values" if own else "have not been tuned"
    raise NotTuned(f"the rules of scenario {scenario.name!r} {found}: run `{_COMMAND}`")


def setting(name: str, rule: Rule, scenario: Scenario) -> Parameters:
    """Tuned parameters of one rule for a scenario, which are those of another if that is the only one that it is tuned on.

    Raises:
        NotTuned: there are none for this scenario, or they are not those that the rule has; says which command makes them.
    """
    if rule.tuned_on is not None:
        scenario = Scenario.load(rule.tuned_on)
    known = parameters(scenario)
    if name not in known or known[name].keys() != rule.ranges.keys():
        found = "was tuned in other parameters" if name in known else "has not been tuned"
        raise NotTuned(f"{name} {found} for scenario {scenario.name!r}: run `{_COMMAND} --rules {name}`")
    return known[name]
