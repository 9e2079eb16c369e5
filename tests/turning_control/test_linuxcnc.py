"""The HAL component with a fake HAL, the plant, and where it is installed LinuxCNC itself, with faults."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from itertools import groupby
from pathlib import Path

import numpy as np
import pytest

from tests.programs import LINUXCNC_ALONE, NO_LINUXCNC
from turning_control import linuxcnc
from turning_control.core import safe_feed
from turning_control.linuxcnc import Fault
from turning_control.plant import Plant
from turning_env import Scenario
from turning_env.scoring.policy import Actions, Observations

BRIDGE = Path(linuxcnc.__file__).parent / "lathe" / "hal_bridge.py"
PLAN = {"in": {"load": "float"}, "out": {"adaptive-feed": "float"}, "period": 0.3, "safe": {"adaptive-feed": 0.25}}
FAKE_HAL = """
HAL_IN = HAL_OUT = HAL_FLOAT = HAL_BIT = HAL_S32 = HAL_U32 = 0

class component(dict):
    def __init__(self, name):
        self.ready = self.exit = lambda: None

    def newpin(self, pin, kind, direction):
        dict.__setitem__(self, pin, 0)

    def __setitem__(self, pin, value):
        dict.__setitem__(self, pin, value)
        print(pin, value)
        if pin == "late" and value == 3:
            raise SystemExit
"""
POLICY = "import sys, time; print('ready', flush=True); sys.stdin.readline(); print('{{\"adaptive-feed\": 0.9}}', flush=True); {}"


@pytest.mark.slow
@pytest.mark.parametrize("then", ["time.sleep(60)", "sys.exit()", "print('{', end='', flush=True); time.sleep(60)"])
def test_a_process_that_stops_answering_leaves_the_safe_feed_after_one_period(then: str, tmp_path: Path) -> None:
    (tmp_path / "hal.py").write_text(FAKE_HAL)
    plan = tmp_path / "plan.json"
    plan.write_text(json.dumps({**PLAN, "command": [sys.executable, "-c", POLICY.format(then)]}))
    command, paths = [sys.executable, str(BRIDGE), "turning", str(plan)], os.environ | {"PYTHONPATH": str(tmp_path)}
    said = subprocess.run(command, env=paths, check=True, capture_output=True, text=True, timeout=60.0).stdout
    pins = [line.split() for line in said.splitlines()]
    assert [feed for feed, _ in groupby(value for pin, value in pins if pin == "adaptive-feed")] == ["0.25", "0.9", "0.25"]
    assert not Path(f"/proc/{next(value for pin, value in pins if pin == 'pid')}").exists()


@pytest.mark.slow
def test_the_plant_cuts_what_the_control_moves() -> None:
    scenario = Scenario.load("override")
    plant = Plant(scenario, 0)
    along, seen = 0.0, {}
    for _ in range(1500):
        along += 4.0 * 0.012
        seen = plant.advance(0.012, along, 710.0, 4.0, True)
    assert seen["power"] > 1.0
    assert seen["along"] == pytest.approx(along)
    standing = [plant.advance(0.012, along, 710.0, 0.0, False) for _ in range(50)][-1]
    assert standing["removed"] == pytest.approx(0.0, abs=1e-4)
    for back in np.linspace(along, 0.0, 20):  # a return at rapid brings the next bar, once
        plant.advance(0.012, back, 710.0, 0.0, False)
    again = [plant.advance(0.012, 0.05 * i, 710.0, 4.0, True) for i in range(100)][-1]
    assert (again["bar"], again["along"]) == (1.0, pytest.approx(4.95))
    assert again["power"] > 1.0


def test_the_program_holds_the_highest_feed() -> None:
    text = linuxcnc.program(Scenario.load("override"), bars=3)
    assert "F0.8" in text
    assert text.count("M52 P1\nG1 ") == 3


def test_without_linuxcnc_the_message_names_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(linuxcnc.LinuxCncError, match=linuxcnc.PACKAGE):
        linuxcnc.run("programmed", "override", 1, 0)


def test_the_figures_of_a_run() -> None:
    row = {"at_feed": 1.0, "bar": 0.0, "edge": 0.0, "power": 4.0, "delay": 0.006, "adaptive_feed": 0.5, "feed": 0.4, "along": 1.0}
    rows = [row | {"seconds": 11.0, "engaged_time": 10.0, "severe_overload_time": 0.1}] * 2
    assert linuxcnc.figures(rows, 0.25) == pytest.approx((22.0, 4.0, 0.01, 1.0, 0.0, 0.006))
    simulated = linuxcnc.simulated("programmed", Scenario.load("override"), 1, 0)
    assert "| programmed | simulation | 22.4" in linuxcnc.table({"programmed": (simulated, simulated)})  # docs/linuxcnc.md


def running() -> list[str]:
    """Return the command lines of processes that belong to the demo."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if any(name in line for name in ("hal_bridge.py", "panel.py", "turning_control serve", "milltask", "rtapi_app")):
            found.append(line)
    return found


needs_linuxcnc = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("linuxcnc") is None, reason=NO_LINUXCNC),
    pytest.mark.skipif("LINUXCNC" not in os.environ, reason=LINUXCNC_ALONE),
]
FAULTS = ["kill", "freeze", "policy", "sensor stuck", "sensor lost", "pause", "e-stop", "feed hold", "spindle stopped"]


def not_a_number(observations: Observations) -> Actions:
    return np.full((len(observations), 1), np.nan, np.float32)


@pytest.mark.parametrize("name", [pytest.param(name, marks=needs_linuxcnc) for name in FAULTS])
def test_faults_end_in_the_safe_feed_or_a_stop_and_leave_nothing_running(name: str) -> None:
    scenario = Scenario.load("override")
    policy = f"{__name__}:not_a_number" if name == "policy" else "programmed"
    rows = linuxcnc.run(policy, "override", 1, 0, Fault(name, after=5.0, lasts=2.0))
    held = sum(row["seconds"] for row in rows if abs(row["adaptive_feed"] - safe_feed(scenario)) < 1e-6)
    if name == "kill":
        assert max(row["along"] for row in rows) > scenario.workpiece.bar_length  # the program goes on at the safe feed
        assert held > 10.0
    elif name in ("freeze", "sensor stuck", "sensor lost"):
        assert held > 1.0
    else:
        assert max(row["feed"] for row in rows[-20:]) < 1e-3
    if name == "policy":  # held before the tool reaches the bar
        assert sum(row["removed"] for row in rows) == 0.0
    assert running() == []


@pytest.mark.parametrize("number", [pytest.param(each, marks=needs_linuxcnc) for each in (signal.SIGTERM, signal.SIGINT)])
def test_a_signal_ends_the_demo_with_all_its_processes(number: signal.Signals) -> None:
    command = [sys.executable, "-m", "turning_control", "demo", "--policies", "programmed"]
    demo = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    limit = time.monotonic() + 60.0
    while not any("panel.py" in line for line in running()) and time.monotonic() < limit:
        time.sleep(0.1)
    time.sleep(2.0)
    demo.send_signal(number)
    assert demo.wait(60.0) != 0
    assert running() == []
