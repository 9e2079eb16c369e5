"""The HAL component with a fake HAL, the plant, and LinuxCNC itself with faults if installed."""

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
from turning_env.policy import Actions, Observations

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
# Answers the first request, then does something else.
ANSWERS_ONCE = """
import sys, time
print("ready", flush=True)
sys.stdin.readline()
print('{"adaptive-feed": 0.9}', flush=True)
"""


def bridged(plan: dict[str, Any], folder: Path) -> list[tuple[str, str]]:
    """Return the pins that the component sets, and their values, in order.

    It runs until it has counted three periods without an answer.
    """
    (folder / "hal.py").write_text(FAKE_HAL)
    path = folder / "plan.json"
    path.write_text(json.dumps(plan))
    done = subprocess.run(
        [sys.executable, str(BRIDGE), "turning", str(path)],
        env=os.environ | {"PYTHONPATH": str(folder)},
        check=True,
        capture_output=True,
        text=True,
        timeout=60.0,
    )
    pins = []
    for line in done.stdout.splitlines():
        name, value = line.split()[:2]
        pins.append((name, value))
    return pins


def values_of(pins: list[tuple[str, str]], name: str = "adaptive-feed") -> list[str]:
    """Return the values that a pin takes one after the other."""
    values = [value for pin, value in pins if pin == name]
    return [value for value, _ in groupby(values)]


@pytest.mark.slow
@pytest.mark.parametrize(
    "then",
    [
        pytest.param("time.sleep(60)", id="hangs"),
        pytest.param("sys.exit()", id="ends"),
        pytest.param("print('{', end='', flush=True); time.sleep(60)", id="hangs in a line"),
    ],
)
def test_a_process_that_stops_answering_leaves_the_safe_feed_after_one_period(
    then: str, tmp_path: Path
) -> None:
    pins = bridged({**PLAN, "command": [sys.executable, "-c", ANSWERS_ONCE + then]}, tmp_path)
    assert values_of(pins) == ["0.25", "0.9", "0.25"]
    (pid,) = values_of(pins, "pid")
    assert not Path(f"/proc/{pid}").exists()


