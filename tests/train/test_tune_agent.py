import math
from pathlib import Path
from typing import Any

import pytest

from tests.train.small import SCENARIO
from train import tune_agent
from train.tune_rules import SettingResult, Trial

FAILED = SettingResult(-math.inf, 1.0, 1.0, 0, "not finite")


def learning_rate_matters(task: tune_agent.TuningTask, setting: dict[str, Any]) -> SettingResult:
    """A landscape without any training: fast learning overloads, very fast learning fails."""
    if setting["learning_rate"] > 2.5e-3:
        return FAILED
    severe = 0.06 if setting["learning_rate"] > 1.5e-3 else 0.04
    return SettingResult(1e5 * setting["learning_rate"], severe, severe, 1)


def search(folder: Path, trials: int, evaluate: Any = learning_rate_matters) -> tuple[int, Trial]:
    return tune_agent.search(
        tune_agent.TuningTask("sac", "RoughTurning-v0", SCENARIO, 100, 1, folder),
        trials,
        evaluate=evaluate,
    )


def test_the_best_feasible_setting_wins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, (setting, played) = search(tmp_path, 12)
    assert 1e-3 <= setting["learning_rate"] <= 1.5e-3  # the first trial is the known setting: 1e-3
    assert played.severe_limit == 0.04
    assert played.mean_return == pytest.approx(1e5 * setting["learning_rate"])
    lines = capsys.readouterr().err
    failures = lines.count("failed: not finite")
    assert failures > 0
    assert lines.count("mean return") + failures == 12
    with pytest.raises(ValueError, match="all 3 trials failed"):
        search(tmp_path / "other", 3, lambda task, setting: FAILED)


def test_an_interrupted_search_finds_what_it_would_have(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(task: tune_agent.TuningTask, setting: dict[str, Any]) -> SettingResult:
        raise KeyboardInterrupt

    undisturbed = search(tmp_path, 10)
    again = tmp_path / "again"
    expected = capsys.readouterr().err
    search(again, 4)
    with pytest.raises(KeyboardInterrupt):
        search(again, 10, interrupted)
    (log,) = again.rglob("*.log")
    log.write_bytes(log.read_bytes() + b'[[], {"le')  # a killed process may leave half a line
    capsys.readouterr()
    assert search(again, 10) == undisturbed
    assert capsys.readouterr().err == expected
    assert search(again, 10, interrupted) == undisturbed  # there is nothing left to do


def test_a_second_identical_search_is_refused_while_the_first_goes_on(tmp_path: Path) -> None:
    refused = []

    def search_again(task: tune_agent.TuningTask, setting: dict[str, Any]) -> SettingResult:
        with pytest.raises(ValueError, match="another process works in") as refusal:
            search(tmp_path, 1)
        refused.append(str(refusal.value))
        return learning_rate_matters(task, setting)

    _, trial = search(tmp_path, 1, search_again)
    assert len(refused) == 1
    assert not trial.played.failed
