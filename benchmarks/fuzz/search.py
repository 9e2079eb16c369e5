"""Tries contents on a reader and keeps those that break its promise, one for each place in the code."""

import hashlib
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from benchmarks.fuzz.damage import damaged
from benchmarks.fuzz.readers import ROOT, Reader

LONGEST = 20.0
"""Processor time of one input [s]: what takes longer is a finding too."""
_MOST_KEPT = 20


@dataclass
class Search:
    """A search in one reader.

    Args:
        reader: what is tried.
        scratch: folder for the file that it reads, which must exist.
        kept: folder for contents that break a promise; it is made when the first is found.
        report: called now and then, and told how many have been tried, what was found, and the processor time taken [s].
    """

    reader: Reader
    scratch: Path
    kept: Path
    report: Callable[[int, dict[str, str], float], object] = lambda tried, found, seconds: None
    tried: int = 0
    found: dict[str, str] = field(default_factory=dict)
    """Of each file that was kept, the error."""
    _places: set[tuple[str, ...]] = field(default_factory=set)
    _begun: float = field(default_factory=time.process_time)
    _reported: float = 0.0

    @property
    def seconds(self) -> float:
        """Processor time since it was begun [s]."""
        return time.process_time() - self._begun

    def attempt(self, content: bytes) -> None:
        """Try one content."""
        started = self.seconds
        try:
            self.reader.check(self.scratch, content)
        except Exception as error:
            self._keep(content, error)
        taken = self.seconds - started
        if taken > LONGEST:
            self._keep(content, TimeoutError(f"takes {taken:.0f} s of processor time"))
        self.tried += 1
        if time.monotonic() - self._reported >= 1.0:
            self.tell()

    def damage(self, seconds: float, inputs: int | None, random: Random) -> None:
        """Try contents damaged at random, for so many seconds of processor time, or so many of them; what is valid goes first."""
        valid = self.reader.valid()
        for content in valid:
            self.attempt(content)
        while self.seconds < seconds and (inputs is None or self.tried < inputs):
            damage = self.reader.damaged if random.random() < 0.7 else damaged
            self.attempt(damage(random.choice(valid), random))

    def _keep(self, content: bytes, error: Exception) -> None:
        place = _place(error)
        if place in self._places or len(self._places) >= _MOST_KEPT:
            return
        self._places.add(place)
        path = keep(self.kept, content, self.reader.suffix)
        self.found[str(path)] = f"{type(error).__name__}: {error}"[:300]
        self.tell()

    def tell(self) -> None:
        """Call ``report``."""
        self._reported = time.monotonic()
        self.report(self.tried, self.found, self.seconds)


def keep(folder: Path, content: bytes, suffix: str) -> Path:
    """Keep a content that breaks a promise, in a folder that is made; where it is."""
    path = folder / f"found-{hashlib.sha256(content).hexdigest()[:12]}{suffix}"
    folder.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    return path


def _place(error: Exception) -> tuple[str, ...]:
    """What tells one fault from another: the error's type, and the last line of the project's that it came through."""
    lines = [f"{frame.filename}:{frame.lineno}" for frame in traceback.extract_tb(error.__traceback__)]
    return type(error).__name__, *[line for line in lines if line.startswith(str(ROOT))][-1:]
