"""A stand-in for Python does what Python does."""

import os
import subprocess
from pathlib import Path

import pytest

from tests import preloaded

FAILS = """
import os, sys, numpy
print(os.environ["COLOUR"], os.getcwd())
print("a failure", file=sys.stderr)
sys.exit(3)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        pytest.param(["-W", "error"], id="in_a_fork"),
        pytest.param([], id="in_a_process_of_its_own"),
    ],
)
def test_a_stand_in_passes_on_streams_variables_and_status(
    options: list[str], tmp_path: Path
) -> None:
    preloaded.write_stand_in(tmp_path / "python", max_seconds=60.0)
    finished = subprocess.run(
        [str(tmp_path / "python"), *options, "-c", FAILS],
        cwd=tmp_path,
        env=os.environ | {"COLOUR": "blue"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert finished.returncode == 3
    assert finished.stdout == f"blue {tmp_path}\n"
    assert finished.stderr == "a failure\n"


@pytest.mark.slow
def test_a_command_that_takes_too_long_is_ended(tmp_path: Path) -> None:
    preloaded.write_stand_in(tmp_path / "python", max_seconds=0.2)
    program = "import time; time.sleep(60)"
    finished = subprocess.run(
        [str(tmp_path / "python"), "-W", "error", "-c", program], cwd=tmp_path, check=False
    )
    # 128 and the number of SIGALRM, as a shell has it.
    assert finished.returncode == 142
