"""HAL components with a fake HAL, and where it is installed LinuxCNC itself, with faults."""

import importlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from turning_control import linuxcnc
from turning_control.linuxcnc import Fault
from turning_control.plant import Plant
from turning_env import Scenario
from turning_env.scoring.policy import Actions, Observations

SAFE = 0.25
PLAN = {"in": {"load": "float"}, "out": {"adaptive-feed": "float"}, "period": 0.3, "safe": {"adaptive-feed": SAFE}}
READY = "import sys, time, json; print('ready', flush=True); line = sys.stdin.readline(); "
ANSWER = "print(json.dumps({'adaptive-feed': 0.9}), flush=True); "


class Enough(Exception):
    """The test has seen what it wanted."""


class Component(dict[str, Any]):
    """A component of a fake HAL: ends the loop after some late periods."""

    def __init__(self, name: str) -> None:
        self.feeds: list[float] = []

    def newpin(self, pin: str, kind: int, direction: int) -> None:
        super().__setitem__(pin, 0)

    def ready(self) -> None:
        return

    def exit(self) -> None:
        return

    def __setitem__(self, pin: str, value: Any) -> None:
        super().__setitem__(pin, value)
        if pin == "adaptive-feed":
            self.feeds.append(value)
        if pin == "late" and value == 3:
            raise Enough


@pytest.mark.slow
@pytest.mark.parametrize("then", ["time.sleep(60)", "sys.exit()", "print('{', end='', flush=True); time.sleep(60)"])
def test_a_process_that_stops_answering_leaves_the_safe_feed_after_one_period(
    then: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Component] = []
    fake = SimpleNamespace(
        component=lambda name: made.append(Component(name)) or made[0], **dict.fromkeys(("HAL_IN", "HAL_OUT"), 0),
        **{f"HAL_{kind}": 0 for kind in ("FLOAT", "BIT", "S32", "U32")},
    )  # fmt: skip
    monkeypatch.setitem(sys.modules, "hal", fake)
    monkeypatch.delitem(sys.modules, "turning_control.lathe.hal_bridge", raising=False)
    bridge = importlib.import_module("turning_control.lathe.hal_bridge")
    path = tmp_path / "plan.json"
    path.write_text(json.dumps({**PLAN, "command": [sys.executable, "-c", READY + ANSWER + then]}))
    monkeypatch.setattr(bridge.signal, "signal", lambda *_: None)
    with pytest.raises(Enough):
        bridge.main("turning", str(path))
    assert [feed for feed, _ in groupby(made[0].feeds)] == [SAFE, 0.9, SAFE]
    assert not Path(f"/proc/{made[0]['pid']}").exists()


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
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(linuxcnc.LinuxCncError, match=linuxcnc.PACKAGE):
        linuxcnc.run("programmed", "override", 1, 0)


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
    pytest.mark.skipif(shutil.which("linuxcnc") is None, reason="LinuxCNC is not installed"),
    pytest.mark.skipif(
        "LINUXCNC" not in os.environ, reason="one LinuxCNC runs on a machine at a time: set LINUXCNC=1, with -n 0"
    ),
]
FAULTS = ["kill", "freeze", "policy", "sensor stuck", "sensor lost", "pause", "e-stop", "feed hold", "spindle stopped"]


def not_a_number(observations: Observations) -> Actions:
    return np.full((len(observations), 1), np.nan, np.float32)


@pytest.mark.parametrize("name", [pytest.param(name, marks=needs_linuxcnc) for name in FAULTS])
def test_faults_end_in_the_safe_feed_or_a_stop_and_leave_nothing_running(name: str) -> None:
    scenario = Scenario.load("override")
    policy = f"{__name__}:not_a_number" if name == "policy" else "programmed"
    rows = linuxcnc.run(policy, "override", 1, 0, Fault(name, after=5.0, lasts=2.0))
    safe = 0.5 * scenario.control.initial_feed / scenario.machine.feed_max
    held = sum(row["seconds"] for row in rows if abs(row["adaptive_feed"] - safe) < 1e-6)
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
