"""Draw operating maps and a page to pin to the machine.

``whatif.py`` and ``prediction.py`` compute what a map shows, ``advise.py`` the advice on the page.
``turning_env.rendering.plot_style`` writes the figures.
"""

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
from turning_shop import Values
from turning_shop.advise import Advice, PartPlan, headline, summary
from turning_shop.allowed import allowed_loads, bending, feed_range
from turning_shop.callouts import (
    ADVISED,
    BOTH,
    HIGHEST,
    SAME_CUT,
    Callout,
    CutMark,
    draw_marks,
    place,
)
from turning_shop.callouts import handles as mark_handles
from turning_shop.fit import SETTINGS
from turning_shop.prediction import Evidence, predict
from turning_shop.units import METRIC, Units
from turning_shop.whatif import NO_LIMIT, Cuts, what_if

from turning_env.rendering.plot_style import BLUE, GREEN, GREY, LIGHT, ORANGE, VERMILLION
from turning_env.scenario import Scenario

GRID_SIZE = 301  # number of cutting speeds, and of feeds, at which the map evaluates the laws
# By a power of the wear, force and power are 0 without wear: the fresh edge's map needs a little.
FRESH_SHARE = 0.3  # wear of the fresh edge's map over the wear criterion [-]
MIN_DOTTED = 0.02  # share of a map in which dots are seen [-]
A4 = (11.69, 8.27)  # size of the page, across [inch]
HEIGHT_RATIOS = (1.2, 1.0)  # heights of the maps and of the text
SHEET_WIDTH = 190  # of a line of the sheet [characters]
MAP_WIDTH = 130  # of a line of warnings above a map [characters]
LINE_SPACING = 1.2  # distance of lines over the font size [-]
BLOCK_GAP = 0.6  # distance of two blocks of the sheet [lines]
DISCLAIMER = (
    "Nominal values from measured or assumed laws: limits are kept with the edge worn as stated, "
    "at nominal depth and hardness. A simulation's output: try each change carefully."
)
TITLE_GAP = 9.0  # between a map and its title, wider than half a mark [pt]
TITLE: dict[str, Any] = {"loc": "left", "fontsize": "medium", "pad": TITLE_GAP}
_ALLOWED = "#DCEFE6"
_DOTS = "#999999"


class _LoadLine(NamedTuple):
    """The look of the line along which a load reaches its limit."""

    load: str  # field of ``Cuts`` and of the scenario's limits
    unit: str
    colour: str
    dashes: Any  # Matplotlib's ``linestyle``


_LOAD_LINES = (
    _LoadLine("thrust_force", "N", ORANGE, dashes="-"),
    _LoadLine("power", "kW", BLUE, dashes=(0, (6, 1.5))),
)


def draw_map(
    scenario: Scenario,
    evidence: Evidence,
    wear: float,
    depth_of_cut: float | None = None,
    hardness: float = 1.0,
    advised: PartPlan | None = None,
    units: Units = METRIC,
) -> Figure:
    """Draw limits, removal rate and tool life over the machine's range of speed and feed.

    Args:
        scenario: The machine, tool and material.
        evidence: What is known of the laws of the scenario.
        wear: Flank wear of the edge [mm].
        depth_of_cut: Depth of cut [mm]; by default the nominal one.
        hardness: Hardness of the bar over nominal [-].
        advised: The advised cut, which is marked beside the highest removal rate.
        units: Units of axes and labels.

    Raises:
        WorkshopError: The nose radius allows no feed of the machine.
    """
    figure = Figure(figsize=(8.6, 6.4), layout="constrained")
    drawn = draw_map_on(
        figure.subplots(),
        scenario,
        evidence=evidence,
        wear=wear,
        bar=Bar(depth_of_cut, hardness),
        advised=advised,
        units=units,
    )
    if evidence.warnings:
        figure.suptitle(
            "\n".join(_wrapped_warnings(evidence, MAP_WIDTH, units)),
            fontsize="x-small",
            color=VERMILLION,
            ha="left",
            x=0.02,
        )
    figure.legend(handles=drawn.handles, loc="outside lower center", ncols=2, frameon=False)
    place(figure, drawn.callouts)
    return _without_formulas(figure)


