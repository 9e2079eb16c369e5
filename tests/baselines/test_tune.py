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
    """Return the path of a user's scenario; two rules can be tuned, and a third has nothing to tune."""
    monkeypatch.setattr(tuned, "FOLDER", tmp_path / "shipped")
    for name in RULES.keys() - {"fixed_handbook", "fixed_tuned"}:
        monkeypatch.delitem(RULES, name)
    monkeypatch.setitem(RULES, "other", OTHER)
    (tmp_path / "own").mkdir()
    SHORT.save(tmp_path / "own" / "short.toml")
    return tmp_path / "own"


def run(folder: Path, *arguments: str) -> int:
    common = ["--scenario", str(folder / "short.toml"), "--seeds", "2"]
    return tune.main([*common, *(arguments if "--trials" in arguments else ("--trials", "3", *arguments))])


def test_the_same_command_writes_the_same_file_beside_the_scenario_s(folder: Path) -> None:
    assert run(folder) == 0
    path = folder / "short.tuned.json"
    scenario = Scenario.load(folder / "short.toml")
    values = json.loads(path.read_text())
    command = f"python -m baselines.tune --scenario {folder / 'short.toml'} --trials 3 --seeds 2"
    assert values["command"] == command
    assert values["scenario_digest"] == SHORT.digest()
    assert values["budget"] == {"trials": 3, "seeds": 2}
    assert list(values["rules"]) == ["fixed_tuned", "other"]
    for name, found in values["rules"].items():
        assert spec(name, scenario).command == f"{command} --rules {name}"
        played = play_setting(RULES[name], SHORT, spec(name, scenario).parameters, [1_000_000_000, 1_000_000_001])
        assert found.pop("parameters").keys() == RULES[name].ranges.keys()
        assert found == {
            "version": 1,
            "mean_return": played.mean_return,
            "severe_share": played.severe_share,
            "feasible": played.severe_limit <= SHORT.limits.overload_allowance,
            "episodes_played": 6,
            "steps_played": 36,
        }
    assert sorted(folder.iterdir()) == [folder / "short.toml", path]


def test_a_scenario_of_ones_own_leaves_what_ships_alone_whatever_it_is_called(folder: Path) -> None:
    """The values that are found beside a scenario are those that play it; those that ship play the preset of its name."""
    tuned.FOLDER.mkdir()
    shipped, own = Scenario.load("forging"), folder / "forging.toml"
    SHORT.save(own)
    rules = {"fixed_tuned": {"parameters": {"cutting_speed": 150.0, "feed": 0.2}}}
    about = {"command": "tune it", "scenario_digest": shipped.digest(), "rules": rules}
    tuned.path(shipped).write_text(json.dumps(about))
    assert tune.main(["--scenario", str(own), "--trials", "1", "--seeds", "1"]) == 0
    assert json.loads(tuned.path(shipped).read_text()) == about
    found = spec("fixed_tuned", Scenario.load(own)).parameters
    assert found == json.loads((folder / "forging.tuned.json").read_text())["rules"]["fixed_tuned"]["parameters"]
    assert found != spec("fixed_tuned", shipped).parameters == {"cutting_speed": 150.0, "feed": 0.2}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], r"forging\.json ships with the project: give .* a TOML file of your own"),
        (["--out", "{shipped}/forging.json"], "ships with the project"),
        (["--shipped", "--scenario", "{own}"], "--shipped rewrites the parameters of a preset, one of .*forging"),
        (["--out", "forging.toml"], r"--out forging\.toml must end in \.json"),
    ],
)
def test_what_ships_is_written_on_demand_alone(
    arguments: list[str], message: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [word.format(shipped=tuned.FOLDER, own=folder / "short.toml") for word in arguments]
    assert tune.main(["--scenario", "forging", "--trials", "1", "--seeds", "1", *words]) == 2
    assert re.search(message, capsys.readouterr().err)
    assert not tuned.FOLDER.exists()


def test_a_maintainer_writes_what_ships(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "play_setting", lambda *task: Played(1.0, 0.0, 0.0, 1))
    arguments = ["--scenario", "override", "--trials", "1", "--seeds", "1", "--rules", "other"]
    assert tune.main([*arguments, "--shipped"]) == 0
    assert [path.name for path in tuned.FOLDER.iterdir()] == ["override.json"]
    elsewhere = folder / "new" / "elsewhere.json"
    assert tune.main([*arguments, "--out", str(elsewhere)]) == 0
    assert json.loads(elsewhere.read_text())["rules"] == tuned.read(tuned.FOLDER / "override.json")["rules"]


def test_a_quick_tuning_is_of_what_is_worth_it_and_says_how_to_tune_others(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "short.toml"
    assert tune.main(["--scenario", str(path), "--quick"]) == 0
    values = tuned.read(folder / "short.tuned.json")
    assert list(values["rules"]) == ["fixed_tuned"]
    assert values["budget"] == tune.QUICK
    scenario = Scenario.load(path)
    assert spec("fixed_tuned", scenario).parameters == values["rules"]["fixed_tuned"]["parameters"]
    with pytest.raises(tuned.NotTuned, match=rf"other has not .* run `{re.escape(tuned.command(scenario))} --rules other`"):
        spec("other", scenario)
    assert run(folder, "--quick", "--rules", "other") == 2
    assert "keeps fixed_tuned, tuned with another budget" in capsys.readouterr().err
    assert run(folder) == 0
    assert spec("other", scenario).command == f"python -m baselines.tune --scenario {path} --trials 3 --seeds 2 --rules other"


@pytest.mark.slow
def test_some_rules_are_tuned_and_the_others_kept(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder, "--rules", "other") == 0
    with pytest.raises(tuned.NotTuned, match=r"fixed_tuned has not been tuned.*--scenario \S*short.toml --rules fixed_tuned"):
        spec("fixed_tuned", Scenario.load(folder / "short.toml"))
    assert run(folder, "--rules", "fixed_tuned") == 0
    path = folder / "short.tuned.json"
    text = path.read_text()
    assert run(folder, "--jobs", "2") == 0
    assert path.read_text() == text  # rule by rule or all at once, side by side
    assert run(folder, "--rules", "other", "--trials", "4") == 2
    assert "keeps fixed_tuned, tuned with another budget" in capsys.readouterr().err
    assert path.read_text() == text
    assert run(folder, "--rules", "other", "fixed_tuned", "--trials", "4") == 0
    assert json.loads(path.read_text())["budget"] == {"trials": 4, "seeds": 2}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--jobs", "0"], "0 jobs asked for"),
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
    assert [path.name for path in folder.iterdir()] == ["short.toml"]


@pytest.mark.parametrize("content", ["[]", '{"rules": {"fixed_tuned": 1}}', "[" * 100_000], ids=range(3))
def test_a_damaged_file_of_tuned_parameters_is_named_and_kept(folder: Path, content: str) -> None:
    path = folder / "short.tuned.json"
    path.write_text(content)
    with pytest.raises(ValueError, match=r"short\.tuned\.json holds no tuned parameters"):
        spec("fixed_tuned", Scenario.load(folder / "short.toml"))
    assert run(folder, "--trials", "1") == 2
    assert path.read_text() == content
