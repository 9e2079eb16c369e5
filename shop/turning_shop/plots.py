"""Draw operating maps and a page to pin to the machine."""

import textwrap
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.text import Text
from matplotlib.ticker import LogLocator, MaxNLocator
from numpy.typing import NDArray
from turning_shop.advise import Advice, Plan, headline, summary
from turning_shop.allowed import allowed_loads, feed_range
from turning_shop.fit import SETTINGS
from turning_shop.prediction import Evidence, predict
from turning_shop.whatif import NO_LIMIT, Cuts, what_if

from turning_env.rendering.plot_style import BLUE, GREEN, GREY, LIGHT, ORANGE, VERMILLION
from turning_env.scenario import Scenario

GRID = 301  # number of cutting speeds, and of feeds, at which the map evaluates the laws
FRESH = 0.3  # wear of the fresh edge's map over the wear criterion [-]: at no wear, the laws of force and power are 0
A4 = 11.69, 8.27  # size of the page [inch]
SHARES = 1.2, 1.0  # heights of the maps and of the text
SHEET_WIDTH = 190  # of a line of the sheet [letters]
LEADING = 1.2  # distance of lines over the size of letters [-]
RULED = (
    "Nominal values from measured or assumed laws: limits are kept with the edge worn as stated, at nominal depth and hardness. "
    "A simulation's output: try each change carefully."
)
_ALLOWED, _DOTS = "#DCEFE6", "#999999"


def draw_map(
    scenario: Scenario,
    evidence: Evidence,
    wear: float,
    depth_of_cut: float | None = None,
    hardness: float = 1.0,
) -> Figure:
    """Draw limits, removal rate and tool life over the machine's whole range of cutting speed and feed.

    They are those of an edge with a flank wear [mm], at a depth of cut [mm], by default the nominal one, and a hardness [-].
    """
    figure = Figure(figsize=(8.6, 6.4), layout="constrained")
    handles = draw_map_on(figure.subplots(), scenario, evidence, wear, depth_of_cut, hardness)
    if evidence.warnings:
        figure.suptitle(
            "\n".join(_wrapped(evidence, 130)),
            fontsize="x-small",
            color=VERMILLION,
            ha="left",
            x=0.02,
        )
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
    return _plain(figure)


def draw_map_on(
    axes: Axes,
    scenario: Scenario,
    evidence: Evidence,
    wear: float,
    depth_of_cut: float | None = None,
    hardness: float = 1.0,
    advised: Plan | None = None,
) -> list[Any]:
    """Draw the map on axes, and return the handles of its legend: see ``draw_map``. Mark the advised cut, or most metal."""
    machine, limits = scenario.machine, scenario.limits
    speeds = np.linspace(machine.cutting_speed_min, machine.cutting_speed_max, GRID)
    feeds = np.linspace(*feed_range(scenario), GRID)
    cuts = what_if(scenario, speeds, feeds[:, np.newaxis], depth_of_cut, hardness, wear=wear)
    kept = _kept(scenario, cuts)
    _fill_allowed(axes, cuts, kept)
    unmeasured = sum(
        law.extrapolates({name: getattr(cuts, name) for name in SETTINGS})
        for law in evidence.laws.values()
    )
    if np.any(unmeasured):
        dots = axes.contourf(
            speeds, feeds, unmeasured, levels=(0.5, 9.5), colors="none", hatches=["."]
        )
        dots.set_edgecolor(_DOTS)
        dots.set_linewidth(0.0)
    _draw_removal_rate(axes, cuts)
    _draw_tool_life(axes, cuts)
    handles: list[Any] = [
        Patch(facecolor=_ALLOWED, edgecolor=GREY, label="within the limits"),
        Patch(facecolor=LIGHT, edgecolor=GREY, label="a limit is exceeded"),
    ]
    of_limits: tuple[tuple[str, str, str, Any], ...] = (
        ("thrust_force", "N", ORANGE, "-"),
        ("power", "kW", BLUE, (0, (6, 1.5))),
    )
    for name, unit, colour, dashes in of_limits:
        share, value = getattr(cuts, f"{name}_share"), getattr(limits, name)
        if value == NO_LIMIT[name]:
            continue
        limit = (
            f"{name.replace('_', ' ')} at its limit, {value:g} {unit}"
            + " (law not measured)" * (name not in evidence.laws)
        )
        if share.min() < 1.0 < share.max():
            axes.contour(
                speeds,
                feeds,
                share,
                levels=(1.0,),
                colors=colour,
                linewidths=2.2,
                linestyles=[dashes],
            )
        handles.append(Line2D([], [], color=colour, linewidth=2.2, linestyle=dashes, label=limit))
    allowed = allowed_loads(scenario)
    if allowed.by_strength:
        share = cuts.thrust_force / allowed.thrust_force
        if share.min() < 1.0 < share.max():
            axes.contour(
                speeds,
                feeds,
                share,
                levels=(1.0,),
                colors=VERMILLION,
                linewidths=2.2,
                linestyles="-.",
            )
        broken = f"edges may break above {allowed.thrust_force:.0f} N"
        handles.append(
            Line2D([], [], color=VERMILLION, linewidth=2.2, linestyle="-.", label=broken)
        )
    extrapolated = predict(scenario, evidence, cuts, of_wear=True).extrapolated
    _mark(axes, cuts, kept, extrapolated, advised)
    axes.set(xlabel="cutting speed [m/min]", ylabel="feed [mm/rev]")
    bar = "nominal hardness" if hardness == 1 else f"{hardness:g} times nominal hardness"
    title = f"{scenario.name}: depth of cut {cuts.depth_of_cut.flat[0]:g} mm, {bar}, {_worn(evidence, wear)}"
    axes.set_title(title, loc="left", fontsize="medium")
    handles += [
        Line2D([], [], color=GREY, linewidth=0.8, label="removal rate, see right axis"),
        Line2D(
            [], [], color=GREEN, linewidth=1.4, linestyle=":", label="tool life, fresh to worn out"
        ),
        Line2D(
            [],
            [],
            color="black",
            marker="o",
            linestyle="none",
            label="advised" if advised else "highest removal rate",
        ),
    ]
    if extrapolated.any():
        handles.append(
            Patch(
                facecolor="white",
                edgecolor=_DOTS,
                hatch="..",
                label="* extrapolated: not measured there",
            )
        )
    return handles


