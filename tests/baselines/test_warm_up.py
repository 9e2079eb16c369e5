"""The warm-up compiles all that environments, readings and rules call."""

import os
import subprocess
import sys

import pytest

from baselines.warm_up import main
from tests.walking import ROOT

CALLS = """
import numpy as np
from baselines import catalogue
from turning_env import IDS, RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.numerics.functions import exp, expm1, log
from turning_env.rendering.fields import Fields

for preset in IDS.values():
    env = RoughTurningEnv(preset)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    Fields(Scenario.load(preset)).along((0, 0), 0, np.zeros(3))
for function in (exp, expm1, log):
    function(np.ones(2))
for name in ("grid_search", "predictive"):
    for num_envs in (1, 3):
        envs = RoughTurningVectorEnv(num_envs)
        observations, _ = envs.reset(seed=0)
        catalogue.spec(name, Scenario()).make(num_envs).act(observations)
"""
"""Calls of all that is compiled, in a process that logs what it compiles."""


@pytest.mark.slow
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_after_a_warm_up_nothing_is_left_to_compile(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 0
    assert "MB of machine code in " in capsys.readouterr().out
    finished = subprocess.run(
        [sys.executable, "-c", CALLS], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert finished.stderr == ""
