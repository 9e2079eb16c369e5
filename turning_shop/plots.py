"""Draw residuals of a calibration, operating maps of scenarios and of a family's jobs, and a page to pin to the machine."""

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import LogLocator, MaxNLocator

from turning_env.scenario import Scenario
from turning_env.scenario.family import Job
from turning_render.plot_style import BLUE, GREEN, GREY, LIGHT, ORANGE, VERMILLION
from turning_shop.advise import Advice, summary
from turning_shop.calibrate import Calibration
from turning_shop.fit import SETTINGS
from turning_shop.measurements import COLUMNS
from turning_shop.prediction import Evidence, read_evidence
from turning_shop.whatif import Cuts, what_if

MAX_POINTS = 20000
"""Number of residuals above which only every n-th is drawn."""
MAX_LIVES = 12
"""Number of lines of tool life above which only those of powers of ten are drawn."""
GRID = 301
"""Number of cutting speeds, and of feeds, at which the map evaluates the laws."""
JOBS_IN_A_ROW, JOB_GRID = 4, 121
FRESH = 0.3
"""Wear of the fresh edge's map over the wear criterion [-]: at no wear, the laws of force and power are 0."""
A4 = 11.69, 8.27
"""Size of the page [inch]."""
MAX_WARNINGS = 4
"""Number of warnings on the page."""
RULED = (
    "Nominal values from measured or assumed laws: limits are kept with the edge worn as stated, at nominal depth and hardness. "
    "A simulation's output: try each change carefully."
)
_ALLOWED, _DOTS = "#DCEFE6", "#999999"


