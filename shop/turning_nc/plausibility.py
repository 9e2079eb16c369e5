"""Find what is implausible in a part program: moves and values that no machinist would run.

Each finding names its lines and asks for the likely mistake. Whether a program is refused for them
is decided in ``command``.
"""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from turning_nc.cutting import Play, Situation
from turning_nc.dialects import INCH
from turning_nc.edges import parts_per_edge
from turning_nc.kinds import DRILL, FACE_GROOVE
from turning_nc.removal import RADIUS, Z
from turning_nc.tool_shapes import tool_shape
from turning_nc.words import at_lines
from turning_shop import Values

Mask = NDArray[np.bool_]

# All bounds are assumptions: they lie well beyond what sample programs do.
MAX_LOAD = 3.0  # over its limit [-]
MIN_FEED = 0.002  # in metal [mm/rev]
MAX_FEED = 5.0  # in metal [mm/rev]
SPEED_ROUNDING = 1e-6  # of spindle speeds at their limit [-]
MIN_UNREACHED = 1000.0  # constant cutting speed from which it may be in rev/min [m/min]
MAX_PARTS = 10_000.0  # per edge
MIN_CHECKED_DEPTH = 3.0  # from which the depth of cut is compared with the diameter [mm]
MIN_BACK_DEPTH = 1.0  # from which it counts that a tool's back cuts [mm]
MIN_BACK_SHARE = 0.5  # share of a move along Z, away from the tool's hand, for its back to cut [-]
MIN_BACK_LENGTH = 2.0  # of a tool's cuts with its back, for them to count [mm]
# Distance of a tool's body from its path, over its distance from the tip, from which its side
# counts [-].
MIN_ASIDE = 0.2
MAX_INCH_FEED = 0.06  # per revolution, up to which a feed speaks for inches
MAX_INCH_DIAMETER = 15.0  # up to which a diameter speaks for inches
MIN_FEET = 250.0  # from which a cutting speed of small cuts speaks for feet per minute
MIN_METRIC_FEED = 0.1  # [inch/rev] above which a feed speaks for millimetres
MIN_METRIC_DIAMETER = 15.0  # [inch] above which a diameter does

LEFT = 41  # G41: the tool is to the left of its path
RIGHT = 42  # G42


def implausible(situation: Situation, played: Play) -> dict[str, str]:
    """Return texts by the names of what is implausible; empty if nothing is."""
    findings = _Findings(situation)
    _check_cuts(situation, played, findings=findings)
    _check_tools(situation, findings)
    _check_edge_life(situation, played, findings=findings)
    _check_whether_it_cuts(situation, findings)
    _check_steps(situation, findings)
    _check_compensation(situation, findings)
    _check_unit(situation, played, findings=findings)
    return findings.texts


class _Findings:
    """Implausible values of a program, by names."""

    def __init__(self, situation: Situation) -> None:
        self.texts: dict[str, str] = {}
        self._line = situation.line

    def add_lines(self, name: str, lines: Iterable[int], text: str) -> None:
        """Add a finding if there are lines to which it applies."""
        distinct = set(lines)
        if distinct:
            self.texts[name] = f"{at_lines(distinct)}: {text}"

    def add_slices(self, name: str, mask: Mask, text: str) -> None:
        """Add a finding if there are slices to which it applies."""
        self.add_lines(name, self._line[mask].tolist(), text=text)


