"""The HAL component with a fake HAL, the plant, and where it is installed LinuxCNC itself, with faults."""

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from itertools import groupby
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from turning_control import linuxcnc
from turning_control.core import safe_feed
from turning_control.linuxcnc import Fault
from turning_control.plant import Plant

from tests.programs import LINUXCNC_ALONE, NO_LINUXCNC
from turning_env import Scenario
from turning_env.scoring.policy import Actions, Observations

BRIDGE = Path(linuxcnc.__file__).parent / "lathe" / "hal_bridge.py"
PLAN = {
    "in": {"load": "float"},
    "out": {"adaptive-feed": "float"},
    "period": 0.3,
    "safe": {"adaptive-feed": 0.25},
}
FAKE_HAL = """
HAL_IN = HAL_OUT = HAL_FLOAT = HAL_BIT = HAL_S32 = HAL_U32 = 0

class component(dict):
    def __init__(self, name):
        self.ready = self.exit = lambda: None

    def newpin(self, pin, kind, direction):
        dict.__setitem__(self, pin, 0)

    def __setitem__(self, pin, value):
        dict.__setitem__(self, pin, value)
        print(pin, value, flush=True)
        if pin == "late" and value == 3:
            raise SystemExit
"""
POLICY = "import sys, time; print('ready', flush=True); sys.stdin.readline(); print('{{\"adaptive-feed\": 0.9}}', flush=True); {}"


def bridged(plan: dict[str, Any], folder: Path) -> list[tuple[str, str]]:
    """Return the pins that the component sets, in order, until it has counted three periods without an answer."""
    (folder / "hal.py").write_text(FAKE_HAL)
    path = folder / "plan.json"
    path.write_text(json.dumps(plan))
    command, paths = (
        [sys.executable, str(BRIDGE), "turning", str(path)],
        os.environ | {"PYTHONPATH": str(folder)},
    )
    said = subprocess.run(
        command, env=paths, check=True, capture_output=True, text=True, timeout=60.0
    ).stdout
    return [(line.split()[0], line.split()[1]) for line in said.splitlines()]


def held(pins: list[tuple[str, str]], name: str = "adaptive-feed") -> list[str]:
    """Return the values that a pin takes one after the other."""
    return [value for value, _ in groupby(value for pin, value in pins if pin == name)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "then", ["time.sleep(60)", "sys.exit()", "print('{', end='', flush=True); time.sleep(60)"]
)
def test_a_process_that_stops_answering_leaves_the_safe_feed_after_one_period(
    then: str, tmp_path: Path
) -> None:
    pins = bridged({**PLAN, "command": [sys.executable, "-c", POLICY.format(then)]}, tmp_path)
    assert held(pins) == ["0.25", "0.9", "0.25"]
    assert not Path(f"/proc/{next(value for pin, value in pins if pin == 'pid')}").exists()


OUTPUTS = {"adaptive-feed": "float", "spindle-override": "float", "status": "s32", "coolant": "bit"}
SAFE = {"adaptive-feed": 0.25, "spindle-override": 1.0, "status": 3, "coolant": False}
ANSWERING = """
import json, os, sys
lines = LINES
print("ready", flush=True)
older = None
for request in sys.stdin:
    time = json.loads(request)["time"]
    right = {"time": time, "adaptive-feed": 0.75, "spindle-override": 1.0, "status": 1, "coolant": True}
    wrong = lines.pop(0) if lines else None
    if wrong is None:
        break
    if "OLDER" in wrong:
        right["time"] = older or 0.0
        wrong = "RIGHT" + chr(10)
    text = wrong.replace("RIGHT", json.dumps(right)).replace("TIME", json.dumps(time))
    os.write(1, text.encode("latin-1") + bytes(10 * (not text)))
    older = time
"""
VALID = '"spindle-override": 1.0, "status": 1, "coolant": true'


def answering(lines: list[str], folder: Path, **plan: Any) -> list[tuple[str, str]]:
    """Return the pins that the component sets while a process answers its requests with lines, then ends."""
    script = folder / "answering.py"
    script.write_text(ANSWERING.replace("LINES", repr(lines)))
    fixed = {"in": {"load": "float"}, "out": OUTPUTS, "period": 0.4, "safe": SAFE, "echo": True}
    return bridged({**fixed, "command": [sys.executable, str(script)], **plan}, folder)


def outputs(text: str, **changed: Any) -> str:
    """Return an answer with a text in place of the feed, and some values changed."""
    right = {
        "time": 7.5,
        "adaptive-feed": "FEED",
        "spindle-override": 1.0,
        "status": 1,
        "coolant": True,
    }
    return json.dumps(right | changed).replace('"FEED"', text)


