"""Tuning: the search of one rule, and the command with its files."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from baselines import tuned
from baselines.catalogue import RULES, spec
from baselines.rule import Parameters, Rule, TuningRange
from train import tune, tune_rules
from train.tune_rules import SettingResult, play_trial
from turning_env import Scenario

SHORT = Scenario.model_validate({"name": "short", "control": {"time_limit": 0.1}})
ALLOWANCE = SHORT.limits.overload_allowance
OTHER = Rule(
    "made up",
    RULES["fixed_tuned"].controller,
    plays=lambda scenario: True,
    parameters={"cutting_speed": TuningRange(80.0, 120.0), "feed": 0.2},
)
RULE = replace(
    OTHER,
    parameters={
        "share": TuningRange(0.0, 1.0),
        "gain": TuningRange(0.01, 1.0, logarithmic=True),
        "known": 7.0,
    },
)


def hill(setting: Parameters) -> tuple[float, float]:
    """Return a score that is highest at a share of 0.7, and feasible up to 0.6."""
    share = setting["share"]
    mean_return = -((share - 0.7) ** 2)
    severe_limit = ALLOWANCE * share / 0.6
    return mean_return, severe_limit


class Counted:
    """Scores settings by a formula instead of playing them.

    It keeps the settings, and raises errors at given ones.
    """

    def __init__(self, score: Callable[[Parameters], tuple[float, float]] = hill) -> None:
        self.score = score
        self.settings: list[Parameters] = []
        self.raise_at: dict[int, BaseException] = {}

    def __call__(
        self, name: str, rule: Rule, task: Scenario, setting: Parameters, seeds: list[int]
    ) -> SettingResult:
        self.settings.append(setting)
        if error := self.raise_at.get(len(self.settings)):
            raise error
        mean_return, severe_limit = self.score(setting)
        return SettingResult(
            mean_return, severe_share=0.8 * severe_limit, severe_limit=severe_limit, steps=100
        )


@pytest.fixture
def search(tmp_path: Path) -> Callable[..., dict[str, Any]]:
    """Return a search that keeps its log in ``tmp_path / "made_up.log"``."""

    def search(
        counted: Counted,
        trials: int = 16,
        seeds: int = 4,
        rule: Rule = RULE,
        scenario: Scenario = SHORT,
    ) -> Any:
        budget = {"trials": trials, "seeds": seeds}
        return tune_rules.search(
            "made_up", rule, scenario, budget, tmp_path / "made_up.log", counted
        )

    return search


def test_the_middle_comes_first_and_the_best_feasible_setting_wins(
    search: Callable[..., dict[str, Any]],
) -> None:
    counted = Counted()
    entry = search(counted, trials=30)
    assert counted.settings[0] == {"share": 0.5, "gain": pytest.approx(0.1), "known": 7.0}
    for setting in counted.settings:
        assert 0.0 <= setting["share"] <= 1.0
        assert 0.01 <= setting["gain"] <= 1.0
        assert setting["known"] == 7.0
    share = entry["parameters"].pop("share")
    assert 0.55 < share <= 0.6
    assert entry.pop("severe_share") == pytest.approx(0.8 * ALLOWANCE * share / 0.6)
    assert entry.pop("parameters").keys() == {"gain"}
    feasible = [setting for setting in counted.settings if setting["share"] <= 0.6]
    best = max(hill(setting)[0] for setting in feasible)
    assert entry == {
        "version": 1,
        "mean_return": best,
        "feasible": True,
        "episodes_played": 120,
        "steps_played": 3000,
    }


@pytest.mark.parametrize("at", [1, 14])
def test_an_interrupted_search_goes_on_to_the_same_end(
    at: int, search: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    whole = Counted()
    parts = Counted()
    expected = search(whole)
    (tmp_path / "made_up.log").unlink()
    parts.raise_at = {at: KeyboardInterrupt(), at + 1: KeyboardInterrupt()}
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            search(parts)
    assert search(parts) == expected
    interrupted = whole.settings[at - 1]
    played = [*whole.settings[:at], interrupted, interrupted, *whole.settings[at:]]
    assert parts.settings == played


def test_damaged_lines_of_a_log_are_played_again(
    search: Callable[..., dict[str, Any]], tmp_path: Path
) -> None:
    counted = Counted()
    log = tmp_path / "made_up.log"
    expected = search(counted, trials=12)
    *whole, last = log.read_bytes().split(b"\n\n")
    for damage in (b"\xff", b"{garbled", b"[" * 100_000, b"[1, 2]", last[: len(last) // 2]):
        log.write_bytes(b"\n".join([*whole, damage]))
        counted.settings.clear()
        assert search(counted, trials=12) == expected
        assert len(counted.settings) == 1


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder of a user's scenario; two rules can be tuned, a third has no ranges."""
    monkeypatch.setattr(tuned, "FOLDER", tmp_path / "shipped")
    for name in RULES.keys() - {"fixed_handbook", "fixed_tuned"}:
        monkeypatch.delitem(RULES, name)
    monkeypatch.setitem(RULES, "other", OTHER)
    (tmp_path / "own").mkdir()
    SHORT.save(tmp_path / "own" / "short.toml")
    return tmp_path / "own"


