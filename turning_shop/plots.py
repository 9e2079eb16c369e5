"""Draw the residuals of a calibration, and the operating map of a scenario."""

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from turning_env.scenario import Scenario
from turning_env.scenario.family import Job
from turning_shop.calibrate import Calibration
from turning_shop.fit import SETTINGS, Fit
from turning_shop.measurements import COLUMNS
from turning_shop.plot_style import BLUE, GREEN, GREY, LIGHT, ORANGE, VERMILLION
from turning_shop.prediction import read_evidence
from turning_shop.whatif import Cuts, what_if

MAX_POINTS = 20000
"""Number of residuals above which only every n-th is drawn."""
GRID = 301
"""Number of cutting speeds, and of feeds, at which the map evaluates the laws."""
JOBS_IN_A_ROW, JOB_GRID = 4, 121
_LIMITS: dict[str, tuple[str, str, str, Any]] = {
    "thrust_force": ("thrust force", "N", ORANGE, "-"),
    "power": ("power", "kW", BLUE, (0, (6, 1.5))),
}
"""Name, unit, colour and dashes of each limit."""
_ALLOWED, _DOTS = "#DCEFE6", "#999999"


def draw_residuals(calibration: Calibration) -> Figure:
    """Draw a row of panels per law: residuals [%] over the prediction and over every factor with a fitted exponent."""
    fits = list(calibration.fits.values())
    columns = 1 + max(len(fitted.estimates) - 1 for fitted in fits)
    figure = Figure(figsize=(max(2.6 * columns + 0.6, 4.6), 2.6 * len(fits) + 0.4), layout="constrained")
    panels = figure.subplots(len(fits), columns, sharey="row", squeeze=False)
    for row, fitted in zip(panels, fits, strict=True):
        names = [name for name in fitted.estimates if name != "coefficient"]
        shown = {fitted.response: fitted.predicted} | {name: fitted.factors[name] for name in names}
        for axes, (name, values) in zip(row, shown.items(), strict=False):
            _draw_panel(axes, fitted, values)
            predicted = "predicted " if name == fitted.response else ""
            axes.set_xlabel(f"{predicted}{name.replace('_', ' ')} [{COLUMNS[name].unit}]")
        for axes in row[len(shown) :]:
            axes.set_axis_off()
        row[0].set_ylabel("measured / predicted - 1\n[%]")
        explained = "" if fitted.r_squared is None else f", R² {fitted.r_squared:.4f}"
        scatter = f"scatter {100 * fitted.scatter:.2g} % (grey: twice it)"
        title = f"{fitted.response.replace('_', ' ').capitalize()}: {len(fitted.lines)} rows{explained}, {scatter}"
        row[0].set_title(title, loc="left", fontsize="medium")
    return figure


