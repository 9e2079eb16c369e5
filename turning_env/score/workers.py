"""Pieces of work that need nothing of one another, done at the same time: in processes of this machine, or on a Dask cluster.

What plays, tunes or verifies starts pieces and takes each as it ends, whoever does them; it alone writes files. So a worker that
is killed loses nothing: its pieces are done again by others. Pieces travel by cloudpickle, with all that they need.

Processes are those of joblib, its loky. For a cluster, ``distributed`` is spoken to directly and not through joblib's backend
``"dask"``. That one gives results only when all are there, so that what is finished could not be kept; it does not notice pieces
that have failed for good; and it puts larger arguments into the memory of a worker, with which they are lost.
"""

import math
import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from signal import SIG_IGN, SIGINT, signal
from typing import Any, TypeVar
from urllib.parse import urlsplit

import baselines
from turning_env.numerics.compilation import source_digest

CONNECTING = 10.0
"""How long a scheduler, and then a first worker of it, is waited for [s]."""
PATIENCE = 60.0
"""How long a cluster may be without any worker before its work is given up [s]."""
ATTEMPTS = 3
"""So many times in a row may processes end without any piece being done."""

_POLL = 2.0  # [s]
_MAX_GREETING = 1_000_000  # bytes
_AGAIN = "what is finished is kept: run the same command again to go on"
_VERSIONS = ("rough-turning", "numpy", "numba", "onnxruntime", "torch", "stable-baselines3")

Tag = TypeVar("Tag")
Piece = TypeVar("Piece")
Outcome = TypeVar("Outcome")


class WorkersError(ValueError):
    """Workers that cannot be had, or not any more."""


@dataclass(frozen=True)
class _Begun:
    tag: Any
    work: Callable[..., Any]
    arguments: tuple[Any, ...]


class Workers:
    """Processes that do pieces of work. See ``processes`` and ``cluster``."""

    def __init__(self, executor: Executor, most: float = math.inf) -> None:
        """Of what is started, the executor has ``most`` pieces at a time."""
        self._executor = executor
        self._most = most
        self._begun: dict[Future[Any], _Begun] = {}
        self._waiting: deque[_Begun] = deque()

    def start(self, tag: Any, work: Callable[..., Any], *arguments: Any) -> None:
        """Have ``work(*arguments)`` done by one of them; ``tag`` says afterwards which piece it was."""
        self._waiting.append(_Begun(tag, work, arguments))
        self._submit_waiting()

    def finished(self) -> tuple[Any, Any]:
        """Wait until a piece that was started ends, and give its tag and what came of it.

        Raises:
            WorkersError: there are no workers any more, or they do not run this code.
            Exception: what the work itself raised.
        """
        while True:
            ended = wait(self._begun, timeout=_POLL, return_when=FIRST_COMPLETED).done
            if not ended:
                self._check()
                continue
            future = ended.pop()
            begun = self._begun.pop(future)
            if self._lost(future):
                self._again(begun)
                continue
            self._submit_waiting()
            try:
                return begun.tag, future.result()
            except CancelledError as error:
                raise WorkersError(f"the connection to the scheduler was lost; {_AGAIN}") from error

    def _submit_waiting(self) -> None:
        while self._waiting and len(self._begun) < self._most:
            begun = self._waiting.popleft()
            self._begun[self._executor.submit(_do, _code(), begun.work, *begun.arguments)] = begun

    def _check(self) -> None:
        """Called every few seconds in which nothing ends; raises a ``WorkersError`` if nothing ever will."""

    def _lost(self, future: "Future[Any]") -> bool:
        """Whether a piece has ended because of the process and not of the work."""
        return False

    def _again(self, *lost: _Begun) -> None:
        """Start pieces again."""
        self._waiting.extendleft(lost)
        self._submit_waiting()


class _Processes(Workers):
    def __init__(self, count: int) -> None:
        self._count = count
        self._broken = 0
        super().__init__(self._pool(), most=2 * count)  # each has its next piece at hand

    def _pool(self) -> Executor:
        from joblib.externals.loky import ProcessPoolExecutor  # type: ignore[import-untyped]

        pool: Executor = ProcessPoolExecutor(self._count, initializer=_begin, initargs=(os.getpid(),))
        return pool

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
        others = [each for each in self._begun if isinstance(each.exception(), BrokenProcessPool)]
        self._again(*(self._begun.pop(each) for each in others))
        return True

    def close(self) -> None:
        """End the processes, whatever they do."""
        start = time.monotonic()
        # Loky fails at killing its processes before each piece is on its way to one. That takes milliseconds for so few pieces.
        while not all(each.running() or each.done() for each in self._begun) and time.monotonic() - start < _POLL:
            time.sleep(0.001)
        self._executor.shutdown(wait=True, kill_workers=bool(self._begun))  # type: ignore[call-arg]


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
    """The first that a process does."""
    signal(SIGINT, SIG_IGN)  # an interruption is for the process that waits to handle
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process soon after its parent, which cannot do so itself if it is killed; else it would wait for ever for work."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