def draw_residuals(calibration: Calibration) -> Figure:
    """Draw a row of panels per law: residuals [%] over the prediction and over every factor with a fitted exponent."""
    fits = list(calibration.fits.values())
    columns = max(len(fitted.estimates) for fitted in fits)
    figure = Figure(figsize=(max(2.6 * columns + 0.6, 4.6), 2.6 * len(fits) + 0.4), layout="constrained")
    panels = figure.subplots(len(fits), columns, sharey="row", squeeze=False)
    for row, fitted in zip(panels, fits, strict=True):
        shown = {fitted.response: fitted.predicted} | {name: fitted.factors[name] for name in fitted.exponents}
        for axes, (name, values) in zip(row, shown.items(), strict=False):
            step = -(-len(values) // MAX_POINTS)
            axes.axhspan(-200 * fitted.scatter, 200 * fitted.scatter, color=LIGHT, linewidth=0)
            axes.axhline(0, color=GREY, linewidth=0.9)
            axes.scatter(values[::step], 100 * fitted.residuals[::step], color=BLUE, s=16, alpha=0.6, linewidths=0)
            axes.spines[["top", "right"]].set_visible(False)
            predicted = "predicted " if name == fitted.response else ""
            axes.set_xlabel(f"{predicted}{name.replace('_', ' ')} [{COLUMNS[name].unit}]")
        for axes in row[len(shown) :]:
            axes.set_axis_off()
        row[0].set_ylabel("measured / predicted - 1\n[%]")
        title = f"{fitted.response.replace('_', ' ').capitalize()}: {fitted.quality} (grey: twice it)"
        row[0].set_title(title, loc="left", fontsize="medium")
    return figure


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
    machine, limits = scenario.machine, scenario.limits
    speeds = np.linspace(machine.cutting_speed_min, machine.cutting_speed_max, GRID)
    feeds = np.linspace(machine.feed_min, machine.feed_max, GRID)
    cuts = what_if(scenario, speeds, feeds[:, np.newaxis], depth_of_cut, hardness, wear=wear)
    _fill_allowed(axes, cuts)
    settings = {name: getattr(cuts, name) for name in SETTINGS}
    unmeasured = sum(law.extrapolates(settings) for law in read_evidence(scenario).laws.values())
    if np.any(unmeasured):
        dots = axes.contourf(speeds, feeds, unmeasured, levels=(0.5, 9.5), colors="none", hatches=["."])
        dots.set_edgecolor(_DOTS)
        dots.set_linewidth(0.0)
    _draw_removal_rate(axes, cuts)
    _draw_tool_life(axes, cuts)
    handles: list[Any] = [
        Patch(facecolor=_ALLOWED, edgecolor=GREY, label="within the limits"),
        Patch(facecolor=LIGHT, edgecolor=GREY, label="a limit is exceeded"),
    ]
    of_limits: tuple[tuple[Any, str, str, Any], ...] = (
        (cuts.thrust_force_share, f"thrust force at its limit, {limits.thrust_force:g} N", ORANGE, "-"),
        (cuts.power_share, f"power at its limit, {limits.power:g} kW", BLUE, (0, (6, 1.5))),
    )
    for share, limit, colour, dashes in of_limits:
        if share.min() < 1.0 < share.max():
            axes.contour(speeds, feeds, share, levels=(1.0,), colors=colour, linewidths=2.2, linestyles=[dashes])
        handles.append(Line2D([], [], color=colour, linewidth=2.2, linestyle=dashes, label=limit))
    _mark_best(axes, cuts)
    axes.set(xlabel="cutting speed [m/min]", ylabel="feed [mm/rev]")
    bar = "nominal hardness" if hardness == 1 else f"{hardness:g} times nominal hardness"
    title = f"{scenario.name}: depth of cut {cuts.depth_of_cut.flat[0]:g} mm, {bar}, edge worn to {wear:g} mm"
    axes.set_title(title, loc="left", fontsize="medium")
    handles += [
        Line2D([], [], color=GREY, linewidth=0.8, label="removal rate, see right axis"),
        Line2D([], [], color=GREEN, linewidth=1.4, linestyle=":", label="tool life, fresh to worn out"),
        Line2D([], [], color="black", marker="o", linestyle="none", label="highest removal rate"),
    ]
    if np.any(unmeasured):
        handles.append(Patch(facecolor="white", edgecolor=_DOTS, hatch="..", label="extrapolated: not measured there"))
    return handles


def draw_sheet(scenario: Scenario, evidence: Evidence, advice: Sequence[Advice]) -> Figure:
    """Draw the page, A4 across.

    Args:
        scenario: The machine, material and limits.
        evidence: Evidence for the laws, with the warnings.
        advice: Returned by ``advise``.
    """
    criterion = scenario.tool.wear_criterion
    figure = Figure(figsize=A4, layout="constrained")
    pages: Any = figure.subfigures(2, 1, height_ratios=(1.35, 1.0))
    maps, rest = pages
    for axes, wear in zip(maps.subplots(1, 2), (FRESH * criterion, criterion), strict=True):
        handles = draw_map_on(axes, scenario, wear)
        axes.set_title(f"edge worn to {wear:.2g} mm", loc="left", fontsize="medium")
    maps.legend(handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize="small")
    maps.suptitle(f"{scenario.name}: {scenario.workpiece.depth_of_cut:g} mm deep", fontsize="large")
    lines = list(summary(scenario, list(advice)))
    table = lines[: lines.index("", 3)] + [line for line in lines[-1:] if line.startswith("*")]
    best = next(each for each in advice if each.aim == "least cost" and len(each.steps) == 1)
    change = f"LEAST COST: {best.steps[0].cutting_speed:.0f} m/min, {best.steps[0].feed:.3f} mm/rev. "
    parts = max(best.change_after, 1)
    change += f"Change the edge after {parts} part{'s' * (parts > 1)}, or at {best.steps[-1].wear:.2f} mm of flank wear."
    warnings = list(evidence.warnings[:MAX_WARNINGS])
    if len(evidence.warnings) > MAX_WARNINGS:
        warnings.append(f"and {len(evidence.warnings) - MAX_WARNINGS} more warnings: see {evidence.source}")
    wrapped = [line for warning in warnings for line in textwrap.wrap(f"! {warning}", 150)]
    rest.text(0.02, 0.97, change, fontsize=13, fontweight="bold", verticalalignment="top")
    rest.text(0.02, 0.85, "\n".join(table), family="monospace", fontsize=8, verticalalignment="top")
    rest.text(0.02, 0.30, "\n".join(wrapped), fontsize=8, color=VERMILLION, verticalalignment="top")
    rest.text(0.02, 0.02, RULED, fontsize=8, verticalalignment="bottom")
    return figure


def _fill_allowed(axes: Axes, cuts: Cuts) -> None:
    axes.set_facecolor(LIGHT)
    if cuts.within_limits.any():
        axes.contourf(cuts.cutting_speed, cuts.feed, cuts.within_limits.astype(float), levels=(0.5, 1.5), colors=[_ALLOWED])


def _draw_removal_rate(axes: Axes, cuts: Cuts) -> None:
    """Draw lines of round removal rates that end at the right axis, which labels them."""
    low, high = (float(rate) for rate in cuts.removal_rate[[0, -1], -1])
    levels = [level for level in MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(low, high) if low < level < high]
    axes.contour(cuts.cutting_speed, cuts.feed, cuts.removal_rate, levels=levels, colors=GREY, linewidths=0.8)
    right = axes.twinx()
    right.set_ylim(cuts.feed.min(), cuts.feed.max())
    right.set_yticks([cuts.feed.max() * level / high for level in levels], [f"{level:g}" for level in levels], color=GREY)
    right.set_ylabel("removal rate [cm³/min] of the line that ends here", color=GREY)


def _draw_tool_life(axes: Axes, cuts: Cuts) -> None:
    """Draw lines of round tool lives, with labels at low feeds, away from other text."""
    low, high = float(cuts.tool_life.min()), min(float(cuts.tool_life.max()), 1e300)
    for digits in ((1.0, 2.0, 5.0), (1.0,)):
        levels = [level for level in LogLocator(subs=digits, numticks=1000).tick_values(low, high) if low < level < high]
        if len(levels) <= MAX_LIVES:
            break
    placed = {level: place for level in levels if (place := _label_position(cuts, level))}
    if placed:
        style: dict[str, Any] = {"levels": list(placed), "colors": GREEN, "linewidths": 1.4, "linestyles": ":"}
        lines = axes.contour(cuts.cutting_speed, cuts.feed, cuts.tool_life, **style)
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


def _mark_best(axes: Axes, cuts: Cuts) -> None:
    """Mark the highest removal rate within limits, if there is any."""
    if not cuts.within_limits.any():
        axes.set_title("nowhere within limits", loc="right", fontsize="medium", color=VERMILLION)
        return
    index = np.where(cuts.within_limits, cuts.removal_rate, 0.0).argmax()
    columns = (cuts.cutting_speed, cuts.feed, cuts.removal_rate, cuts.tool_life)
    speed, feed, rate, life = (float(values.flat[index]) for values in columns)
    axes.plot(speed, feed, marker="o", markersize=9, color="black", clip_on=False, zorder=5)
    right, upper = speed > cuts.cutting_speed.mean(), feed > cuts.feed.mean()
    axes.annotate(
        f"{speed:.0f} m/min, {feed:.3g} mm/rev:\n{rate:.0f} cm³/min, tool life {life:.3g} min",
        (speed, feed),
        xytext=(-12 if right else 12, -14 if upper else 14),
        textcoords="offset points",
        horizontalalignment="right" if right else "left",
        verticalalignment="top" if upper else "bottom",
        bbox={"boxstyle": "round", "facecolor": "white", "edgecolor": GREY, "alpha": 0.95},
        zorder=6,
    )


def draw_jobs(jobs: Sequence[Job]) -> Figure:
    """Draw a panel per job, four in a row: the feasible region at half an edge's life, by the nominal model and in truth."""
    rows = -(-len(jobs) // JOBS_IN_A_ROW)
    figure = Figure(figsize=(7.2, 1.9 * rows + 0.6), layout="constrained")
    panels = figure.subplots(rows, JOBS_IN_A_ROW, squeeze=False).ravel()
    dashes = (0, (5, 1.5))
    for axes, job in zip(panels, jobs, strict=False):
        nominal, machine = job.scenario.nominal(), job.scenario.machine
        speeds = np.linspace(machine.cutting_speed_min, job.scenario.cutting_speed_max, JOB_GRID)
        feeds = np.linspace(machine.feed_min, machine.feed_max, JOB_GRID)
        wear = nominal.tool.wear_criterion * 0.5**nominal.material.wear.time
        by_model, true = (what_if(each, speeds, feeds[:, np.newaxis], wear=wear) for each in (nominal, job.scenario))
        _fill_allowed(axes, by_model)
        within = true.within_limits.astype(float)
        if 0.0 < within.mean() < 1.0:
            axes.contour(speeds, feeds, within, levels=(0.5,), colors=VERMILLION, linewidths=1.6, linestyles=[dashes])
        axes.plot(job.cutting_speed, job.feed, marker="o", markersize=6, color="black", clip_on=False, zorder=5)
        axes.set_title(job.title, fontsize=8, loc="left")
        axes.tick_params(labelsize=8)
    for axes in panels[len(jobs) :]:
        axes.set_axis_off()
    figure.supxlabel("cutting speed [m/min]", fontsize=9)
    figure.supylabel("feed [mm/rev]", fontsize=9)
    handles = [
        Patch(facecolor=_ALLOWED, edgecolor=GREY, label="within limits by the nominal model"),
        Line2D([], [], color=VERMILLION, linewidth=1.6, linestyle=dashes, label="limit in truth"),
        Line2D([], [], color="black", marker="o", linestyle="none", label="best by the nominal model"),
    ]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, frameon=False, fontsize=8)
    return figure
