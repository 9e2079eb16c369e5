"""What a full disk or a killed process leaves of a journal of trials: whole lines, and at most half a line at its end."""

import sys
from pathlib import Path

from optuna.storages.journal import JournalFileOpenLock


def cut_off_half_line(path: Path) -> None:
    """Take a line that was never finished from a journal's end; says so. What it told of is done again.

    Optuna passes over such a line, and is then at odds with what it writes after it.

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
            print(f"{path} ended within a line, which is cut off: what it told of is done again", file=sys.stderr)
    finally:
        lock.release()


def _is_whole(path: Path) -> bool:
    with path.open("rb") as file:
        size = file.seek(0, 2)
        file.seek(max(size - 1, 0))
        return file.read() in (b"", b"\n")