def run(folder: Path, *arguments: str) -> int:
    """Tune on the scenario in a folder with 2 seeds and, unless given, 3 trials."""
    words = ["--scenario", str(folder / "short.toml"), "--seeds", "2"]
    if "--trials" not in arguments:
        words += ["--trials", "3"]
    return tune.main(["rules", *words, *arguments])


def test_the_file_states_command_budget_and_results(folder: Path) -> None:
    assert run(folder) == 0
    path = folder / "short.tuned.json"
    scenario = Scenario.load(folder / "short.toml")
    values = json.loads(path.read_text())
    command = f"python -m train.tune rules --scenario {folder / 'short.toml'} --trials 3 --seeds 2"
    assert values["command"] == command
    assert values["scenario_digest"] == SHORT.digest()
    assert values["budget"] == {"trials": 3, "seeds": 2}
    assert list(values["rules"]) == ["fixed_tuned", "other"]
    for name, entry in values["rules"].items():
        assert spec(name, scenario).command == f"{command} --rules {name}"
        played = play_trial(
            name,
            RULES[name],
            scenario=SHORT,
            setting=spec(name, scenario).parameters,
            seeds=[1_000_000_000, 1_000_000_001],
        )
        assert entry.pop("parameters").keys() == RULES[name].ranges.keys()
        assert entry == {
            "version": 1,
            "mean_return": played.mean_return,
            "severe_share": played.severe_share,
            "feasible": played.severe_limit <= ALLOWANCE,
            "episodes_played": 6,
            "steps_played": 36,
        }
    assert sorted(folder.iterdir()) == [folder / "short.toml", path]


def test_a_quick_tuning_is_of_what_is_worth_it_and_says_how_to_tune_others(
    folder: Path, capsys: Any
) -> None:
    path = folder / "short.toml"
    assert tune.main(["rules", "--scenario", str(path), "--quick"]) == 0
    values = tuned.read(folder / "short.tuned.json")
    scenario = Scenario.load(path)
    assert list(values["rules"]) == ["fixed_tuned"]
    assert values["budget"] == tune_rules.QUICK
    assert spec("fixed_tuned", scenario).parameters == values["rules"]["fixed_tuned"]["parameters"]
    with pytest.raises(
        tuned.NotTuned,
        match=rf"other has not .* run `{re.escape(tuned.command(scenario))} --rules other`",
    ):
        spec("other", scenario)
    assert run(folder, "--quick", "--rules", "other") == 2
    assert "keeps fixed_tuned, tuned with another budget" in capsys.readouterr().err
    assert run(folder) == 0
    assert (
        spec("other", scenario).command
        == f"python -m train.tune rules --scenario {path} --trials 3 --seeds 2 --rules other"
    )


@pytest.mark.parametrize(
    "content",
    [
        pytest.param("[]", id="no object"),
        pytest.param('{"rules": {"fixed_tuned": 1}}', id="no parameters"),
        pytest.param("[" * 100_000, id="too deep"),
    ],
)
def test_a_damaged_file_of_tuned_parameters_is_named_and_kept(folder: Path, content: str) -> None:
    path = folder / "short.tuned.json"
    path.write_text(content)
    with pytest.raises(ValueError, match=r"short\.tuned\.json holds no tuned parameters"):
        spec("fixed_tuned", Scenario.load(folder / "short.toml"))
    assert run(folder, "--trials", "1") == 2
    assert path.read_text() == content
