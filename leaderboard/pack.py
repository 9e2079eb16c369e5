"""Move the results of a leaderboard into one file, and put the returns into the wheel, for ``turning_env.score``."""

import json
import lzma
from collections.abc import Collection
from itertools import groupby
from pathlib import Path

import numpy as np

from leaderboard.result import (
    MANIFEST_FILE,
    PACK_FILE,
    SUFFIX,
    Manifest,
    ResultFile,
    read_file,
    read_part,
    read_results,
    result_files,
    result_folder,
    write_manifest,
    write_part,
    write_whole,
)
from turning_env import FAMILY_ID, IDS
from turning_env.scenario.family import families
from turning_env.scoring.score import FOLDER, SPLIT

DIGITS = 2  # decimals of the times [s] in the wheel


def pack(folder: Path, without: Collection[str] = ()) -> bool:
    """Move the results on a folder's ranked task, but not of some policies, into one file; return whether anything changed."""
    task = read_part(Manifest, folder / MANIFEST_FILE).task
    ranked = (each for each in read_results(folder).values() if each.task.digest == task.digest)
    packed = [each for each in ranked if each.policy.name not in without]
    own = [
        path
        for path in result_files(folder)
        if path.name != PACK_FILE and read_file(path)[0].task.digest == task.digest
    ]
    path = folder / PACK_FILE
    if (
        not own
        and path.is_file()
        and [each.checksum for each in read_file(path)] == [each.checksum for each in packed]
    ):
        return False
    write_part(ResultFile(task=task, results=packed), path)
    for each in own:
        each.unlink()
    write_manifest(folder, task)
    return True


def contents(results: Path) -> dict[Path, str]:
    """Return the text of each board's file in the wheel, made from a folder of results: the episodes' times by policy."""
    found = {}
    boards = {env_id: (env_id, scenario) for env_id, scenario in IDS.items()}
    boards |= {f"{FAMILY_ID}-{family}": (FAMILY_ID, f"{family}-{SPLIT}") for family in families()}
    for board, place in boards.items():
        ranked = list(read_results(result_folder(results, *place)).values())
        ranked.sort(key=lambda each: (each.policy.title, each.policy.training_seed or 0))
        policies = []
        for name, group in groupby(ranked, key=lambda each: each.policy.title):
            same = list(group)
            fields = {
                "returns": "return",
                "severe": "severe_overload_time",
                "engaged": "engaged_time",
            }
            times = {
                key: np.round([each.episodes[field] for each in same], DIGITS).tolist()
                for key, field in fields.items()
            }
            policies.append({"name": name, "kind": same[0].policy.kind} | times)
        found[FOLDER / f"{board}{SUFFIX}"] = json.dumps(
            {"env_id": place[0], "policies": policies}, allow_nan=False
        )
    return found


def write_shipped(results: Path) -> list[Path]:
    """Write the files in the wheel that have changed, and return their paths."""
    made = {path: text.encode() for path, text in contents(results).items()}
    changed = {
        path: text
        for path, text in made.items()
        if not path.is_file() or lzma.decompress(path.read_bytes()) != text
    }
    for path, text in changed.items():
        write_whole(path, lzma.compress(text, preset=9 | lzma.PRESET_EXTREME))
    return list(changed)
