"""Turn a record of a machine into a sheet with one cut per row, which ``calibrate`` reads.

A cut is a stretch of the record at feed, with the spindle turning and the power above that of
idling, at one cutting speed and feed. A gap ends it. Power is the mean over its steady part, less
the idle power at this spindle speed. Depth and wear are not known to a control: the user adds them.
"""

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from turning_control.machine_log.record import Sample, read_samples
from turning_shop import Values

from turning_env.console import UserError
from turning_env.files import replace_file
from turning_env.numerics.conversions import cutting_speed_at, power_at

MIN_SPEED = 1.0  # spindle speed above which it turns [rev/min]
MAX_FEED = 2.0  # feed above which a move is a rapid [mm/rev]
STEADY = 0.05  # share by which speed and feed of one cut may differ from their means [-]
TRIM = 0.5  # at both ends of a cut, while the tool enters and leaves and drives settle [s]
MIN_STEADY = 1.0  # time that must be left of a cut [s]
ENTRY = 0.05  # share of the highest power over idle power from which the tool is in metal [-]
RECENT = 50  # samples of a cut whose mean the next one is compared with
NEAR_SPEED = 0.15  # share by which an idle spindle speed may differ from the cut's [-]

HEADERS = (
    "edge",
    "cutting_speed [m/min]",
    "feed [mm/rev]",
    "depth_of_cut [mm]",
    "time [min]",
    "wear [mm]",
    "power [kW]",
    "note",
)


@dataclass(frozen=True)
class CutSettings:
    """Settings of a search for cuts, which a record does not state."""

    x: str | None = None  # whether the record's x is a "radius" or a "diameter"
    diameter: float | None = None  # of the bar, the same in all cuts [mm]
    rated_power: float | None = None  # of the spindle, where only its load is recorded [kW]
    idle_power: float | None = None  # None: the record shows it [kW]
    depth: float | None = None  # depth of cut, the same in all cuts [mm]
    wear: float | None = None  # flank wear, the same in all cuts [mm]
    edge: str | None = None  # name of the edge of all cuts; None: the tool's number
    is_fresh: bool = False  # whether each tool had a fresh edge when the record began


@dataclass(frozen=True)
class Record:
    """A record as arrays of shape (samples,)."""

    time: Values  # since the first sample [s]
    weight: Values  # time until the next sample, 0 for the last and before gaps [s]
    spindle_speed: Values  # [rev/min]
    cutting_speed: Values  # [m/min]
    feed_rate: Values  # [mm/min]
    power: Values  # [kW]
    is_running: NDArray[np.bool_]
    is_after_gap: NDArray[np.bool_]
    samples: list[Sample]

    @property
    def feed(self) -> Values:
        """Feed [mm/rev]."""
        return self.feed_rate / np.maximum(self.spindle_speed, MIN_SPEED)


@dataclass(frozen=True)
class Cut:
    """A cut at one speed and feed."""

    start: Sample
    tool: str
    spindle_speed: float  # [rev/min]
    cutting_speed: float  # [m/min]
    feed: float  # [mm/rev]
    power: float  # without idle power [kW]
    idle_power: float  # [kW]
    seconds: float  # in metal [s]
    is_steady: bool  # whether enough of it is left without its ends
    is_after_gap: bool  # whether the record has a gap before it
    # Cutting time since the tool's edge was fresh, all at these settings [min]; NaN if unknown.
    edge_time: float = math.nan


@dataclass(frozen=True)
class FoundCuts:
    """The cuts of a record, and how they were found."""

    cuts: list[Cut]
    notes: list[str]


def read_record(path: Path, settings: CutSettings) -> Record:
    """Return a record with the cutting speed and the power that follow from it.

    Raises:
        UserError: The file is no record, or lacks what a cut needs.
        OSError: The file cannot be read.
    """
    samples = list(read_samples(path))
    if len(samples) < 2:
        raise UserError(f"{path} has fewer than two samples")

    def column(name: str) -> Values:
        return np.array([getattr(sample, name) for sample in samples])

    time = np.array([sample.time.timestamp() for sample in samples])
    is_after_gap = np.array([bool(sample.gap) for sample in samples])
    weight = np.append(np.diff(time), 0.0)
    weight[:-1][is_after_gap[1:]] = 0.0
    needed = {"spindle_speed": column("spindle_speed"), "feed_rate": column("feed_rate")}
    for name, values in needed.items():
        if not np.isfinite(values).any():
            raise UserError(f"{path}: the machine gives no {name}, without which no cut is known")
    spindle_speed = np.abs(needed["spindle_speed"])
    diameter = _diameter(path, settings, diameter=column("diameter"), x=column("x"))
    return Record(
        time=time - time[0],
        weight=weight,
        spindle_speed=spindle_speed,
        cutting_speed=cutting_speed_at(spindle_speed, diameter),
        feed_rate=np.abs(needed["feed_rate"]),
        power=_power(path, settings, column("spindle_power"), samples=samples),
        is_running=column("running") != 0.0,  # unknown counts as running
        is_after_gap=is_after_gap,
        samples=samples,
    )


