"""Put the returns of the leaderboards into the wheel, in compact form, for ``turning_env.score``.

python -m leaderboard.pack
"""

import argparse
import lzma
import sys
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

import numpy as np

from leaderboard.result import MANIFEST_FILE, Manifest, Result, ResultError, read_part, read_result, result_files, result_folder
from turning_env import IDS
from turning_env.console import described, exits
from turning_env.files import replace_file
from turning_env.scoring.packed import FOLDER, Played, as_text, unpacked


def played(folder: Path) -> list[Played]:
    """Return every policy on the task that is ranked in a folder, by name."""
    task = read_part(Manifest, folder / MANIFEST_FILE).task
    results = [each for each in (read_result(path, Result) for path in result_files(folder)) if each.task.digest == task.digest]
    results.sort(key=lambda each: (each.policy.name, each.policy.training_seed or 0))
    policies = []
    for name, group in groupby(results, key=lambda each: each.policy.name):
        same = list(group)
        fields = ("return", "severe_overload_time", "engaged_time")
        arrays = (np.array([each.episodes[field] for each in same]) for field in fields)
        policies.append(Played(name, same[0].policy.kind, *arrays))
    return policies


def contents(results: Path) -> dict[Path, str]:
    """Return the text of every id's file, made from a folder of results."""
    return {
        FOLDER / f"{env_id}.json.xz": as_text(env_id, played(result_folder(results, env_id, preset)))
        for env_id, preset in IDS.items()
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the file of every id."""
    parser = argparse.ArgumentParser(prog="python -m leaderboard.pack", **described(__doc__))
    parser.add_argument("--results", type=Path, default=Path("leaderboard/results"), metavar="FOLDER",
                        help="folder of results (default: %(default)s)")  # fmt: skip
    options = parser.parse_args(arguments)

    def run() -> int:
        for path, text in contents(options.results).items():
            if path.is_file() and unpacked(path) == text:
                continue
            content = lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME)
            replace_file(path, lambda partial, content=content: partial.write_bytes(content))  # type: ignore[misc]
            print(path)
        return 0

    return exits(ResultError)(run)()


if __name__ == "__main__":
    sys.exit(main())
