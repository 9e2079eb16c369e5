"""Read LinuxCNC's status, and HAL pins that the user names.

``system_python/status_lines.py`` runs in the system's Python: it polls ``linuxcnc.stat()`` and
prints lines of JSON. It holds no command channel. LinuxCNC knows no loads; a pin of the drive may
tell them.
"""

import json
import os
import subprocess
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from turning_control.linuxcnc import PACKAGE, PYTHON
from turning_control.machine_log.record import (
    QUANTITIES,
    Announcer,
    Runs,
    Sample,
    header_of,
    silence,
)

from turning_env.console import UserError

# In a folder of its own, beside which no module hides ``linuxcnc``.
READER = Path(__file__).parent / "system_python" / "status_lines.py"
STATUS = {
    "spindle_speed": "stat.spindle[0].speed (commanded)",
    "feed_rate": "stat.current_vel",
    "x": "stat.actual_position less offsets",
    "z": "stat.actual_position less offsets",
    "diameter": "twice x: LinuxCNC holds radii",
    "feed_override": "stat.feedrate",
    "rapid_override": "stat.rapidrate",
    "spindle_override": "stat.spindle[0].override",
    "running": "stat.interp_state and stat.motion_type",
    "tool": "stat.tool_in_spindle",
}
"""Fields of the status channel by quantity."""


class LinuxCncSource:
    """LinuxCNC on this machine, read once per interval."""

    def __init__(self, interval: float, pins: Mapping[str, str], python: str = PYTHON) -> None:
        """Keep the settings; nothing is started yet.

        Args:
            interval: time between two reads [s].
            pins: HAL pins or signals of quantities, in the units of the record.
            python: the Python that has LinuxCNC's modules.

        Raises:
            UserError: A quantity is unknown.
        """
        for name in pins:
            if name not in QUANTITIES:
                raise UserError(f"--pin {name}: must be one of {', '.join(QUANTITIES)}")
        self._interval = interval
        self._pins = dict(pins)
        self._python = python
        self._announcer = Announcer()

    def found(self) -> list[str]:
        lines = []
        for name, where in {**STATUS, **self._pins}.items():
            lines.append(f"{header_of(name)} from {where}")
        return lines

    def samples(self, last: Sample | None, runs: Runs) -> Iterator[Sample]:
        if not Path(self._python).exists():
            raise FileNotFoundError(f"{self._python}, the Python of {PACKAGE}, does not exist")
        command = [self._python, str(READER), str(self._interval), json.dumps(self._pins)]
        environment = {}
        for name, value in os.environ.items():
            if not name.startswith("PYTHON"):
                environment[name] = value
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        self._announcer.say(self.found())
        with process:
            try:
                for line in process.stdout or ():
                    if not runs():
                        return
                    answer = json.loads(line)
                    if "error" in answer:
                        raise ConnectionError(f"LinuxCNC: {answer['error']}")
                    sample = _sample(answer, last, self._interval)
                    yield sample
                    last = sample
                raise ConnectionError("LinuxCNC: the reading process has ended")
            finally:
                process.kill()


def _sample(answer: dict[str, Any], last: Sample | None, interval: float) -> Sample:
    now = datetime.fromtimestamp(answer.pop("time"), UTC)
    tool = str(answer.pop("tool"))
    return Sample(time=now, tool=tool, gap=silence(last, now, interval), **answer)
