"""Plausibility of a played program: what no machinist would run, by name and with its lines."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from turning_nc.cutting import Play, Situation
from turning_nc.words import NcError, at_lines

MAX_LOAD = 3.0  # highest plausible load over its limit [-]
MAX_PARTS = 10_000.0  # highest plausible number of parts per edge [-]
MIN_DEPTH = 1.0  # depth of cut below which neither its share of the diameter nor its direction counts [mm]
BACKWARDS = 0.2  # share of a move along Z, away from the tool's hand, from which the back cuts [-]
MAX_INCH_FEED, MAX_INCH_DIAMETER = 0.06, 15.0
"""Highest feed per revolution and diameter that speak for inches in a program without a unit."""


def warnings(situation: Situation, played: Play) -> dict[str, str]:
    """Return texts by the names of what is implausible; empty if nothing is."""
    s, slices = situation, situation.removal.slices
    on, deep = s.engaged, s.engaged & (slices.depth > MIN_DEPTH)
    found: dict[str, str] = {}

    def add(name: str, where: NDArray[np.bool_] | Iterable[int], text: str) -> None:
        lines = set(s.line[where].tolist()) if isinstance(where, np.ndarray) else set(where)
        if lines:
            found[name] = f"{at_lines(lines)}: {text}"

    rapids = s.removal.rapids
    add("rapid in metal", rapids, f"rapid moves sweep up to {max(rapids.values(), default=0.0):.1f} mm2 of metal")
    add("load", on & (played.load > MAX_LOAD), f"the load is above {100 * MAX_LOAD:g} % of its limit")
    radial = abs(slices.end[:, 1] - slices.start[:, 1]) > abs(slices.end[:, 0] - slices.start[:, 0])
    above = slices.depth > np.where(radial, s.removal.stock.bounds[3], slices.radius)
    add("depth of cut", deep & above, "the depth of cut is above half the diameter")
    add("spindle stands", on & ~s.spindle_on, "the tool cuts while the spindle stands: M3 or M4 is missing")
    add("back of the tool", deep & _backwards(s), "the tool cuts with its back: is it left-hand, --tool NAME=left?")
    gouged = s.removal.gouged
    text = f"the insert's back takes {sum(gouged.values()):.1f} mm2 of the part: is it a copying one, --tool NAME=copying?"
    add("gouged contour", gouged, text)
    lives = {tool: float(played.used_life[mine].sum()) for tool, mine in s.by_tool.items()}
    for tool, life in lives.items():
        if 0.0 < life < 1.0 / MAX_PARTS:
            add("edge life", on & s.by_tool[tool], f"an edge of {tool} would last {1.0 / life:,.0f} parts")
    if not s.moves.states_unit and (fed := s.fed & on).any():
        feed, diameter = float(played.feed[fed].max()), 2.0 * float(slices.radius[fed].max())
        if feed <= MAX_INCH_FEED and diameter <= MAX_INCH_DIAMETER:
            text = f"feeds up to {feed:.3g} per revolution and diameters up to {diameter:.3g} speak for inches: set --unit inch"
            add("unit", on, text)
    return found


def _backwards(s: Situation) -> NDArray[np.bool_]:
    """Return where a tool that is not neutral moves away from its hand in metal."""
    slices = s.removal.slices
    along = (slices.end[:, 0] - slices.start[:, 0]) / np.maximum(slices.length, 1e-9)
    hand = np.zeros(len(along))
    for tool, mine in s.by_tool.items():
        kind = s.removal.tools[tool]
        if not kind.startswith(("groove", "drill", "neutral")):
            hand[mine] = -1.0 if "left" in kind else 1.0
    return np.asarray(along * hand > BACKWARDS)


def extrapolated(situation: Situation, played: Play) -> list[str]:
    """Return notes on cuts outside of the settings at which the scenario's laws were measured.

    Raises:
        NcError: the scenario's table ``calibration`` is damaged.
    """
    scenario, on = situation.scenario, situation.engaged
    values = {"cutting_speed": played.cutting_speed, "feed": played.feed, "depth_of_cut": situation.removal.slices.depth}
    notes: dict[str, set[int]] = {}
    try:
        for name, law in (scenario.calibration or {}).get("laws", {}).items():
            if getattr(scenario.material, name).coefficient != law["coefficient"]:
                continue
            for factor, (low, high) in law["measured"].items():
                if factor in values:
                    outside = on & ((values[factor] < 0.99 * low) | (values[factor] > 1.01 * high))
                    text = f"{factor.replace('_', ' ')} outside the measured {low:g} to {high:g}: results are extrapolated"
                    notes.setdefault(text, set()).update(situation.line[outside].tolist())
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise NcError(f"{scenario.file}: the table calibration is damaged: calibrate again, or delete it") from error
    return [f"{at_lines(lines)}: {text}" for text, lines in notes.items() if lines]
