"""What the tunable rules were tuned to, kept as data: one JSON file per scenario's name."""

import json
from pathlib import Path
from typing import Any

from turning_env import Scenario

FOLDER = Path(__file__).parent / "tuned"


class NotTuned(ValueError):
    """The rules have not been tuned for this scenario."""


def path(scenario: Scenario) -> Path:
    """The file of a scenario's tuned parameters."""
    return FOLDER / f"{scenario.name}.json"


def parameters(scenario: Scenario) -> dict[str, dict[str, float]]:
    """Tuned parameters by rule and name.

    Raises:
        NotTuned: there are none for this scenario; says which command makes them.
    """
    try:
        values: dict[str, Any] = json.loads(path(scenario).read_text("utf-8"))
    except FileNotFoundError:
        values = {}
    if values.get("scenario_digest") != scenario.digest():
        found = "were tuned for other values" if values else "have not been tuned"
        raise NotTuned(
            f"the rules of scenario {scenario.name!r} {found}: run `python -m baselines.tune --scenario PRESET_OR_TOML`"
        )
    return {name: rule["parameters"] for name, rule in values["rules"].items()}