def draw_sheet(
    scenario: Scenario, evidence: Evidence, advice: list[Advice], simulated: Sequence[str] = ()
) -> Figure:
    """Draw the page, A4 across, with maps, advice, what the simulation said of it, and warnings."""
    at_change = float(advice[0].plan.cuts.wear)
    fresh = min(FRESH * scenario.tool.wear_criterion, at_change)
    figure = Figure(figsize=A4, layout="constrained")
    pages: Any = figure.subfigures(2, 1, height_ratios=SHARES)
    maps, rest = pages
    for axes, wear in zip(maps.subplots(1, 2), (fresh, at_change), strict=True):
        handles = draw_map_on(axes, scenario, evidence, wear, advised=advice[0].plan)
        when = ", at the change" * (wear == at_change)
        axes.set_title(_worn(evidence, wear) + when, loc="left", fontsize="medium")
    maps.legend(
        handles=handles, loc="outside lower center", ncols=4, frameon=False, fontsize="small"
    )
    maps.suptitle(f"{scenario.name}: {scenario.workpiece.depth_of_cut:g} mm deep", fontsize="large")
    first, *others = headline(scenario, evidence, advice)
    lines = list(summary(scenario, evidence, advice))
    table = [*lines[:2], *lines[lines.index("", 3) + 1 :]]
    said = [line for text in (*others, *simulated) for line in textwrap.wrap(text, SHEET_WIDTH)]
    _write(rest, [
        Block([first], size=11, weight="bold"),
        Block(said, size=7),
        Block(table, size=6.5, family="monospace"),
        Block(_wrapped(evidence, SHEET_WIDTH), size=7, color=VERMILLION),
        Block(textwrap.wrap(RULED, SHEET_WIDTH), size=7),
    ])  # fmt: skip
    return _plain(figure)


class Block(NamedTuple):
    """Lines of one look on the sheet."""

    lines: list[str]
    size: float  # [pt]
    weight: str = "normal"
    family: str = "sans-serif"
    color: str = "black"


def _write(page: Any, blocks: list[Block]) -> None:
    """Write blocks one below the other, smaller if they do not fit."""
    height = A4[1] * 72.0 * SHARES[1] / sum(SHARES)  # [pt]
    wanted = sum(LEADING * block.size * (len(block.lines) + 0.6) for block in blocks if block.lines)
    scale = min(1.0, 0.97 * height / wanted)
    top = 0.99
    for block in blocks:
        if not block.lines:
            continue
        look = {
            "fontsize": scale * block.size,
            "fontweight": block.weight,
            "family": block.family,
            "color": block.color,
        }
        page.text(
            0.02, top, "\n".join(block.lines), verticalalignment="top", linespacing=LEADING, **look
        )
        top -= scale * LEADING * block.size * (len(block.lines) + 0.6) / height


