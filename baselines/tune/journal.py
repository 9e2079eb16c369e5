"""Repair a journal of trials that a full disk or a killed process left with an incomplete last line."""

import sys
from pathlib import Path

from optuna.storages.journal import JournalFileOpenLock


def cut_off_half_line(path: Path) -> None:
    """Cut an incomplete last line off a journal, and print a notice. Its trial is played again.

    Optuna skips such a line when it reads, but appends the next one to it.

    Raises:
        OSError: the file cannot be read or written.
    """
    if not path.is_file() or _is_whole(path):
        return
    lock = JournalFileOpenLock(str(path))
    lock.acquire()  # another process may be in the middle of that line
    try:
        if not _is_whole(path):
            content = path.read_bytes()
            with path.open("r+b") as file:
                file.truncate(content.rfind(b"\n") + 1)
            print(f"{path} ended within a line, which is cut off: its trial is played again", file=sys.stderr)
    finally:
        lock.release()


def _is_whole(path: Path) -> bool:
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - 1, 0))
        return file.read() in (b"", b"\n")
