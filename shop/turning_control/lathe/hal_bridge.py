"""A HAL component that passes pins to another process and back, and falls back to safe outputs without it.

Runs in the system's Python, which has LinuxCNC's modules; it needs nothing of this package:

    loadusr -Wn turning python3 hal_bridge.py turning turning.json

The file names pins (``in``, ``out``: name to HAL type), the ``safe`` outputs, the ``period`` [s] and the ``command`` of the
other process. Once per period, the inputs go to its standard input as one line of JSON, with the ``time`` [s] of the request.
It answers with one line of outputs. If no answer has come when the next period begins, the outputs are the safe ones until it
answers again.

A line sets the pins only if it is an answer: an object that holds every output once and nothing else but ``time``, with finite
numbers of the pins' types, within ``ranges`` (name to lowest and highest value). If the file says ``"echo": true``, an answer
must repeat its request's ``time``, so that neither an older answer nor another program's text passes. Without it, the outputs
are the safe ones as well after a line that is no answer, or one too many, until the next answer.

``late`` counts periods without an answer, ``refused`` counts lines that are no answer. ``latency`` is the time from the last
inputs to their answer [s]. ``alive`` tells whether the process runs, which ends with this component. ``heartbeat`` changes once
per period as long as the component itself runs.
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
RANGES = {
    "adaptive-feed": (0.0, 1.0),
    "spindle-override": (0.0, 2.0),
    "status": (0, 4),
}  # if the file gives none
MAX_LINE = 65536  # length of a line above which it is no answer [bytes]
MAX_LINES_AT_ONCE = (
    32  # lines at once above which none is read: a flood must not hold this component up
)
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
        serve(component, child, plan)
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
            # Its end is missing: what is left of the line when it comes is no answer either.
            lines.append(self._received)
            self._received = b"..."
        return lines


def send(child: Any, values: dict[str, Any]) -> bool:
    """Send a line; return whether the process has taken it whole, which it has not if it reads no more."""
    line = json.dumps(values).encode() + b"\n"
    try:
        return os.write(child.stdin.fileno(), line) == len(
            line
        )  # shorter than the pipe's unit: whole or not at all
    except BlockingIOError:
        return False


def answer_of(line: bytes, asked: float, plan: dict[str, Any]) -> dict[str, Any] | None:
    """Return the outputs that a line sets, or None if it is no answer to the request of the time ``asked``."""
    if len(line) > MAX_LINE:
        return None
    try:
        answer = json.loads(line.decode("utf-8"), object_pairs_hook=unique)
    except (ValueError, RecursionError):
        return None
    if not isinstance(answer, dict):
        return None
    echo = answer.pop("time", None)
    if (echo is not None or plan.get("echo")) and not (is_number(echo) and echo == asked):
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


def wait_until_ready(lines: Lines) -> None:
    """Wait for the line by which the other process says that it has loaded its policy, or for its end."""
    while not lines.ended:
        if b"ready" in lines.read(1.0):
            return


def serve(component: Any, child: Any, plan: dict[str, Any]) -> None:
    """Exchange a line per period."""
    write(component, plan["safe"])
    component["pid"] = child.pid
    component["alive"] = True
    lines = Lines(child.stdout)
    os.set_blocking(child.stdin.fileno(), False)
    wait_until_ready(lines)
    component.ready()
    alive = not lines.ended
    waiting = False  # for the answer to the last request
    asked = begun = time.monotonic()
    while True:
        if alive and not waiting:  # a process that has not answered gets no further request
            asked = time.monotonic()
            inputs = {pin: component[pin] for pin in plan["in"]}
            try:
                waiting = send(child, {"time": asked, **inputs})
            except OSError:
                alive = False
        component["heartbeat"] = not component["heartbeat"]
        begun = max(begun + plan["period"], time.monotonic() - plan["period"])
        answered = False
        refused = 0
        while alive and time.monotonic() < begun:
            received = lines.read(begun - time.monotonic())
            flooded = len(received) > MAX_LINES_AT_ONCE
            for line in received:
                answer = answer_of(line, asked, plan) if waiting and not flooded else None
                if answer is None:
                    refused += 1
                    if not plan.get("echo"):  # nothing tells which line is the answer
                        answered = False
                        write(component, plan["safe"])
                    continue
                write(component, {**answer, "latency": time.monotonic() - asked})
                answered = True
                waiting = False
            alive = not lines.ended
        if refused:
            count(component, "refused", refused)
            waiting = False  # its answer may have been lost among them: ask again
        if not answered:
            count(component, "late")
            component["alive"] = alive
            write(component, plan["safe"])
        time.sleep(max(begun - time.monotonic(), 0.0))


if sys.argv[0].endswith("hal_bridge.py"):  # started by LinuxCNC
    main(*sys.argv[1:3])
