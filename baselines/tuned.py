"""Tuned parameters of the rules, kept as data: one JSON file per scenario.

The presets' files ship in ``baselines/tuned``. The file of your own scenario, ``my_mill.toml``, is
``my_mill.tuned.json`` beside it. A file belongs to the scenario whose digest it states; names do
not matter.
"""

import json
import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from baselines.rule import Parameters, Rule
from turning_env import Scenario, presets
from turning_env.files import read_regular

FOLDER = Path(__file__).parent / "tuned"  # the folder of the tuned values that ship


class NotTuned(ValueError):  # noqa: N818 - it names a state of the rules
    """A rule has not been tuned for this scenario."""


def path(scenario: Scenario) -> Path:
    """Return the path of a scenario's tuned parameters.

    It is beside the scenario's file or, if the scenario ships, the file that ships.
    """
    file = scenario.file
    if file is None:
        return FOLDER / f"{scenario.name}.json"
    return file.with_name(f"{file.stem}.tuned.json")


def command(scenario: Scenario) -> str:
    """Return the command that tunes the rules for a scenario."""
    if scenario.file:
        task = shlex.quote(str(scenario.file))
    elif scenario.name in presets():
        task = f"{scenario.name} --shipped"
    else:
        task = "FILE.toml"
    return f"python -m train.tune rules --scenario {task}"


def command_of(names: Iterable[str], scenario: Scenario) -> str:
    """Return the command that tunes rules which are not tuned for a scenario.

    If others are, it names the rules, and keeps the others as they are.
    """
    try:
        contents(scenario)
    except NotTuned:
        return command(scenario)
    return f"{command(scenario)} --rules {' '.join(names)}"


def read(file: Path) -> dict[str, Any]:
    """Return the contents of a file of tuned parameters, an empty dict if there is no file.

    Raises:
        ValueError: the file is damaged.
    """
    try:
        values: dict[str, Any] = json.loads(read_regular(file))
        for rule in values["rules"].values():
            dict(rule["parameters"])
    except FileNotFoundError:
        return {}
    except OSError as error:
        raise ValueError(f"{file} cannot be read: {error.strerror}") from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(
            f"{file} holds no tuned parameters ({error!r}): delete it and tune the rules again"
        ) from error
    return values


def contents(scenario: Scenario) -> dict[str, Any]:
    """Return the contents of the file for a scenario with these values.

    Raises:
        NotTuned: there is no such file; the message names the command that makes one.
    """
    digest = scenario.digest()
    beside_scenario = read(path(scenario))
    if beside_scenario.get("scenario_digest") == digest:
        return beside_scenario
    for file in sorted(FOLDER.glob("*.json")):
        values = read(file)
        if values.get("scenario_digest") == digest:
            return values
    state = "were tuned for other values" if beside_scenario else "have not been tuned"
    raise NotTuned(f"the rules of scenario {scenario.name!r} {state}: run `{command(scenario)}`")


def setting(name: str, rule: Rule, scenario: Scenario) -> tuple[Parameters, str]:
    """Return a rule's tuned parameters and the command that found them.

    They are those for the scenario or, if the rule has one, for ``rule.tuned_on``.

    Raises:
        NotTuned: there are none.
    """
    tuned_on = scenario if rule.tuned_on is None else Scenario.load(rule.tuned_on)
    values = contents(tuned_on)
    entry = values["rules"].get(name)
    if entry is None:
        state = "has not been tuned"
    elif entry.get("version", 1) != rule.version:
        version = entry.get("version", 1)
        state = f"was tuned in version {version}, and is now version {rule.version},"
    elif entry["parameters"].keys() != rule.ranges.keys():
        state = "was tuned in other parameters"
    else:
        return dict(entry["parameters"]), f"{values['command']} --rules {name}"
    raise NotTuned(
        f"{name} {state} for scenario {tuned_on.name!r}: run `{command(tuned_on)} --rules {name}`"
    )