class Bar(NamedTuple):
    """The bar of a map."""

    depth_of_cut: float | None = None  # [mm]; None: the nominal one
    hardness: float = 1.0  # over nominal [-]


class DrawnMap(NamedTuple):
    """A map on its axes."""

    handles: list[Any]  # of the legend
    callouts: list[Callout]


def draw_map_on(
    axes: Axes,
    scenario: Scenario,
    evidence: Evidence,
    wear: float,
    bar: Bar = Bar(),  # noqa: B008 - immutable
    advised: PartPlan | None = None,
    units: Units = METRIC,
    has_highest: bool = True,
) -> DrawnMap:
    """Draw the map of ``draw_map`` on axes.

    Marks are the advised cut, if there is one, and the highest removal rate if ``has_highest``.
    """
    # The highest speed is that of the machine's range, or that of the spindle at this diameter.
    max_speed = float(scenario.cutting_speed_max)
    speeds = np.linspace(scenario.machine.cutting_speed_min, max_speed, GRID_SIZE)
    min_feed, max_feed = feed_range(scenario)
    feeds = np.linspace(min_feed, max_feed, GRID_SIZE)
    cuts = what_if(
        scenario,
        speeds,
        feed=feeds[:, np.newaxis],
        depth_of_cut=bar.depth_of_cut,
        hardness=bar.hardness,
        wear=wear,
    )
    kept = _kept(scenario, cuts)
    extrapolated = predict(scenario, evidence, cuts, of_wear=True).extrapolated
    shown = _converted(cuts, units)

    # Later drawings cover earlier ones: areas come first, the mark comes last.
    handles = _fill_allowed(axes, shown, kept)
    has_dots = _dot_unmeasured(axes, shown, _extrapolating(evidence, cuts))
    curve_handles = _draw_removal_rate(axes, shown, units)
    curve_handles += _draw_tool_life(axes, shown)
    limit_handles = _draw_load_limits(axes, shown, scenario, evidence)
    limit_handles += _draw_strength_limit(axes, shown, scenario)
    marks = _marks(
        cuts, kept=kept, extrapolated=extrapolated, advised=advised, has_highest=has_highest
    )
    callouts = draw_marks(axes, marks, scenario.tool.nose_radius, units=units)
    if not kept.any():
        # Beside the title, which may fill the line, it would cover text.
        axes.text(
            0.5,
            0.5,
            "nowhere within limits",
            transform=axes.transAxes,
            horizontalalignment="center",
            color=VERMILLION,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 2.0},
        )

    axes.set(
        xlabel=f"cutting speed [{units.name('m/min')}]",
        ylabel=f"feed [{units.name('mm/rev')}]",
    )
    hardness = "nominal hardness"
    if bar.hardness != 1.0:
        hardness = f"{bar.hardness:g} times nominal hardness"
    depth = f"depth of cut {cuts.depth_of_cut.flat[0]:g} mm"
    worn = _worn(evidence, wear)
    title = f"{depth}, {hardness}, {worn}"
    # The name of a tool is no quantity to convert.
    axes.set_title(f"{_name(scenario, evidence)}: {units.text(title)}", **TITLE)

    for handle in limit_handles:
        handle.set_label(units.text(str(handle.get_label())))
    handles += limit_handles + curve_handles + mark_handles(marks)
    has_star = worn.endswith("*") or any(mark.star for mark in marks)
    if has_dots or has_star:
        handles.append(_extrapolation_handle(evidence, has_dots))
    return DrawnMap(handles, callouts)


def _name(scenario: Scenario, evidence: Evidence) -> str:
    """Return the name of the tool, or that of the scenario's file if the tool has none."""
    return evidence.tool or scenario.name


def _extrapolation_handle(evidence: Evidence, has_dots: bool) -> Any:
    """Return the legend handle of what is extrapolated: of dots, or of a star alone."""
    label = f"* extrapolated: not {evidence.origins} there"
    if has_dots:
        return Patch(facecolor="white", edgecolor=_DOTS, hatch="..", label=label)
    return Line2D([], [], linestyle="none", label=label)


