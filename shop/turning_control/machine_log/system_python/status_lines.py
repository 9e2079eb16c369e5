"""Print LinuxCNC's status as lines of JSON until the other side stops reading.

Runs in the system's Python, which has LinuxCNC's modules. It makes no command channel, sets no pin
and is started with the interval [s] and the HAL pins to read, as JSON: ``0.1 '{}'``.
"""

import json
import os
import sys
import time
from typing import Any

import linuxcnc

FEED = 2  # ``motion_type`` of a move at feed
X, Z = 0, 2  # places in a position


def main(interval: float, pins: dict[str, str]) -> None:
    """Print a line per interval."""
    status = linuxcnc.stat()
    hal: Hal | None = None
    due = time.monotonic()
    while True:
        try:
            status.poll()
            line = status_line(status)
            if pins:
                # After the poll: LinuxCNC runs, and HAL with it.
                hal = hal or Hal()
                line |= hal.values(pins)
        except (linuxcnc.error, RuntimeError) as error:
            print(json.dumps({"error": str(error)}), flush=True)
            return
        print(json.dumps(line), flush=True)
        due = max(due + interval, time.monotonic())
        time.sleep(max(due - time.monotonic(), 0.0))


class Hal:
    """Reads pins. HAL wants a component of each of its users; this one has no pins of its own."""

    def __init__(self) -> None:
        import hal

        self._hal = hal
        # HAL answers as long as the component lives.
        self._component = hal.component(f"turning-log-{os.getpid()}")
        self._component.ready()

    def values(self, pins: dict[str, str]) -> dict[str, float]:
        """Return the values of pins by the quantities that they give."""
        return {name: float(self._hal.get_value(pin)) for name, pin in pins.items()}


def status_line(status: Any) -> dict[str, Any]:
    """Return the quantities of the status in the units of the record."""
    # ``linear_units`` are the machine's units in a millimetre: 1, or 1 / 25.4.
    mm = 1.0 / status.linear_units
    spindle = status.spindle[0]
    positions = []
    for axis in (X, Z):
        offsets = status.g5x_offset[axis] + status.g92_offset[axis] + status.tool_offset[axis]
        positions.append(mm * (status.actual_position[axis] - offsets))
    runs = status.interp_state != linuxcnc.INTERP_IDLE and not status.paused
    return {
        "time": time.time(),
        "spindle_speed": abs(spindle["speed"]),
        "feed_rate": 60.0 * mm * status.current_vel,
        "x": positions[0],
        "z": positions[1],
        "diameter": 2.0 * abs(positions[0]),
        "feed_override": 100.0 * status.feedrate,
        "rapid_override": 100.0 * status.rapidrate,
        "spindle_override": 100.0 * spindle["override"],
        "running": float(runs and status.motion_type == FEED),
        "tool": status.tool_in_spindle,
    }


if sys.argv[0].endswith("status_lines.py"):  # started as a process
    main(float(sys.argv[1]), json.loads(sys.argv[2]))