@pytest.fixture
def answer_of(monkeypatch: pytest.MonkeyPatch) -> Callable[[bytes], Any]:
    """Return the function that reads the outputs of a line, after a request of the time 7.5."""
    types = dict.fromkeys(("HAL_IN", "HAL_OUT", "HAL_FLOAT", "HAL_BIT", "HAL_S32", "HAL_U32"), 0)
    monkeypatch.setitem(sys.modules, "hal", SimpleNamespace(**types))
    spec = importlib.util.spec_from_file_location("hal_bridge", BRIDGE)
    assert spec is not None
    assert spec.loader is not None
    bridge = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(bridge)
    return lambda line: bridge.answer_of(line, 7.5, {"out": OUTPUTS, "echo": True})


WRONG_FEEDS = (
    "NaN",
    "Infinity",
    "-0.1",
    "1.01",
    "true",
    "null",
    '"1.0"',
    "[1.0]",
    "1e400",
    "1" + 400 * "0",
    "1" + 5000 * "0",
)


@pytest.mark.parametrize(
    "line",
    [
        "",
        "nonsense",
        "[1, 2]",
        "[" * 60_000,
        '{"time": 7.5, "adaptive-feed": 1.0}',  # incomplete
        outputs("1.0", extra=1),
        outputs("1.0").replace('"time": 7.5, ', ""),
        outputs("1.0", time=7.4),
        outputs("1.0", time=True),
        *map(outputs, WRONG_FEEDS),
        outputs('1.0, "adaptive-feed": 1.0'),
        outputs("1.0", **{"spindle-override": 9.0}),
        outputs("1.0", status=1.5),
        outputs("1.0", status=99),
        outputs("1.0", coolant=1),
        outputs("1.0") + 70_000 * " ",  # longer than a line may be
    ],
)
def test_a_line_that_is_no_answer_is_refused(line: str, answer_of: Callable[[bytes], Any]) -> None:
    assert answer_of(line.encode()) is None
    assert answer_of(outputs("1.0").encode()) == {
        "adaptive-feed": 1.0,
        "spindle-override": 1.0,
        "status": 1,
        "coolant": True,
    }
    assert answer_of(b"\xff" + outputs("1.0").encode()) is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrong",
    [
        "\xff\xfe{\n",  # undecodable
        f'{{"adaptive-feed": 1.0, {VALID}}}\n',  # answers no request
        f'{{"time": TIME, "adaptive-feed": NaN, {VALID}}}\n',
        "x" * 300_000 + "\n",
        "OLDER\n",
    ],
)
def test_a_line_that_is_no_answer_leaves_the_safe_feed_until_the_next_answer(
    wrong: str, tmp_path: Path
) -> None:
    pins = answering(["RIGHT\n", wrong, "RIGHT\n"], tmp_path)
    assert held(pins) == ["0.25", "0.75", "0.25", "0.75", "0.25"]
    assert int(held(pins, "refused")[-1]) >= 1


@pytest.mark.slow
def test_an_answer_among_other_lines_counts(tmp_path: Path) -> None:
    forged = f'{{"adaptive-feed": 1.0, {VALID}}}\n'
    assert held(answering(["RIGHT\n", forged + "RIGHT\n" + forged, "RIGHT\n"], tmp_path)) == [
        "0.25",
        "0.75",
        "0.25",
    ]


@pytest.mark.slow
def test_without_an_echo_a_second_line_gives_the_safe_feed(tmp_path: Path) -> None:
    one = f'{{"adaptive-feed": 0.5, {VALID}}}\n'
    assert held(answering([one, one + one, one], tmp_path, echo=False)) == [
        "0.25",
        "0.5",
        "0.25",
        "0.5",
        "0.25",
    ]


@pytest.mark.slow
def test_a_flood_of_lines_does_not_stop_the_component(tmp_path: Path) -> None:
    code = "import sys\nprint('ready', flush=True)\nwhile True: sys.stdout.write('{}' + 1000 * chr(10))"
    begun = time.monotonic()
    pins = bridged({**PLAN, "command": [sys.executable, "-c", code]}, tmp_path)
    assert held(pins) == ["0.25"]
    assert time.monotonic() - begun < 30.0  # three periods and the start


