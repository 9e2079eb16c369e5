"""The catalogue: which rules play, their tuned parameters, and edges changed in time."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from baselines import tuned
from baselines.catalogue import CHANGE_AT, RULES, TimelyChanges, names, playable, spec
from baselines.fixed import FixedParameters
from baselines.rule import Rule, TuningRange
from train import tune_rules
from turning_env import Scenario

CONTROLLERS = Path(__file__).parents[2] / "docs" / "controllers.md"

TUNABLE = Rule(
    "made up",
    lambda scenario, num_envs, **parameters: FixedParameters(scenario, **parameters),
    plays=lambda scenario: scenario.control.action == "incremental",
    parameters={"cutting_speed": 100.0, "feed": TuningRange(0.1, 0.4)},
)
OTHER_ACTIONS = Scenario.model_validate({"control": {"action": "set_point"}})


@pytest.fixture
def tunable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """Put a rule into the catalogue that has not been tuned; return its name."""
    monkeypatch.setattr(tuned, "FOLDER", tmp_path)
    monkeypatch.setitem(RULES, "tunable", TUNABLE)
    return "tunable"


def keep(rules: dict[str, dict[str, float]], scenario: Scenario) -> None:
    """Write a file of tuned parameters for a scenario."""
    values = {
        "command": "tune it",
        "scenario_digest": scenario.digest(),
        "rules": {name: {"parameters": parameters} for name, parameters in rules.items()},
    }
    tuned.path(scenario).write_text(json.dumps(values))


def test_a_rule_is_offered_only_where_it_can_play(tunable: str) -> None:
    assert tunable in names(Scenario())
    assert tunable not in names(OTHER_ACTIONS)
    with pytest.raises(ValueError, match="tunable cannot play scenario 'rough_turning'"):
        spec(tunable, OTHER_ACTIONS)
    with pytest.raises(KeyError, match=r"'nonsense'.*fixed_handbook"):
        spec("nonsense", Scenario())
    with pytest.raises(ValueError, match="one scenario at a time"):
        spec("fixed_tuned", [Scenario(), Scenario()])


def test_tuned_parameters_join_the_fixed_ones_and_a_change_of_edges_on_command(
    tunable: str,
) -> None:
    keep({tunable: {"feed": 0.3}}, Scenario())
    policy = spec(tunable, Scenario())
    assert policy.parameters == {"cutting_speed": 100.0, "feed": 0.3}
    assert isinstance(policy.make(2), FixedParameters)
    shift = Scenario.model_validate({"control": {"edge_changes": "commanded"}})
    assert playable(tunable, shift).ranges.keys() == {"feed", CHANGE_AT}
    keep({tunable: {"feed": 0.3}}, shift)
    with pytest.raises(tuned.NotTuned, match="tuned in other parameters"):
        spec(tunable, shift)
    keep({tunable: {"feed": 0.3, CHANGE_AT: 0.9}}, shift)
    assert spec(tunable, shift).parameters == {"cutting_speed": 100.0, "feed": 0.3, CHANGE_AT: 0.9}
    assert isinstance(spec(tunable, shift).make(2), TimelyChanges)
    assert playable("tmac_with_speed", shift) is RULES["tmac_with_speed"]  # it changes edges itself


def test_what_is_not_tuned_says_which_command_tunes_it(tunable: str) -> None:
    command = r"run `python -m train\.tune rules --scenario rough_turning --shipped"
    with pytest.raises(tuned.NotTuned, match=f"have not been tuned: {command}`"):
        spec(tunable, Scenario())
    assert tuned.command_of([tunable], Scenario()) == tuned.command(Scenario())
    keep({"fixed_tuned": {"cutting_speed": 150.0, "feed": 0.2}}, Scenario())
    advice = tuned.command_of([tunable, "tmac"], Scenario())
    assert advice == f"{tuned.command(Scenario())} --rules tunable tmac"
    with pytest.raises(
        tuned.NotTuned, match=f"tunable has not been tuned.*{command} --rules tunable`"
    ):
        spec(tunable, Scenario())
    assert spec("fixed_tuned", Scenario()).parameters == {"cutting_speed": 150.0, "feed": 0.2}
    keep({tunable: {"margin": 0.3}}, Scenario())
    with pytest.raises(
        tuned.NotTuned, match=f"tunable was tuned in other parameters.*{command} --rules tunable`"
    ):
        spec(tunable, Scenario())
    with pytest.raises(tuned.NotTuned, match=f"tuned for other values: {command}`"):
        spec(tunable, Scenario.model_validate({"limits": {"power": 6.5}}))


def test_a_rule_tuned_on_one_preset_plays_others_with_what_was_found_there(
    tunable: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(RULES, tunable, replace(TUNABLE, tuned_on="forging"))
    home = Scenario.load("forging")
    with pytest.raises(tuned.NotTuned, match=r"--scenario forging --shipped`"):
        spec(tunable, Scenario())
    keep({tunable: {"feed": 0.3}}, home)
    assert spec(tunable, Scenario()).parameters["feed"] == 0.3
    assert tunable in tune_rules.chosen_rules(None, home)
    assert tunable not in tune_rules.chosen_rules(None, Scenario())
    with pytest.raises(ValueError, match="nothing to tune on scenario 'rough_turning'"):
        tune_rules.chosen_rules([tunable], Scenario())


@pytest.mark.parametrize("name", RULES)
def test_the_page_of_controllers_lists_every_rule(name: str) -> None:
    # The page has one line for all rules of parts, and one for all rules with a cutting speed.
    listed = "parts_pv" if name.startswith("parts_") else name.removesuffix("_with_speed")
    assert f"`{listed}`" in CONTROLLERS.read_text("utf-8"), f"add {name} to {CONTROLLERS}"
