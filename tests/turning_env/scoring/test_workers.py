"""Every piece of work gives one result, or an error that says how to go on."""

import os
import signal
import time
from importlib import metadata
from pathlib import Path

import pytest

from turning_env.scoring import workers
from turning_env.scoring.workers import WorkersError, processes, spread

PIECES = [(str(number), number) for number in range(5)]


def die(number: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return number


def sleep(mark: Path) -> None:
    mark.write_text(str(os.getpid()))
    time.sleep(600.0)


def fail(number: int) -> int:
    raise LookupError(f"no {number}")


def interrupted(number: int) -> int:
    os.kill(os.getpid(), signal.SIGINT)
    return number


@pytest.mark.slow
def test_processes_do_all_pieces_and_end_with_the_context(tmp_path: Path) -> None:
    factor = 3  # travels with the function
    mark = tmp_path / "process"
    expected = [(str(number), 3 * number) for number in range(5)]
    with workers.workers(1, None) as here:
        # In this process, in order.
        assert list(spread(here, lambda number: factor * number, PIECES)) == expected
    with processes(1) as over:
        assert dict(spread(over, lambda number: factor * number, PIECES)) == dict(expected)
        with pytest.raises(LookupError, match="no 4"):
            list(spread(over, fail, [("fails", 4)]))
        assert list(spread(over, interrupted, [("ignored", 5)])) == [("ignored", 5)]
        over.start("long", sleep, mark)
        while not mark.exists() or not mark.read_text():
            time.sleep(0.01)
    with pytest.raises(ProcessLookupError):
        os.kill(int(mark.read_text()), 0)
    message = r"a process ended: .*run the same command again to go on"
    with pytest.raises(WorkersError, match=message), processes(1) as over:
        list(spread(over, die, [("dies", 0)]))


@pytest.mark.slow
# Workers are killed with work left, which a thread of joblib's executor does not always survive.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_workers_with_other_versions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    message = rf"other results: it has .*numpy {metadata.version('numpy')} instead of 1\.0"
    monkeypatch.setattr(metadata, "version", lambda name: "1.0")
    with processes(1) as over, pytest.raises(WorkersError, match=message):
        list(spread(over, abs, PIECES))


def test_a_scheduler_that_is_not_there_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "MAX_CONNECTING", 0.1)
    with (
        pytest.raises(WorkersError, match="no scheduler with workers"),
        workers.cluster("tcp://127.0.0.1:1"),
    ):
        pass
