"""The collection of programs, each with its stock and tools."""

import functools
import tomllib
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.walking import ROOT

pytest.importorskip("shapely")

from turning_env import Scenario
from turning_env.programs.blocks import read_program_file
from turning_env.programs.cutting import Machine, Situation
from turning_env.programs.moves import Moves, run
from turning_env.programs.stock import Removal, read_stock, remove

FOLDER = ROOT / "examples" / "programs"
COLLECTION = tomllib.loads((FOLDER / "collection.toml").read_text())
WITHOUT_CYCLES = [name for name, entry in COLLECTION.items() if not entry.get("cycles")]
SCENARIO = Scenario.load("rough_turning")


@dataclass(frozen=True)
class Case:
    path: Path
    moves: Moves
    removal: Removal

    def situation(self, machine: Machine | None = None) -> Situation:
        return Situation(SCENARIO, machine or Machine(), self.moves, self.removal)


@functools.cache
def case(name: str) -> Case:
    path = next(path for path in FOLDER.iterdir() if path.stem == name and path.suffix in (".nc", ".mpf"))
    moves = run(read_program_file(path))
    entry = COLLECTION[name]
    return Case(path, moves, remove(moves, read_stock(entry["stock"]), entry.get("tools", {})))
