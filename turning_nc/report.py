"""Tell what a part program does, block by block: depths, loads, tool life, and what overloads or wastes time."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from turning_nc.adapt import Section
from turning_nc.cutting import FINISHING_DEPTH, Play, Situation, loads
from turning_nc.stock import Values, volume

MIN_WASTE = 1.0
"""Time that a block must be able to save to be named [s]."""
MAX_TEXT = 36


@dataclass(frozen=True)
class BlockRow:
    """A block, or a pass of a cycle, each time that it is run."""

    line: int
    cycle_pass: int
    """Number of the pass within a cycle; 0 outside."""
    tool: str
    text: str
    depth: float
    """Largest depth of cut [mm]."""
    diameters: tuple[float, float]
    """Smallest and largest diameter of the tip [mm]."""
    cutting_speed: float
    """Highest in metal [m/min]."""
    feed: float  # [mm/rev]
    time: float  # [s]
    air_time: float
    """Time at feed in air [s]."""
    removed: float  # [cm3]
    force_share: float
    """Largest thrust force over the limit [-]."""
    power_share: float
    used_life: float
    """Share of an edge's life [-]."""
    saves: float
    """Time that the highest feed within the limits would save at the same speed [s]; 0 for finishing."""

    @property
    def remark(self) -> str:
        """What is wrong with the block."""
        if max(self.force_share, self.power_share) > 1.0:
            return "OVERLOAD"
        return f"could save {self.saves:.0f} s" if self.saves >= MIN_WASTE else ""


@dataclass(frozen=True)
class Summary:
    """Totals of a program."""

    time: float
    """Cycle time [s]."""
    time_in_metal: float
    time_at_feed_in_air: float
    other_time: float
    """Rapid moves, dwells and tool changes [s]."""
    removed: float  # [cm3]
    removed_by_polygons: float
    """Volume of the stock minus that of the part [cm3]."""
    max_load: float
    """Highest share of a limit [-]."""
    overload_time: float  # [s]
    used_life: dict[str, float]
    """Share of an edge's life per part, by tool [-]."""

    def lines(self) -> list[str]:
        """Return the totals as text."""
        times = (
            f"{self.time_in_metal:.1f} s in metal, {self.time_at_feed_in_air:.1f} s at feed in air, {self.other_time:.1f} s other"
        )
        load = f"highest load: {100 * self.max_load:.0f} % of a limit; {self.overload_time:.1f} s above a limit"
        edges = [
            f"{tool}: {100 * life:.2f} % of an edge's life, {1.0 / life:.0f} parts per edge"
            for tool, life in self.used_life.items()
            if life > 0.0
        ]
        return [f"cycle time: {self.time:.1f} s ({times})", f"removed: {self.removed:.2f} cm3", load, *edges]


def summary(situation: Situation, played: Play) -> Summary:
    """Return the totals of a play."""
    on, removal = situation.engaged, situation.removal
    time = played.time - situation.other_time
    return Summary(
        time=float(played.time.sum()),
        time_in_metal=float(time[on].sum()),
        time_at_feed_in_air=float(time[~on].sum()),
        other_time=float(situation.other_time.sum()),
        removed=float(removal.slices.volume.sum() / 1000.0),
        removed_by_polygons=(volume(removal.stock) - volume(removal.part)) / 1000.0,
        max_load=float(played.load.max()),
        overload_time=float(time[played.load > 1.0].sum()),
        used_life={
            tool: float(played.used_life[situation.tool == tool].sum()) for tool in dict.fromkeys(situation.tool.tolist())
        },
    )


def rows(situation: Situation, played: Play) -> list[BlockRow]:
    """Return a row for every block at feed, in the order in which they are run."""
    moves, slices = situation.moves, situation.removal.slices
    passes = np.array([move.cycle_pass for move in moves.moves])[slices.move]
    fed = np.flatnonzero(situation.fed)
    keys = np.stack((situation.line[fed], passes[fed]))
    breaks = np.flatnonzero((np.diff(keys, axis=1) != 0).any(axis=0) | (np.diff(fed) > 1)) + 1
    fastest = highest_feed(situation, played)
    made: list[BlockRow] = []
    texts = moves.program.text.split("\n")
    time = played.time - situation.other_time
    for group in np.split(fed, breaks):
        on = group[situation.engaged[group]]
        cut = on if on.size else group
        limit = float(fastest[on].min()) if on.size else 0.0
        mine = np.zeros(len(time), np.bool_)
        mine[on] = True
        rough = on.size and not situation.finishing(mine, FINISHING_DEPTH)
        share = float(played.feed[on].max()) / limit if rough else 1.0
        made.append(
            BlockRow(
                line=int(situation.line[group[0]]),
                cycle_pass=int(passes[group[0]]),
                tool=str(situation.tool[group[0]]),
                text=texts[int(situation.line[group[0]]) - 1].strip()[:MAX_TEXT],
                depth=float(slices.depth[cut].max()) if on.size else 0.0,
                diameters=(2.0 * float(slices.radius[cut].min()), 2.0 * float(slices.radius[cut].max())),
                cutting_speed=float(played.cutting_speed[cut].max()),
                feed=float(played.feed[cut].max()),
                time=float(time[group].sum()),
                air_time=float(time[group].sum() - time[on].sum()),
                removed=float(slices.volume[group].sum() / 1000.0),
                force_share=float(played.force_share[group].max()),
                power_share=float(played.power_share[group].max()),
                used_life=float(played.used_life[group].sum()),
                saves=max(float(time[on].sum()) * (1.0 - share), 0.0),
            )
        )
    return made