def _check_cuts(situation: Situation, played: Play, findings: _Findings) -> None:
    """Check depths, loads and feeds in metal, and the metal that rapid moves sweep."""
    s = situation
    slices = s.removal.slices
    on = s.engaged
    rapids = s.removal.rapids
    largest = max(rapids.values(), default=0.0)
    findings.add_lines(
        "rapid in metal", rapids, text=f"rapid moves sweep up to {largest:.1f} mm2 of metal"
    )
    findings.add_slices(
        "load",
        on & (played.load > MAX_LOAD),
        text=f"the load is above {100 * MAX_LOAD:g} % of its limit",
    )

    # A tool may cut down to the axis: by the bar's radius if it faces, by its own if it turns.
    across = abs(slices.end[:, RADIUS] - slices.start[:, RADIUS])
    along = abs(slices.end[:, Z] - slices.start[:, Z])
    outer_radius = s.removal.stock.bounds[3]
    max_depth = np.where(across > along, outer_radius, slices.radius)
    is_too_deep = (slices.depth > max_depth) & (slices.depth > MIN_CHECKED_DEPTH)
    findings.add_slices(
        "depth of cut",
        on & is_too_deep,
        text="the depth of cut is above half the diameter: is X a radius, DIAMOF, G8 or --radius?",
    )
    findings.add_slices(
        "feed",
        on & (played.feed < MIN_FEED),
        text=f"the feed is below {MIN_FEED:g} mm/rev: is it in mm/rev, G95 or G99?",
    )
    findings.add_slices(
        "high feed",
        on & (played.feed > MAX_FEED),
        text=f"the feed is above {MAX_FEED:g} mm/rev: is it in mm/min, G94 or G98?",
    )
    # No metal is cut at this speed: the spindle turns at its limit everywhere.
    is_limited = played.spindle_speed >= (1.0 - SPEED_ROUNDING) * s.max_spindle
    may_be_turns = on & s.constant_speed & (s.speed >= MIN_UNREACHED)
    findings.add_slices(
        "cutting speed",
        may_be_turns & bool(is_limited[may_be_turns].all()),
        text="the spindle never reaches the cutting speed: is it in rev/min, G97?",
    )
    findings.add_slices(
        "spindle stands",
        on & ~s.spindle_on,
        text="the tool cuts while the spindle stands: M3 or M4 is missing",
    )


def _check_tools(situation: Situation, findings: _Findings) -> None:
    """Check whether tools cut with their backs."""
    findings.add_slices(
        "back of the tool",
        _backwards(situation),
        text="the tool cuts with its back: is it left-hand, --tool NAME=left?",
    )
    gouged = situation.removal.gouged
    area = sum(gouged.values())
    findings.add_lines(
        "gouged contour",
        gouged,
        text=(
            f"the insert's back takes {area:.1f} mm2 of the part: "
            "is it a copying one, --tool NAME=copying?"
        ),
    )


def _check_edge_life(situation: Situation, played: Play, findings: _Findings) -> None:
    """Check whether edges last implausibly long."""
    for tool, parts in parts_per_edge(situation, played).items():
        if parts > MAX_PARTS:
            findings.add_slices(
                "edge life",
                situation.engaged & situation.by_tool[tool],
                text=f"an edge of {tool} would last {parts:,.0f} parts",
            )


def _check_whether_it_cuts(situation: Situation, findings: _Findings) -> None:
    """Check whether any move meets metal."""
    turning = situation.fed & ~situation.threads_and_drills
    if not situation.engaged.any():
        findings.add_slices(
            "nothing cut",
            turning,
            text=("no move at feed meets metal: are the stock, its zero point and the unit right?"),
        )


def _check_steps(situation: Situation, findings: _Findings) -> None:
    """Check whether large numbers without a decimal point are steps of the control."""
    fed_lines = set(situation.line[situation.fed].tolist())
    large_numbers = situation.moves.large_numbers
    lines = [line for line in large_numbers if line in fed_lines]
    largest = max((large_numbers[line] for line in lines), default=0.0)
    findings.add_lines(
        "steps",
        lines,
        text=(
            f"coordinates up to {largest:.0f} without a decimal point look like steps: set --steps"
        ),
    )


def _check_compensation(situation: Situation, findings: _Findings) -> None:
    """Check whether the nose radius is compensated to the side on which the tool is."""
    other_side = {LEFT: RIGHT, RIGHT: LEFT}
    for side, mask in _wrong_sides(situation).items():
        findings.add_slices(
            "compensation",
            mask,
            text=(
                f"G{side} has the tool on the other side of the contour: "
                f"is G{other_side[side]} right?"
            ),
        )


