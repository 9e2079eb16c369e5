"""Predict measured edges, or rows, by laws fitted to the others, and compare.

This is the test of a calibration on a user's own sheet: how often 95 % intervals hold the readings
of edges that were left out, and how large the errors are. ``calibrate.py`` fits the laws.
"""

import csv
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import IO

import numpy as np
from numpy.typing import NDArray
from turning_shop import Values, WorkshopError, aligned
from turning_shop.calibrate import fitted_law
from turning_shop.copies import without_copies
from turning_shop.fit import FACTORS, complete_rows
from turning_shop.form import factors_of, folds, without_rows
from turning_shop.headers import COLUMNS
from turning_shop.measurements import Measurements
from turning_shop.prediction import evidence_of

from turning_env.scenario import Scenario

EDGE = "edge"
ROW = "row"
MAX_PARTS = 200  # of a sheet that are left out in turn, each of which needs fits of all laws


@dataclass(frozen=True)
class HeldOut:
    """Readings of one response, and their predictions by laws fitted without them.

    Arrays have the shape (readings,). Intervals have a confidence of 95 %.
    """

    response: str
    lines: NDArray[np.int64]  # of the file
    parts: NDArray[np.int64]  # number of the part that was left out, from 1
    measured: Values  # in the unit of ``COLUMNS``
    predicted: Values
    low: Values
    high: Values
    extrapolated: NDArray[np.bool_]  # whether the law was fitted to other settings, time or wear
    with_growth: int  # number of parts whose law has the form 1 + b VB
    failures: tuple[str, ...]  # reasons why parts were not predicted

    @property
    def holds(self) -> NDArray[np.bool_]:
        """Whether each interval holds its reading."""
        return np.asarray((self.low <= self.measured) & (self.measured <= self.high))

    @property
    def errors(self) -> Values:
        """Absolute relative errors of the predictions [-]."""
        return np.asarray(np.abs(self.predicted / self.measured - 1.0))

    @property
    def width(self) -> float:
        """Median factor between a prediction and the ends of its interval [-]."""
        return float(np.median(np.sqrt(self.high / self.low)))


def hold_out(measurements: Measurements, base: Scenario, by: str | int | None) -> list[HeldOut]:
    """Leave out parts of a sheet in turn; predict them by laws fitted to the rest.

    ``by`` is "edge", "row", the number of parts (of whole edges, if edges have names), or None for
    edges if they have names, otherwise rows. Laws without rows are left out.

    Raises:
        WorkshopError: Edges have no names, no law can be predicted, or there are too many parts.
    """
    measurements = without_copies(measurements)[0]
    if by is None:
        by = EDGE if measurements.edges is not None else ROW
    if by == EDGE and measurements.edges is None:
        raise WorkshopError("no column names edges, so leave out rows: --hold-out row")
    groups = measurements
    if by == ROW:
        groups = Measurements(measurements.columns, measurements.lines)
    results = []
    for response in FACTORS:
        rows = complete_rows(response, measurements)
        if not rows.any():
            continue
        count = by if isinstance(by, int) else len(rows)
        parts = list(folds(groups, rows, count))
        if len(parts) > MAX_PARTS:
            raise WorkshopError(
                f"{len(parts)} parts of the sheet are more than {MAX_PARTS}: "
                "give their number, as --hold-out 10"
            )
        results.append(_held_out(response, measurements, base, parts=parts))
    if not any(len(result.lines) for result in results):
        reasons = {reason for result in results for reason in result.failures}
        raise WorkshopError(f"no law can be predicted: {'; '.join(sorted(reasons))}")
    return results


def _held_out(
    response: str, measurements: Measurements, base: Scenario, parts: Sequence[NDArray[np.bool_]]
) -> HeldOut:
    """Return the predictions of the parts of a sheet by one law."""
    line = []
    part = []
    predicted = []
    half_width = []  # of the logarithm
    measured = []
    extrapolated = []
    with_growth = 0
    failures = []
    for number, left_out in enumerate(parts, 1):
        rest = without_rows(measurements, left_out)
        try:
            fitted = fitted_law(response, rest, base, compares=False).fitted
        except WorkshopError as error:
            failures.append(str(error))
            continue
        with_growth += fitted.has_growth
        evidence = evidence_of(fitted)
        factors = factors_of(response, measurements, left_out)
        # A power of the wear predicts nothing of a fresh edge, whose interval holds nothing.
        with np.errstate(divide="ignore", invalid="ignore"):
            deviation = evidence.log_deviation(fitted.law, factors)
        half_width.append(evidence.quantile * deviation)
        extrapolated.append(evidence.extrapolates(factors))
        predicted.append(fitted.law(**factors))
        measured.append(measurements.columns[response][left_out])
        line.append(measurements.lines[left_out])
        part.append(np.full(int(left_out.sum()), number))
    centre = _joined(predicted)
    with np.errstate(over="ignore"):
        factor = np.exp(_joined(half_width))
    return HeldOut(
        response=response,
        lines=_joined(line).astype(np.int64),
        parts=_joined(part).astype(np.int64),
        measured=_joined(measured),
        predicted=centre,
        low=centre / factor,
        high=centre * factor,
        extrapolated=_joined(extrapolated).astype(np.bool_),
        with_growth=with_growth,
        failures=tuple(failures),
    )


def _joined(arrays: Sequence[NDArray[np.generic]]) -> Values:
    return np.concatenate([np.empty(0), *arrays])


def summary(results: Sequence[HeldOut]) -> Iterator[str]:
    """Yield a table of the laws, and what could not be predicted, as lines of text."""
    rows = [["law", "readings", "95 % intervals hold", "median error", "ends at a factor of"]]
    for result in results:
        if len(result.lines):
            rows.append(
                [
                    result.response,
                    str(len(result.lines)),
                    f"{100 * result.holds.mean():.1f} %",
                    f"{100 * np.median(result.errors):.1f} %",
                    f"{result.width:.2f}",
                ]
            )
    yield from aligned(rows)
    for result in results:
        num_parts = len(np.unique(result.parts))
        if result.response != "wear" and num_parts:
            yield (
                f"{result.response}: 1 + b VB was chosen for {result.with_growth} of "
                f"{num_parts} parts, otherwise a power of VB"
            )
        outside = int(result.extrapolated.sum())
        if outside:
            yield (
                f"{result.response}: {outside} readings lie outside the settings, time or wear of "
                f"the others; {100 * result.holds[result.extrapolated].mean():.1f} % of their "
                "intervals hold"
            )
        if result.failures:
            yield (
                f"{result.response}: {len(result.failures)} parts not predicted: "
                + (result.failures[0])
            )


def write_csv(results: Sequence[HeldOut], file: IO[str]) -> None:
    """Write one row for each reading and its prediction, in the units of ``COLUMNS``."""
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(
        [
            "law",
            "unit",
            "line",
            "part",
            "measured",
            "predicted",
            "low",
            "high",
            "holds",
            "extrapolated",
        ]
    )
    for result in results:
        unit = COLUMNS[result.response].unit
        for index in range(len(result.lines)):
            numbers = (result.measured, result.predicted, result.low, result.high)
            writer.writerow(
                [
                    result.response,
                    unit,
                    result.lines[index],
                    result.parts[index],
                    *(f"{values[index]:.6g}" for values in numbers),
                    int(result.holds[index]),
                    int(result.extrapolated[index]),
                ]
            )
