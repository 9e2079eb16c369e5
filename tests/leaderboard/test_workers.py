"""Every piece of work gives one result, or an error that says how to go on."""

import os
import signal
import time
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest

from leaderboard import workers
from leaderboard.workers import WorkersError, processes, spread
from tests.walking import until

PIECES = [(str(number), number) for number in range(5)]
TRIPLED = {name: 3 * number for name, number in PIECES}


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


@pytest.fixture(scope="module")
def process() -> Iterator[workers.Workers]:
    """A process that works for several tests."""
    with processes(1) as over:
        yield over


def test_without_processes_pieces_are_done_here_in_order() -> None:
    with workers.workers(1, None) as over:
        assert list(spread(over, lambda number: 3 * number, PIECES)) == list(TRIPLED.items())


@pytest.mark.slow
def test_a_process_does_all_pieces(process: workers.Workers) -> None:
    factor = 3  # travels with the function
    assert dict(spread(process, lambda number: factor * number, PIECES)) == TRIPLED


@pytest.mark.slow
def test_an_error_in_a_process_is_raised(process: workers.Workers) -> None:
    with pytest.raises(LookupError, match="no 4"):
        list(spread(process, fail, [("fails", 4)]))


@pytest.mark.slow
def test_a_process_ignores_an_interrupt(process: workers.Workers) -> None:
    assert list(spread(process, interrupted, [("ignored", 5)])) == [("ignored", 5)]


@pytest.mark.slow
def test_processes_end_with_the_context_though_they_work(tmp_path: Path) -> None:
    mark = tmp_path / "process"
    with processes(1) as over:
        over.start("long", sleep, mark)
        until(lambda: mark.exists() and mark.read_text() != "")
    number = int(mark.read_text())
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)


@pytest.mark.slow
def test_a_process_that_is_killed_is_an_error_that_says_how_to_go_on() -> None:
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