OUTPUTS = {
    "adaptive-feed": "float",
    "spindle-override": "float",
    "status": "s32",
    "coolant": "bit",
}
SAFE = {
    "adaptive-feed": 0.25,
    "spindle-override": 1.0,
    "status": 3,
    "coolant": False,
}
ANSWERING = """
import json, os, sys
lines = LINES
print("ready", flush=True)
older = None
for request in sys.stdin:
    time = json.loads(request)["time"]
    right = {"time": time, "adaptive-feed": 0.75}
    right |= {"spindle-override": 1.0, "status": 1, "coolant": True}
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
    """Return the pins that the component sets while a process answers with lines, then ends."""
    script = folder / "answering.py"
    script.write_text(ANSWERING.replace("LINES", repr(lines)))
    fixed = {
        "in": {"load": "float"},
        "out": OUTPUTS,
        "period": 0.3,
        "safe": SAFE,
        "echo": True,
    }
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
    hal = SimpleNamespace(
        HAL_IN=0,
        HAL_OUT=0,
        HAL_FLOAT=0,
        HAL_BIT=0,
        HAL_S32=0,
        HAL_U32=0,
    )
    monkeypatch.setitem(sys.modules, "hal", hal)
    spec = importlib.util.spec_from_file_location("hal_bridge", BRIDGE)
    assert spec is not None
    assert spec.loader is not None
    bridge = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(bridge)
    return lambda line: bridge.answer_of(line, 7.5, {"out": OUTPUTS, "echo": True})


def test_an_answer_sets_the_outputs(answer_of: Callable[[bytes], Any]) -> None:
    assert answer_of(outputs("1.0").encode()) == {
        "adaptive-feed": 1.0,
        "spindle-override": 1.0,
        "status": 1,
        "coolant": True,
    }


@pytest.mark.parametrize(
    "feed",
    [
        "NaN",
        "Infinity",
        "-0.1",
        "1.01",
        "true",
        "null",
        '"1.0"',
        "[1.0]",
        pytest.param("1e400", id="beyond floats"),
        pytest.param("1" + 400 * "0", id="whole number beyond floats"),
        pytest.param("1" + 5000 * "0", id="whole number beyond parsing"),
        pytest.param('1.0, "adaptive-feed": 1.0', id="twice"),
    ],
)
def test_a_feed_out_of_its_range_is_refused(feed: str, answer_of: Callable[[bytes], Any]) -> None:
    assert answer_of(outputs(feed).encode()) is None


@pytest.mark.parametrize(
    "line",
    [
        pytest.param("", id="empty"),
        pytest.param("nonsense", id="no JSON"),
        pytest.param("[1, 2]", id="no object"),
        pytest.param("[" * 60_000, id="deeply nested"),
        pytest.param('{"time": 7.5, "adaptive-feed": 1.0}', id="incomplete"),
        pytest.param(outputs("1.0", extra=1), id="unknown output"),
        pytest.param(outputs("1.0").replace('"time": 7.5, ', ""), id="without a time"),
        pytest.param(outputs("1.0", time=7.4), id="of another time"),
        pytest.param(outputs("1.0", time=True), id="time of no number"),
        pytest.param(outputs("1.0", **{"spindle-override": 9.0}), id="speed out of range"),
        pytest.param(outputs("1.0", status=1.5), id="broken status"),
        pytest.param(outputs("1.0", status=99), id="status out of range"),
        pytest.param(outputs("1.0", coolant=1), id="number for a bit"),
        pytest.param(outputs("1.0") + 70_000 * " ", id="too long"),
    ],
)
def test_a_line_that_is_no_answer_is_refused(line: str, answer_of: Callable[[bytes], Any]) -> None:
    assert answer_of(line.encode()) is None


def test_a_line_that_is_no_text_is_refused(answer_of: Callable[[bytes], Any]) -> None:
    assert answer_of(b"\xff" + outputs("1.0").encode()) is None


FORGED = f'{{"adaptive-feed": 1.0, {VALID}}}\n'


@pytest.mark.slow
@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param("\xff\xfe{\n", id="no text"),
        pytest.param(FORGED, id="answers no request"),
        pytest.param(f'{{"time": TIME, "adaptive-feed": NaN, {VALID}}}\n', id="not finite"),
        pytest.param("x" * 300_000 + "\n", id="too long"),
        pytest.param("OLDER\n", id="answers an older request"),
    ],
)
def test_a_line_that_is_no_answer_leaves_the_safe_feed_until_the_next_answer(
    wrong: str, tmp_path: Path
) -> None:
    pins = answering(["RIGHT\n", wrong, "RIGHT\n"], tmp_path)
    assert values_of(pins) == ["0.25", "0.75", "0.25", "0.75", "0.25"]
    assert int(values_of(pins, "refused")[-1]) >= 1


@pytest.mark.slow
def test_an_answer_among_other_lines_counts(tmp_path: Path) -> None:
    pins = answering(["RIGHT\n", FORGED + "RIGHT\n" + FORGED, "RIGHT\n"], tmp_path)
    assert values_of(pins) == ["0.25", "0.75", "0.25"]


@pytest.mark.slow
def test_without_an_echo_a_second_line_gives_the_safe_feed(tmp_path: Path) -> None:
    line = f'{{"adaptive-feed": 0.5, {VALID}}}\n'
    pins = answering([line, line + line, line], tmp_path, echo=False)
    assert values_of(pins) == ["0.25", "0.5", "0.25", "0.5", "0.25"]


FLOODS = """
import sys
print("ready", flush=True)
while True:
    sys.stdout.write("{}" + 1000 * chr(10))
"""


@pytest.mark.slow
def test_a_flood_of_lines_does_not_stop_the_component(tmp_path: Path) -> None:
    start = time.monotonic()
    pins = bridged({**PLAN, "command": [sys.executable, "-c", FLOODS]}, tmp_path)
    assert values_of(pins) == ["0.25"]
    assert time.monotonic() - start < 30.0  # three periods and the start


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
def test_output_of_a_policy_is_no_answer(tmp_path: Path) -> None:
    (tmp_path / "prints.py").write_text(PRINTS)
    command = [sys.executable, "-m", "turning_control", "drive"]
    command += ["--policy", "prints:policy", "--scenario", "override"]
    pins = {
        "spindle-speed": 700.0,
        "feed-velocity": 4.0,
        "motion-type": 2,
        "position": 5.0,
        "power": 4.0,
        "thrust-force": 700.0,
        "edge": 0,
        "in-position": False,
        "cutting": True,
    }
    times = [100.0, 100.012, 100.024]
    requests = [json.dumps({"time": time, **pins}) for time in times]
    done = subprocess.run(
        command,
        input="\n".join(requests),
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *filter(None, sys.path)])},
        check=True,
        capture_output=True,
        text=True,
        timeout=120.0,
        cwd=tmp_path,
    )
    ready, *lines = done.stdout.splitlines()
    answers = [json.loads(line) for line in lines]
    assert ready == "ready"
    assert [answer["time"] for answer in answers] == times
    assert max(answer["adaptive-feed"] for answer in answers) < 0.5
    assert done.stderr.count("adaptive-feed") >= 5


CYCLE = 0.012  # of the control [s]


def cut(plant: Plant, cycles: int) -> dict[str, float]:
    """Move a plant's tool at feed from the beginning of the approach; return its last values."""
    values: dict[str, float] = {}
    for k in range(1, cycles + 1):
        values = plant.advance(
            CYCLE, along=4.0 * CYCLE * k, spindle_speed=710.0, velocity=4.0, in_feed=True
        )
    return values


