"""Run independent pieces of work in parallel.

They run in processes of this machine (joblib's loky), or on a Dask cluster. The program that starts
pieces takes each result as it comes, and only that program writes files. Pieces travel by
cloudpickle, with everything that they refer to.
"""

import os
import socket
import threading
import time
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from importlib import metadata
from signal import SIG_IGN, SIGINT, signal
from typing import Any

from leaderboard.agents.onnx_session import first_line
from turning_env.extras import needed
from turning_env.physics import MODEL_VERSION

MAX_CONNECTING = 20.0  # time to wait for a scheduler, and then for its first worker [s]

_AGAIN = "what is finished is kept: run the same command again to go on"
_PACKAGES = ("rough-turning", "numpy", "numba", "onnxruntime", "torch", "stable-baselines3")
_ONE_AT_A_TIME = threading.Lock()


class WorkersError(ValueError):
    """Workers are not available, or no longer available."""


class Workers:
    """Workers that do pieces of work. See ``processes`` and ``cluster``."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        # Read once: there are hundreds of pieces, and metadata takes a while to parse.
        self._wanted = _versions()
        self._tags: dict[Future[Any], Any] = {}

    def start(self, tag: Any, work: Callable[..., Any], *arguments: Any) -> None:
        """Hand ``work(*arguments)`` to a worker; ``finished`` returns its result with ``tag``."""
        self._tags[self._executor.submit(_do, self._wanted, work, *arguments)] = tag

    def finished(self) -> tuple[Any, Any]:
        """Wait until a started piece ends; return its tag and its result, or raise its error."""
        future = wait(self._tags, return_when=FIRST_COMPLETED).done.pop()
        return self._tags.pop(future), future.result()


@contextmanager
def processes(count: int) -> Iterator[Workers]:
    """Start processes of this machine; they end with the context, even if they are working.

    Raise WorkersError if one was killed.
    """
    from joblib.externals.loky import ProcessPoolExecutor  # type: ignore[import-untyped]

    executor = ProcessPoolExecutor(count, initializer=_begin, initargs=(os.getpid(),))
    try:
        yield Workers(executor)
    except BrokenExecutor as error:
        raise WorkersError(f"a process ended: {first_line(error)}; {_AGAIN}") from error
    finally:
        executor.shutdown(kill_workers=True)


@contextmanager
def cluster(address: str) -> Iterator[Workers]:
    """Connect to a Dask cluster at an address such as ``tcp://host:8786``.

    Its number of workers may change at any time. Other workers repeat the pieces of a lost one.
    Raise WorkersError if there are no workers, or several are lost over the same piece.
    """
    with needed(WorkersError):
        from distributed import Client, KilledWorker
    try:
        client = Client(  # type: ignore[no-untyped-call]
            address, timeout=MAX_CONNECTING, set_as_default=False
        )
        client.wait_for_workers(1, timeout=MAX_CONNECTING)
    except (OSError, ValueError) as error:
        raise WorkersError(
            f"no scheduler with workers can be reached at {address}: {first_line(error)}"
        ) from error
    with client:
        try:
            yield Workers(client.get_executor(pure=False))  # type: ignore[no-untyped-call]
        except (CancelledError, KilledWorker) as error:
            raise WorkersError(
                f"{address} has lost its workers: {first_line(error)}; {_AGAIN}"
            ) from error


def workers(jobs: int, scheduler: str | None) -> AbstractContextManager[Workers | None]:
    """Use a cluster if a scheduler's address is given, else ``jobs`` processes.

    The context is None if this process does all work.
    """
    if scheduler is not None:
        return cluster(scheduler)
    return processes(jobs) if jobs > 1 else nullcontext()


def spread(
    over: Workers | None, work: Callable[[Any], Any], pieces: Collection[tuple[Any, Any]]
) -> Iterator[tuple[Any, Any]]:
    """Yield the tag and the result of each piece as it ends.

    Without workers, pieces run one by one in this process.
    """
    if over is None:
        for tag, piece in pieces:
            yield tag, work(piece)
        return
    for tag, piece in pieces:
        over.start(tag, work, piece)
    for _ in pieces:
        yield over.finished()


def _begin(parent: int) -> None:
    """Prepare a new process to end soon after its parent.

    Otherwise it would wait for work forever if the parent is killed.
    """

    def end_with_parent() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    signal(SIGINT, SIG_IGN)  # the waiting process handles interruptions
    threading.Thread(target=end_with_parent, daemon=True).start()


def _do(wanted: dict[str, str], work: Callable[..., Any], *arguments: Any) -> Any:
    """Do a piece of work in a worker that has the ``wanted`` versions."""
    present = _versions()
    differing = []
    for name, version in wanted.items():
        if present[name] != version:
            differing.append(f"{name} {present[name]} instead of {version}")
    if differing:
        raise WorkersError(
            f"a worker on {socket.gethostname()} would give other results: "
            f"it has {', '.join(differing)}"
        )
    # A Dask worker may have several threads, but policies and trainings are not thread-safe.
    with _ONE_AT_A_TIME:
        return work(*arguments)


def _versions() -> dict[str, str]:
    """Return the versions of the model and of all packages on which results depend."""
    versions = {"model": str(MODEL_VERSION)} | dict.fromkeys(_PACKAGES, "none")
    for name in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return versions
