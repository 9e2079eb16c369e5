"""Report on a played program: totals, a table of its blocks, and lines that overload or waste time.

``plausibility`` finds mistakes of programs; ``command`` prints both.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from turning_nc.adaptable_words import Change
from turning_nc.cutting import Play, Situation, ToolGroup, highest_feed
from turning_nc.dialects import with_line_feeds
from turning_nc.edges import outside, parts_per_edge
from turning_nc.finishing import Finishing
from turning_nc.words import at_lines
from turning_shop import Values
from turning_shop.advise import Prices, money
from turning_shop.allowed import needed_nose_radius, theoretical_roughness
from turning_shop.units import METRIC, Units

from turning_env.numerics.conversions import torque_at

MIN_WASTE = 1.0  # time that a block must be able to save to be named [s]
MAX_TEXT = 36  # characters of a block that are shown
OVERLOAD = "OVERLOAD"
UNKNOWN_LOAD = "load unknown"
EXTRAPOLATED = " *"
"""Mark of what lies outside the range in which the scenario's laws were measured."""


class Drive(NamedTuple):
    """Highest loads at the cut of a tool that threads or drills."""

    power: float  # [kW]
    torque: float  # [N m]


@dataclass(frozen=True)
class Summary:
    """Totals of a program."""

    time: float  # cycle time [s]
    time_in_metal: float  # [s]
    time_at_feed_in_air: float  # [s]
    time_of_threads_and_drills: float  # [s]
    other_time: float  # rapid moves, dwells and tool changes [s]
    removed: float  # [cm3]
    max_load: float  # highest share of a limit in the last part of an edge [-]
    overload_time: float  # [s]
    limited: bool  # whether there is a limit of force or power
    used_life: dict[str, float]  # share of the tool life per part, by tool [-]
    parts: dict[str, float]  # parts that 97.5 % of a tool's edges last: then they are changed
    change_wear: dict[str, float]  # flank wear at which it is changed at the latest, by tool [mm]
    extrapolated: tuple[str, ...]  # tools that cut outside of what was measured
    cost: float  # of a part, edges and their changes included
    cost_unit: str  # currency, or "min" of machine time if no hourly rate is stated
    # Of the tools that thread or drill metal, by their names.
    drives: dict[str, Drive] = field(default_factory=dict)
    # Theoretical roughness Rt of the highest feed in metal [um]; 0 if no nose radius is stated.
    max_roughness: float = 0.0

    def lines(self) -> list[str]:
        """Return the totals as text."""
        times = [f"{self.time_in_metal:.1f} s in metal"]
        if self.time_of_threads_and_drills > 0.0:
            times.append(f"{self.time_of_threads_and_drills:.1f} s of threads and drills")
        times.append(f"{self.time_at_feed_in_air:.1f} s at feed in air")
        times.append(f"{self.other_time:.1f} s other")
        lines = [
            f"cycle time: {self.time:.1f} s ({', '.join(times)})",
            f"removed: {self.removed:.2f} cm3",
        ]
        if self.limited:
            lines.append(
                f"highest load: {100 * self.max_load:.0f} % of a limit; "
                f"{self.overload_time:.1f} s above a limit"
            )
        else:
            lines.append("limits of force and power are off")
        lines.append(f"cost: {self.cost_text}, edges and their changes included")
        if self.max_roughness > 0.0:
            lines.append(f"highest theoretical roughness: Rt {self.max_roughness:.1f} um")
        for tool, drive in self.drives.items():
            lines.append(
                f"{tool} threads or drills: up to {drive.power:.3g} kW and {drive.torque:.3g} N m "
                "at the cut"
            )
        for tool in self.parts:
            life = f"{100 * self.used_life[tool]:.2f} % of the tool life a part"
            lines.append(f"{tool}: {life}, {self.edge_change(tool)}")
        return lines

    @property
    def cost_text(self) -> str:
        """The cost of a part as text."""
        unit = self.cost_unit
        if unit == "min":
            unit = "min of machine time"
        return f"{money(self.cost)} {unit} a part"

    def edge_change(self, tool: str) -> str:
        """Return the edge change of a tool as text, with a star if it is extrapolated."""
        parts = self.parts[tool]
        if parts < 1.0:
            count = f"{parts:.2f} of a part"
        elif parts == 1.0:
            count = "1 part"
        else:
            count = f"{parts:,.0f} parts"
        mark = EXTRAPOLATED if tool in self.extrapolated else ""
        return f"change after {count} or at {self.change_wear[tool]:.3g} mm{mark}"


