import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import optuna
import pytest
from optuna.trial import TrialState

from tests.train.small import PARAMETERS, SCENARIO
from train import tune
from train.run import hyperparameters
from turning_env.scoring.workers import Workers


class AtOnce(Executor):
    """Does everything when it is asked to, in this process."""

    def submit(self, work: Callable[..., Any], *arguments: Any) -> Future[Any]:  # type: ignore[override]
        future: Future[Any] = Future()
        future.set_result(work(*arguments))
        return future


@contextmanager
def at_once(count: int) -> Iterator[Workers]:
    yield Workers(AtOnce())


def learning_rate_matters(task: tune.Task, setting: dict[str, Any]) -> tune.Evaluation | str:
    """A landscape without any training: fast learning overloads, very fast learning fails."""
    if setting["learning_rate"] > 2.5e-3:
        return "not finite"
    return tune.Evaluation(1e5 * setting["learning_rate"], 0.06 if setting["learning_rate"] > 1.5e-3 else 0.04)


def task_in(folder: Path) -> tune.Task:
    return tune.Task("sac", "RoughTurning-v0", SCENARIO, 100, 1, folder)


@pytest.fixture
def task(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tune.Task:
    monkeypatch.setattr(tune, "processes", at_once)
    monkeypatch.setattr(tune, "evaluate", learning_rate_matters)
    return task_in(tmp_path)


def test_the_best_feasible_setting_wins(task: tune.Task, capsys: pytest.CaptureFixture[str]) -> None:
    best = tune.search(task, 12, 2)
    assert tune.feasible(best)
    assert 1e-3 <= best.params["learning_rate"] <= 1.5e-3  # the first trial is the known setting: 1e-3
    assert best.value == pytest.approx(1e5 * best.params["learning_rate"])
    told = capsys.readouterr().err
    assert told.count("mean return") + told.count("failed with") == 12
    assert "failed with" in told


def test_an_interrupted_search_finds_what_it_would_have(
    task: tune.Task, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def settings() -> list[str]:
        return [line.partition(" with ")[2] for line in capsys.readouterr().err.splitlines()]

    undisturbed = tune.search(task, 10, 1)
    expected = settings()
    again = task_in(tmp_path / "again")

    def interrupted(task: tune.Task, setting: dict[str, Any]) -> tune.Evaluation | str:
        raise KeyboardInterrupt

    tune.search(again, 4, 1)
    monkeypatch.setattr(tune, "evaluate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        tune.search(again, 10, 1)
    monkeypatch.setattr(tune, "evaluate", learning_rate_matters)
    assert tune.search(again, 10, 1).params == undisturbed.params
    assert settings() == expected
    assert tune.search(again, 3, 1).params == undisturbed.params  # there is nothing left to do


def test_nothing_but_failures_is_an_error(task: tune.Task, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune, "evaluate", lambda task, setting: "not finite")
    with pytest.raises(ValueError, match="all 3 trials failed"):
        tune.search(task, 3, 1)


@pytest.mark.slow
def test_a_setting_is_trained_and_played(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tune, "hyperparameters", lambda algorithm, env_id: hyperparameters(algorithm, env_id) | PARAMETERS["ppo"])
    monkeypatch.setattr(tune, "NUM_EPISODES", 3)
    task = tune.Task("ppo", "RoughTurning-v0", SCENARIO, 512, 2, tmp_path)
    found = tune.evaluate(task, {"discount": 0.5})
    assert isinstance(found, tune.Evaluation)
    assert 0.0 <= found.severe_limit <= 1.0
    policies = sorted(tmp_path.rglob("policy.zip"))
    assert [path.parent.name for path in policies] == ["ppo-seed0", "ppo-seed1"]
    before = [path.stat().st_mtime_ns for path in policies]
    assert tune.evaluate(task, {"discount": 0.5}) == found  # a finished training is not repeated
    assert [path.stat().st_mtime_ns for path in policies] == before


def test_the_command_prints_a_table(task: tune.Task, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["--algorithm", "sac", "--trials", "2", "--steps", "100", "--runs", str(tmp_path / "runs")]
    assert tune.main(arguments) == 0
    command, result, *table = capsys.readouterr().out.splitlines()
    assert command == "# python -m train.tune " + " ".join(arguments)
    assert result.startswith("# trial ")
    assert table[0] == "[RoughTurning-v0]"
    assert {line.split(" = ")[0] for line in table[1:]} == set(tune.algorithm_of("sac").search)


def share_a_study(folder: Path, storage: str, trials: int) -> None:
    """Search with a shared storage, without training, two trials at a time."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(tune, "processes", at_once)
        patched.setattr(tune, "evaluate", learning_rate_matters)
        tune.search(task_in(folder), trials, 2, storage=storage)


OTHER = "import sys; from pathlib import Path; from tests.train.test_tune import share_a_study as share; "


@pytest.mark.slow
@pytest.mark.parametrize("storage", ["sqlite:///FOLDER/trials.db", "FOLDER/new/trials.log"])
def test_processes_share_a_study(storage: str, tmp_path: Path) -> None:
    """One goes on with the other's trials, and then both at the same time, whichever of these is quicker."""
    storage = storage.replace("FOLDER", str(tmp_path))

    def other(trials: int) -> "subprocess.Popen[bytes]":
        return subprocess.Popen([sys.executable, "-c", f"{OTHER}share(Path({str(tmp_path)!r}), {storage!r}, {trials})"])

    def trials() -> list[optuna.trial.FrozenTrial]:
        return optuna.load_study(study_name=None, storage=tune.open_storage(storage)).get_trials(deepcopy=False)

    share_a_study(tmp_path, storage, 4)
    assert len(trials()) == 4
    both = other(12)
    share_a_study(tmp_path, storage, 12)
    assert both.wait() == 0
    found = trials()
    assert [trial.number for trial in found] == list(range(len(found)))
    assert 12 <= len(found) <= 14  # each completes the trials that it began
    assert {trial.state for trial in found} <= {TrialState.COMPLETE, TrialState.PRUNED}
    assert len({tuple(trial.params.values()) for trial in found}) == len(found)


@pytest.mark.parametrize(
    ("storage", "message"),
    [
        ("sqlite://nonsense:words/", "a study cannot be kept there: it is not the URL of a database"),
        ("cuneiform:///tablet", "a study cannot be kept in cuneiform:///tablet: Can't load plugin"),
        ("mysql://me:secret@localhost/trials", "a study cannot be kept in mysql://me:***@localhost/trials: "),
        ("FOLDER/text", "a study cannot be kept in FOLDER/text: "),
    ],
)
def test_bad_storages_are_refused(storage: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "text").write_text("This is no list of trials, however one reads it.\n" * 100)
    arguments = ["--algorithm", "sac", "--runs", str(tmp_path / "runs"), "--storage", storage.replace("FOLDER", str(tmp_path))]
    assert tune.main(arguments) == 2
    told = capsys.readouterr().err
    assert told.startswith("error: ")
    assert message.replace("FOLDER", str(tmp_path)) in told
    assert "secret" not in told
