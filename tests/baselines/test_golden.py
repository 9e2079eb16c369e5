"""Golden actions: what every controller does on the same observations, as recorded when its version was released.

A failure means that a rule acts otherwise than its version promises: raise ``version`` of its
``Rule`` or take the change back; tune it anew if it is tuned; write the file with ``python -m
tests.baselines.test_golden``. Results and tuned values of the old version are then void: ``python
-m leaderboard verify --check`` names them.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from baselines import tuned
from baselines.catalogue import RULES, names, spec
from tests.turning_env.playing import fixed_actions
from turning_env import IDS, Family, RoughTurningVectorEnv, Scenario

FILE = Path(__file__).parents[1] / "golden" / "actions.json"
STEPS, EVERY, NUM_ENVS = 40, 8, 2
FAMILIES = {"shop": ["self_tuning"], "unmodelled": ["contextual"]}
"""Rules whose actions are recorded on the first job of a family."""
TOLERANCE = 2e-6
"""Largest difference of an action in -1..1, recorded with seven digits. A rewritten formula within it needs no new version."""


def observations(scenario: Scenario) -> list[NDArray[np.float32]]:
    """Observations of a play of fixed actions, each of shape (NUM_ENVS, entries)."""
    env = RoughTurningVectorEnv(NUM_ENVS, scenario)
    seen = [env.reset(seed=2024)[0]]
    return [*seen, *(env.step(actions)[0] for actions in fixed_actions(STEPS, NUM_ENVS, scenario))]


def actions(name: str, preset: str) -> list[list[float]]:
    """A rule's actions on every ``EVERY``-th of these observations, all environments in one row."""
    if preset in FAMILIES:
        family = Family.load(preset)
        job = family.job(0)
        scenario = job.scenario
        made = spec(name, scenario, own=tuned.on_family(family, name), numbers=[job.numbers])
    else:
        scenario = Scenario.load(preset)
        made = spec(name, scenario)
    policy = made.make(NUM_ENVS)
    policy.reset(np.ones(NUM_ENVS, np.bool_))
    acted = [policy.act(seen) for seen in observations(scenario)]
    return [[float(f"{value:.7g}") for value in each.ravel().tolist()] for each in acted[::EVERY]]


def recorded() -> dict[str, dict[str, Any]]:
    """Return every rule's version, and its actions on the preset of each id or on the family's first job, if it can play it."""
    playable = {preset: names(Scenario.load(preset)) for preset in IDS.values()} | FAMILIES
    return {
        name: {
            "version": rule.version,
            "actions": {
                preset: actions(name, preset) for preset, rules in playable.items() if name in rules
            },
        }
        for name, rule in RULES.items()
    }


GOLDEN: dict[str, dict[str, Any]] = json.loads(FILE.read_text("utf-8")) if FILE.exists() else {}


@pytest.mark.parametrize("name", GOLDEN)
def test_a_rule_acts_as_its_version_promises(name: str) -> None:
    golden, rule = GOLDEN[name], RULES[name]
    advice = f"raise `version` of rule {name!r}, which is {rule.version}, and run `python -m tests.baselines.test_golden`"
    assert golden["version"] == rule.version, (
        f"golden actions are of version {golden['version']}: {advice}"
    )
    for preset, expected in golden["actions"].items():
        found = np.array(actions(name, preset))
        assert np.abs(found - np.array(expected)).max() <= TOLERANCE, (
            f"other actions on {preset}: {advice}"
        )


def test_every_rule_with_shipped_results_has_golden_actions() -> None:
    manifests = (Path(__file__).parents[2] / "leaderboard" / "results").glob("*/*/manifest.json")
    ranked = {
        label for path in manifests for label in json.loads(path.read_text("utf-8"))["results"]
    }
    assert ranked & RULES.keys() <= GOLDEN.keys(), "run `python -m tests.baselines.test_golden`"


if __name__ == "__main__":
    lines = []
    for rule_name, entry in recorded().items():
        rows = ",\n".join(
            f"   {json.dumps(preset)}: {json.dumps(values)}"
            for preset, values in entry["actions"].items()
        )
        lines.append(
            f' {json.dumps(rule_name)}: {{"version": {entry["version"]}, "actions": {{\n{rows}\n }}}}'
        )
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")
