import json
import re
from pathlib import Path

import pytest

from baselines import tuned
from baselines.catalogue import RULES, spec
from baselines.rule import Range, Rule
from baselines.tune import __main__ as tune
from baselines.tune import study
from baselines.tune.study import Played, play_setting
from turning_env import Scenario

SHORT = Scenario.model_validate({"name": "short", "control": {"time_limit": 0.1}})
OTHER = Rule("made up", RULES["fixed_tuned"].build, lambda scenario: True, {"cutting_speed": Range(80.0, 120.0), "feed": 0.2})


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where tuned values are kept; two rules can be tuned, and a third has nothing to tune."""
    monkeypatch.setattr(tuned, "FOLDER", tmp_path / "tuned")
    for name in RULES.keys() - {"fixed_handbook", "fixed_tuned"}:
        monkeypatch.delitem(RULES, name)
    monkeypatch.setitem(RULES, "other", OTHER)
    SHORT.save(tmp_path / "short.toml")
    return tmp_path


def run(folder: Path, *arguments: str) -> int:
    common = ["--scenario", str(folder / "short.toml"), "--seeds", "2"]
    return tune.main([*common, *(arguments if "--trials" in arguments else ("--trials", "3", *arguments))])


def test_the_same_command_writes_the_same_file(folder: Path) -> None:
    assert run(folder) == 0
    path = folder / "tuned" / "short.json"
    text = path.read_text()
    values = json.loads(text)
    assert values["command"] == f"python -m baselines.tune --scenario {folder / 'short.toml'} --trials 3 --seeds 2"
    assert values["scenario_digest"] == SHORT.digest()
    assert values["budget"] == {"trials": 3, "seeds": 2}
    assert list(values["rules"]) == ["fixed_tuned", "other"]
    for name, found in values["rules"].items():
        played = play_setting(RULES[name], SHORT, spec(name, SHORT).parameters, [1_000_000_000, 1_000_000_001])
        assert found.pop("parameters").keys() == RULES[name].ranges.keys()
        assert found == {
            "version": 1,
            "mean_return": played.mean_return,
            "severe_share": played.severe_share,
            "feasible": played.severe_limit <= SHORT.limits.overload_allowance,
            "episodes_played": 6,
            "steps_played": 36,
        }
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.slow
def test_interrupted_or_side_by_side_it_comes_to_the_same_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder) == 0
    path = folder / "tuned" / "short.json"
    text = path.read_text()
    path.unlink()
    assert run(folder, "--jobs", "2") == 0
    assert path.read_text() == text
    path.unlink()
    played = 0

    def interrupted(*arguments: object) -> Played:
        nonlocal played
        played += 1
        if played == 5:
            raise KeyboardInterrupt
        return play_setting(*arguments)

    monkeypatch.setattr(study, "play_setting", interrupted)
    assert run(folder) == 130
    assert "again to go on" in capsys.readouterr().err
    assert not path.exists()
    assert run(folder) == 0
    assert played == 2 * 3 + 1
    assert path.read_text() == text
    assert list(path.parent.iterdir()) == [path]


def test_some_rules_are_tuned_and_the_others_kept(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder, "--rules", "other") == 0
    with pytest.raises(tuned.NotTuned, match=r"fixed_tuned has not been tuned.*--rules fixed_tuned"):
        spec("fixed_tuned", SHORT)
    assert run(folder, "--rules", "fixed_tuned") == 0
    path = folder / "tuned" / "short.json"
    text = path.read_text()
    assert run(folder) == 0
    assert path.read_text() == text  # rule by rule or all at once
    assert run(folder, "--rules", "other", "--trials", "4") == 2
    assert "keeps fixed_tuned, tuned with another budget" in capsys.readouterr().err
    assert path.read_text() == text
    assert run(folder, "--rules", "other", "fixed_tuned", "--trials", "4") == 0
    assert json.loads(path.read_text())["budget"] == {"trials": 4, "seeds": 2}


def test_what_was_tuned_for_other_values_is_not_kept(folder: Path) -> None:
    assert run(folder) == 0
    other = Scenario.model_validate({"name": "short", "control": {"time_limit": 0.2}})
    other.save(folder / "short.toml")
    assert run(folder, "--rules", "other", "--trials", "4") == 0
    assert tuned.rules(other).keys() == {"other"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--jobs", "0"], "0 jobs asked for"),
        (["--scheduler", "nowhere"], "must be an address like tcp://host:8786"),
        (["--scenario", "harder_lot"], "scenario 'harder_lot' has a model mismatch"),
        (["--rules", "nonsense"], "no controller is called 'nonsense'; there are fixed_handbook, fixed_tuned, other"),
        (["--rules", "other", "fixed_handbook"], "fixed_handbook has nothing to tune"),
        (["--rules", "unable"], "unable cannot play"),
    ],
)
def test_bad_input_is_an_error(
    arguments: list[str],
    message: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if "unable" in arguments:
        monkeypatch.setitem(RULES, "unable", Rule("made up", OTHER.build, lambda scenario: False, OTHER.parameters))
    assert run(folder, *arguments) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert re.search(message, error)
    assert not (folder / "tuned").exists()


@pytest.mark.parametrize(
    "content", ["", "[]", "{}", '{"rules": []}', '{"rules": {"fixed_tuned": 1}}', "[" * 100_000], ids=range(6)
)
def test_a_damaged_file_of_tuned_parameters_is_named(folder: Path, content: str) -> None:
    path = tuned.path(SHORT)
    path.parent.mkdir()
    path.write_text(content)
    with pytest.raises(tuned.NotTuned, match=r"short\.json holds no tuned parameters"):
        tuned.setting("fixed_tuned", RULES["fixed_tuned"], SHORT)
    assert run(folder, "--rules", "fixed_tuned", "--trials", "1") == 2
    assert path.read_text() == content
