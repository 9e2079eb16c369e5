"""Report on a part program block by block: depths, loads, tool life; lines that overload, waste time, or are implausible."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from turning_nc.adapt import Change
from turning_nc.cutting import FINISHING_DEPTH, Play, Situation, highest_feed
from turning_nc.dialects import with_line_feeds
from turning_nc.edges import outside, parts_per_edge
from turning_nc.words import at_lines

MIN_WASTE = 1.0  # time that a block must be able to save to be named [s]
MAX_TEXT = 36
Row = dict[str, Any]
"""A block, or a pass of a cycle, each time that it is run: names and values of the table's columns and of JSON."""


@dataclass(frozen=True)
class Summary:
    """Totals of a program."""

    time: float  # cycle time [s]
    time_in_metal: float
    time_at_feed_in_air: float
    time_of_threads_and_drills: float
    other_time: float  # rapid moves, dwells and tool changes [s]
    removed: float  # [cm3]
    max_load: float  # highest share of a limit in the last part of an edge [-]
    overload_time: float  # [s]
    limited: bool  # whether there is a limit of force or power
    used_life: dict[str, float]  # share of the tool life per part, by tool [-]
    parts: dict[
        str, float
    ]  # parts after which an edge is changed, by tool: 97.5 % of edges last as long
    change_wear: dict[str, float]  # flank wear at which it is changed at the latest, by tool [mm]
    extrapolated: tuple[str, ...]  # tools that cut outside of what was measured

    def lines(self) -> list[str]:
        """Return the totals as text."""
        apart = f"{self.time_of_threads_and_drills:.1f} s of threads and drills, " * (
            self.time_of_threads_and_drills > 0.0
        )
        air = f"{self.time_at_feed_in_air:.1f} s at feed in air"
        times = f"{self.time_in_metal:.1f} s in metal, {apart}{air}, {self.other_time:.1f} s other"
        load = f"highest load: {100 * self.max_load:.0f} % of a limit; {self.overload_time:.1f} s above a limit"
        load = load if self.limited else "limits of force and power are off"
        edges = [
            f"{tool}: {100 * self.used_life[tool]:.2f} % of the tool life a part, {self.change(tool)}"
            for tool in self.parts
        ]
        return [
            f"cycle time: {self.time:.1f} s ({times})",
            f"removed: {self.removed:.2f} cm3",
            load,
            *edges,
        ]

    def change(self, tool: str) -> str:
        """Return the edge change of a tool as text, with a star if it cuts outside of what was measured."""
        parts = self.parts[tool]
        count = (
            f"{parts:.2f} of a part" if parts < 1.0 else f"{parts:,.0f} part{'s' * (parts > 1.0)}"
        )
        return f"change after {count} or at {self.change_wear[tool]:.3g} mm" + " *" * (
            tool in self.extrapolated
        )


def summary(situation: Situation, played: Play) -> Summary:
    """Return the totals of a play."""
    on, removal = situation.engaged, situation.removal
    time = played.time - situation.other_time
    used = {tool: float(played.used_life[mine].sum()) for tool, mine in situation.by_tool.items()}
    parts, beyond = parts_per_edge(situation, played), _unmeasured(situation, played)
    return Summary(
        time=float(played.time.sum()),
        time_in_metal=float(time[on].sum()),
        time_at_feed_in_air=float(time[~on & ~situation.threads_and_drills].sum()),
        time_of_threads_and_drills=float(time[situation.threads_and_drills].sum()),
        other_time=float(situation.other_time.sum()),
        removed=float(removal.slices.volume.sum() / 1000.0),
        max_load=float(played.load.max()),
        overload_time=float(time[played.load > 1.0].sum()),
        limited=situation.has_force_limit or situation.has_power_limit,
        used_life=used,
        parts=parts,
        change_wear={tool: float(played.change_wear[situation.by_tool[tool]][0]) for tool in parts},
        extrapolated=tuple(tool for tool, mine in situation.by_tool.items() if beyond[mine].any()),
    )


