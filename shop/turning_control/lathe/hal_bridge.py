"""A HAL component that passes pins to another process and back.

Without an answer from that process, it falls back to safe outputs. It runs in the system's Python,
which has LinuxCNC's modules, and needs nothing of this package:

    loadusr -Wn turning python3 hal_bridge.py turning turning.json

The JSON file holds the plan:

* ``in`` and ``out``: pins, name to HAL type;
* ``safe``: the safe outputs;
* ``period`` [s];
* ``command``: the other process;
* ``ranges``: lowest and highest value of an output, by name (optional);
* ``echo``: whether an answer must repeat its request's ``time`` (optional).

Once per period, the inputs go to the process's standard input as one line of JSON, with the
``time`` [s] of the request. The process answers with one line of outputs. If no answer has come
when the next period begins, the outputs are the safe ones until it answers again.

A line sets the pins only if it is an answer: an object that holds every output once and nothing
else but ``time``, with finite numbers of the pins' types, within ``ranges``. With ``echo``, neither
an older answer nor another program's text passes. Without it, the outputs are also the safe ones
after a line that is no answer, or one too many, until the next answer.

Further outputs are

* ``late``: number of periods without an answer;
* ``refused``: number of lines that are no answer;
* ``latency``: time from the last inputs to their answer [s];
* ``alive``: whether the process runs, which ends with this component;
* ``heartbeat``: changes once per period as long as the component itself runs;
* ``pid``: of the process.
"""

import contextlib
import json
import math
import os
import selectors
import signal
import subprocess
import sys
import time
from typing import Any

import hal

ALWAYS = {
    "late": "u32",
    "refused": "u32",
    "latency": "float",
    "alive": "bit",
    "heartbeat": "bit",
    "pid": "s32",
}
TYPES = {"float": hal.HAL_FLOAT, "bit": hal.HAL_BIT, "s32": hal.HAL_S32, "u32": hal.HAL_U32}
INTEGERS = {"s32": (-(2**31), 2**31 - 1), "u32": (0, 2**32 - 1)}
# Ranges of outputs for which the plan gives none.
RANGES = {"adaptive-feed": (0.0, 1.0), "spindle-override": (0.0, 2.0), "status": (0, 4)}
MAX_LINE = 65536  # length of a line above which it is no answer [bytes]
# Lines at once above which none is read: a flood must not hold this component up.
MAX_LINES_AT_ONCE = 32
MAX_COUNT = 2**32 - 1  # at which the counters stay


def main(name: str, path: str) -> None:
    """Serve until a signal or until the other side ends."""
    with open(path) as file:
        plan = json.load(file)
    component = hal.component(name)
    for pin, kind in plan["in"].items():
        component.newpin(pin, TYPES[kind], hal.HAL_IN)
    for pin, kind in {**plan["out"], **ALWAYS}.items():
        component.newpin(pin, TYPES[kind], hal.HAL_OUT)
    child: Any = subprocess.Popen(
        plan["command"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0
    )
    for stop in (signal.SIGTERM, signal.SIGINT):
        signal.signal(stop, lambda *_: sys.exit(0))
    try:
        Bridge(component, child, plan).serve()
    finally:
        write(component, plan["safe"])
        child.kill()
        child.wait()
        child.stdout.close()
        with contextlib.suppress(OSError):
            child.stdin.close()
        component.exit()


def write(component: Any, values: dict[str, Any]) -> None:
    """Set output pins."""
    for pin, value in values.items():
        component[pin] = value


def count(component: Any, pin: str, more: int = 1) -> None:
    """Add to a counter."""
    component[pin] = min(component[pin] + more, MAX_COUNT)


class Lines:
    """The lines that a process writes, read without waiting for them."""

    def __init__(self, file: Any) -> None:
        self._descriptor = file.fileno()
        os.set_blocking(self._descriptor, False)
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._descriptor, selectors.EVENT_READ)
        self._received = b""
        self.ended = False

    def read(self, seconds: float) -> list[bytes]:
        """Return the lines that are complete within some seconds, perhaps none."""
        if not self._selector.select(max(seconds, 0.0)):
            return []
        try:
            chunk = os.read(self._descriptor, MAX_LINE)
        except BlockingIOError:
            return []
        self.ended = not chunk
        *lines, self._received = (self._received + chunk).split(b"\n")
        if len(self._received) > MAX_LINE:
            # Its end is missing. The rest, when it comes, must be no answer either.
            lines.append(self._received)
            self._received = b"..."
        return lines


