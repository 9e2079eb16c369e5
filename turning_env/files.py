"""How files are written, whole or not at all, and how a folder's files are told from what they were."""

import hashlib
import os
from collections.abc import Callable, Iterable
from pathlib import Path


def replace_file(target: Path, write: Callable[[Path], object]) -> None:
    """Have ``write`` fill a hidden file beside ``target``, then put it in the target's place; the folder is made.

    The hidden file keeps the target's suffix, as some writers choose the format by it or add one that is missing. It is
    removed if anything fails, and the target is then as it was. What it holds is on the disk before it takes the target's
    place, so that a loss of power leaves the one or the other.

    Raises:
        OSError: the folder or the file cannot be written; also whatever ``write`` raises.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    # Named by process, so that two that write the same target do not fill the same file.
    partial = target.with_name(f".partial-{os.getpid()}-{target.name}")
    try:
        write(partial)
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        partial.replace(target)
    finally:
        partial.unlink(missing_ok=True)


def digest_of_files(folder: Path, paths: Iterable[Path]) -> str:
    """SHA-256 over contents and names, as seen from ``folder``, of the paths that are files, in any order."""
    digest = hashlib.sha256()
    for path in sorted(paths):
        if path.is_file():
            digest.update(path.relative_to(folder).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()
