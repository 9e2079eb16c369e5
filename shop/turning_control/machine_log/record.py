"""The record of a machine: samples, the CSV file that holds them, and what a gap is.

A sample is the state of the machine from its time on, until the next sample. Its ``gap`` says what
is unknown *before* it: nothing is interpolated across a gap. Sources (``opcua.py``,
``mtconnect.py`` and ``linuxcnc.py``) yield samples; ``cuts.py`` makes a sheet of cuts of a record.
"""

import csv
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol, TextIO

from turning_env.console import UserError, printable

TEXTS = ("time", "tool", "mark", "gap")  # fields of a sample that are no numbers
MAX_SILENCE = 5.0  # time between two reads above which there is a gap [intervals of reading]
RETRY_PAUSE = 2.0  # time until a lost connection is tried again [s]


def _quantity(unit: str, meaning: str) -> Any:
    """Return a field of a sample that is a number in a unit; NaN if the machine does not say it."""
    return field(default=math.nan, metadata={"unit": unit, "meaning": meaning})


@dataclass(frozen=True)
class Sample:
    """The state of a machine from a time on."""

    time: datetime  # in UTC
    spindle_speed: float = _quantity("rev/min", "speed of the spindle")
    feed_rate: float = _quantity("mm/min", "speed of the tool along its path")
    x: float = _quantity("mm", "position of the tool across the bar, as the control shows it")
    z: float = _quantity("mm", "position of the tool along the bar")
    diameter: float = _quantity("mm", "diameter at the tool, if the control states it")
    spindle_power: float = _quantity("kW", "power of the spindle drive")
    spindle_load: float = _quantity("%", "load of the spindle drive over its rating")
    spindle_torque: float = _quantity("N m", "torque of the spindle drive")
    x_load: float = _quantity("%", "load of the cross feed drive over its rating")
    z_load: float = _quantity("%", "load of the longitudinal feed drive over its rating")
    feed_override: float = _quantity("%", "feed override")
    rapid_override: float = _quantity("%", "rapid override")
    spindle_override: float = _quantity("%", "spindle override")
    running: float = _quantity("-", "1 if a program runs, 0 if not")
    tool: str = ""  # number or name of the tool
    mark: str = ""  # where the source goes on reading, in its own terms
    gap: str = ""  # what is unknown before this sample; empty if nothing is


QUANTITIES = {item.name: item for item in fields(Sample) if item.name not in TEXTS}
"""Fields of a sample that are numbers, with ``unit`` and ``meaning`` in their metadata."""


def header_of(name: str) -> str:
    """Return the header of a field's column, with its unit."""
    unit = QUANTITIES[name].metadata["unit"] if name in QUANTITIES else "-"
    return name if unit == "-" else f"{name} [{unit}]"


FIELDS = tuple(item.name for item in fields(Sample))
HEADERS = [header_of(name) for name in FIELDS]

Runs = Callable[[], bool]
"""Whether to go on; asked once per cycle."""


class Source(Protocol):
    """A machine to read from."""

    def found(self) -> list[str]:
        """Return lines that say where each quantity comes from.

        OSError: The machine cannot be reached. UserError: It does not offer what is asked for.
        """

    def samples(self, last: Sample | None, runs: Runs) -> Iterator[Sample]:
        """Yield samples of one connection, from the last one that is recorded on.

        OSError: The connection cannot be made, or is lost.
        """


class Announcer:
    """Prints where quantities come from, on the first connection of a source."""

    def __init__(self) -> None:
        self._has_said = False

    def say(self, lines: Sequence[str]) -> None:
        """Print lines to stderr, the first time only."""
        if not self._has_said:
            print(*lines, sep="\n", file=sys.stderr)
        self._has_said = True


def reconnecting(
    source: Source, last: Sample | None, runs: Runs, pause: float = RETRY_PAUSE
) -> Iterator[Sample]:
    """Yield the samples of a source, and connect again after a loss, until ``runs`` says no.

    There is a pause before another try [s]. The first connection must succeed, because its failure
    is likely a mistake.

    Raises:
        OSError: The first connection cannot be made.
    """
    has_read = False
    fault = ""  # why there is no connection; empty if there is one
    while runs():
        try:
            for sample in source.samples(last, runs):
                if fault:
                    print("connected again", file=sys.stderr)
                has_read = True
                fault = ""
                last = sample
                yield sample
        except OSError as error:
            if not has_read:
                raise
            # A machine that is off all night needs no line every two seconds.
            reason = str(error) or type(error).__name__
            if reason != fault:
                print(f"lost: {reason}; trying again", file=sys.stderr)
            fault = reason
        pause_until(time.monotonic() + pause, runs)


