"""Results that ship with this package: the episodes' returns of every policy on the leaderboard of every id.

One file per id, JSON compressed with xz, made from the leaderboard's results by ``python -m leaderboard pack`` in a clone.
"""

import json
import lzma
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from turning_env.scoring.statistics import Floats

FOLDER = Path(__file__).parent / "shipped_results"


@dataclass(frozen=True)
class Played:
    """A policy's episodes on the held-out seeds: arrays of shape (training seeds, seeds); one row for a rule."""

    name: str
    kind: str
    """``rule``, ``agent`` or ``oracle``."""
    returns: Floats
    """[s of machine time]"""
    severe: Floats
    """Time with an excess above the tolerance [s]."""
    engaged: Floats
    """Cutting time [s]."""

    def first(self, count: int) -> "Played":
        """Return the first ``count`` seeds alone."""
        return Played(self.name, self.kind, self.returns[:, :count], self.severe[:, :count], self.engaged[:, :count])


@cache
def shipped(env_id: str) -> tuple[Played, ...]:
    """Return the results of every policy on an id's leaderboard, on the first held-out seeds.

    Raises:
        ValueError: the id has no leaderboard.
    """
    path = FOLDER / f"{env_id}.json.xz"
    if not path.is_file():
        known = sorted(each.name.removesuffix(".json.xz") for each in FOLDER.glob("*.json.xz"))
        raise ValueError(f"{env_id!r} has no results to compare with; ids with results: {', '.join(known)}")
    content = json.loads(unpacked(path))
    return tuple(
        Played(each["name"], each["kind"], *(np.array(each[name]) for name in ("returns", "severe", "engaged")))
        for each in content["policies"]
    )


def unpacked(path: Path) -> str:
    """Return the text of a file."""
    return lzma.decompress(path.read_bytes()).decode()
