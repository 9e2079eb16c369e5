import json
from pathlib import Path

import pytest

from baselines import tune, tuned
from baselines.catalogue import entry
from turning_env import Scenario


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(tuned, "FOLDER", tmp_path)
    return tmp_path


def quick(monkeypatch: pytest.MonkeyPatch, best: float) -> None:
    """Have settings scored by how near their first value is to ``best``, instead of played."""
    monkeypatch.setattr(tune, "mean_return", lambda rule, scenario, setting, seeds: -abs(next(iter(setting.values())) - best))


def test_the_best_setting_is_found_and_kept(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    quick(monkeypatch, 130.0)
    setting, score, episodes = tune.tune("fixed_tuned", Scenario(), 8, tune.open_journal(Scenario()))
    assert setting["cutting_speed"] == pytest.approx(130)
    assert score == pytest.approx(0)
    assert episodes == 16 * 19 * 2 + 30 * 8
    assert tune.main(["--draws", "2"]) == 0
    assert entry("fixed_tuned", Scenario.load("rough_turning")).parameters["cutting_speed"] == pytest.approx(130)
    assert [path.name for path in folder.iterdir()] == ["rough_turning.json"]
    written = json.loads((folder / "rough_turning.json").read_text())
    assert written["command"] == "python -m baselines.tune --scenario rough_turning --draws 2"


def test_a_scenario_of_other_values_is_not_tuned(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(tuned.NotTuned, match=r"have not been tuned.*baselines\.tune"):
        entry("fixed_tuned", Scenario())
    quick(monkeypatch, 130.0)
    tune.main(["--draws", "1"])
    other = Scenario.model_validate({"limits": {"power": 6.5}})
    with pytest.raises(tuned.NotTuned, match="tuned for other values"):
        entry("fixed_tuned", other)


def test_an_interrupted_tuning_goes_on_where_it_stopped(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    quick(monkeypatch, 130.0)
    score, played = tune.mean_return, 0

    def interrupted(*arguments: object) -> float:
        nonlocal played
        played += 1
        if played == 101:
            raise KeyboardInterrupt
        return score(*arguments)

    monkeypatch.setattr(tune, "mean_return", interrupted)
    assert tune.main(["--draws", "4"]) == 130
    assert "again to go on" in capsys.readouterr().err
    assert not (folder / "rough_turning.json").exists()
    assert tune.main(["--draws", "4"]) == 0
    assert played == 1 + sum(
        len(tune.candidates(rule, Scenario())) * 11 // 10 for rule in ("fixed_tuned", "rescaled_grid_search")
    )
    assert [path.name for path in folder.iterdir()] == ["rough_turning.json"]


def test_an_unknown_rule_names_those_there_are() -> None:
    with pytest.raises(KeyError, match=r"'nonsense'.*fixed_handbook"):
        entry("nonsense", Scenario())


def test_settings_are_really_played() -> None:
    scenario = Scenario.model_validate({"tool": {"wear_criterion": 0.1}})
    slow, good = ({"cutting_speed": v, "feed": f} for v, f in ((50.0, 0.06), (140.0, 0.35)))
    assert tune.mean_return("fixed_tuned", scenario, slow, [1, 2]) < tune.mean_return("fixed_tuned", scenario, good, [1, 2])


@pytest.mark.parametrize("arguments", [["--draws", "0"], ["--scenario", "nowhere"]])
def test_bad_input_is_an_error(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert tune.main(arguments) == 2
    assert "error: " in capsys.readouterr().err