def draw_sheet(
    scenario: Scenario,
    evidence: Evidence,
    advice: list[Advice],
    simulated: Sequence[str] = (),
    units: Units = METRIC,
) -> Figure:
    """Draw the page, A4 across: maps, advice, sentences on the simulated advice, and warnings."""
    plan = advice[0].plan
    at_change = float(plan.cuts.wear)
    fresh = min(FRESH_SHARE * scenario.tool.wear_criterion, at_change)
    figure = Figure(figsize=A4, layout="constrained")
    pages: Any = figure.subfigures(2, 1, height_ratios=HEIGHT_RATIOS)
    maps, text_page = pages

    handles: dict[str, Any] = {}
    callouts: list[Callout] = []
    for axes, wear in zip(maps.subplots(1, 2), (fresh, at_change), strict=True):
        drawn = draw_map_on(
            axes,
            scenario,
            evidence=evidence,
            wear=wear,
            advised=plan,
            units=units,
            has_highest=False,
        )
        callouts += drawn.callouts
        # Both maps have one legend, which shows what either of them holds.
        handles |= {handle.get_label(): handle for handle in drawn.handles}
        title = _worn(evidence, wear)
        if wear == at_change:
            title += ", at the change"
        axes.set_title(units.text(title), **TITLE)
    maps.legend(
        handles=list(handles.values()),
        loc="outside lower center",
        ncols=4,
        frameon=False,
        fontsize="small",
    )
    depth = units.text(f"{scenario.workpiece.depth_of_cut:g} mm deep")
    maps.suptitle(f"{_name(scenario, evidence)}: {depth}", fontsize="large")

    recommendation, *notes = map(units.text, headline(scenario, evidence, advice))
    sentences = []
    for text in (*notes, *map(units.text, simulated)):
        sentences += textwrap.wrap(text, SHEET_WIDTH)
    # The summary repeats the headline between its two empty lines, of which the first is line 2.
    lines = list(summary(scenario, evidence, advice, units))
    end_of_headline = lines.index("", 3)
    table = lines[:2] + lines[end_of_headline + 1 :]
    warnings = _wrapped_warnings(evidence, SHEET_WIDTH, units)
    blocks = [
        TextBlock([recommendation], size=11, weight="bold"),
        TextBlock(sentences, size=7),
        TextBlock(table, size=6.5, family="monospace"),
        TextBlock(warnings, size=7, color=VERMILLION),
        TextBlock(textwrap.wrap(DISCLAIMER, SHEET_WIDTH), size=7),
    ]
    _write(text_page, blocks)
    place(figure, callouts)
    return _without_formulas(figure)


class TextBlock(NamedTuple):
    """Lines of one look on the sheet."""

    lines: list[str]
    size: float  # [pt]
    weight: str = "normal"
    family: str = "sans-serif"
    color: str = "black"

    @property
    def height(self) -> float:
        """Height at the block's font size, with the gap below [pt]."""
        return LINE_SPACING * self.size * (len(self.lines) + BLOCK_GAP)


def _write(page: Any, blocks: Sequence[TextBlock]) -> None:
    """Write blocks one below the other, smaller if they do not fit."""
    height = A4[1] * 72.0 * HEIGHT_RATIOS[1] / sum(HEIGHT_RATIOS)  # [pt]
    filled = [block for block in blocks if block.lines]
    scale = min(1.0, 0.97 * height / sum(block.height for block in filled))
    top = 0.99
    for block in filled:
        page.text(
            0.02,
            top,
            "\n".join(block.lines),
            verticalalignment="top",
            linespacing=LINE_SPACING,
            fontsize=scale * block.size,
            fontweight=block.weight,
            family=block.family,
            color=block.color,
        )
        top -= scale * block.height / height


def _worn(evidence: Evidence, wear: float) -> str:
    """Return the edge's state, with a star if a law was not measured at this flank wear [mm]."""
    state = f"edge worn to {wear:.3g} mm"
    factors = {"wear": np.asarray(wear)}
    if any(law.extrapolates(factors) for law in evidence.laws.values()):
        state += " *"
    return state


def _wrapped_warnings(evidence: Evidence, width: int, units: Units) -> list[str]:
    lines = []
    for warning in evidence.warnings:
        lines += textwrap.wrap(f"! {units.text(warning)}", width)
    return lines


