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
    assert schema["properties"]["base"]["anyOf"][0]["enum"] == list(presets())
    assert (bar_length["unit"], bar_length["minimum"], bar_length["maximum"]) == ("mm", 1, 1e5)


@pytest.mark.slow
@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")
def test_after_a_warm_up_nothing_is_left_to_compile(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["warm-up"]) == 0
    assert "MB of machine code in " in capsys.readouterr().out
    code = "import logging, turning_env as t; from turning_env.rendering.fields import Fields; import numpy as np\n"
    code += "for env_id, preset in t.IDS.items():\n    env = t.RoughTurningEnv(preset); env.reset(seed=0)\n"
    code += "    env.step(env.action_space.sample()); Fields(t.Scenario.load(preset)).along((0, 0), 0, np.zeros(3))\n"
    again = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=True,
    )
    assert again.stderr == ""
