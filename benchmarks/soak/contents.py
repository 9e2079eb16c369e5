"""What a folder of results holds: whether every file can be read, and what of it must be alike from run to run."""

import csv
import json
import lzma
import zipfile
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

TIMES = {"wall_time"}
"""Columns that differ from run to run."""


def files(folder: Path) -> Iterator[Path]:
    """The files that count as results: neither what is hidden, being filled, nor TensorBoard's, which grow and are for people."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        if path.is_file() and "tensorboard" not in parts and not any(part.startswith(".") for part in parts):
            yield path


def unreadable(folder: Path) -> list[str]:
    """Which files cannot be read to their end, each with the reason."""
    return [f"{path}: {error!r}" for path in files(folder) if (error := _error(path))]


def contents(folder: Path) -> dict[str, str]:
    """Digests of what the files hold, but for times and journals, of which trials that were killed are a part."""
    return {
        str(path.relative_to(folder)): sha256(path.read_bytes() if _error(path) else _read(path)).hexdigest()
        for path in files(folder)
        if path.suffix != ".log" and path.name != "run.json"
    }


def _error(path: Path) -> Exception | None:
    try:
        _read(path)
    except Exception as error:  # of any reader
        return error
    return None


def _read(path: Path) -> bytes:
    content = path.read_bytes()
    if not content:
        raise ValueError("it is empty")
    match path.suffix:
        case ".xz":
            json.loads(lzma.decompress(content, format=lzma.FORMAT_XZ))
        case ".json":
            json.loads(content)
        case ".log":
            for line in content.splitlines():
                json.loads(line)
        case ".html":
            if not content.rstrip().endswith(b"</html>"):
                raise ValueError("it has no end")
        case ".csv":
            rows = list(csv.DictReader(content.decode("utf-8").splitlines()))
            kept = [{name: float(value) for name, value in row.items() if name not in TIMES} for row in rows]
            content = json.dumps(kept).encode()
        case ".zip":
            content = _weights(path)
    return content


def _weights(path: Path) -> bytes:
    """Weights and optimisers' states of a model of Stable-Baselines3; what is beside them names times and paths."""
    with zipfile.ZipFile(path) as archive:
        if (broken := archive.testzip()) is not None:
            raise ValueError(f"{broken} is broken in it")
        return b"".join(archive.read(name) for name in sorted(archive.namelist()) if name.endswith((".pth", ".pt")))