def _diameter(path: Path, settings: CutSettings, diameter: Values, x: Values) -> Values:
    """Return the diameter at the tool [mm]."""
    if settings.diameter is not None:
        return np.full(len(x), settings.diameter)
    if np.isfinite(diameter).any():
        return diameter
    if not np.isfinite(x).any():
        raise UserError(f"{path}: the machine gives no position of X: say --diameter MM")
    if settings.x is None:
        raise UserError(
            f"{path}: is x a radius or a diameter? It is {np.nanmin(x):g} to {np.nanmax(x):g}: "
            "say --x radius or --x diameter, or --diameter MM for one diameter in all cuts"
        )
    return np.asarray(np.abs(x) * (2.0 if settings.x == "radius" else 1.0))


def _power(path: Path, settings: CutSettings, power: Values, samples: Sequence[Sample]) -> Values:
    """Return the spindle's power [kW]: as recorded, or from torque and speed, or from the load."""
    if np.isfinite(power).any():
        return power
    torque = np.array([sample.spindle_torque for sample in samples])
    if np.isfinite(torque).any():
        speed = np.array([sample.spindle_speed for sample in samples])
        return np.asarray(np.abs(power_at(torque, speed)))
    load = np.array([sample.spindle_load for sample in samples])
    if not np.isfinite(load).any():
        raise UserError(f"{path}: the machine gives no power, torque or load of the spindle")
    if settings.rated_power is None:
        raise UserError(
            f"{path}: the machine gives the spindle's load in % alone: say --rated-power KW, "
            "the power at 100 %"
        )
    return np.asarray(load / 100.0 * settings.rated_power)


def find_cuts(record: Record, settings: CutSettings) -> FoundCuts:
    """Return the cuts of a record.

    Raises:
        UserError: The record shows no idle power and none is stated, or it has no cut.
    """
    turns = (record.spindle_speed > MIN_SPEED) & np.isfinite(record.power)
    feeds = (record.feed_rate > 0.0) & (record.feed < MAX_FEED)
    moves = feeds & record.is_running
    at_feed = turns & moves
    idles = turns & ~moves
    if not at_feed.any():
        raise UserError("the record has no move at feed with a turning spindle")
    idle = settings.idle_power
    if idle is None:
        if not record.weight[idles].any():
            raise UserError(
                "the record never shows the spindle turning without feed: say --idle-power KW"
            )
        idle = _median(record.power[idles], record.weight[idles])
    highest = max(float(record.power[at_feed].max()), idle)
    threshold = idle + ENTRY * (highest - idle)
    in_metal = at_feed & (record.power > threshold)

    stretches = []
    for stretch in _stretches(record, in_metal):
        cut = _cut(record, stretch, idles=idles, idle=idle, settings=settings)
        stretches.append(cut)
    if settings.is_fresh and settings.wear is None:
        stretches = list(_with_edge_times(stretches))
    cuts = [cut for cut in stretches if cut.is_steady and cut.power > 0.0]
    if not cuts:
        least = MIN_STEADY + 2.0 * TRIM
        raise UserError(f"the record has no steady cut of {least:g} s or more")
    notes = _notes(record, cuts, stretches=stretches, settings=settings)
    return FoundCuts(cuts, list(notes))


def _median(values: Values, weights: Values) -> float:
    """Return the weighted median."""
    order = np.argsort(values)
    summed_weights = np.cumsum(weights[order])
    half = 0.5 * summed_weights[-1]
    place = np.searchsorted(summed_weights, half)
    return float(values[order][place])


def _stretches(record: Record, in_metal: NDArray[np.bool_]) -> Iterator[slice]:
    """Yield the stretches of samples in metal, at one speed and feed, without a gap."""
    start: int | None = None
    for index in range(len(in_metal)):
        if start is not None:
            so_far = slice(start, index)
            if not in_metal[index] or _is_new(record, so_far, index=index):
                yield so_far
                start = None
        if in_metal[index] and start is None:
            start = index
    if start is not None:
        yield slice(start, len(in_metal))


def _is_new(record: Record, so_far: slice, index: int) -> bool:
    """Return whether a sample begins another stretch: behind a gap, or at other settings."""
    if record.is_after_gap[index]:
        return True
    if record.samples[index].tool != record.samples[so_far.start].tool:
        return True
    for values in (record.cutting_speed, record.feed):
        # The last samples tell the settings; the mean of all would take time on long cuts.
        mean = values[max(so_far.start, index - RECENT) : index].mean()
        if abs(values[index] - mean) > STEADY * mean:
            return True
    return False


