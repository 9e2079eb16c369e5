"""LinuxCNC's interpreter ``rs274`` as the reference for moves, feeds and speeds: programs in its dialect, and its moves."""

import itertools
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

INSTALLED = shutil.which("rs274") is not None
HOME = "G0 X400 Z200"
INCH, FOOT = 25.4, 0.3048


@dataclass(frozen=True)
class Canonical:
    """A move: kind, end and centre as Z and X (radius) [mm], and sense."""

    kind: str
    end: tuple[float, float]
    centre: tuple[float, float] | None
    clockwise: bool
    feed: float = 0.0  # [mm/rev] or [mm/min]
    per_turn: bool = False
    speed: float = 0.0  # [rev/min], or [m/min] with a limit of the spindle's speed
    limit: float = 0.0  # [rev/min]
    time: float = 0.0  # of a dwell [s]


_WORDS: dict[str, list[tuple[str, Any]]] = {
    "fanuc": [
        *(
            (r"\([^)]*\)", ""),
            (r"\bG98\b", "G94"),
            (r"\bG99\b", "G95"),
            (r"^(N\d+ )?G50 S\d+$", ""),
            (r"\bT(\d+)\b", r"T\1 M6"),
        ),
        *(
            (r"\bG4 P(\d+)$", lambda found: f"G4 P{int(found[1]) / 1000}"),
            (r"^G28.*", HOME),
            (r"^%$", ""),
        ),
    ],
    "sinumerik": [
        *(
            (r";.*", ""),
            (r"^%_N_\w+_MPF$", ""),
            (r"^%_N_L(\d+)_SPF$", r"O\1"),
            (r"\bRET\b|\bM17\b", "M99"),
        ),
        (r"\bL(\d+)(?: P(\d+))?$", lambda found: f"M98 P{found[1]} L{found[2] or 1}"),
        *(
            (r'MSG\("[^"]*"\)', ""),
            (r"\bG4 F", "G4 P"),
            (r'T="[^"]*"', "T1"),
            (r"\bT(\d+)( D\d+)?( M6)?", r"T\1 M6"),
        ),
        *(
            (r" LIMS=\d+", ""),
            (r"CR=", "R"),
            (r"^(N\d+) G26 S\d+$", r"\1"),
            (r"G71\b|G710", "G21"),
            (r"G70\b|G700", "G20"),
        ),
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
        ["rs274", "-g", "-t", "tool.tbl", "program.ngc"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert finished.returncode == 0, finished.stdout[-400:] + finished.stderr[-400:]
    return _moves(finished.stdout)


def _moves(output: str) -> list[Canonical]:
    """Follow the canonical commands."""
    moves, here = [], (0.0, 0.0)
    scale, per_turn, feed, lead, limit, speed = 1.0, False, 0.0, 0.0, 0.0, 0.0
    for name, given in re.findall(r"(\w+)\(([^)]*)\)", output):
        values = [float(value) for value in re.findall(r"-?\d+\.?\d*", given)]
        match name:
            case "USE_LENGTH_UNITS":
                scale = INCH if "INCHES" in given else 1.0
            case "SET_FEED_MODE":
                per_turn = values[1] == 1.0
            case "SET_FEED_RATE":
                feed = values[0] * scale
            case "SET_SPINDLE_MODE":
                limit = values[1]
            case "SET_SPINDLE_SPEED":
                speed = values[1]
            case "START_SPEED_FEED_SYNC":
                lead = values[0] * scale
            case "STOP_SPEED_FEED_SYNCH":
                lead = 0.0
            case "DWELL":
                moves.append(Canonical("dwell", here, None, False, time=values[0]))
            case "STRAIGHT_TRAVERSE":
                here = values[2] * scale, values[0] * scale
                moves.append(Canonical("rapid", here, None, False))
            case "STRAIGHT_FEED" | "ARC_FEED":
                centre, clockwise = None, False
                here = values[2] * scale, values[0] * scale
                if name == "ARC_FEED":
                    here, centre = (
                        (values[0] * scale, values[1] * scale),
                        (values[2] * scale, values[3] * scale),
                    )
                    clockwise = values[4] < 0
                turning = speed * (FOOT if limit and scale == INCH else 1.0)
                moves.append(
                    Canonical(
                        "feed",
                        here,
                        centre,
                        clockwise,
                        lead or feed,
                        per_turn or lead > 0.0,
                        turning,
                        limit,
                    )
                )
    return moves