def _worn(evidence: Evidence, wear: float) -> str:
    """Return the state of the edge, with a star if a law was not measured at this flank wear [mm]."""
    beyond = any(law.extrapolates({"wear": np.asarray(wear)}) for law in evidence.laws.values())
    return f"edge worn to {wear:.3g} mm" + " *" * beyond


def _wrapped(evidence: Evidence, width: int) -> list[str]:
    return [line for warning in evidence.warnings for line in textwrap.wrap(f"! {warning}", width)]


def _plain(figure: Figure) -> Figure:
    """Let names with "$" be text, not formulas."""
    for text in figure.findobj(Text):
        text.set_parse_math(False)
    return figure


def _kept(scenario: Scenario, cuts: Cuts) -> NDArray[np.bool_]:
    """Return which cuts are within the limits, and below the force at which edges may break if their strength is stated."""
    allowed = allowed_loads(scenario)
    unbroken = cuts.thrust_force <= (allowed.thrust_force if allowed.by_strength else np.inf)
    return np.asarray(cuts.within_limits & unbroken)


def _fill_allowed(axes: Axes, cuts: Cuts, kept: NDArray[np.bool_]) -> None:
    axes.set_facecolor(LIGHT)
    if kept.any():
        axes.contourf(
            cuts.cutting_speed, cuts.feed, kept.astype(float), levels=(0.5, 1.5), colors=[_ALLOWED]
        )


def _draw_removal_rate(axes: Axes, cuts: Cuts) -> None:
    """Draw lines of round removal rates that end at the right axis, which labels them."""
    low, high = (float(rate) for rate in cuts.removal_rate[[0, -1], -1])
    levels = [
        level
        for level in MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(low, high)
        if low < level < high
    ]
    axes.contour(
        cuts.cutting_speed, cuts.feed, cuts.removal_rate, levels=levels, colors=GREY, linewidths=0.8
    )
    right = axes.twinx()
    right.set_ylim(cuts.feed.min(), cuts.feed.max())
    right.set_yticks(
        [cuts.feed.max() * level / high for level in levels],
        [f"{level:g}" for level in levels],
        color=GREY,
    )
    right.set_ylabel("removal rate [cm³/min] of the line that ends here", color=GREY)


def _draw_tool_life(axes: Axes, cuts: Cuts) -> None:
    """Draw lines of round tool lives with labels."""
    low, high = float(cuts.tool_life.min()), min(float(cuts.tool_life.max()), 1e300)
    digits = (1.0, 2.0, 5.0) if high < 1e4 * low else (1.0,)
    levels = [
        level
        for level in LogLocator(subs=digits, numticks=1000).tick_values(low, high)
        if low < level < high
    ]
    if levels:
        lines = axes.contour(
            cuts.cutting_speed,
            cuts.feed,
            cuts.tool_life,
            levels=levels,
            colors=GREEN,
            linewidths=1.4,
            linestyles=":",
        )
        for text in axes.clabel(lines, fmt="%g min", fontsize=9):
            text.set_bbox({"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85})


def _mark(
    axes: Axes, cuts: Cuts, kept: NDArray[np.bool_], extrapolated: Any, advised: Plan | None
) -> None:
    """Mark the advised cut, or the highest removal rate within limits, if there is any, with a star if it extrapolates."""
    if not kept.any():
        axes.set_title("nowhere within limits", loc="right", fontsize="medium", color=VERMILLION)
        return
    index = np.where(kept, cuts.removal_rate, 0.0).argmax()
    marked = advised.cuts if advised else Cuts(*(np.asarray(values.flat[index]) for values in cuts))
    speed, feed = float(marked.cutting_speed), float(marked.feed)
    star = advised.mark if advised else " *" * bool(extrapolated.flat[index])
    axes.plot(speed, feed, marker="o", markersize=9, color="black", clip_on=False, zorder=5)
    right, upper = speed > cuts.cutting_speed.mean(), feed > cuts.feed.mean()
    axes.annotate(
        f"{speed:.0f} m/min, {feed:.3g} mm/rev:\n{marked.removal_rate:.0f} cm³/min, tool life {marked.tool_life:.3g} min{star}",
        (speed, feed),
        xytext=(-12 if right else 12, -14 if upper else 14),
        textcoords="offset points",
        horizontalalignment="right" if right else "left",
        verticalalignment="top" if upper else "bottom",
        bbox={"boxstyle": "round", "facecolor": "white", "edgecolor": GREY, "alpha": 0.95},
        zorder=6,
    )