@contextmanager
def processes(count: int) -> Iterator[Workers]:
    """So many processes of this machine; they are ended, whatever they do, when the context is."""
    workers = _Processes(count)
    try:
        yield workers
    finally:
        workers.close()


@contextmanager
def cluster(address: str) -> Iterator[Workers]:
    """The workers of a Dask cluster, as many as it has at any time.

    Args:
        address: the scheduler's, such as ``tcp://host:8786``.

    Raises:
        WorkersError: Dask is not installed, there is no scheduler at the address, or it has no workers; or it is no address.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise WorkersError(f"a scheduler needs the extra 'distributed', which is not installed: {error}") from error
    try:
        _see_scheduler(address)
        client = Client(address, timeout=CONNECTING, set_as_default=False)  # type: ignore[no-untyped-call]
    except OSError as error:
        raise WorkersError(f"no scheduler can be reached at {address}: {_first_line(error)}") from error
    with client:
        try:
            client.wait_for_workers(1, timeout=CONNECTING)
        except TimeoutError as error:
            raise WorkersError(f"{address} has no workers: start some by 'dask worker {address} --nthreads 1'") from error
        yield _Cluster(client, address)


def _see_scheduler(address: str) -> None:
    """See that there is a scheduler without Dask, whose client waits for ever for what is none but listens.

    Raises:
        OSError: there is none.
        WorkersError: it is no address.
    """
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
    except ValueError:  # of the port
        host = port = None
    if not host or not port or parts.scheme not in ("tcp", "tls"):
        raise WorkersError(f"the scheduler is {address!r}, but must be an address like tcp://host:8786")
    with socket.create_connection((host, port), timeout=CONNECTING) as connection, connection.makefile("rb") as stream:
        if parts.scheme == "tcp":  # by tls it says nothing to us
            greeting = stream.read(8)  # the length of what it says of itself
            if len(greeting) < 8 or int.from_bytes(greeting, "little") > _MAX_GREETING:
                raise OSError("what answers is no Dask scheduler")


@contextmanager
def workers(jobs: int, scheduler: str | None) -> Iterator[Workers | None]:
    """Those of a cluster if there is a scheduler's address, else so many processes; None if one is enough: this one.

    Raises:
        WorkersError: see ``cluster``.
    """
    if scheduler is not None:
        with cluster(scheduler) as found:
            yield found
    elif jobs > 1:
        with processes(jobs) as found:
            yield found
    else:
        yield None


def spread(
    over: Workers | None, work: Callable[[Piece], Outcome], pieces: Iterable[tuple[Tag, Piece]]
) -> Iterator[tuple[Tag, Outcome]]:
    """What comes of each piece, with its tag, as they end; without workers one after another, in this process.

    Raises:
        WorkersError: see ``Workers.finished``.
        Exception: what the work itself raised.
    """
    if over is None:
        for tag, piece in pieces:
            yield tag, work(piece)
        return
    started = 0
    for tag, piece in pieces:
        over.start(tag, work, piece)
        started += 1
    for _ in range(started):
        yield over.finished()


_AT_A_TIME = threading.Lock()


def _do(code: dict[str, str], work: Callable[..., Any], *arguments: Any) -> Any:
    """Done by a worker."""
    mine = _code()
    if other := [f"{name} {mine[name]} in place of {wanted}" for name, wanted in code.items() if mine[name] != wanted]:
        raise WorkersError(f"a worker on {socket.gethostname()} would come to other results: it has {', '.join(other)}")
    with _AT_A_TIME:  # a Dask worker may have several threads, for which neither policies nor trainings are made
        return work(*arguments)


@cache  # what has been imported goes on working, even if its file is changed meanwhile
def _code() -> dict[str, str]:
    """What a result depends on beside its piece of work."""
    clone = Path(baselines.__path__[0]).parent
    folders = sorted(path.parent for path in clone.glob("*/__init__.py"))
    return {folder.name: source_digest(folder)[:16] for folder in folders} | {name: _version(name) for name in _VERSIONS}


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return "none"


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