def _without_formulas(figure: Figure) -> Figure:
    """Let names with "$" be text, which Matplotlib else reads as formulas."""
    for text in figure.findobj(Text):
        text.set_parse_math(False)
    return figure


def _kept(scenario: Scenario, cuts: Cuts) -> NDArray[np.bool_]:
    """Return which cuts keep the limits.

    If the strength of edges is stated, cuts must also stay below the force at which edges may
    break.
    """
    kept = cuts.within_limits
    allowed = allowed_loads(scenario)
    if allowed.by_strength or allowed.by_deflection:
        kept = kept & (cuts.thrust_force <= allowed.thrust_force)
    return np.asarray(kept)


def _fill_allowed(axes: Axes, cuts: Cuts, kept: NDArray[np.bool_]) -> list[Any]:
    """Fill the area within the limits; return a legend handle for each area that there is."""
    axes.set_facecolor(LIGHT)
    handles = []
    if kept.any():
        handles.append(Patch(facecolor=_ALLOWED, edgecolor=GREY, label="within the limits"))
        axes.contourf(
            cuts.cutting_speed,
            cuts.feed,
            kept.astype(float),
            levels=(0.5, 1.5),
            colors=[_ALLOWED],
        )
    if not kept.all():
        handles.append(Patch(facecolor=LIGHT, edgecolor=GREY, label="a limit is exceeded"))
    return handles


def _converted(cuts: Cuts, units: Units) -> Cuts:
    """Return cuts with the speed, feed and removal rate that axes show in their units."""
    return cuts._replace(
        cutting_speed=units.unit("m/min").factor * cuts.cutting_speed,
        feed=units.unit("mm/rev").factor * cuts.feed,
        removal_rate=units.unit("cm3/min").factor * cuts.removal_rate,
    )


def _extrapolating(evidence: Evidence, cuts: Cuts) -> NDArray[np.int64]:
    """Return how many laws are used outside their measured range of settings."""
    settings = {name: getattr(cuts, name) for name in SETTINGS}
    num_extrapolating = np.zeros(cuts.feed.shape, int)
    for law in evidence.laws.values():
        num_extrapolating += law.extrapolates(settings)
    return num_extrapolating


def _dot_unmeasured(axes: Axes, cuts: Cuts, num_extrapolating: NDArray[np.int64]) -> bool:
    """Dot the area in which a law is used outside its measured range of settings.

    Return whether it is large enough to show dots.
    """
    if num_extrapolating.any():
        dots = axes.contourf(
            cuts.cutting_speed,
            cuts.feed,
            num_extrapolating,
            levels=(0.5, 9.5),
            colors="none",
            hatches=["."],
        )
        dots.set_edgecolor(_DOTS)
        dots.set_linewidth(0.0)
    return bool((num_extrapolating > 0).mean() > MIN_DOTTED)


def _draw_removal_rate(axes: Axes, cuts: Cuts, units: Units) -> list[Any]:
    """Draw lines of round removal rates that end at the right axis, which labels them.

    Return their legend handle.
    """
    low = float(cuts.removal_rate[0, -1])
    high = float(cuts.removal_rate[-1, -1])
    round_rates = MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(low, high)
    levels = [rate for rate in round_rates if low < rate < high]
    axes.contour(
        cuts.cutting_speed,
        cuts.feed,
        cuts.removal_rate,
        levels=levels,
        colors=GREY,
        linewidths=0.8,
    )
    right = axes.twinx()
    max_feed = cuts.feed.max()
    right.set_ylim(cuts.feed.min(), max_feed)
    right.set_yticks(
        # At the highest speed, where the axis is, the rate is proportional to the feed.
        [max_feed * level / high for level in levels],
        labels=[f"{level:g}" for level in levels],
        color=GREY,
    )
    unit = units.name("cm3/min").replace("3", "³")
    right.set_ylabel(f"removal rate [{unit}] of the line that ends here", color=GREY)
    label = "removal rate, see right axis"
    return [Line2D([], [], color=GREY, linewidth=0.8, label=label)]


