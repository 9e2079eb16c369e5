"""Programs killed by SIGKILL at any moment: the short form of ``make soak``."""

import os
import subprocess
import sys
from pathlib import Path
from random import Random

import pytest

from tests.walking import MAX_SECONDS, ROOT, until
from tools import soak

BRIEF = 'base = "override"\nname = "brief"\n[control]\ntime_limit = 0.05\n'
"""Episodes of three seconds: what a kill can break is the files, which short ones write, too."""


def leaderboard(folder: Path) -> int:
    """Play a few rules on short episodes."""
    # Beside the folders, because the results that are compared contain its path.
    scenario = folder.parent / "brief.toml"
    scenario.write_text(BRIEF, "utf-8")
    return soak.leaderboard(folder, more=("--seeds", "4", "--scenario", str(scenario)))


@pytest.mark.slow
@pytest.mark.parametrize(
    "program",
    [pytest.param(soak.training, marks=pytest.mark.soak), soak.tuning_of_rules, leaderboard],
    ids=["training", "tuning of rules", "leaderboard"],
)
def test_a_killed_program_goes_on_to_what_it_makes_undisturbed(
    program: soak.Program, tmp_path: Path
) -> None:
    toll = soak.kill(program, 1, tmp_path, Random(4))
    assert toll.kills == 1
    assert toll.torn == toll.differing == toll.orphans == 0, toll
    assert soak.contents(tmp_path / "undisturbed")


PARENT = """
import runpy, sys
from leaderboard.workers import processes
with processes(1) as over:
    over.start("long", runpy.run_path, sys.argv[1])
    over.finished()
"""
# Longer than the test waits for its end.
LONG = f"""
import os, pathlib, time
pathlib.Path(__file__).with_suffix(".number").write_text(str(os.getpid()))
time.sleep({2 * MAX_SECONDS})
"""


@pytest.mark.slow
def test_processes_end_though_who_started_them_is_killed(tmp_path: Path) -> None:
    program = tmp_path / "long.py"
    mark = tmp_path / "long.number"
    program.write_text(LONG)
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, str(program)], cwd=ROOT, stderr=subprocess.DEVNULL
    ) as parent:
        until(lambda: mark.exists() and mark.read_text() != "")
        parent.kill()
    number = int(mark.read_text())
    until(lambda: _has_ended(number))


def _has_ended(number: int) -> bool:
    try:
        os.kill(number, 0)
    except ProcessLookupError:
        return True
    # Where nobody takes its status, an ended process stays as a zombie.
    status = Path(f"/proc/{number}/stat")
    return status.exists() and status.read_text().rpartition(")")[2].split()[0] == "Z"