@pytest.fixture
def plant() -> Plant:
    return Plant(Scenario.load("override"), seed=0)


@pytest.mark.slow
def test_the_plant_cuts_where_the_control_moves(plant: Plant) -> None:
    values = cut(plant, cycles=1500)
    assert values["power"] > 1.0
    assert values["along"] == pytest.approx(1500 * 4.0 * CYCLE)


@pytest.mark.slow
def test_the_plant_removes_nothing_while_the_control_stands(plant: Plant) -> None:
    along = cut(plant, cycles=1500)["along"]
    for _ in range(50):
        values = plant.advance(
            CYCLE,
            along,
            spindle_speed=710.0,
            velocity=0.0,
            in_feed=False,
        )
        assert values["removed"] < 1e-4


@pytest.mark.slow
def test_a_return_to_the_beginning_brings_the_next_bar_once(plant: Plant) -> None:
    along = cut(plant, cycles=1500)["along"]
    for position in np.linspace(along, 0.0, 20):
        plant.advance(
            CYCLE,
            position,
            spindle_speed=710.0,
            velocity=0.0,
            in_feed=False,
        )
    values = cut(plant, cycles=100)
    assert values["bar"] == 1.0
    assert values["along"] == pytest.approx(100 * 4.0 * CYCLE)
    assert values["power"] > 1.0


def test_the_program_holds_the_highest_feed_in_every_bar() -> None:
    text = linuxcnc.program(Scenario.load("override"), bars=3)
    assert text.count("M52 P1\nG1 ") == 3
    assert text.count("F0.8") == 3


def test_without_linuxcnc_the_message_names_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(linuxcnc.LinuxCncError, match=linuxcnc.PACKAGE):
        linuxcnc.run("programmed", "override", bars=1, seed=0)


def test_figures_of_a_run_add_up_its_cycles() -> None:
    # Two cycles in the first bar, with one edge.
    cycle = {
        "at_feed": 1.0,
        "bar": 0.0,
        "edge": 0.0,
        "power": 4.0,
        "delay": 0.006,
        "adaptive_feed": 0.5,
        "seconds": 11.0,
        "engaged_time": 10.0,
        "severe_overload_time": 0.1,
    }
    figures = linuxcnc.figures([cycle, cycle], safe_share=0.25)
    assert figures.time == pytest.approx(2 * 11.0)
    assert figures.mean_power == pytest.approx(4.0)
    assert figures.severe == pytest.approx(0.1 / 10.0)
    assert figures.edges == 1.0
    # The feed is not the safe one in either cycle.
    assert figures.safe == 0.0
    assert linuxcnc.lateness(figures) == ""
    late = linuxcnc.figures([cycle, cycle | {"adaptive_feed": 0.25}], safe_share=0.25)
    assert "held for 50 % of the time" in linuxcnc.lateness(late)
    assert figures.delay == pytest.approx(0.006)


@pytest.mark.slow
def test_the_simulated_cycle_takes_little_longer_than_at_the_programmed_feed() -> None:
    scenario = Scenario.load("override")
    workpiece = scenario.workpiece.model_copy(update={"bar_length": 10.0})
    short = scenario.model_copy(update={"workpiece": workpiece})
    simulated = linuxcnc.simulated("programmed", short, bars=1, seed=0)
    # 12 mm at 0.4 mm/rev and 133.83 m/min on a diameter of 60 mm, that is 710 rev/min: 2.535 s.
    assert 2.535 < simulated.time < 1.05 * 2.535
    comparison = linuxcnc.Comparison(linuxcnc=simulated, simulation=simulated)
    table = linuxcnc.figures_table({"programmed": comparison})
    assert f"| programmed | simulation | {simulated.time:.2f} |" in table


