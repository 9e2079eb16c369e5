"""Files that are written whole or not at all, and folders that several processes write to."""

import errno
import hashlib
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # pragma: no cover - not on Linux or macOS
    fcntl = None  # type: ignore[assignment]

_PARTIAL = ".partial-"


def replace_file(target: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a hidden file beside ``target``, then rename it to ``target``; the folder is made if need be.

    If anything fails, the target stays as it was and the hidden file is removed. The hidden file keeps the target's suffix, by
    which some writers choose the format. Its contents are on the disk before it is renamed, so that a loss of power leaves the
    old file or the new one.

    Raises:
        OSError: The folder or the file cannot be written; it names the target. Also whatever ``write`` raises.
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


def digest_of_files(folder: Path, paths: Iterable[Path]) -> str:
    """Return the SHA-256 of the contents, and of the names relative to ``folder``, of all paths that are files, in any order."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        if path.is_file():
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


class FolderTaken(ValueError):
    """Another process holds the lock of a folder or a file."""


@contextmanager
def exclusive_lock(folder: Path, wait: bool = False) -> Iterator[None]:
    """Lock a folder, which is made if need be, against all other processes, and remove what killed ones left there.

    The system's lock on the folder itself ends with the process: a kill leaves nothing to clear away. File systems without locks
    are used without. ``wait`` for other processes instead of raising.

    Raises:
        FolderTaken: Another process holds a lock.
        OSError: The folder cannot be made or opened.
    """
    with _opened(folder) as handle:
        if not _lock(handle, shared=False, wait=wait):
            raise FolderTaken(f"another process works in {folder}: wait until it has finished, or choose another folder")
        _remove_partial_files(folder)
        yield


@contextmanager
def shared_lock(folder: Path) -> Iterator[None]:
    """Lock a folder against ``exclusive_lock`` only; the first process to come removes what killed ones left there.

    Raises:
        OSError: The folder cannot be made or opened.
    """
    with _opened(folder) as handle:
        if _lock(handle, shared=False, wait=False):
            _remove_partial_files(folder)
        _lock(handle, shared=True, wait=True)
        yield


@contextmanager
def file_lock(path: Path, wait: bool = False) -> Iterator[None]:
    """Lock a file, which is made if need be, against other processes; the rest of its folder stays free.

    ``wait`` for other processes instead of raising.

    Raises:
        FolderTaken: Another process holds the lock.
        OSError: The file cannot be made or opened.
    """
    with _opened(path, is_file=True) as handle:
        if not _lock(handle, shared=False, wait=wait):
            raise FolderTaken(f"another process works with {path}: wait until it has finished")
        yield


@contextmanager
def _opened(path: Path, is_file: bool = False) -> Iterator[int]:
    (path.parent if is_file else path).mkdir(parents=True, exist_ok=True)
    handle = os.open(path, os.O_RDONLY | (os.O_CREAT if is_file else 0), 0o666)
    try:
        yield handle
    finally:
        os.close(handle)


def _lock(handle: int, shared: bool, wait: bool) -> bool:
    """Return whether the lock is held, or this file system has none."""
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
