"""Tuned parameters of the rules, kept as data: one JSON file per scenario's name."""

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
    """Return the file of a scenario's tuned parameters."""
    return FOLDER / f"{scenario.name}.json"


def contents(scenario: Scenario) -> dict[str, Any]:
    """Return all that the scenario's file says; nothing where there is no file.

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


def rules(scenario: Scenario) -> dict[str, dict[str, Any]]:
    """Return what was found for the rules that have been tuned for a scenario of these values: ``parameters``, ``version``, ...

    Raises:
        NotTuned: there are none for this scenario; says which command makes them.
    """
    own = contents(scenario)
    others = map(_read, sorted(FOLDER.glob("*.json")))
    for values in chain([own], others):
        if values.get("scenario_digest") == scenario.digest():
            tuned_rules: dict[str, dict[str, Any]] = values["rules"]
            return tuned_rules
    found = "were tuned for other values" if own else "have not been tuned"
    raise NotTuned(f"the rules of scenario {scenario.name!r} {found}: run `{_COMMAND}`")


def setting(name: str, rule: Rule, scenario: Scenario) -> Parameters:
    """Return the tuned parameters of one rule for a scenario: those of ``rule.tuned_on`` if it is tuned there alone.

    Raises:
        NotTuned: there are none for this scenario, or they are not those that the rule has; says which command makes them.
    """
    if rule.tuned_on is not None:
        scenario = Scenario.load(rule.tuned_on)
    known = rules(scenario)
    if name not in known:
        found = "has not been tuned"
    elif known[name].get("version", 1) != rule.version:
        found = f"was tuned in version {known[name].get('version', 1)}, and is now version {rule.version},"
    elif known[name]["parameters"].keys() != rule.ranges.keys():
        found = "was tuned in other parameters"
    else:
        return dict(known[name]["parameters"])
    raise NotTuned(f"{name} {found} for scenario {scenario.name!r}: run `{_COMMAND} --rules {name}`")
