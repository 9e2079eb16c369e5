from collections.abc import Callable
from concurrent.futures import Executor, Future
from pathlib import Path
from typing import Any

import pytest
from optuna.trial import FrozenTrial

from tests.train.small import PARAMETERS, SCENARIO
from train import tune
from turning_env.scoring.workers import Workers


class AtOnce(Executor):
    """Does everything when it is asked to, in this process."""

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:  # type: ignore[override]
        future: Future[Any] = Future()
        future.set_result(work(*arguments))
        return future


def learning_rate_matters(task: tune.Task, setting: dict[str, Any]) -> tune.Evaluation | str:
    """A landscape without any training: fast learning overloads, very fast learning fails."""
    if setting["learning_rate"] > 2.5e-3:
        return "not finite"
    return tune.Evaluation(1e5 * setting["learning_rate"], 0.06 if setting["learning_rate"] > 1.5e-3 else 0.04)


def search(folder: Path, trials: int, parallel: int = 1, evaluate: Any = learning_rate_matters) -> FrozenTrial:
    """Tune without training."""
    task = tune.Task("sac", "RoughTurning-v0", SCENARIO, 100, 1, folder)
    return tune.search(task, trials, Workers(AtOnce()), parallel, evaluate=evaluate)


def test_the_best_feasible_setting_wins(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    best = search(tmp_path, 12, 2)
    assert tune.feasible(best)
    assert 1e-3 <= best.params["learning_rate"] <= 1.5e-3  # the first trial is the known setting: 1e-3
    assert best.value == pytest.approx(1e5 * best.params["learning_rate"])
    told = capsys.readouterr().err
    assert told.count("mean return") + told.count("failed with") == 12
    assert "failed with" in told
    with pytest.raises(ValueError, match="all 3 trials failed"):
        search(tmp_path / "other", 3, evaluate=lambda task, setting: "not finite")


def test_an_interrupted_search_finds_what_it_would_have(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def settings() -> list[str]:
        return [line.partition(" with ")[2] for line in capsys.readouterr().err.splitlines()]

    def interrupted(task: tune.Task, setting: dict[str, Any]) -> tune.Evaluation | str:
        raise KeyboardInterrupt

    undisturbed, again = search(tmp_path, 10), tmp_path / "again"
    expected = settings()
    search(again, 4)
    with pytest.raises(KeyboardInterrupt):
        search(again, 10, evaluate=interrupted)
    (journal,) = again.rglob("*.log")
    journal.write_bytes(journal.read_bytes() + b'{"op')  # a killed process may leave half a line
    assert search(again, 10).params == undisturbed.params
    assert settings() == expected
    assert search(again, 3).params == undisturbed.params  # there is nothing left to do


@pytest.mark.slow
def test_the_command_trains_plays_and_prints_a_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    settings = [word for name, value in (PARAMETERS["ppo"] | {"epochs": 3}).items() for word in ("--set", f"{name}={value}")]
    arguments = ["--algorithm", "ppo", "--trials", "1", "--seeds", "2", *settings, "--steps", "100", "--runs", str(tmp_path)]
    assert tune.main(arguments) == 0
    command, result, *table = capsys.readouterr().out.splitlines()
    assert command == "# python -m train.tune " + " ".join(arguments)
    assert result.startswith("# trial 0: mean return ")
    assert table[0] == "[RoughTurning-v0]"
    assert {line.split(" = ")[0] for line in table[1:]} == set(tune.algorithm_of("ppo").search)
    policies = sorted(tmp_path.rglob("policy.zip"))
    assert [path.parent.name for path in policies] == ["ppo-seed0", "ppo-seed1"]
    before = [path.stat().st_mtime_ns for path in policies]
    assert tune.main(arguments) == 0  # a finished trial is not repeated
    assert capsys.readouterr().out.splitlines() == [command, result, *table]
    assert [path.stat().st_mtime_ns for path in policies] == before