def summary(situation: Situation, played: Play) -> Summary:
    """Return the totals of a play."""
    on = situation.engaged
    time = played.time - situation.other_time
    in_air = ~on & ~situation.threads_and_drills
    parts = parts_per_edge(situation, played)
    is_outside = _outside_measured(situation, played)
    used_life = {}
    change_wear = {}
    extrapolated = []
    for tool, is_tool in situation.by_tool.items():
        used_life[tool] = float(played.used_life[is_tool].sum())
        if tool in parts:
            change_wear[tool] = float(played.change_wear[is_tool][0])
        if is_outside[is_tool].any():
            extrapolated.append(tool)
    prices = Prices.of(situation.scenario)
    cost = prices.minute * float(played.time.sum()) / 60.0
    for group in situation.groups:
        edges_per_part = sum(1.0 / parts[tool] for tool in group.tools if tool in parts)
        cost += _cost_of_edge(prices, group) * edges_per_part
    return Summary(
        time=float(played.time.sum()),
        time_in_metal=float(time[on].sum()),
        time_at_feed_in_air=float(time[in_air].sum()),
        time_of_threads_and_drills=float(time[situation.threads_and_drills].sum()),
        other_time=float(situation.other_time.sum()),
        removed=float(situation.removal.slices.volume.sum() / 1000.0),
        max_load=float(played.load.max()),
        overload_time=float(time[played.load > 1.0].sum()),
        limited=situation.has_force_limit or situation.has_power_limit,
        used_life=used_life,
        parts=parts,
        change_wear=change_wear,
        extrapolated=tuple(extrapolated),
        cost=cost,
        cost_unit=prices.unit,
        drives=_drives(situation, played),
        max_roughness=_max_roughness(situation, played),
    )


def _drives(situation: Situation, played: Play) -> dict[str, Drive]:
    """Return the highest loads of the tools that thread or drill metal, by tool."""
    loaded = situation.loaded & ~situation.engaged
    turns = np.where(loaded, played.spindle_speed, 1.0)
    torque = torque_at(played.power, turns)
    drives = {}
    for tool, is_tool in situation.by_tool.items():
        cut = loaded & is_tool
        if cut.any():
            drives[tool] = Drive(float(played.power[cut].max()), torque=float(torque[cut].max()))
    return drives


def _cost_of_edge(prices: Prices, group: ToolGroup) -> float:
    """Return the cost of an edge of a group and of its change, at the prices of the machine.

    A price in another currency, or in minutes, is converted by what a minute costs in both.
    """
    prices_of_group = Prices.of(group.scenario)
    edge = prices_of_group.edge
    if prices_of_group.unit != prices.unit:
        edge *= prices.minute / prices_of_group.minute
    return edge + prices.minute * prices_of_group.change_time


def _max_roughness(situation: Situation, played: Play) -> float:
    """Return the theoretical roughness of the highest feed in metal [um]; 0 if it is not known."""
    roughness = 0.0
    for group in situation.groups:
        nose_radius = group.scenario.tool.nose_radius
        if nose_radius:
            on = situation.engaged & group.slices
            highest = float(played.feed[on].max(initial=0.0))
            roughness = max(roughness, theoretical_roughness(highest, nose_radius))
    return roughness


def _outside_measured(situation: Situation, played: Play) -> NDArray[np.bool_]:
    """Return which slices lie outside the measured range of any factor."""
    is_outside = np.zeros(len(played.time), np.bool_)
    for mark in outside(situation, played).values():
        is_outside |= mark
    return is_outside


