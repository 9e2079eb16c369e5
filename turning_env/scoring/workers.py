"""Run independent pieces of work in parallel: in processes of this machine, or on a Dask cluster.

The program that starts pieces takes each result as it comes, and only that program writes files. If a worker is killed, nothing
is lost: others repeat its pieces. Pieces travel by cloudpickle, with everything that they refer to.

Processes are those of joblib's loky. A cluster is used through ``distributed``. Joblib's backend ``"dask"`` returns results only
when all are there, does not notice pieces that failed for good, and loses larger arguments with a worker.
"""

import math
import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext, suppress
from importlib import metadata
from signal import SIG_IGN, SIGINT, signal
from typing import Any, TypeVar
from urllib.parse import urlsplit

from turning_env.physics import MODEL_VERSION

CONNECTING = 10.0
"""Time to wait for a scheduler, and then for its first worker [s]."""
PATIENCE = 60.0
"""Time that a cluster may have no workers before its work is abandoned [s]."""
ATTEMPTS = 3
"""Number of times in a row that processes may end before a piece is done."""

_POLL = 2.0  # [s]
_AGAIN = "what is finished is kept: run the same command again to go on"
_PACKAGES = ("rough-turning", "numpy", "numba", "onnxruntime", "torch", "stable-baselines3")

Tag = TypeVar("Tag")
Piece = TypeVar("Piece")
Outcome = TypeVar("Outcome")
_Started = tuple[Any, Callable[..., Any], tuple[Any, ...]]
"""A piece's tag, function and arguments."""


class WorkersError(ValueError):
    """Workers are not available, or no longer available."""


class Workers:
    """Processes that do pieces of work. See ``processes`` and ``cluster``."""

    def __init__(self, executor: Executor, max_pending: float = math.inf) -> None:
        """Hand at most ``max_pending`` pieces to the executor at a time."""
        self._executor = executor
        self._max_pending = max_pending
        self._pending: dict[Future[Any], _Started] = {}
        self._queue: deque[_Started] = deque()

    def start(self, tag: Any, work: Callable[..., Any], *arguments: Any) -> None:
        """Hand ``work(*arguments)`` to a worker; ``finished`` returns its result with ``tag``."""
        self._queue.append((tag, work, arguments))
        self._submit()

    def finished(self) -> tuple[Any, Any]:
        """Wait until a started piece ends, and return its tag and its result.

        Raises:
            WorkersError: No workers are left, or their versions differ from this process's.
            Exception: Whatever the work raised.
        """
        while True:
            ended = wait(self._pending, timeout=_POLL, return_when=FIRST_COMPLETED).done
            if not ended:
                self._check()
                continue
            future = ended.pop()
            piece = self._pending.pop(future)
            if self._lost(future):
                self._queue.appendleft(piece)
                self._submit()
                continue
            self._submit()
            try:
                return piece[0], future.result()
            except CancelledError as error:
                raise WorkersError(f"the connection to the scheduler was lost; {_AGAIN}") from error

    def _submit(self) -> None:
        while self._queue and len(self._pending) < self._max_pending:
            piece = self._queue.popleft()
            self._pending[self._executor.submit(_do, _versions(), piece[1], *piece[2])] = piece

    def _check(self) -> None:
        """Raise a ``WorkersError`` if no piece can ever end; called every few seconds while no piece ends."""

    def _lost(self, future: "Future[Any]") -> bool:
        """Return whether a piece failed because of its process, not its work."""
        return False


class _Processes(Workers):
    def __init__(self, count: int) -> None:
        self._count = count
        self._broken = 0
        super().__init__(self._pool(), max_pending=2 * count)  # each process has its next piece at hand

    def _pool(self) -> Executor:
        from joblib.externals.loky import ProcessPoolExecutor  # type: ignore[import-untyped]

        return ProcessPoolExecutor(self._count, initializer=_begin, initargs=(os.getpid(),))  # type: ignore[no-any-return]

    def _lost(self, future: "Future[Any]") -> bool:
        from joblib.externals.loky import BrokenProcessPool

        if future.cancelled() or not isinstance(error := future.exception(), BrokenProcessPool):
            self._broken = 0
            return False
        self._broken += 1
        if self._broken >= ATTEMPTS:
            raise WorkersError(f"processes ended {ATTEMPTS} times in a row: {_first_line(error)}; {_AGAIN}") from error
        self.close()
        self._executor = self._pool()
        for other in [each for each in self._pending if isinstance(each.exception(), BrokenProcessPool)]:
            self._queue.appendleft(self._pending.pop(other))
        return True

    def close(self) -> None:
        """End the processes, even if they are working."""
        start = time.monotonic()
        # Loky cannot kill its processes before each piece is on its way to one, which takes milliseconds for so few pieces.
        while not all(each.running() or each.done() for each in self._pending) and time.monotonic() - start < _POLL:
            time.sleep(0.001)
        self._executor.shutdown(wait=True, kill_workers=bool(self._pending))  # type: ignore[call-arg]


