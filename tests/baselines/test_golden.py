"""Golden actions: those of every controller on the same observations.

They were recorded when the controller's version was released.
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

from baselines.catalogue import RULES, names, spec
from tests.turning_env.playing import fixed_actions
from turning_env import IDS, Family, RoughTurningVectorEnv, Scenario

FILE = Path(__file__).parents[1] / "golden" / "actions.json"
STEPS = 40
EVERY = 8
NUM_ENVS = 2
FAMILIES = {
    "shop": ["self_tuning", "load_loop_jobs"],
    "unmodelled": ["chip_window", "reactive"],
}
"""Rules whose actions are recorded on the first job of a family."""
TOLERANCE = 2e-6
"""Largest difference of an action in -1..1, recorded with seven digits.

A rewritten formula within it needs no new version.
"""


def observations(scenario: Scenario) -> list[NDArray[np.float32]]:
    """Return the observations of a play of fixed actions, each of shape (NUM_ENVS, entries)."""
    env = RoughTurningVectorEnv(NUM_ENVS, scenario)
    seen = [env.reset(seed=2024)[0]]
    for played in fixed_actions(STEPS, NUM_ENVS, scenario):
        seen.append(env.step(played)[0])
    return seen


def actions(name: str, preset: str) -> list[list[float]]:
    """Return a rule's actions on every ``EVERY``-th observation, all environments in one row."""
    is_family = preset in FAMILIES
    scenario = Family.load(preset).job(0).scenario if is_family else Scenario.load(preset)
    policy = spec(name, scenario).make(NUM_ENVS)
    policy.reset(np.ones(NUM_ENVS, np.bool_))
    rows = []
    for step, seen in enumerate(observations(scenario)):
        acted = policy.act(seen)
        if step % EVERY == 0:
            rows.append([float(f"{value:.7g}") for value in acted.ravel().tolist()])
    return rows


def recorded() -> dict[str, dict[str, Any]]:
    """Return the version of every rule, and its actions.

    They are those on the preset of each id, and on the families' first jobs, if it can play them.
    """
    rules_of = {preset: names(Scenario.load(preset)) for preset in IDS.values()} | FAMILIES
    entries: dict[str, dict[str, Any]] = {}
    for name, rule in RULES.items():
        entries[name] = {"version": rule.version, "actions": {}}
        for preset, rules in rules_of.items():
            if name in rules:
                entries[name]["actions"][preset] = actions(name, preset)
    return entries


GOLDEN: dict[str, dict[str, Any]] = json.loads(FILE.read_text("utf-8")) if FILE.exists() else {}


@pytest.mark.slow
@pytest.mark.parametrize("name", GOLDEN)
def test_a_rule_acts_as_its_version_promises(name: str) -> None:
    golden = GOLDEN[name]
    version = RULES[name].version
    advice = (
        f"raise `version` of rule {name!r}, which is {version}, "
        "and run `python -m tests.baselines.test_golden`"
    )
    released = golden["version"]
    assert released == version, f"golden actions are of version {released}: {advice}"
    for preset, expected in golden["actions"].items():
        difference = np.abs(np.array(actions(name, preset)) - np.array(expected))
        assert difference.max() <= TOLERANCE, f"other actions on {preset}: {advice}"


def test_every_rule_with_shipped_results_has_golden_actions() -> None:
    manifests = (Path(__file__).parents[2] / "leaderboard" / "results").glob("*/*/manifest.json")
    ranked: set[str] = set()
    for path in manifests:
        ranked |= json.loads(path.read_text("utf-8"))["results"].keys()
    missing = sorted(ranked & RULES.keys() - GOLDEN.keys())
    assert not missing, f"run `python -m tests.baselines.test_golden`, which records {missing}"


if __name__ == "__main__":
    lines = []
    for rule_name, entry in recorded().items():
        rows = []
        for preset, values in entry["actions"].items():
            rows.append(f"   {json.dumps(preset)}: {json.dumps(values)}")
        head = f'{json.dumps(rule_name)}: {{"version": {entry["version"]}, "actions": {{'
        body = ",\n".join(rows)
        lines.append(f" {head}\n{body}\n }}}}")
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")
