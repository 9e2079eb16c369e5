#!{PYTHON}
"""The display of the lathe: presses the buttons that an operator would, and ends with the program.

Runs in the system's Python, which has LinuxCNC's modules.
"""

import json
import os
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import linuxcnc

folder = Path(__file__).parent
control, status, errors = linuxcnc.command(), linuxcnc.stat(), linuxcnc.error_channel()


def report() -> None:
    """Print the control's messages."""
    message = errors.poll()
    while message:
        print("linuxcnc:", message[1].strip(), flush=True)
        message = errors.poll()


def press(button: Callable[[Any], None], value: Any) -> None:
    """Give the control a command and wait until it is carried out."""
    button(value)
    control.wait_complete()


def pins(*commands: str) -> str:
    """Run commands of halcmd; return the output of the last one."""
    return [
        subprocess.run(["halcmd", *each.split()], check=True, capture_output=True, text=True).stdout
        for each in commands
    ][-1]


def cause(fault: dict[str, Any]) -> None:
    """Cause a fault and let it last."""
    pid = int(pins("getp turning.pid"))
    faults: dict[str, Callable[[], Any]] = {
        "kill": lambda: os.kill(pid, signal.SIGKILL),
        "freeze": lambda: os.kill(pid, signal.SIGSTOP),
        "pause": lambda: control.auto(linuxcnc.AUTO_PAUSE),
        "e-stop": lambda: control.state(linuxcnc.STATE_ESTOP),
        "feed hold": lambda: pins("setp motion.feed-hold 1"),
        "spindle stopped": lambda: pins(
            "unlinkp turning.spindle-speed", "setp turning.spindle-speed 0"
        ),
        "sensor stuck": lambda: pins("unlinkp turning.power", "setp turning.power 1"),
        "sensor lost": lambda: pins("unlinkp turning.power", "setp turning.power nan"),
        "policy": lambda: None,  # the policy itself is at fault
    }
    faults[fault["name"]]()
    time.sleep(fault["lasts"])
    if fault["name"] == "freeze":
        os.kill(pid, signal.SIGCONT)


def stopped(parent: int) -> bool:
    """Return whether the process that started LinuxCNC has asked to stop it, or has ended itself."""
    return (folder / "stop").exists() or not Path(f"/proc/{parent}").exists()


def main() -> int:
    """Run the program; carry out the fault of the test at its time, if there is one."""
    plan = json.loads((folder / "panel.json").read_text())
    fault = plan["fault"]
    press(control.state, linuxcnc.STATE_ESTOP_RESET)
    press(control.state, linuxcnc.STATE_ON)
    press(control.mode, linuxcnc.MODE_MANUAL)
    control.home(-1)
    limit = time.monotonic() + 10.0
    while time.monotonic() < limit and not all(status.homed[:2]):
        time.sleep(0.1)
        status.poll()
    press(control.mode, linuxcnc.MODE_AUTO)
    press(control.program_open, str(folder / "bars.ngc"))
    control.auto(linuxcnc.AUTO_RUN, 0)
    start = time.monotonic()
    time.sleep(0.5)
    while True:
        status.poll()
        report()
        if stopped(plan["parent"]):
            return 1
        if fault and time.monotonic() - start > fault["after"]:
            cause(fault)
            if fault["name"] not in ("kill", "freeze"):
                return 0
            fault = None
        if status.interp_state == linuxcnc.INTERP_IDLE or status.task_state != linuxcnc.STATE_ON:
            return 0 if status.task_state == linuxcnc.STATE_ON else 1
        time.sleep(0.05)


code = main()
report()
raise SystemExit(code)
