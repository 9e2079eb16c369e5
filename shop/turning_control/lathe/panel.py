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
control = linuxcnc.command()
status = linuxcnc.stat()
errors = linuxcnc.error_channel()


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


def halcmd(command: str) -> str:
    """Run a command of halcmd; return its output."""
    words = ["halcmd", *command.split()]
    return subprocess.run(words, check=True, capture_output=True, text=True).stdout


def force_pin(pin: str, value: str) -> None:
    """Take a pin from its signal and give it a constant value."""
    halcmd(f"unlinkp {pin}")
    halcmd(f"setp {pin} {value}")


def cause(fault: dict[str, Any]) -> None:
    """Cause a fault and let it last."""
    pid = int(halcmd("getp turning.pid"))
    faults: dict[str, Callable[[], Any]] = {
        "kill": lambda: os.kill(pid, signal.SIGKILL),
        "freeze": lambda: os.kill(pid, signal.SIGSTOP),
        "pause": lambda: control.auto(linuxcnc.AUTO_PAUSE),
        "e-stop": lambda: control.state(linuxcnc.STATE_ESTOP),
        "feed hold": lambda: halcmd("setp motion.feed-hold 1"),
        "spindle stopped": lambda: force_pin("turning.spindle-speed", "0"),
        "sensor stuck": lambda: force_pin("turning.power", "1"),
        "sensor lost": lambda: force_pin("turning.power", "nan"),
        "policy": lambda: None,  # the policy itself is at fault
    }
    faults[fault["name"]]()
    time.sleep(fault["lasts"])
    if fault["name"] == "freeze":
        os.kill(pid, signal.SIGCONT)


def stopped(parent: int) -> bool:
    """Return whether the process that started LinuxCNC has ended, or wants it to stop."""
    return (folder / "stop").exists() or not Path(f"/proc/{parent}").exists()


def switch_on() -> None:
    """Switch the lathe on and home its axes."""
    press(control.state, linuxcnc.STATE_ESTOP_RESET)
    press(control.state, linuxcnc.STATE_ON)
    press(control.mode, linuxcnc.MODE_MANUAL)
    control.home(-1)
    limit = time.monotonic() + 10.0
    while time.monotonic() < limit and not all(status.homed[:2]):
        time.sleep(0.1)
        status.poll()


def main() -> int:
    """Run the program, and cause the fault of a test at its time; return the exit status."""
    plan = json.loads((folder / "panel.json").read_text())
    fault = plan["fault"]
    switch_on()
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
            # After faults of the other process the program goes on; others stop the lathe.
            if fault["name"] not in ("kill", "freeze"):
                return 0
            fault = None
        is_on = status.task_state == linuxcnc.STATE_ON
        if status.interp_state == linuxcnc.INTERP_IDLE or not is_on:
            return 0 if is_on else 1
        time.sleep(0.05)


code = main()
report()
raise SystemExit(code)
