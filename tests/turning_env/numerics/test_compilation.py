"""Compiled or interpreted, in this process or another: the same numbers."""

import os
import pickle
import subprocess
import sys
from pathlib import Path

import pytest

from tests.turning_env.playing import (
    FAILING,
    HOT_SPINDLE,
    SHORT_LIVED,
    Record,
    assert_same_bytes,
    changed,
    fixed_actions,
    play,
)
from turning_env import RoughTurningEnv, Scenario, presets

REPOSITORY = Path(__file__).parents[3]
INTERPRETED = """
import pickle, sys
from tests.turning_env.numerics.test_compilation import plays

pickle.dump(plays(), sys.stdout.buffer)
"""


def play_of(scenario: Scenario, steps: int) -> Record:
    return play(RoughTurningEnv(scenario), 21, fixed_actions(steps, 1, scenario)[:, 0])


def plays() -> dict[str, Record]:
    """Return a few steps of every preset, and more that cross ends of episodes."""
    records = {}
    for preset in presets():
        steps = 2 if preset.startswith("batch") else 10
        records[preset] = play_of(Scenario.load(preset), steps)
    records["short_lived"] = play_of(SHORT_LIVED, 100)
    records["hot_spindle"] = play_of(HOT_SPINDLE, 40)
    records["failing"] = play_of(changed("rough_turning", **FAILING), 100)
    return records


@pytest.mark.slow
def test_an_interpreted_process_with_another_hash_seed_gives_the_same_bytes() -> None:
    variables = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONHASHSEED": "1"}
    command = [sys.executable, "-W", "error", "-c", INTERPRETED]
    run = subprocess.run(
        command,
        cwd=REPOSITORY,
        env=variables,
        capture_output=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr.decode()
    interpreted = pickle.loads(run.stdout)
    compiled = plays()
    assert interpreted.keys() == compiled.keys()
    for name, record in compiled.items():
        assert_same_bytes(interpreted[name], record)