def pause_until(due: float, runs: Runs) -> None:
    """Wait until a time of ``time.monotonic`` [s], or until ``runs`` says no."""
    while runs() and (left := due - time.monotonic()) > 0.0:
        time.sleep(min(left, 0.2))


def silence(last: Sample | None, now: datetime, interval: float) -> str:
    """Return the gap between two reads of a source that is read every ``interval`` [s]."""
    if last is None:
        return ""
    seconds = (now - last.time).total_seconds()
    if seconds <= max(MAX_SILENCE * interval, 1.0):
        return ""
    return f"{seconds:.1f} s without a reading"


def last_sample(path: Path, append: bool) -> Sample | None:
    """Return the last sample of a record that is continued; None if it has none yet.

    Raises:
        UserError: The file exists and is not to be continued, or is no record.
        OSError: The file cannot be read or written.
    """
    if not path.exists():
        return None
    if not append:
        raise UserError(f"{path} exists; --append continues it")
    last = None
    for last in read_samples(path):  # noqa: B007 - the last one counts
        pass
    _drop_partial_line(path)
    return last


def _drop_partial_line(path: Path) -> None:
    """Cut off the end of a file after its last line break: a crash may leave half a line."""
    with path.open("rb+") as file:
        file.truncate(file.read().rfind(b"\n") + 1)


class Recorder:
    """Writes samples to the end of a file, each at once, so that a crash loses none.

    A new file is made with the first sample: a machine that cannot be reached leaves none.
    """

    def __init__(self, path: Path) -> None:
        self.count = 0
        self.gaps = 0
        self._path = path
        self._file: TextIO | None = None

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()

    def write(self, sample: Sample) -> None:
        """Write a sample; OSError if the file cannot be written."""
        if self._file is None:
            is_new = not self._path.exists()
            self._file = self._path.open("a", encoding="utf-8", newline="")
            if is_new:
                self._write(HEADERS)
        self._write([_cell(sample, name) for name in FIELDS])
        self.count += 1
        self.gaps += bool(sample.gap)

    def _write(self, cells: list[str]) -> None:
        if self._file is not None:
            csv.writer(self._file, lineterminator="\n").writerow(cells)
            self._file.flush()


def _cell(sample: Sample, name: str) -> str:
    value = getattr(sample, name)
    if name == "time":
        return str(value.astimezone(UTC).isoformat(timespec="milliseconds"))
    if name in TEXTS:
        return printable(value)
    return "" if math.isnan(value) else f"{value:.7g}"


def read_samples(path: Path) -> Iterator[Sample]:
    """Yield the samples of a record.

    A last line without a line break, as a crash leaves it, is left out.

    Raises:
        UserError: The file is no record; the message names the line.
        OSError: The file cannot be read.
    """
    with path.open(encoding="utf-8", newline="") as file:
        reader = csv.reader(line for line in file if line.endswith("\n"))
        if next(reader, None) != HEADERS:
            raise UserError(
                f"{path} is no record of `python -m turning_control log`: its first line must be "
                f"{','.join(HEADERS[:4])},..."
            )
        for cells in reader:
            where = f"{path}, line {reader.line_num}"
            if len(cells) != len(HEADERS):
                raise UserError(f"{where}: {len(cells)} cells, but the header has {len(HEADERS)}")
            yield _sample(cells, where)


def _sample(cells: list[str], where: str) -> Sample:
    values: dict[str, Any] = {}
    for name, cell in zip(FIELDS, cells, strict=False):
        try:
            values[name] = _value(name, cell)
        except ValueError as error:
            raise UserError(f"{where}, {name}: {error}") from error
    return Sample(**values)


def _value(name: str, cell: str) -> Any:
    if name == "time":
        return datetime.fromisoformat(cell)
    if name in TEXTS:
        return cell
    return float(cell) if cell else math.nan
