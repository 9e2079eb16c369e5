"""Edge changes of a program by the policy of ``advise``, and cuts beyond what was measured.

An edge is changed after as many whole parts as 97.5 % of edges last within the limits.
"""

import numpy as np
from numpy.typing import NDArray
from turning_nc.cutting import Play, Situation, ToolGroup, play, tool_life
from turning_nc.words import at_lines
from turning_shop import Values, prediction
from turning_shop.advise import life_margin, whole_parts
from turning_shop.allowed import feed_ends
from turning_shop.prediction import Evidence
from turning_shop.whatif import CHANGES

# Share of a line's time in metal up to which cuts outside the measured range do not count [-], as
# at the entry.
MAX_BRIEF = 0.1
SPEED_TOLERANCE = 0.001  # by which cutting speeds may exceed the machine's, by rounding [-]


def factors(situation: Situation, played: Play, group: ToolGroup) -> dict[str, Values]:
    """Return the factors of the laws where the tools of a group turn metal.

    Time and wear are those of an edge that has made the same cut up to its change.
    """
    on = situation.engaged & group.slices
    cutting_speed = played.cutting_speed[on]
    feed = played.feed[on]
    depth = situation.removal.slices.depth[on]
    life = tool_life(group.scenario, cutting_speed, feed=feed, depth=depth)
    return {
        "cutting_speed": cutting_speed,
        "feed": feed,
        "depth_of_cut": depth,
        "time": life / 60.0 * played.life_at_change[on],
        "hardness": np.ones(int(on.sum())),
        "wear": played.change_wear[on],
    }


def parts_per_edge(situation: Situation, played: Play) -> dict[str, float]:
    """Return the parts after which each tool's edge is changed.

    It is a share of one if edges do not last a part. Tools that cut no metal are left out. No edge
    cuts longer than its law of wear is used for.
    """
    # Share of the life that a slice uses of an edge that lasts shorter than 97.5 % of all edges.
    used_life = np.zeros(len(played.time))
    longest_life: dict[str, float] = {}  # of each tool [s]
    for group in situation.groups:
        evidence = group.laws.evidence or Evidence()
        margin = life_margin(group.scenario, evidence, factors(situation, played, group=group))
        on = situation.engaged & group.slices
        used_life[on] = played.used_life[on] * np.exp(margin)
        longest = 60.0 * prediction.longest_life(evidence)
        longest_life |= dict.fromkeys(group.tools, longest)
    parts = {}
    for tool, is_tool in situation.by_tool.items():
        used_by_part = used_life[is_tool].sum()
        life = played.life_at_change[is_tool][0]
        cutting_time = played.time[is_tool & situation.engaged].sum()
        if used_by_part > 0.0:
            lasting = min(life / used_by_part, longest_life[tool] / cutting_time)
            parts[tool] = float(whole_parts(lasting))
    return parts


def change_wear(situation: Situation) -> Values:
    """Return the flank wear at which the edge of each slice's tool is changed at the latest [mm].

    It is the highest, in tenths of the wear criterion, at which the tool keeps the limits, but none
    before a part is done.
    """
    criterion = np.zeros(len(situation.tool))
    for group in situation.groups:
        criterion[group.slices] = group.scenario.tool.wear_criterion
    plays = [play(situation, share * criterion) for share in CHANGES]
    parts = [parts_per_edge(situation, played) for played in plays]
    chosen = np.zeros(len(situation.tool))
    for tool, is_tool in situation.by_tool.items():
        lasting = []
        for played, parts_of_tool in zip(plays, parts, strict=True):
            if parts_of_tool.get(tool, 1.0) >= 1.0:
                lasting.append(played)
        if not lasting:
            lasting = plays[-1:]
        # An earlier change does not lower the loads of threads and drills.
        turned = is_tool & situation.engaged
        within_limits = [
            played for played in lasting if played.load[turned].max(initial=0.0) <= 1.0
        ]
        best = within_limits[-1] if within_limits else lasting[0]
        chosen[is_tool] = best.change_wear[is_tool]
    return chosen


def outside(situation: Situation, played: Play) -> dict[str, NDArray[np.bool_]]:
    """Return which slices lie outside the range in which the laws of their tools were measured.

    The keys name the factor and the range. Cuts of a line that take less than a tenth of its time
    in metal do not count.
    """
    on = situation.engaged
    line = situation.line
    time_of_line = np.bincount(line, played.time * on)
    time_of_line = np.maximum(time_of_line, 1e-9)
    nowhere = np.zeros(len(on), np.bool_)
    marks: dict[str, NDArray[np.bool_]] = {}
    for group in situation.groups:
        evidence = group.laws.evidence or Evidence()
        values = factors(situation, played, group=group)
        for measured in prediction.outside(evidence, values):
            mark = np.zeros(len(on), np.bool_)
            mark[on & group.slices] = measured.outside
            marked_time = np.bincount(line, played.time * mark)
            is_brief = marked_time / time_of_line <= MAX_BRIEF
            factor = measured.factor.replace("_", " ")
            text = f"{factor} outside the {evidence.range_name} {measured.text}"
            marks[text] = marks.get(text, nowhere) | (mark & ~is_brief[line])
    return marks


def beyond(situation: Situation, played: Play) -> list[str]:
    """Return notes on cuts beyond what was measured, the machine's speed or the inserts' feed."""
    notes = []
    for text, mark in outside(situation, played).items():
        if mark.any():
            lines = set(situation.line[mark].tolist())
            notes.append(f"* {at_lines(lines)}: {text}")
    for group in situation.groups:
        notes += _beyond_range(situation, played, group=group)
    return notes


def _beyond_range(situation: Situation, played: Play, group: ToolGroup) -> list[str]:
    """Return notes on cuts of a group beyond its machine's speed or its inserts' feed."""
    notes = []
    on = situation.engaged & group.slices
    max_speed = group.scenario.machine.cutting_speed_max
    is_fast = on & (played.cutting_speed > (1.0 + SPEED_TOLERANCE) * max_speed)
    if is_fast.any():
        fastest = played.cutting_speed[is_fast].max()
        lines = situation.line[is_fast].tolist()
        notes.append(
            f"{at_lines(lines)}: cutting speeds up to {fastest:.0f} m/min are above "
            f"machine.cutting_speed_max, {max_speed:g} m/min"
        )
    end = feed_ends(group.scenario)[0]
    is_coarse = on & (played.feed > (1.0 + SPEED_TOLERANCE) * end.feed)
    if is_coarse.any():
        coarsest = played.feed[is_coarse].max()
        lines = situation.line[is_coarse].tolist()
        notes.append(
            f"{at_lines(lines)}: feeds up to {coarsest:.3g} mm/rev are above "
            f"{end.feed:.3g} mm/rev, {end.reason}"
        )
    return notes