def comparison(before: Summary, after: Summary) -> list[str]:
    """Return the totals of two programs side by side, as text."""
    saved = 100.0 * (1.0 - after.time / before.time)
    change = f"{saved:.1f} % saved" if saved >= 0.0 else f"{-saved:.1f} % longer"
    lines = [f"cycle time: {before.time:.1f} s before, {after.time:.1f} s after: {change}"]
    if before.limited:
        load_before = 100 * before.max_load
        load_after = 100 * after.max_load
        lines.append(f"highest load: {load_before:.0f} % before, {load_after:.0f} % after")
    lines.append(f"cost: {before.cost_text} before, {after.cost_text} after")
    life_before = 100.0 * sum(before.used_life.values())
    life_after = 100.0 * sum(after.used_life.values())
    lines.append(f"tool life per part: {life_before:.2f} % before, {life_after:.2f} % after")
    for tool in before.parts:
        change_before = before.edge_change(tool)
        change_after = after.edge_change(tool)
        lines.append(f"{tool}: {change_before} before, {change_after} after")
    return lines


def changes(changed: Sequence[Change]) -> list[str]:
    """Return changed words as text.

    With a nose radius r [mm], feeds f come with the theoretical roughness Rt = f^2 / (8 r).
    """
    lines = []
    for change in changed:
        roughness = ""
        radius = change.nose_radius
        if change.feeds and radius:
            depths = [f"{theoretical_roughness(feed, radius):.1f} um" for feed in change.feeds]
            roughness = f" (theoretical roughness Rt {' -> '.join(depths)})"
        before = change.before or "new word"
        lines.append(f"  line {change.line}: {before} -> {change.after}{roughness}")
    without_radius = [change for change in changed if not change.nose_radius]
    highest = max(map(_raised_feed, without_radius), default=0.0)
    if highest:
        # The feed is at most half of the nose radius, as with --nose-radius.
        lines.append(
            f"  feeds up to {highest:.3g} mm/rev need a nose radius of "
            f"{needed_nose_radius(highest):.2g} mm "
            "or more: set that of your inserts, --nose-radius"
        )
    return lines


def _raised_feed(change: Change) -> float:
    """Return the feed after a change that raises it [mm/rev]; otherwise 0."""
    if change.feeds is None:
        return 0.0
    is_raised = change.feeds.after > change.feeds.before
    return change.feeds.after if is_raised else 0.0


@dataclass(frozen=True)
class Row:
    """A block, or a pass of a cycle, each time that it is run. Shares are those of a limit."""

    line: int
    cycle_pass: int  # 0 if no cycle makes the move
    tool: str
    text: str  # the first characters of the block
    depth: float  # largest depth of cut [mm]
    diameters: tuple[float, float]  # smallest and largest [mm]; in metal, if it cuts
    feed: float  # highest [mm/rev]; in metal, if it cuts
    cutting_speed: float  # highest [m/min]; in metal, if it cuts
    time: float  # [s]
    air_time: float  # at feed in air [s]
    removed: float  # [cm3]
    force_share: float | None  # highest [-]; None without a limit, or of threads and drills
    power_share: float | None  # highest [-]; None without a limit, or if the load is not known
    used_life: float | None  # of an edge [-]; None for threads and drills
    saves: float  # time that the highest feed within limits would save [s]; 0 for finishing
    remark: str


def rows(situation: Situation, played: Play) -> list[Row]:
    """Return a row for every block at feed, in the order in which they are run."""
    writer = _RowWriter(situation, played)
    return [writer.row(slices) for slices in writer.blocks()]


