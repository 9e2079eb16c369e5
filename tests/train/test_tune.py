import math
from pathlib import Path
from typing import Any

import pytest

from baselines.tune import Played, Trial
from tests.train.small import PARAMETERS, SCENARIO
from train import tune
from train.training import algorithm_of

FAILED = Played(-math.inf, 1.0, 1.0, 0, "not finite")


def learning_rate_matters(task: tune.Task, setting: dict[str, Any]) -> Played:
    """A landscape without any training: fast learning overloads, very fast learning fails."""
    if setting["learning_rate"] > 2.5e-3:
        return FAILED
    severe = 0.06 if setting["learning_rate"] > 1.5e-3 else 0.04
    return Played(1e5 * setting["learning_rate"], severe, severe, 1)


def search(folder: Path, trials: int, evaluate: Any = learning_rate_matters) -> tuple[int, Trial]:
    return tune.search(tune.Task("sac", "RoughTurning-v0", SCENARIO, 100, 1, folder), trials, evaluate=evaluate)


def test_the_best_feasible_setting_wins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, (setting, played) = search(tmp_path, 12)
    assert 1e-3 <= setting["learning_rate"] <= 1.5e-3  # the first trial is the known setting: 1e-3
    assert (played.severe_limit, played.mean_return) == (0.04, pytest.approx(1e5 * setting["learning_rate"]))
    told = capsys.readouterr().err
    assert told.count("mean return") + told.count("failed: not finite") == 12
    assert "failed" in told
    with pytest.raises(ValueError, match="all 3 trials failed"):
        search(tmp_path / "other", 3, lambda task, setting: FAILED)


def test_an_interrupted_search_finds_what_it_would_have(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupted(task: tune.Task, setting: dict[str, Any]) -> Played:
        raise KeyboardInterrupt

    undisturbed, again = search(tmp_path, 10), tmp_path / "again"
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


@pytest.mark.slow
def test_the_command_trains_plays_and_prints_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = [word for name, value in (PARAMETERS["ppo"] | {"epochs": 3}).items() for word in ("--set", f"{name}={value}")]
    arguments = ["--algorithm", "ppo", "--trials", "1", "--seeds", "2", *settings, "--steps", "100", "--runs", str(tmp_path)]
    assert tune.main(arguments) == 0
    command, result, *table = capsys.readouterr().out.splitlines()
    assert command == "# python -m train.tune " + " ".join(arguments)
    assert result.startswith("# trial 0: mean return ")
    assert table[0] == "[RoughTurning-v0]"
    assert {line.split(" = ")[0] for line in table[1:]} == set(algorithm_of("ppo").search)
    policies = sorted(tmp_path.rglob("policy.zip"))
    assert [path.parent.name for path in policies] == ["ppo-seed0", "ppo-seed1"]
    before = [path.stat().st_mtime_ns for path in policies]
    assert tune.main(arguments) == 0  # a finished trial is not repeated
    assert capsys.readouterr().out.splitlines() == [command, result, *table]
    assert [path.stat().st_mtime_ns for path in policies] == before
