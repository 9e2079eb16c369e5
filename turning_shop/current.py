"""Relate the current of a feed motor to its load: characteristic quantities, regression and hysteresis (servo current paper).

The record is a current sampled at a constant rate and feed velocity while the load is held at one value after another. A phase
current alternates, so its mean tells nothing of the load. Three quantities of each hold do [A]:

* ``rms``: the root mean square of all samples;
* ``peak``: the root mean square of the spectral line that grows most with the load, the same line for all holds;
* ``filtered``: the root mean square after a Butterworth low-pass of tenth order. It is run forwards and backwards, fifth order
  each, so that it does not lag.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import signal, stats

from turning_shop import Values, WorkshopError, aligned
from turning_shop.fit import Estimate
from turning_shop.headers import Column
from turning_shop.measurements import Measurements

LOADS = {"torque": Column("N m", 0, 1e6, "load torque"), "thrust_force": Column("N", 0, 1e6, "thrust force")}
"""Columns of the load; a record has one of them."""
CURRENT_COLUMNS = {
    "time": Column("s", 0, 1e7, "time of the sample"),
    "current": Column("A", -1e5, 1e5, "current of one phase, or its amplitude"),
    **LOADS,
}
CURRENT_REQUIRED = ("time", "current")
QUANTITIES = ("rms", "peak", "filtered")
MIN_SAMPLES = 32
"""Lowest number of samples of a hold."""
MIN_LOADS = 3
"""Lowest number of different loads."""
ORDER = 10
"""Order of the low-pass, forwards and backwards together."""


@dataclass(frozen=True)
class Line:
    """Load as a straight line over one characteristic quantity of the current: ``intercept + slope * quantity``.

    Attributes:
        intercept: In the unit of the load.
        slope: Load per ampere.
        r_squared: Share of the load's variance that the line explains [-].
        hysteresis: Largest difference of the quantity between unloading and loading at the same load, over the quantity's range
            [-]; None if the load is not raised from hold to hold and then lowered.
    """

    intercept: Estimate
    slope: Estimate
    r_squared: float
    hysteresis: float | None


@dataclass(frozen=True)
class CurrentReport:
    """Characteristic quantities of every hold of a record, and the load's line over each.

    Attributes:
        load_name: A key of ``LOADS``.
        load: Load of each hold, in the order of the record, in its unit.
        quantities: Each of ``QUANTITIES`` of every hold [A].
        frequency: Frequency of the spectral line that grows most with the load [Hz]; 0 if the current does not alternate.
        cutoff: Cut-off frequency of the low-pass [Hz].
        lines: By quantity.
    """

    load_name: str
    load: list[float]
    quantities: dict[str, list[float]]
    frequency: float
    cutoff: float
    lines: dict[str, Line]

    def summary(self) -> Iterator[str]:
        """Yield a table of the holds, and the lines."""
        unit = LOADS[self.load_name].unit
        columns = {f"{self.load_name} [{unit}]": [f"{load:g}" for load in self.load]}
        columns |= {f"{name} [A]": [f"{value:.4f}" for value in values] for name, values in self.quantities.items()}
        yield from aligned([list(columns), *zip(*columns.values(), strict=True)])
        yield f"peak of the spectrum at {self.frequency:.3g} Hz, low-pass at {self.cutoff:.3g} Hz"
        for name, line in self.lines.items():
            (start, *starts), (slope, *slopes) = line.intercept, line.slope
            yield f"{self.load_name} = {start:.4g} + {slope:.4g} {name}, R2 {line.r_squared:.4f}"
            yield f"  intercept {starts[0]:.4g} to {starts[1]:.4g} {unit}"
            yield f"  slope     {slopes[0]:.4g} to {slopes[1]:.4g} {unit}/A"
            unknown = "not measured: raise the load in steps, then lower it"
            yield f"  hysteresis {unknown if line.hysteresis is None else f'{100 * line.hysteresis:.1f} %'}"


def analyse_sheet(sheet: Measurements, cutoff: float | None = None, confidence: float = 0.95) -> CurrentReport:
    """Return the report of a sheet with the columns ``time``, ``current`` and one of ``LOADS``; otherwise as ``analyse``."""
    present = [name for name in LOADS if name in sheet.columns]
    if len(present) != 1:
        raise WorkshopError(f"the record has {' and '.join(present) or 'no load'}, but needs one column of {' or '.join(LOADS)}")
    for name in (*CURRENT_REQUIRED, *present):
        if (empty := np.isnan(sheet.columns[name])).any():
            raise WorkshopError(f"line {sheet.lines[empty.argmax()]}, column {name}: empty, but every sample needs a number")
    time, current, load = (sheet.columns[name] for name in (*CURRENT_REQUIRED, *present))
    return analyse(time, current, load, present[0], cutoff, confidence)


def analyse(
    time: Values, current: Values, load: Values, load_name: str = "torque", cutoff: float | None = None, confidence: float = 0.95
) -> CurrentReport:
    """Return characteristic quantities of a current and the load's line over each.

    Args:
        time: Time of each sample [s].
        current: Measured current [A].
        load: Load at each sample, constant during a hold.
        load_name: A key of ``LOADS``.
        cutoff: Cut-off frequency of the low-pass [Hz]; by default twice the peak's, and at least four lines of the spectrum.
        confidence: Confidence level of the intervals [-]. They take holds as independent.

    Raises:
        WorkshopError: The sampling rate varies, or holds or loads are too few, or the cut-off frequency is too high.
    """
    steps = np.diff(time)
    if len(time) < MIN_SAMPLES or not np.allclose(steps, steps.mean(), rtol=0.01, atol=0.0) or steps.mean() <= 0.0:
        raise WorkshopError(f"time: needs {MIN_SAMPLES} or more samples at a constant rate, ascending")
    rate = float(1.0 / steps.mean())
    changes = np.flatnonzero(np.diff(load)) + 1
    holds = np.split(current, changes)
    loads = load[np.append(0, changes)]
    length, count = min(map(len, holds)), len(np.unique(loads))
    if count < MIN_LOADS or length < MIN_SAMPLES:
        raise WorkshopError(
            f"{load_name}: {count} loads, the shortest held for {length} samples; needed are {MIN_LOADS} loads, each held for "
            f"{MIN_SAMPLES} samples or more: write the load that was set, not a noisy reading"
        )
    # Holds of one length have the same spectral lines.
    spectra = [signal.periodogram(hold[-length:], rate, "hann", detrend=False, scaling="spectrum") for hold in holds]
    frequencies, amplitudes = spectra[0][0], np.sqrt([power for _, power in spectra])
    peak = int(np.polyfit(loads, amplitudes, 1)[0].argmax())
    frequency, nyquist = float(frequencies[peak]), 0.5 * rate
    if cutoff is None:
        cutoff = min(max(2.0 * frequency, 4.0 * rate / length), 0.8 * nyquist)
    if not 0.0 < cutoff < nyquist:
        raise WorkshopError(f"cutoff is {cutoff:g} Hz, but must be above 0 and below half the sampling rate, {nyquist:g} Hz")
    sections = signal.butter(ORDER // 2, cutoff, fs=rate, output="sos")
    quantities = {
        "rms": [_rms(hold) for hold in holds],
        "peak": amplitudes[:, peak].tolist(),
        "filtered": [_rms(signal.sosfiltfilt(sections, hold)) for hold in holds],
    }
    lines = {name: _line(np.array(values), loads, confidence) for name, values in quantities.items()}
    return CurrentReport(load_name, loads.tolist(), quantities, frequency, cutoff, lines)


def _rms(values: Values) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _line(values: Values, loads: Values, confidence: float) -> Line:
    """Return the line of the loads over a quantity of the same holds."""
    found = stats.linregress(values, loads)
    quantile = float(stats.t.ppf(0.5 + 0.5 * confidence, len(loads) - 2))
    intercept, slope = (
        Estimate(float(value), float(value - quantile * error), float(value + quantile * error))
        for value, error in ((found.intercept, found.intercept_stderr), (found.slope, found.stderr))
    )
    return Line(intercept, slope, float(found.rvalue**2), _hysteresis(values, loads))


def _hysteresis(values: Values, loads: Values) -> float | None:
    """Return the largest difference between unloading and loading, over the range of values; None without either."""
    top = int(loads.argmax())
    changes = np.diff(loads)
    if top in (0, len(loads) - 1) or (changes[:top] <= 0.0).any() or (changes[top:] >= 0.0).any():
        return None
    covered = loads[top:] >= loads[0]
    loading = np.interp(loads[top:][covered], loads[: top + 1], values[: top + 1])
    return float(np.abs(values[top:][covered] - loading).max() / np.ptp(values))
