"""A HAL component that passes pins to another process and back, and falls back to safe outputs without it.

Runs in the system's Python, which has LinuxCNC's modules; it needs nothing of this package:

    loadusr -Wn turning python3 hal_bridge.py turning turning.json

The file names pins (``in``, ``out``: name to HAL type), the ``safe`` outputs, the ``period`` [s] and the ``command`` of the other
process. Once per period, the inputs go to its standard input as one line of JSON; it answers with a line of outputs. If no answer
has come when the next period begins, the outputs are the safe ones until it answers again. ``late`` counts such periods;
``latency`` is the time from the last inputs to their answer [s]; ``alive`` tells whether the process runs, which ends with this
component. ``heartbeat`` changes once per period as long as the component itself runs.
"""

import contextlib
import json
import os
import selectors
import signal
import subprocess
import sys
import time
from typing import Any

import hal

ALWAYS = {"late": "u32", "latency": "float", "alive": "bit", "heartbeat": "bit", "pid": "s32"}
TYPES = {"float": hal.HAL_FLOAT, "bit": hal.HAL_BIT, "s32": hal.HAL_S32, "u32": hal.HAL_U32}


def main(name: str, path: str) -> None:
    """Serve until a signal or until the other side ends."""
    with open(path) as file:
        plan = json.load(file)
    component = hal.component(name)
    for pin, kind in plan["in"].items():
        component.newpin(pin, TYPES[kind], hal.HAL_IN)
    for pin, kind in {**plan["out"], **ALWAYS}.items():
        component.newpin(pin, TYPES[kind], hal.HAL_OUT)
    child: Any = subprocess.Popen(plan["command"], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
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


def serve(component: Any, child: Any, plan: dict[str, Any]) -> None:
    """Exchange a line per period."""
    write(component, plan["safe"])
    component["pid"] = child.pid
    component["alive"] = True
    ready = child.stdout.readline()  # the other process has loaded its policy
    component.ready()
    os.set_blocking(child.stdout.fileno(), False)
    selector = selectors.DefaultSelector()
    selector.register(child.stdout, selectors.EVENT_READ)
    alive, waiting, received, begun = bool(ready), False, b"", time.monotonic()
    asked = begun
    while True:
        if alive and not waiting:  # a process that has not answered gets no further line
            asked, inputs = time.monotonic(), {pin: component[pin] for pin in plan["in"]}
            try:
                child.stdin.write(json.dumps({"time": asked, **inputs}).encode() + b"\n")
                child.stdin.flush()
                waiting = True
            except OSError:
                alive = False
        component["heartbeat"] = not component["heartbeat"]
        begun = max(begun + plan["period"], time.monotonic() - plan["period"])
        while alive and waiting and (left := begun - time.monotonic()) > 0.0 and selector.select(left):
            chunk = child.stdout.read() or b""
            alive = bool(chunk)
            received += chunk
            lines, newline, received = received.rpartition(b"\n")
            if newline:
                write(component, {**json.loads(lines.splitlines()[-1]), "latency": time.monotonic() - asked})
                waiting = False
        if waiting or not alive:
            component["late"] += 1
            component["alive"] = alive
            write(component, plan["safe"])
        time.sleep(max(begun - time.monotonic(), 0.0))


if sys.argv[0].endswith("hal_bridge.py"):  # started by LinuxCNC
    main(*sys.argv[1:3])