# Parts of the command lines of processes that belong to the simulated lathe. A NUL separates two
# arguments, so that a shell that was given a whole command as one argument is not among them.
PROCESSES = (
    "hal_bridge.py",
    "panel.py",
    "turning_control\0drive",
    "turning_control.plant",
    "milltask",
    "rtapi_app",
)


def running(names: tuple[str, ...] = PROCESSES) -> list[str]:
    """Return the command lines of processes that have one of these names in them."""
    lines = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().decode(errors="replace")
        except OSError:
            continue
        if any(name in line for name in names):
            lines.append(line)
    return lines


def needs_linuxcnc(test: Callable[..., None]) -> Callable[..., None]:
    """Mark a test that runs LinuxCNC."""
    marks = [
        pytest.mark.slow,
        pytest.mark.skipif(shutil.which("linuxcnc") is None, reason=NO_LINUXCNC),
        pytest.mark.skipif("LINUXCNC" not in os.environ, reason=LINUXCNC_ALONE),
    ]
    for mark in marks:
        test = mark(test)
    return test


def not_a_number(observations: Observations) -> Actions:
    return np.full((len(observations), 1), np.nan, np.float32)


def run_with_fault(name: str, policy: str = "programmed") -> list[dict[str, float]]:
    """Return the log of a run in which a fault is caused after five seconds."""
    fault = Fault(name, after=5.0, lasts=2.0)
    return linuxcnc.run(policy, "override", bars=1, seed=0, fault=fault)


def safe_time(rows: list[dict[str, float]]) -> float:
    """Return the time in which the safe feed held [s]."""
    safe = safe_feed(Scenario.load("override"))
    return sum(row["seconds"] for row in rows if abs(row["adaptive_feed"] - safe) < 1e-6)


def last_feed(rows: list[dict[str, float]]) -> float:
    """Return the highest feed in the last cycles [mm/rev]."""
    return max(row["feed"] for row in rows[-20:])


@needs_linuxcnc
def test_after_the_end_of_the_policy_the_program_goes_on_at_the_safe_feed() -> None:
    rows = run_with_fault("kill")
    bar_length = Scenario.load("override").workpiece.bar_length
    assert max(row["along"] for row in rows) > bar_length
    assert safe_time(rows) > 10.0
    assert running() == []


@needs_linuxcnc
@pytest.mark.parametrize("name", ["freeze", "sensor stuck", "sensor lost"])
def test_faults_of_policy_and_sensors_give_the_safe_feed(name: str) -> None:
    rows = run_with_fault(name)
    assert safe_time(rows) > 1.0
    assert running() == []


@needs_linuxcnc
@pytest.mark.parametrize("name", ["pause", "e-stop", "feed hold", "spindle stopped"])
def test_stops_of_the_control_stop_the_feed_and_leave_nothing_running(name: str) -> None:
    rows = run_with_fault(name)
    assert last_feed(rows) < 1e-3
    assert running() == []


def half_feed(observations: Observations) -> Actions:
    """Ask for half the programmed feed."""
    return np.full((len(observations), 1), -0.5, np.float32)


@needs_linuxcnc
def test_a_run_up_with_adaptive_feed_off_is_no_fault(tmp_path: Path) -> None:
    decisions = tmp_path / "decisions.log"
    fault = Fault("e-stop", after=4.0, lasts=0.5)  # ends the run in the bar
    linuxcnc.run(
        f"{__name__}:half_feed",
        "override",
        bars=1,
        seed=0,
        fault=fault,
        decisions=decisions,
    )
    faults = ("feed_velocity does not follow", "feed_velocity contradicts spindle_speed")
    log = decisions.read_text()
    assert "POLICY: passed" in log
    assert not any(name in log for name in faults)


@needs_linuxcnc
def test_a_policy_of_wrong_answers_is_stopped_before_the_tool_reaches_the_bar() -> None:
    rows = run_with_fault("policy", policy=f"{__name__}:not_a_number")
    assert last_feed(rows) < 1e-3
    assert sum(row["removed"] for row in rows) == 0.0
    assert running() == []


@needs_linuxcnc
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_simulated_lathe_with_all_its_processes(number: signal.Signals) -> None:
    command = [sys.executable, "-m", "turning_control", "drive", "--simulated"]
    command += ["--policy", "programmed"]
    drive = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    limit = time.monotonic() + 60.0
    while not running(("panel.py",)) and time.monotonic() < limit:
        time.sleep(0.1)
    time.sleep(2.0)
    drive.send_signal(number)
    assert drive.wait(60.0) != 0
    assert running() == []