def _unmeasured(situation: Situation, played: Play) -> NDArray[np.bool_]:
    return np.asarray(sum(outside(situation, played).values(), np.zeros(len(played.time))) > 0)


def comparison(before: Summary, after: Summary) -> list[str]:
    """Return the totals of two programs side by side, as text."""
    saved = 100.0 * (1.0 - after.time / before.time)
    change = f"{saved:.1f} % saved" if saved >= 0.0 else f"{-saved:.1f} % longer"
    lives = [100.0 * sum(totals.used_life.values()) for totals in (before, after)]
    load = f"highest load: {100 * before.max_load:.0f} % before, {100 * after.max_load:.0f} % after"
    return [
        f"cycle time: {before.time:.1f} s before, {after.time:.1f} s after: {change}",
        *([load] if before.limited else []),
        f"tool life per part: {lives[0]:.2f} % before, {lives[1]:.2f} % after",
        *(
            f"{tool}: {before.change(tool)} before, {after.change(tool)} after"
            for tool in before.parts
        ),
    ]


def changes(changed: Sequence[Change], nose_radius: float | None) -> list[str]:
    """Return changed words as text; with a nose radius [mm], also the theoretical roughness Rt = feed^2 / (8 nose radius)."""
    lines = []
    for change in changed:
        roughness = ""
        if change.feeds and nose_radius:
            depths = [f"{1000.0 * feed**2 / (8.0 * nose_radius):.1f}" for feed in change.feeds]
            roughness = f" (theoretical roughness Rt {' -> '.join(depths)} um)"
        lines.append(
            f"  line {change.line}: {change.before or 'new word'} -> {change.after}{roughness}"
        )
    highest = max(
        (
            change.feeds[1]
            for change in changed
            if change.feeds and change.feeds[1] > change.feeds[0]
        ),
        default=0.0,
    )
    if highest and not nose_radius:
        needed = f"a nose radius of {2.0 * highest:.2g} mm or more"
        lines.append(
            f"  feeds up to {highest:.3g} mm/rev need {needed}: set that of your inserts, --nose-radius"
        )
    return lines


def rows(situation: Situation, played: Play) -> list[Row]:
    """Return a row for every block at feed, in the order in which they are run.

    Depth is the largest [mm], cutting speed the highest in metal [m/min], and ``saves`` the time that the highest feed within the
    limits would save at the same speed [s]; it is 0 for finishing. Shares are those of the limits and of an edge's life [-].
    """
    s, slices = situation, situation.removal.slices
    passes = np.array([move.cycle_pass for move in s.moves.moves])[slices.move]
    fed = np.flatnonzero(s.fed)
    keys = np.stack((s.line[fed], passes[fed]))
    breaks = np.flatnonzero((np.diff(keys, axis=1) != 0).any(axis=0) | (np.diff(fed) > 1)) + 1
    low, high = s.min_feed, s.max_feed
    fastest = np.full(len(played.time), high)
    on = s.engaged
    cuts = played.cutting_speed[on], played.spindle_speed[on], slices.depth[on], played.wear[on]
    fastest[on] = highest_feed(s.scenario, *cuts, high)
    texts = with_line_feeds(s.moves.program.text).split("\n")
    made: list[Row] = []
    time, beyond = played.time - s.other_time, _unmeasured(s, played)

    # Arrays over all slices are made once, not for each row.
    loads = played.load
    in_air = ~(on | s.threads_and_drills)
    for group in np.split(fed, breaks):
        metal = group[on[group]]
        cut = metal if metal.size else group
        saves = 0.0
        if metal.size and not s.is_finishing(metal, FINISHING_DEPTH):
            share = float(played.feed[metal].max() / max(fastest[metal].min(), low))
            saves = max(float(time[metal].sum()) * (1.0 - share), 0.0)
        mark = " *" * bool(beyond[group].any())
        line, radius, load = int(s.line[group[0]]), slices.radius[cut], loads[group].max()
        row: Row = {
            "line": line,
            "cycle_pass": int(passes[group[0]]),
            "tool": str(s.tool[group[0]]),
        }
        row |= {
            "text": texts[line - 1].strip()[:MAX_TEXT],
            "depth": float(slices.depth[metal].max(initial=0.0)),
        }
        row |= {
            "diameters": (2.0 * float(radius.min()), 2.0 * float(radius.max())),
            "feed": float(played.feed[cut].max()),
        }
        row |= {
            "cutting_speed": float(played.cutting_speed[cut].max()),
            "time": float(time[group].sum()),
        }
        row |= {
            "air_time": float(time[group] @ in_air[group]),
            "removed": float(slices.volume[group].sum() / 1000.0),
        }
        row |= {
            "force_share": float(played.force_share[group].max()),
            "power_share": float(played.power_share[group].max()),
        }
        row |= {"used_life": float(played.used_life[group].sum()), "saves": saves}
        remark = (
            "OVERLOAD" if load > 1.0 else f"could save {saves:.0f} s" if saves >= MIN_WASTE else ""
        )
        made.append(row | {"remark": remark + mark})
    return made


