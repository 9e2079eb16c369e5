"""Write files whole or not at all, digest contents, and lock files that several processes share."""

import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

_PARTIAL = ".partial-"
_LOCK = ".lock"


def replace_file(target: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a hidden file beside ``target``, then rename it to ``target``.

    A missing folder is made. If anything fails, the target is unchanged, the hidden file is
    removed, and OSError names the target. The hidden file keeps the target's suffix, because some
    writers choose the format by it. Its contents are on the disk before it is renamed.
    """
    # Named by process, so that two processes that write the same target do not fill the same file.
    partial = target.with_name(f"{_PARTIAL}{os.getpid()}-{target.name}")
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        write(partial)
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        partial.replace(target)
    except OSError as error:
        if error.errno is not None and str(error.filename) in ("None", str(partial)):
            error.filename = str(target)
            error.filename2 = None
        raise
    finally:
        partial.unlink(missing_ok=True)


def digest_of(value: Any) -> str:
    """Return the SHA-256 of a value that JSON can hold."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def digest_of_files(folder: Path, paths: Iterable[Path]) -> str:
    """Return the SHA-256 of the files' contents and of their names relative to ``folder``.

    Their order and folders among the paths do not count.
    """
    digest = hashlib.sha256()
    for path in sorted(paths):
        if path.is_file():
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0")
            digest.update(path.read_bytes())
    return digest.hexdigest()


@contextmanager
def folder_lock(folder: Path, wait: bool = False) -> Iterator[None]:
    """Lock a folder, and remove hidden files that killed processes left in it.

    A missing folder is made. Processes that write into the same folder hold its lock while they
    write; otherwise the next one may remove their hidden files. The lock ends with the process,
    also if it is killed.

    Args:
        folder: folder to lock.
        wait: wait for other processes instead of raising an error.

    Raises:
        ValueError: if another process has the lock.
    """
    with _locked(folder / _LOCK, folder, wait):
        for path in folder.glob(f"{_PARTIAL}*"):
            with suppress(OSError):  # a hidden file is not read, so it does no harm
                path.unlink(missing_ok=True)
        yield


def file_lock(path: Path, wait: bool = False) -> AbstractContextManager[None]:
    """Lock a file, which need not exist, but not its folder; see ``folder_lock``."""
    # On Windows nobody can read a file that is locked itself.
    return _locked(path.with_name(path.name + _LOCK), path, wait)


@contextmanager
def _locked(lock_file: Path, locked: Path, wait: bool) -> Iterator[None]:
    """Hold the lock of a file or a folder, whose lock file exists meanwhile."""
    lock_file.parent.mkdir(parents=True, exist_ok=True)
    lock = FileLock(lock_file)
    try:
        lock.acquire(timeout=-1 if wait else 0)
    except Timeout:
        raise ValueError(
            f"another process works in {locked}: "
            "wait until it has finished, or choose another place"
        ) from None
    try:
        yield
    finally:
        # A waiting process opens the file again at each attempt, and accepts no removed file.
        # Windows refuses to remove an open file; there, filelock removes it.
        with suppress(OSError):
            lock_file.unlink(missing_ok=True)
        lock.release()