def highest_feed(situation: Situation, played: Play) -> Values:
    """Return the highest feed within the machine's range and the limits of force and power, at the played speed [mm/rev]."""
    scenario = situation.scenario
    material, limits, (low, high) = scenario.material, scenario.limits, situation.feed_range
    highest = np.full(len(played.time), high)
    on = situation.engaged
    speed, depth, wear = played.cutting_speed[on], situation.removal.slices.depth[on], played.wear[on]
    reference = np.full(speed.shape, high)
    force, power = loads(scenario, speed, reference, depth, wear)
    for load, limit, law in ((force, limits.thrust_force, material.thrust_force), (power, limits.power, material.power)):
        if law.feed > 0.0:
            allowed = high * (limit / load) ** (1.0 / law.feed)
            highest[on] = np.minimum(highest[on], allowed)
    return np.asarray(np.maximum(highest, low))


def table(blocks: Sequence[BlockRow]) -> str:
    """Return an aligned table of rows."""
    heads = ("line", "pass", "tool", "depth", "diameter", "speed", "feed", "time", "removed", "force", "power", "life", "block")
    units = ("", "", "", "mm", "mm", "m/min", "mm/rev", "s", "cm3", "%", "%", "%", "")
    cells = [heads, units]
    for row in blocks:
        low, high = (f"{value:.4g}" for value in row.diameters)
        cells.append(
            (
                *(
                    str(row.line),
                    str(row.cycle_pass or ""),
                    row.tool,
                    f"{row.depth:.2f}",
                    low if low == high else f"{low}-{high}",
                ),
                *(f"{row.cutting_speed:.0f}", f"{row.feed:.3f}", f"{row.time:.1f}", f"{row.removed:.1f}"),
                *(f"{100 * row.force_share:.0f}", f"{100 * row.power_share:.0f}", f"{100 * row.used_life:.2f}"),
                f" {row.text}  {row.remark}".rstrip(),
            )
        )
    widths = [max(len(row[k]) for row in cells) for k in range(len(heads) - 1)]
    return "\n".join(
        "  ".join([*(cell.rjust(width) for cell, width in zip(row, widths, strict=False)), row[-1]]).rstrip() for row in cells
    )


def findings(blocks: Sequence[BlockRow], count: int = 5) -> list[str]:
    """Return the lines that overload, and those that waste most time."""
    found = []
    over = [row for row in blocks if row.remark == "OVERLOAD"]
    if over:
        lines = ", ".join(dict.fromkeys(str(row.line) for row in over))
        worst = max(max(row.force_share, row.power_share) for row in over)
        found.append(
            f"overload: {'lines' if ',' in lines else 'line'} {lines}; the highest load is {100 * worst:.0f} % of its limit"
        )
    wasted: dict[int, float] = {}
    air: dict[int, float] = {}
    for row in blocks:
        wasted[row.line] = wasted.get(row.line, 0.0) + row.saves
        air[row.line] = air.get(row.line, 0.0) + row.air_time
    for what, by_line in (("too little feed", wasted), ("air at feed", air)):
        longest = sorted(((time, line) for line, time in by_line.items() if time >= MIN_WASTE), reverse=True)[:count]
        if longest:
            found.append(f"wasted by {what}: " + ", ".join(f"line {line} {time:.1f} s" for time, line in longest))
    return found


def as_records(blocks: Sequence[BlockRow]) -> list[dict[str, Any]]:
    """Return rows for JSON."""
    return [asdict(row) | {"remark": row.remark} for row in blocks]


def schedule_table(sections: Sequence[Section]) -> str:
    """Return a schedule by position as CSV."""
    points = "from Z [mm],to Z [mm],from diameter [mm],to diameter [mm]"
    rows = [
        f"{each.line},{each.cycle_pass or ''},{each.tool},"
        + ",".join(f"{value:.3f}" for value in (*each.z, *each.diameter, each.depth, each.feed))
        + f",{100 * each.override:.0f},{each.cutting_speed:.0f}"
        for each in sections
    ]
    return "\n".join([f"line,pass,tool,{points},depth [mm],feed [mm/rev],override [%],speed [m/min]", *rows]) + "\n"