def _draw_tool_life(axes: Axes, cuts: Cuts) -> list[Any]:
    """Draw lines of round tool lives with labels; return their legend handle, if there are any."""
    low = float(cuts.tool_life.min())
    high = min(float(cuts.tool_life.max()), 1e300)  # a life that overflows is infinite
    # Over more than four decades, lines at 2 and 5 as well would hide the map.
    digits = (1.0, 2.0, 5.0) if high < 1e4 * low else (1.0,)
    round_lives = LogLocator(subs=digits, numticks=1000).tick_values(low, high)
    levels = [life for life in round_lives if low < life < high]
    if not levels:
        return []
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
    label = "tool life, fresh to worn out"
    return [Line2D([], [], color=GREEN, linewidth=1.4, linestyle=":", label=label)]


def _draw_load_limits(
    axes: Axes, cuts: Cuts, scenario: Scenario, evidence: Evidence
) -> list[Line2D]:
    """Draw where force and power reach their limits; return a legend handle for each limit."""
    handles = []
    for line in _LOAD_LINES:
        limit = getattr(scenario.limits, line.load)
        if limit == NO_LIMIT[line.load]:
            continue
        share = getattr(cuts, f"{line.load}_share")
        if not _draw_limit(axes, cuts, share, colour=line.colour, dashes=line.dashes):
            continue
        label = f"{line.load.replace('_', ' ')} at its limit, {limit:.4g} {line.unit}"
        known = evidence.known(line.load)
        if known != "measured":
            label += f" ({known})"
        handles.append(_limit_handle(label, line.colour, line.dashes))
    return handles


def _draw_strength_limit(axes: Axes, cuts: Cuts, scenario: Scenario) -> list[Line2D]:
    """Draw where edges may break, or bar or tool bend too far; return its legend handle."""
    allowed = allowed_loads(scenario)
    if not (allowed.by_strength or allowed.by_deflection):
        return []
    share = cuts.thrust_force / allowed.thrust_force
    if not _draw_limit(axes, cuts, share, colour=VERMILLION, dashes="-."):
        return []
    label = f"edges may break above {allowed.thrust_force:.0f} N"
    if allowed.by_deflection:
        label = f"{bending(scenario)} at {allowed.thrust_force:.0f} N"
    return [_limit_handle(label, VERMILLION, "-.")]


def _draw_limit(axes: Axes, cuts: Cuts, share: Values, colour: str, dashes: Any) -> bool:
    """Draw the line on which a share of a limit is 1, and return whether the map has one."""
    # Matplotlib warns if a contour has no level within the data.
    is_on_map = bool(share.min() < 1.0 < share.max())
    if is_on_map:
        axes.contour(
            cuts.cutting_speed,
            cuts.feed,
            share,
            levels=(1.0,),
            colors=colour,
            linewidths=2.2,
            linestyles=[dashes],
        )
    return is_on_map


def _limit_handle(label: str, colour: str, dashes: Any) -> Line2D:
    return Line2D([], [], color=colour, linewidth=2.2, linestyle=dashes, label=label)


def _marks(
    cuts: Cuts,
    kept: NDArray[np.bool_],
    extrapolated: NDArray[np.bool_],
    advised: PartPlan | None,
    has_highest: bool,
) -> list[CutMark]:
    """Return the marks of the advised cut and of the highest removal rate within the limits."""
    marks = []
    if advised is not None:
        marks.append(CutMark(ADVISED, advised.cuts, advised.mark))
    if has_highest and kept.any():
        index = np.where(kept, cuts.removal_rate, 0.0).argmax()
        cut = Cuts._make(np.asarray(values.flat[index]) for values in cuts)
        if advised is not None and _is_same(advised.cuts, cut):
            return [CutMark(BOTH, advised.cuts, advised.mark)]
        marks.append(CutMark(HIGHEST, cut, " *" if extrapolated.flat[index] else ""))
    return marks


def _is_same(cut: Cuts, other: Cuts) -> bool:
    """Return whether two cuts have one place on the map."""
    is_speed = np.isclose(cut.cutting_speed, other.cutting_speed, rtol=SAME_CUT)
    is_feed = np.isclose(cut.feed, other.feed, rtol=SAME_CUT)
    return bool(is_speed and is_feed)
