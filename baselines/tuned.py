"""Tuned parameters of the rules, kept as data: one JSON file per scenario.

The presets' files ship in ``baselines/tuned``, and those of families that a rule plays with parameters of its own in
``baselines/tuned/families``. The file of your own scenario, ``my_mill.toml``, is ``my_mill.tuned.json`` beside it. A file belongs
to the scenario whose digest it states; names do not matter.
"""

import json
import shlex
from pathlib import Path
from typing import Any

from baselines.rule import Parameters, Rule
from turning_env import Family, Scenario, presets

FOLDER = Path(__file__).parent / "tuned"  # the folder of the tuned values that ship


class NotTuned(ValueError):
    """A rule has not been tuned for this scenario."""


def path(scenario: Scenario) -> Path:
    """Return the path of a scenario's tuned parameters: beside the scenario's file or, if it ships, the file that ships."""
    file = scenario.file
    return file.with_name(f"{file.stem}.tuned.json") if file else FOLDER / f"{scenario.name}.json"


def command(scenario: Scenario) -> str:
    """Return the command that tunes the rules for a scenario."""
    shipped = f"{scenario.name} --shipped" if scenario.name in presets() else "FILE.toml"
    return f"python -m baselines.tune --scenario {shlex.quote(str(scenario.file)) if scenario.file else shipped}"


def read(file: Path) -> dict[str, Any]:
    """Return the contents of a file of tuned parameters, an empty dict if there is no file; ValueError if it is damaged."""
    try:
        values: dict[str, Any] = json.loads(file.read_text("utf-8"))
        for rule in values["rules"].values():
            dict(rule["parameters"])
    except FileNotFoundError:
        return {}
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ValueError(
            f"{file} holds no tuned parameters ({error!r}): delete it and tune the rules again"
        ) from error
    return values


def contents(scenario: Scenario) -> dict[str, Any]:
    """Return the contents of the file for a scenario with these values; NotTuned says which command makes one."""
    own = read(path(scenario))
    for values in (own, *map(read, sorted(FOLDER.glob("*.json")))):
        if values.get("scenario_digest") == scenario.digest():
            return values
    found = "were tuned for other values" if own else "have not been tuned"
    raise NotTuned(f"the rules of scenario {scenario.name!r} {found}: run `{command(scenario)}`")


def on_family(family: Family, name: str) -> Parameters:
    """Return the parameters that a rule has on the jobs of this family alone."""
    values = read(family_path(family))
    own = (
        values["rules"].get(name, {})
        if values.get("family_digest") == family_digest(family)
        else {}
    )
    return dict(own.get("parameters", {}))


def family_path(family: Family) -> Path:
    """Return the path of the parameters that rules have on the jobs of a family that ships."""
    return FOLDER / "families" / f"{family.name}.json"


def family_digest(family: Family) -> str:
    """Return the digest of a family's values, whichever jobs are held out."""
    return family.model_copy(update={"held_out_key": ""}).digest()


def setting(name: str, rule: Rule, scenario: Scenario) -> tuple[Parameters, str]:
    """Return one rule's tuned parameters and their command, for a scenario or ``rule.tuned_on``; NotTuned if there are none."""
    home = scenario if rule.tuned_on is None else Scenario.load(rule.tuned_on)
    values = contents(home)
    known = values["rules"].get(name)
    if known is None:
        found = "has not been tuned"
    elif (version := known.get("version", 1)) != rule.version:
        found = f"was tuned in version {version}, and is now version {rule.version},"
    elif known["parameters"].keys() != rule.ranges.keys():
        found = "was tuned in other parameters"
    else:
        return dict(known["parameters"]), f"{values['command']} --rules {name}"
    raise NotTuned(
        f"{name} {found} for scenario {home.name!r}: run `{command(home)} --rules {name}`"
    )
