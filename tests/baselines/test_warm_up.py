"""The warm-up of the rules: it compiles all that they call."""

import os
import subprocess
import sys

import pytest

from baselines.warm_up import warm_up
from tests.walking import ROOT

CALLS = """
from baselines import catalogue
from turning_env import RoughTurningVectorEnv, Scenario

for name in ("grid_search", "predictive"):
    for num_envs in (1, 3):
        envs = RoughTurningVectorEnv(num_envs)
        observations, _ = envs.reset(seed=0)
        catalogue.spec(name, Scenario()).make(num_envs).act(observations)
"""
"""First steps of rules, in a process that logs what it compiles."""


@pytest.mark.slow
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_after_a_warm_up_no_rule_is_left_to_compile() -> None:
    warm_up()
    finished = subprocess.run(
        [sys.executable, "-c", CALLS], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert finished.stderr == ""