class _RowWriter:
    """Writes the rows of a play. Arrays over all slices are made once, not for each row."""

    def __init__(self, situation: Situation, played: Play) -> None:
        s = situation
        slices = s.removal.slices
        cycle_pass_of_move = np.array([move.cycle_pass for move in s.moves.moves])
        self._situation = s
        self._played = played
        self._cycle_pass = cycle_pass_of_move[slices.move]
        self._texts = with_line_feeds(s.moves.program.text).split("\n")
        self._time = played.time - s.other_time
        self._load = played.load
        self._in_air = ~(s.engaged | s.threads_and_drills)
        self._is_outside = _outside_measured(s, played)
        self._finishing = Finishing(s)
        self._highest_feed = np.full(len(played.time), s.max_feed)
        self._min_feed = np.full(len(played.time), s.min_feed)
        self._has_force_limit = np.zeros(len(played.time), np.bool_)
        self._has_power_limit = np.zeros(len(played.time), np.bool_)
        for group in s.groups:
            # Threads and drills have no law of the thrust force.
            turns = group.slices & ~s.threads_and_drills
            self._has_force_limit[turns] = group.laws.has_force_limit
            self._has_power_limit[group.slices] = group.laws.has_power_limit
            view = s.under(group)
            on = s.engaged & group.slices
            self._min_feed[group.slices] = view.min_feed
            self._highest_feed[on] = highest_feed(
                group.scenario,
                played.cutting_speed[on],
                spindle_speed=played.spindle_speed[on],
                depth=slices.depth[on],
                wear=played.wear[on],
                max_feed=view.max_feed,
            )
        for mask in s.unknown.values():
            self._has_power_limit[mask] = False

    def blocks(self) -> list[NDArray[np.int64]]:
        """Return the indices of the slices of each block at feed."""
        fed = np.flatnonzero(self._situation.fed)
        line = self._situation.line[fed]
        cycle_pass = self._cycle_pass[fed]
        is_new_line = np.diff(line) != 0
        is_new_pass = np.diff(cycle_pass) != 0
        is_gap = np.diff(fed) > 1  # another move lies between
        is_new_block = is_new_line | is_new_pass | is_gap
        starts = np.flatnonzero(is_new_block) + 1
        return np.split(fed, starts)

    def row(self, block: NDArray[np.int64]) -> Row:
        """Return the row of a block, given by the indices of its slices."""
        s = self._situation
        played = self._played
        slices = s.removal.slices
        metal = block[s.engaged[block]]
        loaded = block[s.loaded[block]]
        cut = loaded if loaded.size else block
        line = int(s.line[block[0]])
        diameter = s.diameter[cut]
        turns = not s.threads_and_drills[block].all()
        saves = self._saved_time(metal)
        return Row(
            line=line,
            cycle_pass=int(self._cycle_pass[block[0]]),
            tool=str(s.tool[block[0]]),
            text=self._texts[line - 1].strip()[:MAX_TEXT],
            depth=float(slices.depth[metal].max(initial=0.0)),
            diameters=(float(diameter.min()), float(diameter.max())),
            feed=float(played.feed[cut].max()),
            cutting_speed=float(played.cutting_speed[cut].max()),
            time=float(self._time[block].sum()),
            air_time=float(self._time[block] @ self._in_air[block]),
            removed=float(slices.volume[block].sum() / 1000.0),
            force_share=_highest(played.force_share[block], self._has_force_limit[block]),
            power_share=_highest(played.power_share[block], self._has_power_limit[block]),
            used_life=float(played.used_life[block].sum()) if turns else None,
            saves=saves,
            remark=self._why_unknown(block) or self._remark(block, saves),
        )

    def _why_unknown(self, block: NDArray[np.int64]) -> str:
        """Return that the load of a block is unknown, and why; empty if it is known."""
        for reason, mask in self._situation.unknown.items():
            if mask[block].any():
                return f"{UNKNOWN_LOAD}: {reason}"
        return ""

    def _saved_time(self, metal: NDArray[np.int64]) -> float:
        """Return the time that the highest feed would save at the same speed [s]."""
        s = self._situation
        if not s.is_described[metal].any() or self._finishing.is_finishing(metal):
            return 0.0
        feed = self._played.feed[metal].max()
        highest = max(self._highest_feed[metal].min(), self._min_feed[metal].max())
        share = float(feed / highest)
        time = float(self._time[metal].sum())
        return max(time * (1.0 - share), 0.0)

    def _remark(self, block: NDArray[np.int64], saves: float) -> str:
        remark = ""
        if self._load[block].max() > 1.0:
            remark = OVERLOAD
        elif saves >= MIN_WASTE:
            remark = f"could save {saves:.0f} s"
        if self._is_outside[block].any():
            remark += EXTRAPOLATED
        return remark