def _draw_panel(axes: Axes, fitted: Fit, values: NDArray[np.float64]) -> None:
    step = -(-len(values) // MAX_POINTS)
    axes.axhspan(-200 * fitted.scatter, 200 * fitted.scatter, color=LIGHT, linewidth=0)
    axes.axhline(0, color=GREY, linewidth=0.9)
    axes.scatter(values[::step], 100 * fitted.residuals[::step], color=BLUE, s=16, alpha=0.6, linewidths=0)
    axes.spines[["top", "right"]].set_visible(False)


def draw_map(scenario: Scenario, wear: float, depth_of_cut: float | None = None, hardness: float = 1.0) -> Figure:
    """Draw limits, removal rate and tool life over the machine's whole range of cutting speed and feed.

    Args:
        scenario: The machine, material and limits.
        wear: Flank wear of the edge [mm], at most the wear criterion.
        depth_of_cut: [mm]; the scenario's nominal depth if None.
        hardness: Hardness of the bar over nominal [-].
    """
    figure = Figure(figsize=(8.6, 6.4), layout="constrained")
    handles = draw_map_on(figure.subplots(), scenario, wear, depth_of_cut, hardness)
    if warnings := read_evidence(scenario).warnings:
        text = "\n".join(textwrap.wrap(f"{len(warnings)} warnings, the first: {warnings[0]}", 110))
        figure.suptitle(text, fontsize="small", color=VERMILLION)
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return figure


def draw_map_on(
    axes: Axes, scenario: Scenario, wear: float, depth_of_cut: float | None = None, hardness: float = 1.0
) -> list[Any]:
    """Draw the map on axes, and return the handles of its legend: see ``draw_map``."""
    machine = scenario.machine
    speeds = np.linspace(machine.cutting_speed_min, machine.cutting_speed_max, GRID)
    feeds = np.linspace(machine.feed_min, machine.feed_max, GRID)
    cuts = what_if(scenario, speeds, feeds[:, np.newaxis], depth_of_cut, hardness, wear=wear)
    axes.set_facecolor(LIGHT)
    if cuts.within_limits.any():
        axes.contourf(speeds, feeds, cuts.within_limits.astype(float), levels=(0.5, 1.5), colors=[_ALLOWED])
    beyond = _beyond_measured(scenario, cuts)
    if beyond.any():
        dots = axes.contourf(speeds, feeds, beyond.astype(float), levels=(0.5, 1.5), colors="none", hatches=["."])
        dots.set_edgecolor(_DOTS)
        dots.set_linewidth(0.0)
    _draw_removal_rate(axes, cuts)
    _draw_tool_life(axes, cuts)
    for name, (_, _, colour, dashes) in _LIMITS.items():
        share = getattr(cuts, f"{name}_share")
        if share.min() < 1.0 < share.max():
            axes.contour(speeds, feeds, share, levels=(1.0,), colors=colour, linewidths=2.2, linestyles=[dashes])
    _mark_best(axes, cuts)
    axes.set_xlabel("cutting speed [m/min]")
    axes.set_ylabel("feed [mm/rev]")
    axes.set_title(
        f"{scenario.name}: depth of cut {cuts.depth_of_cut.flat[0]:g} mm, "
        f"{'nominal hardness' if hardness == 1 else f'{hardness:g} times nominal hardness'}, edge worn to {wear:g} mm",
        loc="left",
        fontsize="medium",
    )
    limits = scenario.limits.thrust_force, scenario.limits.power
    lines = [
        Line2D([], [], color=colour, linewidth=2.2, linestyle=dashes, label=f"{what} at its limit, {limit:g} {unit}")
        for limit, (what, unit, colour, dashes) in zip(limits, _LIMITS.values(), strict=True)
    ]
    handles: list[Any] = [
        Patch(facecolor=_ALLOWED, edgecolor=GREY, label="within the limits"),
        Patch(facecolor=LIGHT, edgecolor=GREY, label="a limit is exceeded"),
        *lines,
        Line2D([], [], color=GREY, linewidth=0.8, label="removal rate, see right axis"),
        Line2D([], [], color=GREEN, linewidth=1.4, linestyle=":", label="tool life, fresh to worn out"),
        Line2D([], [], color="black", marker="o", linestyle="none", label="highest removal rate"),
    ]
    if beyond.any():
        handles.append(Patch(facecolor="white", edgecolor=_DOTS, hatch="..", label="extrapolated: not measured there"))
    return handles


def _beyond_measured(scenario: Scenario, cuts: Cuts) -> NDArray[np.bool_]:
    """Return where speed, feed, depth or hardness lies outside the range in which a law was measured."""
    settings = {name: getattr(cuts, name) for name in SETTINGS}
    laws = read_evidence(scenario).laws.values()
    return np.asarray(sum((law.extrapolates(settings) for law in laws), np.zeros(cuts.wear.shape, bool)))


def draw_jobs(jobs: Sequence[Job]) -> Figure:
    """Draw a panel per job, four in a row: what is within limits at half an edge's life, by the nominal model and in truth."""
    rows = -(-len(jobs) // JOBS_IN_A_ROW)
    figure = Figure(figsize=(7.2, 1.9 * rows + 0.6), layout="constrained")
    panels = figure.subplots(rows, JOBS_IN_A_ROW, squeeze=False).ravel()
    for axes, job in zip(panels, jobs, strict=False):
        nominal, machine = job.scenario.nominal(), job.scenario.machine
        speeds = np.linspace(machine.cutting_speed_min, job.scenario.cutting_speed_max, JOB_GRID)
        feeds = np.linspace(machine.feed_min, machine.feed_max, JOB_GRID)
        wear = nominal.tool.wear_criterion * 0.5**nominal.material.wear.time
        told, true = (
            what_if(each, speeds, feeds[:, np.newaxis], wear=wear).within_limits.astype(float) for each in (nominal, job.scenario)
        )
        axes.set_facecolor(LIGHT)
        if told.any():
            axes.contourf(speeds, feeds, told, levels=(0.5, 1.5), colors=[_ALLOWED])
        if 0.0 < true.mean() < 1.0:
            axes.contour(speeds, feeds, true, levels=(0.5,), colors=VERMILLION, linewidths=1.6, linestyles=[(0, (5, 1.5))])
        axes.plot(job.cutting_speed, job.feed, marker="o", markersize=6, color="black", clip_on=False, zorder=5)
        axes.set_title(job.title, fontsize=8, loc="left")
        axes.tick_params(labelsize=8)
    for axes in panels[len(jobs) :]:
        axes.set_axis_off()
    figure.supxlabel("cutting speed [m/min]", fontsize=9)
    figure.supylabel("feed [mm/rev]", fontsize=9)
    handles = [
        Patch(facecolor=_ALLOWED, edgecolor=GREY, label="within limits by the nominal model"),
        Line2D([], [], color=VERMILLION, linewidth=1.6, linestyle=(0, (5, 1.5)), label="limit in truth"),
        Line2D([], [], color="black", marker="o", linestyle="none", label="best by the nominal model"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False, fontsize=8)
    return figure


def _draw_removal_rate(axes: Axes, cuts: Cuts) -> None:
    """Draw lines of round removal rates; the right axis labels their ends."""
    rates = cuts.removal_rate
    step = _round_down((rates.max() - rates.min()) / 7)
    levels = step * np.arange(np.floor(rates[0, -1] / step) + 1, np.ceil(rates.max() / step))  # those that end at the right axis
    axes.contour(cuts.cutting_speed, cuts.feed, rates, levels=levels, colors=GREY, linewidths=0.8)
    right = axes.twinx()
    right.set_ylim(cuts.feed.min(), cuts.feed.max())
    ends = np.interp(levels, rates[:, -1], cuts.feed[:, -1])
    right.set_yticks(ends, [f"{level:g}" for level in levels], color=GREY)
    right.set_ylabel("removal rate [cm³/min] of the line that ends here", color=GREY)


def _draw_tool_life(axes: Axes, cuts: Cuts) -> None:
    """Draw lines of round tool lives, with labels at low feeds, away from other text."""
    placed = {level: place for level in _log_levels(cuts.tool_life) if (place := _label_position(cuts, level))}
    if not placed:
        return
    lines = axes.contour(
        cuts.cutting_speed, cuts.feed, cuts.tool_life, levels=list(placed), colors=GREEN, linewidths=1.4, linestyles=":"
    )
    for text in axes.clabel(lines, fmt="%g min", fontsize=9, manual=list(placed.values())):
        text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85})


def _label_position(cuts: Cuts, level: float) -> tuple[float, float] | None:
    """Return a cutting speed [m/min] and a low feed [mm/rev] with a tool life of ``level`` [min], away from the sides."""
    for share in (0.15, 0.5, 0.85):
        row = round(share * (GRID - 1))
        longer = cuts.tool_life[row] > level
        changes = np.flatnonzero(longer[1:] != longer[:-1])
        if changes.size and GRID // 20 < changes[0] < GRID - GRID // 20:
            return float(cuts.cutting_speed[row, changes[0]]), float(cuts.feed[row, 0])
    return None


def _log_levels(values: NDArray[np.float64]) -> list[float]:
    """Return the values 1, 2 and 5 times a power of ten within the range of ``values``; only the powers if these are too many."""
    finite = values[np.isfinite(values) & (values > 0)]
    if finite.size == 0:
        return []
    low, high = finite.min(), finite.max()
    decades = 10.0 ** np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
    many, few = (
        [level for level in np.outer(decades, digits).ravel().tolist() if low < level < high] for digits in ((1, 2, 5), 1)
    )
    return many if len(many) <= 12 else few


def _round_down(value: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that does not exceed a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(factor * power for factor in (1, 2, 5) if factor * power <= value * (1 + 1e-9)))


def _mark_best(axes: Axes, cuts: Cuts) -> None:
    """Mark the highest removal rate within limits, if there is any."""
    rates = np.where(cuts.within_limits, cuts.removal_rate, -np.inf)
    index = int(rates.argmax())
    if not np.isfinite(rates.flat[index]):
        axes.set_title("nowhere within limits", loc="right", fontsize="medium", color=VERMILLION)
        return
    speed, feed, life = (values.flat[index] for values in (cuts.cutting_speed, cuts.feed, cuts.tool_life))
    axes.plot(speed, feed, marker="o", markersize=9, color="black", clip_on=False, zorder=5)
    right = speed > cuts.cutting_speed.mean()
    upper = feed > cuts.feed.mean()
    axes.annotate(
        f"{speed:.0f} m/min, {feed:.3g} mm/rev:\n{rates.flat[index]:.0f} cm³/min, tool life {life:.3g} min",
        (speed, feed),
        xytext=(-12 if right else 12, -14 if upper else 14),
        textcoords="offset points",
        horizontalalignment="right" if right else "left",
        verticalalignment="top" if upper else "bottom",
        bbox={"boxstyle": "round", "facecolor": "white", "edgecolor": GREY, "alpha": 0.95},
        zorder=6,
    )
