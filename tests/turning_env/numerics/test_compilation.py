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


def every_play() -> dict[str, Record]:
    """A few steps of every scenario, and more that cross ends of episodes."""
    counts = {preset: 2 if preset.startswith("batch") else 20 for preset in presets()}
    records = {
        preset: play(RoughTurningEnv(preset), 21, fixed_actions(count, 1, preset)[:, 0])
        for preset, count in counts.items()
    }
    records["short_lived"] = play(RoughTurningEnv(SHORT_LIVED), 21, fixed_actions(100, 1)[:, 0])
    records["hot_spindle"] = play(
        RoughTurningEnv(HOT_SPINDLE), 21, fixed_actions(40, 1, HOT_SPINDLE)[:, 0]
    )
    records["failing"] = play(
        RoughTurningEnv(changed(Scenario(), **FAILING)), 21, fixed_actions(100, 1)[:, 0]
    )
    return records


@pytest.mark.slow
def test_an_interpreted_process_with_another_hash_seed_gives_the_same_bytes() -> None:
    code = "import pickle, sys; from tests.turning_env.numerics.test_compilation import every_play as play; "
    code += "pickle.dump(play(), sys.stdout.buffer)"
    variables = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONHASHSEED": "1"}
    command = [sys.executable, "-W", "error", "-c", code]
    run = subprocess.run(command, cwd=REPOSITORY, env=variables, capture_output=True, check=False)
    assert run.returncode == 0, run.stderr.decode()
    interpreted = pickle.loads(run.stdout)
    for name, record in every_play().items():
        assert_same_bytes(interpreted[name], record)
