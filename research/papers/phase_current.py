"""Relate the current of a feed motor to its load: characteristic quantities and regression (servo current paper).

The record is a current sampled at a constant rate and feed velocity while the load is held at one value after another. A phase
current alternates, so its mean tells nothing of the load. Three quantities of each hold do [A]:

* ``rms``: the root mean square of all samples;
* ``peak``: the root mean square of the spectral line that grows most with the load, the same line for all holds;
* ``filtered``: the root mean square after a Butterworth low-pass of tenth order at twice the frequency of that line. It is run
  forwards and backwards, fifth order each, so that it does not lag.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import signal, stats

Values = npt.NDArray[np.float64]

MIN_SAMPLES, MIN_LOADS = 32, 3  # lowest number of samples of a hold, and of different loads
ORDER = 10  # order of the low-pass, forwards and backwards together


class Line(NamedTuple):
    """Load as a straight line over one characteristic quantity of the current: ``intercept + slope * quantity``."""

    intercept: float
    slope: float  # load per ampere
    r_squared: float  # share of the load's variance that the line explains [-]


class CurrentReport(NamedTuple):
    """Characteristic quantities of every hold of a record, and the load's line over each."""

    load: list[float]  # of each hold, in the order of the record
    quantities: dict[str, list[float]]  # each of every hold [A]
    frequency: float  # of the spectral line that grows most with the load [Hz]; 0 if the current does not alternate
    lines: dict[str, Line]  # by quantity


def analyse(time: Values, current: Values, load: Values) -> CurrentReport:
    """Return characteristic quantities of a current [A] sampled at times [s] and the line over each of the loads held.

    Raises:
        ValueError: Holds or loads are too few.
    """
    rate = float(1.0 / np.diff(time).mean())
    changes = np.flatnonzero(np.diff(load)) + 1
    holds, loads = np.split(current, changes), load[np.append(0, changes)]
    length = min(map(len, holds))
    if len(np.unique(loads)) < MIN_LOADS or length < MIN_SAMPLES:
        raise ValueError(
            f"load: needed are {MIN_LOADS} loads, each held for {MIN_SAMPLES} samples or more"
        )
    # Holds of one length have the same spectral lines.
    spectra = [
        signal.periodogram(hold[-length:], rate, "hann", detrend=False, scaling="spectrum")
        for hold in holds
    ]
    frequencies, amplitudes = spectra[0][0], np.sqrt([power for _, power in spectra])
    peak = int(np.polyfit(loads, amplitudes, 1)[0].argmax())
    frequency = float(frequencies[peak])
    cutoff = min(max(2.0 * frequency, 4.0 * rate / length), 0.4 * rate)
    sections = signal.butter(ORDER // 2, cutoff, fs=rate, output="sos")
    quantities = {
        "rms": [_rms(hold) for hold in holds],
        "peak": amplitudes[:, peak].tolist(),
        "filtered": [_rms(signal.sosfiltfilt(sections, hold)) for hold in holds],
    }
    found = {name: stats.linregress(values, loads) for name, values in quantities.items()}
    lines = {
        name: Line(float(line.intercept), float(line.slope), float(line.rvalue**2))
        for name, line in found.items()
    }
    return CurrentReport(loads.tolist(), quantities, frequency, lines)


def _rms(values: Values) -> float:
    return float(np.sqrt(np.mean(values**2)))
