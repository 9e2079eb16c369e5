"""Searches that share their trials, by a journal or by a database."""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import optuna
import pytest
from optuna.trial import TrialState

from tests.train.small import SCENARIO
from train import tune
from train.storage import opened
from turning_env.score.workers import Workers

TRIALS = 12


def slowly(task: tune.Task, setting: dict[str, Any]) -> tune.Played:
    """No training, but some time in which the other search gets on."""
    time.sleep(0.05)
    return tune.Played(1e5 * setting["learning_rate"], 0.0)


def search(folder: Path, storage: str) -> list[int]:
    """Search, two trials side by side; the numbers of the trials that were this process's."""
    from tests.train.test_tune import AtOnce

    done = []

    @contextmanager
    def here(count: int) -> Iterator[Workers]:
        yield Workers(AtOnce())

    def told(study: optuna.Study, trial: optuna.Trial, played: Any, task: tune.Task) -> None:
        done.append(trial.number)
        tell(study, trial, played, task)

    tell = tune._tell
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(tune, "processes", here)
        patched.setattr(tune, "evaluate", slowly)
        patched.setattr(tune, "_tell", told)
        tune.search(tune.Task("sac", "RoughTurning-v0", SCENARIO, 100, 1, folder), TRIALS, 2, storage=storage)
    return done


def main() -> None:
    """Searches on the storages named on standard input, one per line, and prints whose trials were its own."""
    print("ready", flush=True)
    for line in sys.stdin:
        print(search(Path("."), line.strip()), flush=True)


def test_two_processes_share_a_search(tmp_path: Path) -> None:
    command = [sys.executable, "-c", "from tests.train.test_storage import main; main()"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as other:
        assert other.stdin is not None
        assert other.stdout is not None
        try:
            assert other.stdout.readline() == "ready\n"
            for storage in (f"sqlite:///{tmp_path / 'trials.db'}", str(tmp_path / "new" / "trials.log")):
                print(storage, file=other.stdin, flush=True)
                mine = search(tmp_path, storage)
                others = json.loads(other.stdout.readline())
                study = optuna.load_study(study_name=None, storage=opened(storage))
                trials = study.get_trials(deepcopy=False)
                assert min(len(mine), len(others)) > 0
                assert sorted(mine + others) == [trial.number for trial in trials]
                assert TRIALS <= len(trials) <= TRIALS + 2
                assert {trial.state for trial in trials} == {TrialState.COMPLETE}
                settings = {tuple(trial.params.values()) for trial in trials}
                assert len(settings) >= len(trials) - 1  # both may have begun with what is known
        finally:
            other.kill()


@pytest.mark.parametrize(
    ("storage", "message"),
    [
        ("sqlite://nonsense:words/", "a study cannot be kept there: what is given is no database's URL"),
        ("cuneiform:///tablet", "a study cannot be kept in cuneiform:///tablet: Can't load plugin"),
        ("sqlite:////nowhere/at/all.db", "a study cannot be kept in sqlite:////nowhere/at/all.db: "),
        ("mysql://me:secret@localhost/trials", "a study cannot be kept in mysql://me:***@localhost/trials: "),
        ("sqlite:///FOLDER/text", "file is not a database"),
        ("FOLDER/text", "a study cannot be kept in FOLDER/text: "),
        ("FOLDER", "a study cannot be kept in FOLDER: "),
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