class _Cluster(Workers):
    def __init__(self, client: Any, address: str) -> None:
        self._client, self._address = client, address
        self._seen = time.monotonic()
        super().__init__(client.get_executor(pure=False))

    def _check(self) -> None:
        if self._client.nthreads():
            self._seen = time.monotonic()
        elif time.monotonic() - self._seen > PATIENCE:
            raise WorkersError(f"{self._address} has had no workers for {PATIENCE:.0f} s; {_AGAIN}")

    def _lost(self, future: "Future[Any]") -> bool:
        from distributed import KilledWorker

        if not future.cancelled() and isinstance(error := future.exception(), KilledWorker):
            raise WorkersError(f"several workers of {self._address} ended over the same piece of work; {_AGAIN}") from error
        return False


def _begin(parent: int) -> None:
    """Prepare a new process."""
    signal(SIGINT, SIG_IGN)  # the waiting process handles interruptions
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process soon after its parent; otherwise it would wait for work forever if the parent is killed."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def processes(count: int) -> AbstractContextManager[Workers]:
    """Start processes of this machine; they end with the context, even if they are working."""
    return closing(_Processes(count))


@contextmanager
def cluster(address: str) -> Iterator[Workers]:
    """Connect to a Dask cluster, whose number of workers may change at any time.

    Args:
        address: The scheduler's address, such as ``tcp://host:8786``.

    Raises:
        WorkersError: Dask is not installed, there is no scheduler at the address, it has no workers, or the address is malformed.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise WorkersError(f"a scheduler needs the extra 'distributed', which is not installed: {error}") from error
    try:
        _check_scheduler(address)
        client = Client(address, timeout=CONNECTING, set_as_default=False)  # type: ignore[no-untyped-call]
    except OSError as error:
        raise WorkersError(f"no scheduler can be reached at {address}: {_first_line(error)}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECTING)
        except TimeoutError as error:
            raise WorkersError(f"{address} has no workers: start some by 'dask worker {address} --nthreads 1'") from error
        yield _Cluster(client, address)


def _check_scheduler(address: str) -> None:
    """Check without Dask that a scheduler listens; Dask's client would wait forever for another kind of server.

    Raises:
        OSError: There is no scheduler.
        WorkersError: The address is malformed.
    """
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:  # the port is no number
        host = port = None
    if not host or not port or parts.scheme not in ("tcp", "tls"):
        raise WorkersError(f"the scheduler is {address!r}, but must be an address like tcp://host:8786")
    with socket.create_connection((host, port), timeout=CONNECTING) as connection, connection.makefile("rb") as stream:
        if parts.scheme == "tcp":  # with tls, the client speaks first
            length = stream.read(8)  # of the scheduler's greeting
            if len(length) < 8 or int.from_bytes(length, "little") > 1_000_000:
                raise OSError("what answers is no Dask scheduler")


def workers(jobs: int, scheduler: str | None) -> AbstractContextManager[Workers | None]:
    """Use a cluster if a scheduler's address is given, else ``jobs`` processes; None if this process does all work.

    Raises:
        WorkersError: See ``cluster``.
    """
    if scheduler is not None:
        return cluster(scheduler)
    return processes(jobs) if jobs > 1 else nullcontext()


def spread(
    over: Workers | None, work: Callable[[Piece], Outcome], pieces: Iterable[tuple[Tag, Piece]]
) -> Iterator[tuple[Tag, Outcome]]:
    """Yield the tag and the result of each piece as it ends; without workers, run pieces one by one in this process.

    Raises:
        WorkersError: See ``Workers.finished``.
        Exception: Whatever the work raised.
    """
    if over is None:
        for tag, piece in pieces:
            yield tag, work(piece)
        return
    count = 0
    for count, (tag, piece) in enumerate(pieces, 1):  # noqa: B007
        over.start(tag, work, piece)
    for _ in range(count):
        yield over.finished()


_ONE_AT_A_TIME = threading.Lock()


def _do(wanted: dict[str, str], work: Callable[..., Any], *arguments: Any) -> Any:
    """Do a piece of work in a worker that has the ``wanted`` versions."""
    mine = _versions()
    if other := [f"{name} {mine[name]} instead of {wanted[name]}" for name in wanted if mine[name] != wanted[name]]:
        raise WorkersError(f"a worker on {socket.gethostname()} would give other results: it has {', '.join(other)}")
    with _ONE_AT_A_TIME:  # a Dask worker may have several threads, but policies and trainings are not thread-safe
        return work(*arguments)


def _versions() -> dict[str, str]:
    """Return the versions of the model and of all packages on which results depend."""
    versions = {"model": str(MODEL_VERSION)} | dict.fromkeys(_PACKAGES, "none")
    for name in _PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            versions[name] = metadata.version(name)
    return versions


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
