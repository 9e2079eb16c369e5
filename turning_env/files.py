"""Write files whole or not at all, digest contents, and lock files that several processes share."""

import errno
import hashlib
import json
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # pragma: no cover - not on Linux or macOS
    fcntl = None  # type: ignore[assignment]

_PARTIAL = ".partial-"


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
def folder_lock(folder: Path, wait: bool = False, shared: bool = False) -> Iterator[None]:
    """Lock a folder, and remove hidden files that killed processes left in it.

    A missing folder is made. The operating system releases the lock when the process ends, also if
    it is killed. On file systems without locks, nothing is locked.

    Args:
        folder: folder to lock.
        wait: wait for other processes instead of raising an error.
        shared: lock against locks that are not shared, and wait for them; only the first process
            removes hidden files.

    Raises:
        ValueError: if another process has a lock.
    """
    if not folder.exists():
        folder.mkdir(parents=True, exist_ok=True)
    handle = os.open(folder, os.O_RDONLY)
    try:
        # Also a process that shares the lock tries to be alone first, to remove hidden files.
        if _locked(handle, wait and not shared):
            for path in folder.glob(f"{_PARTIAL}*"):
                with suppress(OSError):  # a hidden file is not read, so it does no harm
                    path.unlink(missing_ok=True)
        elif not shared:
            raise ValueError(
                f"another process works in {folder}: "
                "wait until it has finished, or choose another place"
            )
        if shared:
            _locked(handle, wait=True, shared=True)
        yield
    finally:
        os.close(handle)


def file_lock(path: Path, wait: bool = False) -> AbstractContextManager[None]:
    """Lock a file, made if missing, but not its folder; see ``folder_lock``."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return folder_lock(path, wait)


def _locked(handle: int, wait: bool, shared: bool = False) -> bool:
    """Return whether the lock is held; true if the file system has no locks."""
    if not fcntl:
        return True
    operation = fcntl.LOCK_SH if shared else fcntl.LOCK_EX
    if not wait:
        operation |= fcntl.LOCK_NB
    try:
        fcntl.flock(handle, operation)
    except OSError as error:
        held_by_other = error.errno in (errno.EWOULDBLOCK, errno.EAGAIN, errno.EACCES)
        return not held_by_other
    return True
