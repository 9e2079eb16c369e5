import os
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.train.small import ALGORITHMS, PARAMETERS, SCENARIO
from train import tune
from train.run import hyperparameters
from turning_env.score.workers import Workers


class AtOnce(Executor):
    """Does everything when it is asked to, in this process."""

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:  # type: ignore[override]
        future: Future[Any] = Future()
        future.set_result(work(*arguments))
        return future


@contextmanager
def at_once(count: int) -> Iterator[Workers]:
    yield Workers(AtOnce())


def learning_rate_matters(task: tune.Task, setting: dict[str, Any]) -> tune.Played | str:
    """A landscape without any training: fast learning overloads, very fast learning fails."""
    if setting["learning_rate"] > 2.5e-3:
        return "not finite"
    return tune.Played(1e5 * setting["learning_rate"], 0.06 if setting["learning_rate"] > 1.5e-3 else 0.04)


@pytest.fixture
def task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tune.Task:
    monkeypatch.setattr(tune, "processes", at_once)
    monkeypatch.setattr(tune, "evaluate", learning_rate_matters)
    return tune.Task("sac", "RoughTurning-v0", SCENARIO, 100, 1, tmp_path)


def test_the_best_feasible_setting_wins(task: tune.Task, capsys: pytest.CaptureFixture[str]) -> None:
    best = tune.search(task, 12, 2)
    assert tune.feasible(best)
    assert 1e-3 <= best.params["learning_rate"] <= 1.5e-3  # the first trial is what is known: 1e-3
    assert best.value == pytest.approx(1e5 * best.params["learning_rate"])
    told = capsys.readouterr().err
    assert told.count("mean return") + told.count("came to nothing") == 12
    assert "came to nothing with" in told


def test_an_interrupted_search_finds_what_it_would_have(
    task: tune.Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    undisturbed = tune.search(task, 10, 1)
    told = capsys.readouterr().err
    again = tune.Task("sac", "RoughTurning-v0", SCENARIO, 100, 1, tmp_path / "again")

    def interrupted(task: tune.Task, setting: dict[str, Any]) -> tune.Played | str:
        raise KeyboardInterrupt

    tune.search(again, 4, 1)
    monkeypatch.setattr(tune, "evaluate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        tune.search(again, 10, 1)
    monkeypatch.setattr(tune, "evaluate", learning_rate_matters)
    resumed = tune.search(again, 10, 1)
    assert resumed.params == undisturbed.params
    settings = [line.partition(" with ")[2] for line in told.splitlines()]
    assert [line.partition(" with ")[2] for line in capsys.readouterr().err.splitlines()] == settings
    assert tune.search(again, 3, 1).params == undisturbed.params  # there is nothing left to do


def test_nothing_but_failures_is_an_error(task: tune.Task, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune, "evaluate", lambda task, setting: "not finite")
    with pytest.raises(ValueError, match="none of 3 trials came to anything"):
        tune.search(task, 3, 1)


def test_a_setting_is_trained_and_played(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune, "hyperparameters", lambda algorithm, env_id: hyperparameters(algorithm, env_id) | PARAMETERS["ppo"])
    monkeypatch.setattr(tune, "DRAWS", 3)
    task = tune.Task("ppo", "RoughTurning-v0", SCENARIO, 512, 2, tmp_path)
    played = tune.evaluate(task, {"discount": 0.5})
    assert isinstance(played, tune.Played)
    assert 0.0 <= played.severe_limit <= 1.0
    policies = sorted(tmp_path.rglob("policy.zip"))
    assert [path.parent.name for path in policies] == ["ppo-seed0", "ppo-seed1"]
    before = [path.stat().st_mtime_ns for path in policies]
    assert tune.evaluate(task, {"discount": 0.5}) == played  # what is trained is not trained again
    assert [path.stat().st_mtime_ns for path in policies] == before


@pytest.mark.parametrize("name", ALGORITHMS)
def test_what_is_known_lies_within_what_is_searched(name: str) -> None:
    known = hyperparameters(name, "RoughTurning-v0")
    for key, distribution in tune.algorithm_of(name).search.items():
        assert distribution._contains(distribution.to_internal_repr(known[key])), key


def test_every_algorithm_can_be_tuned() -> None:
    assert set(ALGORITHMS) == set(tune.ALGORITHMS)


def test_the_command_prints_a_table(task: tune.Task, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--algorithm", "sac", "--trials", "2", "--steps", "100", "--runs", str(tmp_path / "runs")]
    assert tune.main(arguments) == 0
    command, result, *table = capsys.readouterr().out.splitlines()
    assert command == "# python -m train.tune " + " ".join(arguments)
    assert result.startswith("# trial ")
    assert table[0] == "[RoughTurning-v0]"
    assert {line.split(" = ")[0] for line in table[1:]} == set(tune.algorithm_of("sac").search)


def test_wrong_arguments_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, message in (
        (["--algorithm", "dqn"], "invalid choice: 'dqn'"),
        (["--algorithm", "sac", "--trials", "0"], "--trials is 0, but must be 1 to"),
        (["--algorithm", "sac", "--workers", "-1"], "--workers is -1, but must be 1 to"),
    ):
        with pytest.raises(SystemExit):
            tune.main(arguments)
        assert message in capsys.readouterr().err
    assert tune.main(["--algorithm", "sac", "--scenario", f"nowhere{os.sep}"]) == 2
    assert "error: " in capsys.readouterr().err