def send(child: Any, values: dict[str, Any]) -> bool:
    """Send a line; return whether the process has taken it.

    A process that reads no more takes nothing.
    """
    line = json.dumps(values).encode() + b"\n"
    try:
        # The line is shorter than the pipe's unit, so it is written whole or not at all.
        return os.write(child.stdin.fileno(), line) == len(line)
    except BlockingIOError:
        return False


def answer_of(line: bytes, asked: float, plan: dict[str, Any]) -> dict[str, Any] | None:
    """Return the outputs that a line sets.

    Return None if it is no answer to the request of the time ``asked``.
    """
    if len(line) > MAX_LINE:
        return None
    try:
        answer = json.loads(line.decode("utf-8"), object_pairs_hook=unique)
    except (ValueError, RecursionError):
        return None
    if not isinstance(answer, dict):
        return None

    echo = answer.pop("time", None)
    needs_echo = echo is not None or plan.get("echo")
    if needs_echo and not (is_number(echo) and echo == asked):
        return None

    if answer.keys() != plan["out"].keys():
        return None
    ranges = {**RANGES, **plan.get("ranges", {})}
    for pin, kind in plan["out"].items():
        if not allowed(answer[pin], kind, ranges.get(pin)):
            return None
    return answer


def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return an object of JSON; ValueError if it names something twice."""
    values = dict(pairs)
    if len(values) < len(pairs):
        raise ValueError("a name occurs twice")
    return values


def is_number(value: Any) -> bool:
    """Return whether a value is a finite number, which true and false are not."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond all floats
        return False


def allowed(value: Any, kind: str, limits: Any) -> bool:
    """Return whether a pin of a HAL type may have a value, within its lowest and highest one."""
    if kind == "bit":
        return isinstance(value, bool)
    if not is_number(value):
        return False
    if kind in INTEGERS:
        lowest, highest = INTEGERS[kind]
        if not isinstance(value, int) or not lowest <= value <= highest:
            return False
    return limits is None or bool(limits[0] <= value <= limits[1])


class Bridge:
    """The exchange of lines between a component's pins and a process."""

    def __init__(self, component: Any, child: Any, plan: dict[str, Any]) -> None:
        self._component = component
        self._child = child
        self._plan = plan
        self._lines = Lines(child.stdout)
        os.set_blocking(child.stdin.fileno(), False)
        self._alive = True
        self._waiting = False  # for the answer to the last request
        self._asked = 0.0  # time of the last request [s]

    def serve(self) -> None:
        """Exchange a line per period."""
        component = self._component
        period = self._plan["period"]
        write(component, self._plan["safe"])
        component["pid"] = self._child.pid
        component["alive"] = True
        self._wait_until_ready()
        component.ready()
        end = time.monotonic()  # of the period
        while True:
            # A process that has not answered gets no further request.
            if self._alive and not self._waiting:
                self._ask()
            component["heartbeat"] = not component["heartbeat"]
            # A delay of more than a period is not made up for.
            end = max(end + period, time.monotonic() - period)
            self._take_answers(end)
            time.sleep(max(end - time.monotonic(), 0.0))

    def _wait_until_ready(self) -> None:
        """Wait for the line that says that the process has loaded its policy, or for its end."""
        while not self._lines.ended:
            if b"ready" in self._lines.read(1.0):
                break
        self._alive = not self._lines.ended

    def _ask(self) -> None:
        """Send the inputs."""
        self._asked = time.monotonic()
        inputs = {pin: self._component[pin] for pin in self._plan["in"]}
        try:
            self._waiting = send(self._child, {"time": self._asked, **inputs})
        except OSError:
            self._alive = False

    def _take_answers(self, end: float) -> None:
        """Set the outputs by the lines that come until a time, or else the safe ones."""
        answered = False
        refused = 0
        while self._alive and time.monotonic() < end:
            lines = self._lines.read(end - time.monotonic())
            flooded = len(lines) > MAX_LINES_AT_ONCE
            for line in lines:
                answer = None
                if self._waiting and not flooded:
                    answer = answer_of(line, self._asked, self._plan)
                if answer is not None:
                    latency = time.monotonic() - self._asked
                    write(self._component, {**answer, "latency": latency})
                    answered = True
                    self._waiting = False
                else:
                    refused += 1
                    if not self._plan.get("echo"):
                        # Nothing tells which of the lines is the answer.
                        answered = False
                        write(self._component, self._plan["safe"])
            self._alive = not self._lines.ended
        if refused:
            count(self._component, "refused", refused)
            # The answer may have been lost among the refused lines, so the process is asked again.
            self._waiting = False
        if not answered:
            count(self._component, "late")
            self._component["alive"] = self._alive
            write(self._component, self._plan["safe"])


if sys.argv[0].endswith("hal_bridge.py"):  # started by LinuxCNC
    main(*sys.argv[1:3])
