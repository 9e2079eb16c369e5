"""LinuxCNC's interpreter ``rs274`` as the reference for moves and times: programs in its dialect, and what it makes of them."""

import itertools
import math
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

Point = tuple[float, float]

INSTALLED = shutil.which("rs274") is not None
HOME = "G0 X400 Z200"
INCH, FOOT = 25.4, 0.3048


@dataclass(frozen=True)
class Canonical:
    """A move: kind, end and centre as Z and X (radius) [mm], sense, and its duration [s]."""

    kind: str
    end: tuple[float, float]
    centre: tuple[float, float] | None
    clockwise: bool
    time: float


_WORDS: dict[str, list[tuple[str, Any]]] = {
    "fanuc": [
        *((r"\([^)]*\)", ""), (r"\bG98\b", "G94"), (r"\bG99\b", "G95"), (r"^(N\d+ )?G50 S\d+$", ""), (r"\bT(\d+)\b", r"T\1 M6")),
        *((r"\bG4 P(\d+)$", lambda found: f"G4 P{int(found[1]) / 1000}"), (r"^G28.*", HOME), (r"^%$", "")),
    ],
    "sinumerik": [
        *((r";.*", ""), (r"^%_N_\w+_MPF$", ""), (r"^%_N_L(\d+)_SPF$", r"O\1"), (r"\bRET\b|\bM17\b", "M99")),
        (r"\bL(\d+)(?: P(\d+))?$", lambda found: f"M98 P{found[1]} L{found[2] or 1}"),
        *((r'MSG\("[^"]*"\)', ""), (r"\bG4 F", "G4 P"), (r'T="[^"]*"', "T1"), (r"\bT(\d+)( D\d+)?( M6)?", r"T\1 M6")),
        *((r" LIMS=\d+", ""), (r"CR=", "R"), (r"^(N\d+) G26 S\d+$", r"\1"), (r"G71\b|G710", "G21"), (r"G70\b|G700", "G20")),
        *((r"DIAMON", "G7"), (r"DIAMOF", "G8")),
    ],
}
"""Words of a dialect, and those of LinuxCNC."""


def translated(text: str, dialect: str) -> str:
    """Return the program in LinuxCNC's dialect, by substitutions of words."""
    limit = re.findall(r"(?:G50 S|LIMS=)(\d+)", text)
    lines = [HOME]
    for line in text.splitlines():
        for pattern, replacement in _WORDS[dialect]:
            line = re.sub(pattern, replacement, line)
        if dialect == "fanuc" and re.search(r"\b[UW]-?\d", line):
            line = f"G91 {re.sub('U', 'X', re.sub('W', 'Z', line))}\nG90"
        lines.append(line)
    body = "\n".join(lines)
    if dialect == "fanuc":
        body = re.sub(r"(?m)^O\d+.*$", "", body, count=1)
    if limit:  # those in force, in their order; the last stays
        following = itertools.chain(limit, itertools.repeat(limit[-1]))
        body = re.sub(r"G96 S", lambda found: f"G96 D{next(following)} S", body)
    return f"O1\nG7 G90 G18 G21 G95\n{body}\n"


def canonical(program: str, folder: Path) -> list[Canonical]:
    """Return the moves that ``rs274`` makes of a program."""
    (folder / "program.ngc").write_text(program)
    tools = [1, 2, 3, 4, 5, 101, 202, 303, 404]
    (folder / "tool.tbl").write_text("".join(f"T{tool} P{tool} X0 Z0 D0\n" for tool in tools))
    finished = subprocess.run(
        ["rs274", "-g", "-t", "tool.tbl", "program.ngc"], cwd=folder, capture_output=True, text=True, timeout=60, check=False
    )
    assert finished.returncode == 0, finished.stdout[-400:] + finished.stderr[-400:]
    return _moves(finished.stdout)


def _moves(output: str) -> list[Canonical]:
    """Follow the canonical commands, and integrate the times with 500 steps per move."""
    moves = []
    here = 0.0, 0.0
    scale, per_turn, feed, lead, limit, speed, spindle_scale = 1.0, False, 0.0, 0.0, 0.0, 0.0, 1.0
    for name, given in re.findall(r"(\w+)\(([^)]*)\)", output):
        values = [float(value) for value in re.findall(r"-?\d+\.?\d*", given)]
        if name == "USE_LENGTH_UNITS":
            scale = INCH if "INCHES" in given else 1.0
            spindle_scale = FOOT if "INCHES" in given else 1.0
        elif name == "SET_FEED_MODE":
            per_turn = values[1] == 1.0
        elif name == "SET_FEED_RATE":
            feed = values[0] * scale
        elif name == "SET_SPINDLE_MODE":
            limit = values[1]
        elif name == "SET_SPINDLE_SPEED":
            speed = values[1]
        elif name == "START_SPEED_FEED_SYNC":
            lead = values[0] * scale
        elif name == "STOP_SPEED_FEED_SYNCH":
            lead = 0.0
        elif name == "DWELL":
            moves.append(Canonical("dwell", here, None, False, values[0]))
        elif name in ("STRAIGHT_TRAVERSE", "STRAIGHT_FEED", "ARC_FEED"):
            centre, clockwise = None, False
            if name == "ARC_FEED":
                z, x, centre_z, centre_x, turns = values[:5]
                centre, clockwise = (centre_z * scale, centre_x * scale), turns < 0
            else:
                x, _, z = values[:3]
            end = z * scale, x * scale
            rapid = name == "STRAIGHT_TRAVERSE"
            time = 60.0 * math.dist(here, end) / 10_000.0
            if not rapid:
                turning = speed * (spindle_scale if limit else 1.0)
                time = _feed_time(here, end, centre, clockwise, lead or feed, per_turn or lead > 0.0, limit, turning)
            moves.append(Canonical("rapid" if rapid else "feed", end, centre, clockwise, time))
            here = end
    return moves


def _feed_time(
    start: Point, end: Point, centre: Point | None, clockwise: bool, feed: float, per_turn: bool, limit: float, speed: float
) -> float:
    shares = (np.arange(500) + 0.5) / 500
    length, radii = math.dist(start, end), start[1] + shares * (end[1] - start[1])
    if centre is not None:
        radius, sign = math.dist(start, centre), -1.0 if clockwise else 1.0
        first, last = (math.atan2(point[1] - centre[1], point[0] - centre[0]) for point in (start, end))
        turn = sign * (last - first) % (2 * math.pi)
        length, radii = radius * turn, centre[1] + radius * np.sin(first + sign * turn * shares)
    if not per_turn:
        return 60.0 * length / feed
    turns = np.minimum(1000.0 * speed / (2 * math.pi * np.maximum(abs(radii), 1e-6)), limit) if limit else speed
    return float(np.mean(60.0 * length / (feed * turns)))
