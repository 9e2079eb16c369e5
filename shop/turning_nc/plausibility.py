"""Find what is implausible in a part program: moves and values that no machinist would run."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from turning_nc.cutting import Play, Situation
from turning_nc.edges import parts_per_edge
from turning_nc.tool_shapes import tool_shape
from turning_nc.words import at_lines

MAX_LOAD = 3.0  # highest plausible load over its limit [-]
MIN_FEED, MAX_FEED = 0.002, 5.0  # range of plausible feeds in metal [mm/rev]
MAX_PARTS = 10_000.0  # highest plausible number of parts per edge [-]
MIN_DEEP, MIN_BACK = (
    3.0,
    1.0,
)  # depths of cut below which its share of the diameter, and its direction, do not count [mm]
BACKWARDS = 0.5  # share of a move along Z, away from the tool's hand, from which the back cuts [-]
MIN_BACKWARDS = 2.0  # length of a tool's cuts with its back below which they do not count [mm]
MIN_ASIDE = 0.2  # distance of a tool's body from its path, over its distance from the tip, from which its side counts [-]
MAX_INCH_FEED, MAX_INCH_DIAMETER = 0.06, 15.0
"""Highest feed per revolution and diameter that speak for inches in a program without a unit."""


def implausible(situation: Situation, played: Play) -> dict[str, str]:
    """Return texts by the names of what is implausible; empty if nothing is."""
    s, slices = situation, situation.removal.slices
    on, deep = s.engaged, s.engaged & (slices.depth > MIN_BACK)
    found: dict[str, str] = {}

    def add(name: str, where: NDArray[np.bool_] | Iterable[int], text: str) -> None:
        lines = set(s.line[where].tolist()) if isinstance(where, np.ndarray) else set(where)
        if lines:
            found[name] = f"{at_lines(lines)}: {text}"

    rapids = s.removal.rapids
    add(
        "rapid in metal",
        rapids,
        f"rapid moves sweep up to {max(rapids.values(), default=0.0):.1f} mm2 of metal",
    )
    add(
        "load",
        on & (played.load > MAX_LOAD),
        f"the load is above {100 * MAX_LOAD:g} % of its limit",
    )
    radial = abs(slices.end[:, 1] - slices.start[:, 1]) > abs(slices.end[:, 0] - slices.start[:, 0])
    above = slices.depth > np.where(radial, s.removal.stock.bounds[3], slices.radius)
    text = "the depth of cut is above half the diameter: is X a radius, DIAMOF, G8 or --radius?"
    add("depth of cut", on & above & (slices.depth > MIN_DEEP), text)
    add(
        "feed",
        s.fed & on & (played.feed < MIN_FEED),
        f"the feed is below {MIN_FEED:g} mm/rev: is it in mm/rev, G95 or G99?",
    )
    high = f"the feed is above {MAX_FEED:g} mm/rev: is it in mm/min, G94 or G98?"
    add("high feed", s.fed & on & (played.feed > MAX_FEED), high)
    add(
        "spindle stands",
        on & ~s.spindle_on,
        "the tool cuts while the spindle stands: M3 or M4 is missing",
    )
    add(
        "back of the tool",
        _backwards(s, deep),
        "the tool cuts with its back: is it left-hand, --tool NAME=left?",
    )
    gouged = s.removal.gouged
    text = f"the insert's back takes {sum(gouged.values()):.1f} mm2 of the part: is it a copying one, --tool NAME=copying?"
    add("gouged contour", gouged, text)
    for tool, parts in parts_per_edge(s, played).items():
        if parts > MAX_PARTS:
            add(
                "edge life",
                on & s.by_tool[tool],
                f"an edge of {tool} would last {parts:,.0f} parts",
            )
    if not on.any() and (s.fed & ~s.threads_and_drills).any():
        add(
            "nothing cut",
            s.fed & ~s.threads_and_drills,
            "no move at feed meets metal: are the stock, its zero point and the unit right?",
        )
    fed_lines = set(s.line[s.fed].tolist())
    large = {line: number for line, number in s.moves.large_numbers.items() if line in fed_lines}
    text = f"coordinates up to {max(large.values(), default=0.0):.0f} without a decimal point look like steps: set --steps"
    add("steps", large, text)
    for side, where in _wrong_sides(s).items():
        add(
            "compensation",
            where,
            f"G{side} has the tool on the other side of the contour: is G{83 - side} right?",
        )
    if not s.moves.states_unit and (fed := s.fed & on).any():
        feed, diameter = float(played.feed[fed].max()), 2.0 * float(slices.radius[fed].max())
        if feed <= MAX_INCH_FEED and diameter <= MAX_INCH_DIAMETER:
            text = f"feeds up to {feed:.3g} per revolution and diameters up to {diameter:.3g} speak for inches: set --unit inch"
            add("unit", on, text)
    return found


def _wrong_sides(s: Situation) -> dict[int, NDArray[np.bool_]]:
    """Return where the nose radius is compensated to the side on which the tool is not, for G41 and G42.

    A tool counts if it is on the wrong side for most of its path in metal. It is to the left of its path if its body is.
    """
    slices = s.removal.slices
    step = slices.end - slices.start
    left = np.zeros(len(slices.length))  # how far to the left the body is: -1 to 1
    for tool, mine in s.by_tool.items():
        shape = tool_shape(s.removal.tools[tool])
        if shape is not None:
            z, x = shape.mean(axis=0) / np.linalg.norm(shape.mean(axis=0))
            left[mine] = (x * step[mine, 0] - z * step[mine, 1]) / np.maximum(
                slices.length[mine], 1e-9
            )
    compensation = np.array([move.compensation for move in s.moves.moves])[slices.move]
    clear = (
        s.engaged & (abs(left) > MIN_ASIDE) & (slices.start[:, 1] > 0.0)
    )  # tools beyond the axis do not count
    wrong = clear & np.where(left > 0.0, compensation == 42, compensation == 41)
    right = clear & (compensation > 0) & ~wrong
    found: dict[int, NDArray[np.bool_]] = {}
    for mine in s.by_tool.values():
        if slices.length[wrong & mine].sum() > slices.length[right & mine].sum():
            for side in (41, 42):
                there = wrong & mine & (compensation == side)
                found[side] = found.get(side, np.zeros(len(left), np.bool_)) | there
    return found


def _backwards(s: Situation, deep: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return where a tool that is not neutral moves away from its hand in deep metal."""
    slices = s.removal.slices
    along = (slices.end[:, 0] - slices.start[:, 0]) / np.maximum(slices.length, 1e-9)
    hand = np.zeros(len(along))
    for tool, mine in s.by_tool.items():
        kind = s.removal.tools[tool]
        if not kind.startswith(("groove", "drill", "neutral")):
            hand[mine] = -1.0 if "left" in kind else 1.0
    back = deep & (along * hand > BACKWARDS)
    enough = [
        back & mine
        for mine in s.by_tool.values()
        if slices.length[back & mine].sum() > MIN_BACKWARDS
    ]
    return np.asarray(np.any([np.zeros_like(deep), *enough], axis=0))
