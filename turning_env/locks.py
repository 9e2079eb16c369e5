"""Programs that write into one folder at the same time, and what a killed one leaves there.

A folder is held by a lock of the system on the folder itself, which ends with the process, however that ends: nothing needs to
be cleared away after a kill, and no file of it is seen. Where a file system has no such locks, programs go on without.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # pragma: no cover - not on Linux or macOS
    fcntl = None  # type: ignore[assignment]

LEFT_OVER = ".partial-*"
"""What ``turning_env.files.replace_file`` was filling when its process was killed."""


class FolderTaken(ValueError):
    """Another process works in the folder."""


@contextmanager
def exclusive_lock(folder: Path, wait: bool = False) -> Iterator[None]:
    """Be the only one in a folder, which is made if need be, and clear away what a killed process has left.

    Args:
        folder: where.
        wait: wait until others have done; without, they are an error.

    Raises:
        FolderTaken: another process is in it.
        OSError: the folder cannot be made or opened.
    """
    with _opened(folder) as handle:
        if not _lock(handle, shared=False, wait=wait):
            raise FolderTaken(f"another process works in {folder}: wait until it has done, or choose another folder")
        _clear(folder)
        yield


@contextmanager
def file_lock(path: Path) -> Iterator[None]:
    """Be the only one who works with a file, which is made if need be; others in its folder are let be.

    Raises:
        FolderTaken: another process works with it.
        OSError: it cannot be made or opened.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    handle = os.open(path, os.O_RDONLY | os.O_CREAT, 0o666)
    try:
        if not _lock(handle, shared=False, wait=False):
            raise FolderTaken(f"another process works with {path}: wait until it has done")
        yield
    finally:
        os.close(handle)


@contextmanager
def shared_lock(folder: Path) -> Iterator[None]:
    """Work in a folder in which others may too; whoever comes first clears away what a killed process has left.

    Raises:
        OSError: the folder cannot be made or opened.
    """
    with _opened(folder) as handle:
        if _lock(handle, shared=False, wait=False):
            _clear(folder)
        _lock(handle, shared=True, wait=True)
        yield


@contextmanager
def _opened(folder: Path) -> Iterator[int]:
    folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(folder, os.O_RDONLY)
    try:
        yield handle
    finally:
        os.close(handle)


def _lock(handle: int, shared: bool, wait: bool) -> bool:
    """Whether the lock is had, or there are none on this file system."""
    if fcntl is None:  # pragma: no cover
        return True
    try:
        fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB))
    except OSError as error:
        return error.errno not in (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES)
    return True


def _clear(folder: Path) -> None:
    for path in folder.glob(LEFT_OVER):
        try:
            path.unlink(missing_ok=True)
        except OSError:  # it does no harm: what is hidden is not read
            continue
