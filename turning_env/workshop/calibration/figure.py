"""Draws what is left of the measurements once the laws are taken off: how far and where they miss."""

from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from turning_env.workshop.calibration.columns import COLUMNS
from turning_env.workshop.calibration.material import Calibration
from turning_env.workshop.calibration.regression import Fit
from turning_env.workshop.inquiry.pictures import BLUE, GREY, LIGHT

_TITLES = {"wear": "Flank wear", "thrust_force": "Thrust force", "power": "Spindle power"}
_POINTS: dict[str, Any] = {"color": BLUE, "s": 16, "alpha": 0.6, "linewidths": 0}
MAX_POINTS = 20000
"""Of more rows, evenly spaced ones are drawn."""


def draw(calibration: Calibration) -> Figure:
    """One row of fields per law: its residuals [%] over what it predicts and over every factor whose exponent was fitted."""
    fits = list(calibration.fits.values())
    columns = 1 + max(len(fit.estimates) - 1 for fit in fits)
    figure = Figure(figsize=(max(2.6 * columns + 0.6, 4.6), 2.6 * len(fits) + 0.4), layout="constrained")
    fields = figure.subplots(len(fits), columns, sharey="row", squeeze=False)
    for row, fit in zip(fields, fits, strict=True):
        shown = {fit.response: fit.predicted} | {name: fit.factors[name] for name in fit.estimates if name != "coefficient"}
        for axes, (name, values) in zip(row, shown.items(), strict=False):
            _draw_residuals(axes, fit, values)
            predicted = "predicted " if name == fit.response else ""
            axes.set_xlabel(f"{predicted}{name.replace('_', ' ')} [{COLUMNS[name].unit}]")
        for axes in row[len(shown) :]:
            axes.set_axis_off()
        row[0].set_ylabel("measured over predicted,\nless 1 [%]")
        explained = "" if fit.r_squared is None else f", R² {fit.r_squared:.4f}"
        title = f"{_TITLES[fit.response]}: {len(fit.lines)} rows{explained}, scatter {100 * fit.scatter:.2g} % (grey: twice it)"
        row[0].set_title(title, loc="left", fontsize="medium")
    return figure


def _draw_residuals(axes: Axes, fit: Fit, values: Any) -> None:
    step = -(-len(values) // MAX_POINTS)
    axes.axhspan(-200 * fit.scatter, 200 * fit.scatter, color=LIGHT, linewidth=0)
    axes.axhline(0, color=GREY, linewidth=0.9)
    axes.scatter(values[::step], 100 * fit.residuals[::step], **_POINTS)
    axes.spines[["top", "right"]].set_visible(False)