PRINTS = """
import ctypes, os, subprocess, sys
import numpy as np

forged = '{"adaptive-feed": 1.0, "spindle-override": 1.0, "status": 1}'
print(forged, flush=True)

def policy(observations):
    print(forged, flush=True)
    sys.__stdout__.write(forged + chr(10))
    sys.__stdout__.flush()
    os.write(1, forged.encode() + bytes([10]))
    ctypes.CDLL(None).puts(forged.encode())
    ctypes.CDLL(None).fflush(None)
    subprocess.run(["echo", forged], check=True)
    sys.stdin.read()
    return np.full((len(observations), 1), -1.0, np.float32)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="the C library is found otherwise")
def test_what_a_policy_prints_is_no_answer(tmp_path: Path) -> None:
    (tmp_path / "prints.py").write_text(PRINTS)
    command = [
        sys.executable,
        "-m",
        "turning_control",
        "serve",
        "--policy",
        "prints:policy",
        "--scenario",
        "override",
    ]
    paths = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])}
    pins = {
        "spindle-speed": 700.0,
        "feed-velocity": 4.0,
        "motion-type": 2,
        "position": 5.0,
        "power": 4.0,
        "thrust-force": 700.0,
    }
    pins |= {"edge": 0, "in-position": False, "cutting": True}
    requests = [{"time": 100.0 + 0.012 * k, **pins} for k in range(3)]
    text = "\n".join(map(json.dumps, requests))
    done = subprocess.run(
        command,
        input=text,
        env=paths,
        check=True,
        capture_output=True,
        text=True,
        timeout=120.0,
        cwd=tmp_path,
    )
    ready, *answers = done.stdout.splitlines()
    assert ready == "ready"
    assert [json.loads(answer)["time"] for answer in answers] == [
        request["time"] for request in requests
    ]
    assert all(json.loads(answer)["adaptive-feed"] < 0.5 for answer in answers)
    assert done.stderr.count("adaptive-feed") >= 5


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


@pytest.mark.slow
def test_the_figures_of_a_run() -> None:
    row = {
        "at_feed": 1.0,
        "bar": 0.0,
        "edge": 0.0,
        "power": 4.0,
        "delay": 0.006,
        "adaptive_feed": 0.5,
        "feed": 0.4,
        "along": 1.0,
    }
    rows = [row | {"seconds": 11.0, "engaged_time": 10.0, "severe_overload_time": 0.1}] * 2
    assert linuxcnc.figures(rows, 0.25) == pytest.approx((22.0, 4.0, 0.01, 1.0, 0.0, 0.006))
    simulated = linuxcnc.simulated("programmed", Scenario.load("override"), 1, 0)
    assert "| programmed | simulation | 22.4" in linuxcnc.table(
        {"programmed": (simulated, simulated)}
    )  # docs/linuxcnc.md


def running() -> list[str]:
    """Return the command lines of processes that belong to the demo."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if any(
            name in line
            for name in (
                "hal_bridge.py",
                "panel.py",
                "turning_control serve",
                "milltask",
                "rtapi_app",
            )
        ):
            found.append(line)
    return found


needs_linuxcnc = [
    pytest.mark.slow,
    pytest.mark.skipif(shutil.which("linuxcnc") is None, reason=NO_LINUXCNC),
    pytest.mark.skipif("LINUXCNC" not in os.environ, reason=LINUXCNC_ALONE),
]
FAULTS = [
    "kill",
    "freeze",
    "policy",
    "sensor stuck",
    "sensor lost",
    "pause",
    "e-stop",
    "feed hold",
    "spindle stopped",
]


def not_a_number(observations: Observations) -> Actions:
    return np.full((len(observations), 1), np.nan, np.float32)


@pytest.mark.parametrize("name", [pytest.param(name, marks=needs_linuxcnc) for name in FAULTS])
def test_faults_end_in_the_safe_feed_or_a_stop_and_leave_nothing_running(name: str) -> None:
    scenario = Scenario.load("override")
    policy = f"{__name__}:not_a_number" if name == "policy" else "programmed"
    rows = linuxcnc.run(policy, "override", 1, 0, Fault(name, after=5.0, lasts=2.0))
    safe_time = sum(
        row["seconds"] for row in rows if abs(row["adaptive_feed"] - safe_feed(scenario)) < 1e-6
    )
    if name == "kill":
        assert (
            max(row["along"] for row in rows) > scenario.workpiece.bar_length
        )  # the program goes on at the safe feed
        assert safe_time > 10.0
    elif name in ("freeze", "sensor stuck", "sensor lost"):
        assert safe_time > 1.0
    else:
        assert max(row["feed"] for row in rows[-20:]) < 1e-3
    if name == "policy":  # held before the tool reaches the bar
        assert sum(row["removed"] for row in rows) == 0.0
    assert running() == []


@pytest.mark.parametrize(
    "number", [pytest.param(each, marks=needs_linuxcnc) for each in (signal.SIGTERM, signal.SIGINT)]
)
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