def _cut(
    record: Record, stretch: slice, idles: NDArray[np.bool_], idle: float, settings: CutSettings
) -> Cut:
    """Return the cut of a stretch, its values as means over the part without its ends."""
    starts = record.time[stretch]
    ends = starts + record.weight[stretch]
    first = starts[0] + TRIM
    last = ends[-1] - TRIM
    steady = np.maximum(np.minimum(ends, last) - np.maximum(starts, first), 0.0)
    is_steady = bool(steady.sum() >= MIN_STEADY)
    weights = steady if is_steady else np.ones(len(starts))

    def mean(values: Values) -> float:
        return float(np.average(values[stretch], weights=weights))

    spindle_speed = mean(record.spindle_speed)
    if settings.idle_power is None:
        near = idles & (np.abs(record.spindle_speed / spindle_speed - 1.0) < NEAR_SPEED)
        if record.weight[near].any():
            idle = _median(record.power[near], record.weight[near])
    return Cut(
        start=record.samples[stretch.start],
        tool=record.samples[stretch.start].tool,
        spindle_speed=spindle_speed,
        cutting_speed=mean(record.cutting_speed),
        feed=mean(record.feed),
        power=mean(record.power) - idle,
        idle_power=idle,
        seconds=float(record.weight[stretch].sum()),
        is_steady=is_steady,
        is_after_gap=bool(record.is_after_gap[: stretch.start + 1].any()),
    )


def _with_edge_times(cuts: Sequence[Cut]) -> Iterator[Cut]:
    """Yield cuts with the cutting time of each tool's edge at their end.

    It is unknown behind a gap, in which the edge may have cut, and once the settings have changed.
    """
    seconds: dict[str, float] = {}
    first: dict[str, Cut] = {}
    mixed: set[str] = set()
    for cut in cuts:
        tool = cut.tool
        seconds[tool] = seconds.get(tool, 0.0) + cut.seconds
        if not cut.is_steady:
            yield cut
            continue
        before = first.setdefault(tool, cut)
        speed_change = abs(cut.cutting_speed / before.cutting_speed - 1.0)
        feed_change = abs(cut.feed / before.feed - 1.0)
        if speed_change > STEADY or feed_change > STEADY:
            mixed.add(tool)
        edge_time = math.nan
        if tool not in mixed and not cut.is_after_gap:
            edge_time = seconds[tool] / 60.0
        yield replace(cut, edge_time=edge_time)


def _notes(
    record: Record, cuts: Sequence[Cut], stretches: Sequence[Cut], settings: CutSettings
) -> Iterator[str]:
    """Yield how the cuts were found, for people."""
    short = len(stretches) - len(cuts)
    minutes = record.time[-1] / 60.0
    left_out = ""
    if short:
        left_out = f"; {short} shorter or unsteady stretches in metal left out"
    yield f"{len(cuts)} cuts in {minutes:.1f} min{left_out}"

    idle_powers = sorted({round(cut.idle_power, 3) for cut in cuts})
    lowest = f"{idle_powers[0]:g}"
    highest = f"{idle_powers[-1]:g}"
    span = lowest if len(idle_powers) == 1 else f"{lowest} to {highest}"
    source = "as stated" if settings.idle_power is not None else "while no axis feeds"
    yield f"idle power {span} kW, {source}: subtracted"

    gaps = int(record.is_after_gap.sum())
    if gaps:
        yield f"{gaps} gaps: no cut goes across one, and cutting times after the first are unknown"
    if not settings.is_fresh and settings.wear is None:
        yield "time is empty: --fresh says that each tool had a fresh edge when the record began"
    missing = [name for name in ("depth", "wear") if getattr(settings, name) is None]
    if missing:
        options = " or ".join(f"--{name} MM" for name in missing)
        yield f"the control does not know {' and '.join(missing)}: fill it in, or say {options}"


def write_sheet(cuts: Sequence[Cut], settings: CutSettings, path: Path) -> None:
    """Write the sheet, whole or not at all; OSError if it cannot be written."""

    def write(partial: Path) -> None:
        with partial.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(HEADERS)
            writer.writerows(_row(cut, settings) for cut in cuts)

    replace_file(path, write)


def _row(cut: Cut, settings: CutSettings) -> list[str]:
    return [
        settings.edge or cut.tool,
        f"{cut.cutting_speed:.5g}",
        f"{cut.feed:.4g}",
        _cell(settings.depth),
        _cell(cut.edge_time),
        _cell(settings.wear),
        f"{cut.power:.5g}",
        f"{cut.start.time:%Y-%m-%d %H:%M:%S} UTC, {cut.seconds:.1f} s in metal",
    ]


def _cell(value: float | None) -> str:
    """Return a number as text, nothing if it is unknown."""
    return "" if value is None or math.isnan(value) else f"{value:.5g}"