def _highest(shares: Values, is_known: NDArray[np.bool_]) -> float | None:
    """Return the highest share of a limit; None if none is known."""
    known = shares[is_known]
    return float(known.max()) if known.size else None


def _percent(share: float | None, form: str = ".0f") -> str:
    return "-" if share is None else format(100 * share, form)


_METRIC = {
    "line": "",
    "pass": "",
    "tool": "",
    "depth": "mm",
    "diameter": "mm",
    "speed": "m/min",
    "feed": "mm/rev",
    "time": "s",
    "removed": "cm3",
    "force": "%",
    "power": "%",
    "life": "%",
}
"""Columns of the table."""


def _cells(row: Row, units: Units) -> dict[str, str]:
    """Return the cells of a row by their columns."""
    diameters = [units.cell(diameter, "mm", ".4g") for diameter in row.diameters]
    return {
        "line": str(row.line),
        "pass": str(row.cycle_pass or ""),
        "tool": row.tool,
        "depth": units.cell(row.depth, "mm", ".2f"),
        "diameter": "-".join(dict.fromkeys(diameters)),
        "speed": units.cell(row.cutting_speed, "m/min", ".0f"),
        "feed": units.cell(row.feed, "mm/rev", ".3f"),
        "time": f"{row.time:.1f}",
        "removed": units.cell(row.removed, "cm3", ".1f"),
        "force": _percent(row.force_share),
        "power": _percent(row.power_share),
        "life": _percent(row.used_life, ".2f"),
    }


def blocks_table(situation: Situation, blocks: Sequence[Row], units: Units = METRIC) -> str:
    """Return an aligned table of rows, without loads that have no limit."""
    heads = dict(_METRIC)
    if not situation.has_force_limit:
        del heads["force"]
    if not situation.has_power_limit:
        del heads["power"]
    cells = [_cells(row, units) for row in blocks]
    columns = []
    for head, unit in heads.items():
        column = [head, units.name(unit)]
        for row_cells in cells:
            column.append(row_cells[head])
        width = max(len(cell) for cell in column)
        columns.append([cell.rjust(width) for cell in column])
    texts = [f" {row.text}  {row.remark}" for row in blocks]
    columns.append(["block", "", *texts])
    lines = []
    for line in zip(*columns, strict=True):
        lines.append("  ".join(line).rstrip())
    return "\n".join(lines)


def findings(blocks: Sequence[Row], count: int = 5) -> list[str]:
    """Return the lines that overload, and those that waste most time."""
    sentences = []
    overloads = [row for row in blocks if row.remark.startswith(OVERLOAD)]
    if overloads:
        shares = [max(row.force_share or 0.0, row.power_share or 0.0) for row in overloads]
        worst = 100 * max(shares)
        lines = at_lines(row.line for row in overloads)
        sentences.append(f"overload: {lines}; the highest load is {worst:.0f} % of its limit")
    by_feed = [_LineTime(row.line, row.saves) for row in blocks]
    wasted_by_feed = _longest(by_feed, count)
    if wasted_by_feed:
        sentences.append(f"wasted by too little feed: {wasted_by_feed}")
    in_air = [_LineTime(row.line, row.air_time) for row in blocks]
    wasted_in_air = _longest(in_air, count)
    if wasted_in_air:
        sentences.append(f"wasted by air at feed: {wasted_in_air}")
    return sentences


class _LineTime(NamedTuple):
    line: int
    time: float  # [s]


def _longest(times: Iterable[_LineTime], count: int) -> str:
    """Return the lines that take longest in sum, as text; empty if none takes ``MIN_WASTE``."""
    sums: dict[int, float] = {}
    for line, time in times:
        sums[line] = sums.get(line, 0.0) + time
    long_lines = []
    for line, time in sums.items():
        if time >= MIN_WASTE:
            long_lines.append((time, line))
    long_lines.sort(reverse=True)
    texts = [f"line {line} {time:.1f} s" for time, line in long_lines[:count]]
    return ", ".join(texts)
