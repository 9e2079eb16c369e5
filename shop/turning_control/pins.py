"""The lines of pins that a process exchanges with ``lathe/hal_bridge.py``."""

import json
from collections.abc import Iterator
from typing import Any, TextIO

FEED_MOTION = 2  # ``motion.motion-type`` of a move at feed


class Pins:
    """The other side of ``hal_bridge.py``: yields its requests, and answers the last one."""

    def __init__(self, requests: TextIO, answers: TextIO) -> None:
        self._requests = requests
        self._answers = answers
        self._time = 0.0  # of the last request

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Say that everything is loaded, then yield pins until the requests end."""
        self._write("ready")
        for line in self._requests:
            pins = json.loads(line)
            self._time = pins["time"]
            yield pins

    def answer(self, **pins: float) -> None:
        """Answer the last request."""
        values = {name.replace("_", "-"): value for name, value in pins.items()}
        self._write(json.dumps({"time": self._time, **values}))

    def _write(self, line: str) -> None:
        self._answers.write(line + "\n")
        self._answers.flush()
