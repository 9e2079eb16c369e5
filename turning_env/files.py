"""Write files whole or not at all, digest contents, and lock files and folders that several processes share."""

import errno
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # pragma: no cover - not on Linux or macOS
    fcntl = None  # type: ignore[assignment]

_PARTIAL = ".partial-"


def replace_file(target: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a hidden file beside ``target``, then rename it to ``target``; make the folder if it is missing.

    If anything fails, the target is unchanged, the hidden file is removed, and OSError names the target. The hidden file keeps
    the target's suffix, because some writers choose the format by it. Its contents are on the disk before it is renamed.
    """
    # Named by process, so that two processes that write the same target do not fill the same file.
    partial = target.with_name(f"{_PARTIAL}{os.getpid()}-{target.name}")
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        try:
            write(partial)
            with partial.open("rb+") as file:
                os.fsync(file.fileno())
            partial.replace(target)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:
        if error.errno is not None and str(error.filename) in ("None", str(partial)):
            error.filename, error.filename2 = str(target), None
        raise


def digest_of(value: Any) -> str:
    """Return the SHA-256 of a value that JSON can hold."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def digest_of_files(folder: Path, paths: Iterable[Path]) -> str:
    """Return the SHA-256 of the files' contents and of their names relative to ``folder``; order and folders do not count."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        if path.is_file():
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


class FolderTaken(ValueError):
    """Another process holds the lock of a folder or a file."""


@contextmanager
def exclusive_lock(folder: Path, wait: bool = False) -> Iterator[None]:
    """Lock a folder, made if missing, and remove hidden files that killed processes left; FolderTaken if another has a lock.

    The operating system releases the lock when the process ends, also if it is killed. On file systems without locks, nothing is
    locked. ``wait``: wait for other processes instead of raising an error.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with _opened(folder, os.O_RDONLY) as handle:
        if not _lock(handle, shared=False, wait=wait):
            raise FolderTaken(f"another process works in {folder}: wait until it has finished, or choose another folder")
        _remove_partial_files(folder)
        yield


@contextmanager
def shared_lock(folder: Path) -> Iterator[None]:
    """Lock a folder against ``exclusive_lock`` only; the first process removes hidden files that killed processes left there."""
    folder.mkdir(parents=True, exist_ok=True)
    with _opened(folder, os.O_RDONLY) as handle:
        if _lock(handle, shared=False, wait=False):
            _remove_partial_files(folder)
        _lock(handle, shared=True, wait=True)
        yield


@contextmanager
def file_lock(path: Path, wait: bool = False) -> Iterator[None]:
    """Lock a file, not its folder, as ``exclusive_lock`` locks a folder; make the file if it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with _opened(path, os.O_RDONLY | os.O_CREAT) as handle:
        if not _lock(handle, shared=False, wait=wait):
            raise FolderTaken(f"another process works with {path}: wait until it has finished")
        yield


@contextmanager
def _opened(path: Path, flags: int) -> Iterator[int]:
    handle = os.open(path, flags, 0o666)
    try:
        yield handle
    finally:
        os.close(handle)


def _lock(handle: int, shared: bool, wait: bool) -> bool:
    """Return whether the lock is held; true if the file system has no locks."""
    if fcntl is None:  # pragma: no cover
        return True
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB))
    except OSError as error:
        return error.errno not in (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES)
    return True


def _remove_partial_files(folder: Path) -> None:
    for path in folder.glob(f"{_PARTIAL}*"):
        with suppress(OSError):  # a hidden file is not read, so it does no harm
            path.unlink(missing_ok=True)
