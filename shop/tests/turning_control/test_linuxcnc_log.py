"""Records of LinuxCNC, with its modules replaced by small ones."""

import shlex
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from turning_control.machine_log.linuxcnc import LinuxCncSource

from turning_env.console import UserError

# A lathe in inches, whose status has no command channel beside it.
LINUXCNC = """
INTERP_IDLE = 1

class error(Exception):
    pass

class stat:
    polls = 0

    def poll(self):
        stat.polls += 1
        if stat.polls == 4:
            raise error("emcStatusBuffer invalid err=3")
        self.linear_units = 1 / 25.4
        self.spindle = ({"speed": -900.0, "override": 0.9},)
        self.current_vel = 0.15
        self.actual_position = (2.0, 0.0, -1.0)
        self.g5x_offset = (1.0, 0.0, 0.0)
        self.g92_offset = self.tool_offset = (0.0, 0.0, 0.0)
        self.feedrate, self.rapidrate = 0.8, 1.0
        self.interp_state, self.paused, self.motion_type = 3, False, 2
        self.tool_in_spindle = 7
"""
HAL = """
alive = []

class component:
    def __init__(self, name):
        alive.append(name)

    def ready(self):
        pass

    def __del__(self):
        alive.clear()

def get_value(pin):
    if not alive:
        raise RuntimeError("Cannot call before creating component")
    return {"drive.power-kw": 4.25}[pin]
"""


@pytest.fixture
def python(tmp_path: Path) -> str:
    """Return a Python that finds the replaced modules."""
    (tmp_path / "linuxcnc.py").write_text(LINUXCNC)
    (tmp_path / "hal.py").write_text(HAL)
    script = tmp_path / "python"
    words = f"PYTHONPATH={shlex.quote(str(tmp_path))} exec {shlex.quote(sys.executable)}"
    script.write_text(f'#!/bin/sh\n{words} "$@"\n')
    script.chmod(0o755)
    return str(script)


def times(count: int) -> Callable[[], bool]:
    """Return what says yes a number of times."""
    answers = iter([True] * count)
    return lambda: next(answers, False)


def test_the_status_and_named_pins_are_read_in_the_units_of_the_record(python: str) -> None:
    source = LinuxCncSource(0.01, {"spindle_power": "drive.power-kw"}, python=python)
    first, *_ = source.samples(None, times(3))
    assert first.spindle_speed == 900.0
    assert first.spindle_override == 90.0
    assert first.feed_rate == pytest.approx(60 * 0.15 * 25.4)
    assert first.diameter == pytest.approx(50.8)  # a radius of an inch from the work's zero
    assert first.z == pytest.approx(-25.4)
    assert first.spindle_power == 4.25
    assert first.running == 1.0
    assert first.tool == "7"
    assert first.gap == ""


def test_the_end_of_linuxcnc_is_a_lost_connection(python: str) -> None:
    samples = LinuxCncSource(0.01, {}, python=python).samples(None, lambda: True)
    with pytest.raises(ConnectionError, match="emcStatusBuffer"):
        list(samples)


def test_an_unknown_quantity_or_no_linuxcnc_is_a_mistake(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="spindle_power"):
        LinuxCncSource(0.1, {"power": "drive.power"})
    with pytest.raises(OSError, match="does not exist"):
        next(LinuxCncSource(0.1, {}, python=str(tmp_path / "no")).samples(None, times(1)))
