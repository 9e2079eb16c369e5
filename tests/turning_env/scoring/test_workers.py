"""Every piece of work gives one result, even if its process dies."""

import os
import signal
import socket
import threading
import time
from contextlib import suppress
from importlib import metadata
from pathlib import Path

import pytest

from tests.dask_cluster import dask_cluster
from turning_env.scoring import workers
from turning_env.scoring.workers import WorkersError, processes, spread

PIECES = [(str(number), number) for number in range(5)]


def square(number: int) -> int:
    return number * number


def die(number: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return number


def die_once(mark: Path) -> int:
    if not mark.exists():
        mark.touch()
        die(0)
    return 7


def sleep(mark: Path) -> None:
    mark.write_text(str(os.getpid()))
    time.sleep(600.0)


def fail(number: int) -> int:
    raise LookupError(f"no {number}")


def interrupted(number: int) -> int:
    os.kill(os.getpid(), signal.SIGINT)
    return number


def test_without_workers_pieces_are_done_here_in_order() -> None:
    with workers.workers(1, None) as over:
        assert list(spread(over, lambda number: number + 1, PIECES)) == [(str(number), number + 1) for number in range(5)]


@pytest.mark.slow
def test_processes_do_all_pieces_and_what_fails_is_raised(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "ATTEMPTS", 2)
    with processes(1) as over:
        factor = 3  # travels with the function
        assert dict(spread(over, lambda number: factor * number, PIECES)) == {str(number): 3 * number for number in range(5)}
        with pytest.raises(LookupError, match="no 4"):
            list(spread(over, fail, [("fails", 4)]))
        assert list(spread(over, interrupted, [("ignored", 5)])) == [("ignored", 5)]
        # A killed process is replaced and its pieces are done again; a piece that always kills its process is an error.
        mark = tmp_path / "mark"
        assert dict(spread(over, die_once, [("first", mark), ("second", mark)])) == {"first": 7, "second": 7}
        with pytest.raises(WorkersError, match=r"ended 2 times in a row: .*run the same command again to go on"):
            list(spread(over, die, [("dies", 0)]))
    with processes(1) as over:
        over.start("long", sleep, mark := tmp_path / "process")
        while not mark.exists() or not mark.read_text():
            time.sleep(0.01)
    with pytest.raises(ProcessLookupError):  # processes end with the context
        os.kill(int(mark.read_text()), 0)


@pytest.mark.slow
def test_workers_with_other_versions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    here = metadata.version("numpy")
    with processes(1) as over:
        monkeypatch.setattr(metadata, "version", lambda name: "1.0")
        with pytest.raises(WorkersError, match=rf"other results: it has .*numpy {here} instead of 1\.0"):
            list(spread(over, square, PIECES))


@pytest.mark.slow
def test_lost_cluster_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with dask_cluster(tmp_path, workers=0, DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES="0") as cluster:
        monkeypatch.setattr(workers, "CONNECTING", 5.0)  # long enough to connect beside other work
        with pytest.raises(WorkersError, match="has no workers"), workers.cluster(cluster.address):
            pass
        monkeypatch.setattr(workers, "CONNECTING", 60.0)
        cluster.add_worker()
        with workers.cluster(cluster.address) as over:
            assert dict(spread(over, square, PIECES)) == {str(number): square(number) for number in range(5)}
            with pytest.raises(WorkersError, match="ended over the same piece of work"):
                list(spread(over, die, [("dies", 0)]))
            monkeypatch.setattr(workers, "PATIENCE", 0.5)
            with pytest.raises(WorkersError, match="has had no workers"):
                list(spread(over, square, PIECES))
            over.start("never", square, 0)
            cluster.scheduler.kill()
            monkeypatch.setattr(workers, "PATIENCE", 60.0)
            with pytest.raises(WorkersError, match="the connection to the scheduler was lost"):
                over.finished()


@pytest.mark.slow
def test_server_that_is_no_scheduler_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "CONNECTING", 0.5)

    def greet() -> None:
        connection, _ = server.accept()
        with connection, suppress(ConnectionError):
            connection.sendall(b"SSH-2.0-OpenSSH")
            connection.recv(1)  # until the other hangs up

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=greet)
        thread.start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(WorkersError, match=f"no scheduler can be reached at {address}: "), workers.cluster(address):
            pass
        thread.join(10.0)
