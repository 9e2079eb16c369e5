"""LinuxCNC's interpreter ``rs274`` as the reference for moves, feeds and speeds.

Programs are translated to LinuxCNC's dialect, and its canonical commands are read as moves.
"""

import itertools
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

INSTALLED = shutil.which("rs274") is not None
HOME = "G0 X400 Z200"
INCH = 25.4  # [mm]
FOOT = 0.3048  # [m]
MAX_TIME = 60  # of rs274 [s]

# Tools of the programs; rs274 refuses others.
TOOLS = (1, 2, 3, 4, 5, 101, 202, 303, 404)


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


Replacement = str | Callable[[re.Match[str]], str]


def _dwell_in_seconds(match: re.Match[str]) -> str:
    return f"G4 P{int(match[1]) / 1000}"


def _call(match: re.Match[str]) -> str:
    return f"M98 P{match[1]} L{match[2] or 1}"


# Words of a dialect, and those of LinuxCNC.
_WORDS: dict[str, list[tuple[str, Replacement]]] = {
    "fanuc": [
        (r"\([^)]*\)", ""),
        (r"\bG98\b", "G94"),
        (r"\bG99\b", "G95"),
        (r"^(N\d+ )?G50 S\d+$", ""),
        (r"\bT(\d+)\b", r"T\1 M6"),
        (r"\bG4 P(\d+)$", _dwell_in_seconds),
        (r"^G28.*", HOME),
        (r"^%$", ""),
    ],
    "sinumerik": [
        (r";.*", ""),
        (r"^%_N_\w+_MPF$", ""),
        (r"^%_N_L(\d+)_SPF$", r"O\1"),
        (r"\bRET\b|\bM17\b", "M99"),
        (r"\bL(\d+)(?: P(\d+))?$", _call),
        (r'MSG\("[^"]*"\)', ""),
        (r"\bG4 F", "G4 P"),
        (r'T="[^"]*"', "T1"),
        (r"\bT(\d+)( D\d+)?( M6)?", r"T\1 M6"),
        (r" LIMS=\d+", ""),
        (r"CR=", "R"),
        (r"^(N\d+) G26 S\d+$", r"\1"),
        (r"G71\b|G710", "G21"),
        (r"G70\b|G700", "G20"),
        (r"DIAMON", "G7"),
        (r"DIAMOF", "G8"),
    ],
}


def translated(text: str, dialect: str) -> str:
    """Return the program in LinuxCNC's dialect, by substitutions of words."""
    lines = [HOME]
    for line in text.splitlines():
        for pattern, replacement in _WORDS[dialect]:
            line = re.sub(pattern, replacement, line)
        # LinuxCNC has no U and W.
        if dialect == "fanuc" and re.search(r"\b[UW]-?\d", line):
            line = f"G91 {line.replace('U', 'X').replace('W', 'Z')}\nG90"
        lines.append(line)
    body = "\n".join(lines)
    if dialect == "fanuc":
        body = re.sub(r"(?m)^O\d+.*$", "", body, count=1)
    body = _with_limits(body, re.findall(r"(?:G50 S|LIMS=)(\d+)", text))
    return f"O1\nG7 G90 G18 G21 G95\n{body}\n"


def _with_limits(body: str, limits: list[str]) -> str:
    """Return a program whose G96 state the spindle's limits, in their order; the last stays."""
    if not limits:
        return body
    in_force = itertools.chain(limits, itertools.repeat(limits[-1]))
    return re.sub(r"G96 S", lambda _: f"G96 D{next(in_force)} S", body)


def canonical(program: str, folder: Path) -> list[Canonical]:
    """Return the moves that ``rs274`` makes of a program."""
    (folder / "program.ngc").write_text(program)
    (folder / "tool.tbl").write_text("".join(f"T{tool} P{tool} X0 Z0 D0\n" for tool in TOOLS))
    finished = subprocess.run(
        ["rs274", "-g", "-t", "tool.tbl", "program.ngc"],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=MAX_TIME,
        check=False,
    )
    assert finished.returncode == 0, finished.stdout[-400:] + finished.stderr[-400:]
    state = _State()
    for name, arguments in re.findall(r"(\w+)\(([^)]*)\)", finished.stdout):
        state.run(name, arguments)
    return state.moves


@dataclass
class _State:
    """State that canonical commands have set, and the moves that they make."""

    moves: list[Canonical] = field(default_factory=list)
    here: tuple[float, float] = (0.0, 0.0)
    scale: float = 1.0  # of lengths to mm
    per_turn: bool = False
    feed: float = 0.0
    lead: float = 0.0  # of a thread; 0 outside
    limit: float = 0.0
    speed: float = 0.0

    def run(self, name: str, arguments: str) -> None:
        """Run a canonical command; those that are not known have no effect here."""
        values = [float(value) for value in re.findall(r"-?\d+\.?\d*", arguments)]
        match name:
            case "USE_LENGTH_UNITS":
                self.scale = INCH if "INCHES" in arguments else 1.0
            case "SET_FEED_MODE":
                self.per_turn = values[1] == 1.0
            case "SET_FEED_RATE":
                self.feed = values[0] * self.scale
            case "SET_SPINDLE_MODE":
                self.limit = values[1]
            case "SET_SPINDLE_SPEED":
                self.speed = values[1]
            case "START_SPEED_FEED_SYNC":
                self.lead = values[0] * self.scale
            case "STOP_SPEED_FEED_SYNCH":
                self.lead = 0.0
            case _:
                self._move(name, values)

    def _move(self, name: str, values: list[float]) -> None:
        """Add the move of a command, if it makes one."""
        if name == "DWELL":
            dwell = Canonical(
                "dwell",
                self.here,
                centre=None,
                clockwise=False,
                time=values[0],
            )
            self.moves.append(dwell)
        elif name == "STRAIGHT_TRAVERSE":
            # X, Y and Z of the end.
            self.here = self._point(values[2], values[0])
            self.moves.append(
                Canonical(
                    "rapid",
                    self.here,
                    centre=None,
                    clockwise=False,
                )
            )
        elif name == "STRAIGHT_FEED":
            self.here = self._point(values[2], values[0])
            self._feed(centre=None, clockwise=False)
        elif name == "ARC_FEED":
            # Z and X of the end, Z and X of the centre, and the turns, below 0 if clockwise.
            self.here = self._point(values[0], values[1])
            centre = self._point(values[2], values[3])
            self._feed(centre=centre, clockwise=values[4] < 0)

    def _point(self, z: float, x: float) -> tuple[float, float]:
        return z * self.scale, x * self.scale

    def _feed(self, centre: tuple[float, float] | None, clockwise: bool) -> None:
        # The cutting speed of programs in inch is in feet per minute.
        in_feet = self.limit and self.scale == INCH
        self.moves.append(
            Canonical(
                "feed",
                self.here,
                centre=centre,
                clockwise=clockwise,
                feed=self.lead or self.feed,
                per_turn=self.per_turn or self.lead > 0.0,
                speed=self.speed * (FOOT if in_feet else 1.0),
                limit=self.limit,
            )
        )