def _check_unit(situation: Situation, played: Play, findings: _Findings) -> None:
    """Check whether feeds, diameters and speeds are those of the other unit."""
    s = situation
    used = s.engaged if s.engaged.any() else s.fed & ~s.threads_and_drills
    if not used.any():
        return
    feed = float(played.feed[used].max())
    diameter = 2.0 * float(s.removal.slices.radius[used].max())
    seen = f"feeds up to {feed:.3g} mm per revolution and diameters up to {diameter:.3g} mm"
    text = ""
    if s.moves.in_inches:
        if feed > MIN_METRIC_FEED * INCH and diameter > MIN_METRIC_DIAMETER * INCH:
            text = f"{seen} are large for inches: is the program in mm?"
    elif feed <= MAX_INCH_FEED and diameter <= MAX_INCH_DIAMETER:
        speeds = s.speed[used & s.constant_speed]
        is_fast = bool((speeds >= MIN_FEET).any())
        if not s.moves.states_unit:
            text = f"{seen} speak for inches: set --unit inch"
        elif is_fast:
            text = f"{seen}, at {speeds.max():.0f} m/min, speak for inches and feet: is it G20?"
    if text:
        findings.add_slices("unit", used, text=text)


def _wrong_sides(situation: Situation) -> dict[int, Mask]:
    """Return where the nose radius is compensated to the wrong side, for G41 and G42.

    A tool counts if it is on the wrong side for most of its path in metal.
    """
    s = situation
    slices = s.removal.slices
    of_moves = np.array([move.compensation for move in s.moves.moves])
    compensation = of_moves[slices.move]
    left = _body_to_the_left(s)
    is_clear = s.engaged & (abs(left) > MIN_ASIDE)
    is_clear &= slices.start[:, RADIUS] > 0.0  # tools beyond the axis do not count
    contrary = np.where(left > 0.0, compensation == RIGHT, compensation == LEFT)
    wrong = is_clear & contrary
    right = is_clear & (compensation > 0) & ~wrong
    nowhere = np.zeros(len(left), np.bool_)
    marks: dict[int, Mask] = {}
    for is_tool in s.by_tool.values():
        wrong_of_tool = wrong & is_tool
        wrong_length = slices.length[wrong_of_tool].sum()
        right_length = slices.length[right & is_tool].sum()
        if wrong_length > right_length:
            for side in (LEFT, RIGHT):
                mark = wrong_of_tool & (compensation == side)
                marks[side] = marks.get(side, nowhere) | mark
    return marks


def _body_to_the_left(situation: Situation) -> Values:
    """Return how far to the left of its path the body of each slice's tool is: -1 to 1."""
    slices = situation.removal.slices
    step = slices.end - slices.start
    length = np.maximum(slices.length, 1e-9)
    left = np.zeros(len(slices.length))
    for tool, is_tool in situation.by_tool.items():
        shape = tool_shape(situation.removal.tools[tool])
        if shape is None:
            continue
        centre = shape.mean(axis=0)
        z, x = centre / np.linalg.norm(centre)
        across = x * step[is_tool, 0] - z * step[is_tool, 1]
        left[is_tool] = across / length[is_tool]
    return left


def _backwards(situation: Situation) -> Mask:
    """Return where a tool that is not neutral moves away from its hand in deep metal."""
    slices = situation.removal.slices
    count = len(slices.length)
    hand = np.zeros(count)
    for tool, is_tool in situation.by_tool.items():
        kind = situation.removal.tools[tool]
        has_hand = not kind.startswith(("groove", FACE_GROOVE, DRILL, "neutral"))
        if has_hand:
            hand[is_tool] = -1.0 if "left" in kind else 1.0
    length = np.maximum(slices.length, 1e-9)
    rise_z = slices.end[:, Z] - slices.start[:, Z]
    along = rise_z / length
    is_deep = situation.engaged & (slices.depth > MIN_BACK_DEPTH)
    is_back = is_deep & (along * hand > MIN_BACK_SHARE)
    marked = np.zeros(count, np.bool_)
    for is_tool in situation.by_tool.values():
        back_of_tool = is_back & is_tool
        back_length = slices.length[back_of_tool].sum()
        if back_length > MIN_BACK_LENGTH:
            marked |= back_of_tool
    return marked
