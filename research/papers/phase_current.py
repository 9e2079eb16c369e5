"""Relate the current of a feed motor to its load, as in the servo current paper.

The record is a current sampled at a constant rate and feed velocity while the load is held at one
value after another. A phase current alternates, so its mean says nothing about the load. Three
quantities of each hold do [A]:

* ``rms``: the root mean square of all samples;
* ``peak``: the root mean square of the spectral line that grows most with the load, the same line
  for all holds;
* ``filtered``: the root mean square after a Butterworth low-pass of tenth order at twice the
  frequency of that line. It is run forwards and backwards, fifth order each, so that it does not
  lag.

The paper's numbers are compared with these in ``research/papers/reproduce/servo_current.py``.
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy import signal, stats

Values = npt.NDArray[np.float64]

MIN_SAMPLES = 32  # lowest number of samples of a hold
MIN_LOADS = 3  # lowest number of different loads
ORDER = 10  # order of the low-pass, forwards and backwards together


class Line(NamedTuple):
    """Load as a line over one quantity of the current: ``intercept + slope * quantity``."""

    intercept: float
    slope: float  # load per ampere
    r_squared: float  # share of the load's variance that the line explains [-]


class CurrentReport(NamedTuple):
    """Characteristic quantities of every hold of a record, and the load's line over each."""

    load: list[float]  # of each hold, in the order of the record
    quantities: dict[str, list[float]]  # by name, with a value for every hold [A]
    # Frequency of the spectral line that grows most with the load [Hz]; 0 if the current does not
    # alternate.
    frequency: float
    lines: dict[str, Line]  # by quantity


def analyse(time: Values, current: Values, load: Values) -> CurrentReport:
    """Return the quantities of a current [A] sampled at times [s], and the load's line over each.

    Args:
        time: times of the samples, at a constant rate [s], shape (samples,).
        current: current [A], shape (samples,).
        load: load that is held at each sample, in any unit, shape (samples,).

    Raises:
        ValueError: Holds or loads are too few.
    """
    rate = float(1.0 / np.diff(time).mean())
    changes = np.flatnonzero(np.diff(load)) + 1
    holds = np.split(current, changes)
    loads = load[np.append(0, changes)]
    length = min(len(hold) for hold in holds)
    if len(np.unique(loads)) < MIN_LOADS or length < MIN_SAMPLES:
        raise ValueError(
            f"load: needed are {MIN_LOADS} loads, each held for {MIN_SAMPLES} samples or more"
        )

    # Holds of one length have the same spectral lines.
    amplitude_spectra = []
    for hold in holds:
        frequencies, power = signal.periodogram(
            hold[-length:], rate, window="hann", detrend=False, scaling="spectrum"
        )
        amplitude_spectra.append(np.sqrt(power))
    amplitudes = np.array(amplitude_spectra)

    # The slope of each spectral line over the load tells which grows most.
    slopes = np.polyfit(loads, amplitudes, deg=1)[0]
    peak = int(slopes.argmax())
    frequency = float(frequencies[peak])

    # Four periods of the cutoff fit into the shortest hold, and it stays below 0.5 rate (Nyquist).
    cutoff = min(max(2.0 * frequency, 4.0 * rate / length), 0.4 * rate)
    sections = signal.butter(ORDER // 2, cutoff, fs=rate, output="sos")
    quantities = {
        "rms": [_rms(hold) for hold in holds],
        "peak": amplitudes[:, peak].tolist(),
        "filtered": [_rms(signal.sosfiltfilt(sections, hold)) for hold in holds],
    }

    lines = {}
    for name, values in quantities.items():
        fit = stats.linregress(values, loads)
        lines[name] = Line(
            intercept=float(fit.intercept),
            slope=float(fit.slope),
            r_squared=float(fit.rvalue**2),
        )
    return CurrentReport(
        load=loads.tolist(), quantities=quantities, frequency=frequency, lines=lines
    )


def _rms(values: Values) -> float:
    return float(np.sqrt(np.mean(values**2)))
