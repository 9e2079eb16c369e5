"""Move the results of a leaderboard into one file, and copy the returns into the wheel.

``leaderboard.score`` compares a user's policy with the returns in the wheel.
"""

import json
import lzma
from collections.abc import Collection, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from leaderboard.result import (
    MANIFEST_FILE,
    PACK_FILE,
    SUFFIX,
    Manifest,
    Result,
    ResultFile,
    read_file,
    read_part,
    read_results,
    result_files,
    result_folder,
    write_manifest,
    write_part,
)
from leaderboard.scoring import FOLDER, SHIPPED_FIELDS, SPLIT
from turning_env import FAMILY_ID, IDS
from turning_env.files import write_file
from turning_env.scenario.family import families

DIGITS = 2  # decimals of the times [s] in the wheel


def pack(folder: Path, without: Collection[str] = ()) -> bool:
    """Move the results on a folder's ranked task into one file; return whether anything changed.

    Results of the policies named in ``without`` are deleted.
    """
    task = read_part(Manifest, folder / MANIFEST_FILE).task
    results = [
        result
        for result in read_results(folder).values()
        if result.task.digest == task.digest and result.policy.name not in without
    ]
    pack_file = folder / PACK_FILE
    single_files = [
        path
        for path in result_files(folder)
        if path != pack_file and read_file(path)[0].task.digest == task.digest
    ]
    if not single_files and _holds(pack_file, results):
        return False
    write_part(ResultFile(task=task, results=results), pack_file)
    for path in single_files:
        path.unlink()
    write_manifest(folder, task)
    return True


def _holds(pack_file: Path, results: Sequence[Result]) -> bool:
    """Return whether a file holds these results and no others."""
    if not pack_file.is_file():
        return False
    checksums = [result.checksum for result in results]
    return [result.checksum for result in read_file(pack_file)] == checksums


class Board(NamedTuple):
    """A leaderboard whose results ship in the wheel."""

    file_name: str  # in the wheel
    env_id: str
    family: str | None  # of a family's id

    def folder(self, results: Path) -> Path:
        """Return its folder in a folder of results."""
        if self.family is None:
            return result_folder(results, self.env_id, IDS[self.env_id])
        return result_folder(results, self.env_id, f"{self.family}-{SPLIT}")


def boards() -> list[Board]:
    """Return all leaderboards whose results ship in the wheel."""
    shipped = [Board(f"{env_id}{SUFFIX}", env_id, family=None) for env_id in IDS]
    for family in families():
        shipped.append(Board(f"{FAMILY_ID}-{family}{SUFFIX}", FAMILY_ID, family=family))
    return shipped


def contents(results: Path) -> dict[Path, str]:
    """Return the text of each leaderboard's file in the wheel, made from a folder of results."""
    texts = {}
    for board in boards():
        present = list(read_results(board.folder(results)).values())
        texts[FOLDER / board.file_name] = returns_text(board.env_id, present)
    return texts


def returns_text(env_id: str, results: list[Result], **about: Any) -> str:
    """Return the episodes' returns and times of each policy as JSON, after facts about them."""
    results.sort(key=lambda result: (result.policy.title, result.policy.training_seed or 0))
    policies = []
    for name, group in groupby(results, key=lambda result: result.policy.title):
        trainings = list(group)
        policy: dict[str, Any] = {"name": name, "kind": trainings[0].policy.kind}
        for field, key in SHIPPED_FIELDS.items():
            policy[key] = _rounded(field, trainings)
        policies.append(policy)
    return json.dumps({"env_id": env_id, **about, "policies": policies}, allow_nan=False)


def _rounded(field: str, results: Sequence[Result]) -> Any:
    """Return a time of all episodes as lists, one per training seed."""
    times = [result.episodes[field] for result in results]
    return np.round(times, DIGITS).tolist()


def write_shipped(texts: Mapping[Path, str]) -> list[Path]:
    """Write the files in the wheel whose texts have changed, and return their paths."""
    written = []
    for path, text in texts.items():
        content = text.encode()
        # Compare texts: another version of xz may compress the same text to other bytes.
        if path.is_file() and lzma.decompress(path.read_bytes()) == content:
            continue
        write_file(path, lzma.compress(content, preset=9 | lzma.PRESET_EXTREME))
        written.append(path)
    return written
