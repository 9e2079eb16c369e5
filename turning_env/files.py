"""Read regular files of bounded size, write files whole or not at all, and lock and digest them."""

import errno
import hashlib
import json
import os
import shutil
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from filelock import FileLock, Timeout

MAX_BYTES = 100_000_000  # largest size of a file whose reader states no other
_PARTIAL = ".partial-"
_LOCK = ".lock"


def read_regular(path: Path, max_bytes: int = MAX_BYTES, *, follow_links: bool = True) -> bytes:
    """Return the content of a regular file.

    A pipe or a device may have no end, or wait for ever for whoever writes into it.

    Args:
        path: the file.
        max_bytes: largest size that is read.
        follow_links: whether the path may be a symbolic link to a file.

    Raises:
        OSError: there is no such file, it is a folder, a pipe or a device, or a link that is not
            followed, or it is too large. ``filename`` is the path, ``strerror`` says why.
    """
    if not follow_links and path.is_symlink():
        raise _refusal(errno.ELOOP, "is a link: give the file itself", path)
    # Some devices act when they are opened, so the kind of file is looked at before and after.
    _check_regular(path.stat(), path)
    # O_NONBLOCK: a pipe that was put there meanwhile has no writer. Some systems lack some flags.
    flags = os.O_RDONLY
    for name in ("O_NONBLOCK", "O_BINARY", "O_CLOEXEC"):
        flags |= getattr(os, name, 0)
    if not follow_links:
        flags |= getattr(os, "O_NOFOLLOW", 0)
    with os.fdopen(os.open(path, flags), "rb") as stream:
        _check_regular(os.fstat(stream.fileno()), path)
        content = stream.read(max_bytes + 1)
    if len(content) > max_bytes:
        raise _refusal(errno.EFBIG, f"is larger than {max_bytes} bytes", path)
    return content


def _check_regular(status: os.stat_result, path: Path) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise _refusal(
            errno.EINVAL, "is a folder, a pipe or a device, but must be a regular file", path
        )


def _refusal(code: int, reason: str, path: Path) -> OSError:
    return OSError(code, reason, str(path))


def replace_file(target: Path, write: Callable[[Path], object]) -> None:
    """Let ``write`` fill a file in a hidden folder beside ``target``, then rename it to ``target``.

    A missing folder is made. If anything fails, the target is unchanged, the hidden folder is
    removed, and OSError names the target. The file keeps the target's suffixes, because some
    writers choose the format by them. Its contents are on the disk before it is renamed.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        # The folder is new and this user's own, so that nobody can have put a link into it.
        with TemporaryDirectory(
            prefix=_PARTIAL, dir=target.parent, ignore_cleanup_errors=True
        ) as folder:
            # Not the target's name: what a killed process leaves is never taken for the target.
            partial = Path(folder, f"content{''.join(target.suffixes)}")
            write(partial)
            with partial.open("rb+") as file:
                os.fsync(file.fileno())
            partial.replace(target)
    except OSError as error:
        is_hidden = _PARTIAL in str(error.filename)
        if error.errno is not None and (error.filename is None or is_hidden):
            error.filename = str(target)
            error.filename2 = None
        raise


def write_file(target: Path, content: str | bytes) -> None:
    """Write a file whole or not at all, a text in UTF-8; see ``replace_file``."""
    encoded = content.encode() if isinstance(content, str) else content

    def write(partial: Path) -> None:
        partial.write_bytes(encoded)

    replace_file(target, write)


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
    """Lock a folder, and remove hidden folders that killed processes left in it.

    A missing folder is made. Processes that write into the same folder hold its lock while they
    write; otherwise the next one may remove their hidden folders. The lock ends with the process,
    also if it is killed.

    Args:
        folder: folder to lock.
        wait: wait for other processes instead of raising an error.

    Raises:
        ValueError: if another process has the lock.
    """
    with _locked(folder / _LOCK, folder, wait):
        for path in folder.glob(f"{_PARTIAL}*"):
            # What cannot be removed is not read, so it does no harm. A link's target stays.
            shutil.rmtree(path, ignore_errors=True)
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
