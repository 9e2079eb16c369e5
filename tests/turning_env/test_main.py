"""The command line of the environment."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from turning_env import presets
from turning_env.__main__ import main


def test_the_schema_says_unit_and_range(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema"]) == 0
    schema = json.loads(capsys.readouterr().out)
    bar_length = schema["$defs"]["Workpiece"]["properties"]["bar_length"]
    assert bar_length["unit"] == "mm"
    assert bar_length["minimum"] == 1
    assert bar_length["maximum"] == 1e5
    assert schema["properties"]["base"]["anyOf"][0]["enum"] == list(presets())


CALLS = """
import numpy as np
from turning_env import IDS, RoughTurningEnv, Scenario
from turning_env.numerics.functions import exp, expm1, log
from turning_env.rendering.fields import Fields

for preset in IDS.values():
    env = RoughTurningEnv(preset)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    Fields(Scenario.load(preset)).along((0, 0), 0, np.zeros(3))
for function in (exp, expm1, log):
    function(np.ones(2))
"""
"""Calls of all that is compiled, in a process that logs what it compiles."""


@pytest.mark.slow
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_after_a_warm_up_nothing_is_left_to_compile(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["warm-up"]) == 0
    assert "MB of machine code in " in capsys.readouterr().out
    finished = subprocess.run(
        [sys.executable, "-c", CALLS],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    assert finished.stderr == ""