_COLUMNS: dict[str, tuple[str, Callable[[Row], str]]] = {
    "line": ("", lambda row: str(row["line"])),
    "pass": ("", lambda row: str(row["cycle_pass"] or "")),
    "tool": ("", lambda row: row["tool"]),
    "depth": ("mm", lambda row: f"{row['depth']:.2f}"),
    "diameter": (
        "mm",
        lambda row: "-".join(dict.fromkeys(f"{value:.4g}" for value in row["diameters"])),
    ),
    "speed": ("m/min", lambda row: f"{row['cutting_speed']:.0f}"),
    "feed": ("mm/rev", lambda row: f"{row['feed']:.3f}"),
    "time": ("s", lambda row: f"{row['time']:.1f}"),
    "removed": ("cm3", lambda row: f"{row['removed']:.1f}"),
    "force": ("%", lambda row: f"{100 * row['force_share']:.0f}"),
    "power": ("%", lambda row: f"{100 * row['power_share']:.0f}"),
    "life": ("%", lambda row: f"{100 * row['used_life']:.2f}"),
}


def table(situation: Situation, blocks: Sequence[Row]) -> str:
    """Return an aligned table of rows, without loads that have no limit."""
    off = [
        head
        for head, is_off in (("force", not situation.has_force_limit), ("power", not situation.has_power_limit))
        if is_off
    ]
    columns = [
        [head, unit, *map(text, blocks)]
        for head, (unit, text) in _COLUMNS.items()
        if head not in off
    ]
    padded = []
    for column in columns:
        width = max(map(len, column))
        padded.append([cell.rjust(width) for cell in column])
    last = ["block", "", *(f" {row['text']}  {row['remark']}" for row in blocks)]
    lines = zip(*padded, last, strict=True)
    return "\n".join("  ".join(cells).rstrip() for cells in lines)


def findings(blocks: Sequence[Row], count: int = 5) -> list[str]:
    """Return the lines that overload, and those that waste most time."""
    found = []
    over = [row for row in blocks if row["remark"].startswith("OVERLOAD")]
    if over:
        worst = 100 * max(max(row["force_share"], row["power_share"]) for row in over)
        found.append(
            f"overload: {at_lines(row['line'] for row in over)}; the highest load is {worst:.0f} % of its limit"
        )
    for what, time_of in (
        ("too little feed", itemgetter("saves")),
        ("air at feed", itemgetter("air_time")),
    ):
        wasted: dict[int, float] = {}
        for row in blocks:
            wasted[row["line"]] = wasted.get(row["line"], 0.0) + time_of(row)
        longest = sorted(
            ((time, line) for line, time in wasted.items() if time >= MIN_WASTE), reverse=True
        )[:count]
        if longest:
            found.append(
                f"wasted by {what}: "
                + ", ".join(f"line {line} {time:.1f} s" for time, line in longest)
            )
    return found
