"""Edge changes of a program by the policy of ``advise``: after as many whole parts as 97.5 % of edges last within the limits."""

import numpy as np
from numpy.typing import NDArray
from turning_nc.cutting import Play, Situation, play, tool_life
from turning_nc.words import at_lines
from turning_shop import Values, prediction
from turning_shop.advise import life_margin, whole_parts
from turning_shop.prediction import Evidence
from turning_shop.whatif import CHANGES

BRIEF = 0.1  # share of a line's time in metal up to which cuts outside the measured range do not count [-]


def factors(situation: Situation, played: Play) -> dict[str, Values]:
    """Return the factors of the laws in metal, of an edge that has made the same cut up to its change."""
    on, scenario = situation.engaged, situation.scenario
    settings = played.cutting_speed[on], played.feed[on], situation.removal.slices.depth[on]
    values = dict(zip(("cutting_speed", "feed", "depth_of_cut"), settings, strict=True))
    values["time"] = tool_life(scenario, *settings) / 60.0 * played.life_at_change[on]
    return values | {"hardness": np.ones(int(on.sum())), "wear": played.change_wear[on]}


def parts_per_edge(situation: Situation, played: Play) -> dict[str, float]:
    """Return the parts after which each tool's edge is changed; a share of one if edges do not last a part."""
    used = np.zeros(
        len(played.time)
    )  # share of the life of an edge that lasts shorter than 97.5 % of them
    margin = life_margin(
        situation.scenario, situation.evidence or Evidence(), factors(situation, played)
    )
    used[situation.engaged] = played.used_life[situation.engaged] * np.exp(margin)
    found = {
        tool: (played.life_at_change[mine][0], used[mine].sum())
        for tool, mine in situation.by_tool.items()
    }
    return {
        tool: float(whole_parts(life / share))
        for tool, (life, share) in found.items()
        if share > 0.0
    }


def change_wear(situation: Situation) -> Values:
    """Return the flank wear at which the edge of each slice's tool is changed at the latest [mm].

    It is the highest, in tenths of the wear criterion, at which the tool keeps the limits, but none before a part is done.
    """
    plays = [play(situation, wear) for wear in CHANGES * situation.scenario.tool.wear_criterion]
    parts = [parts_per_edge(situation, played) for played in plays]
    chosen = np.zeros(len(situation.tool))
    for tool, mine in situation.by_tool.items():
        whole = [
            played
            for played, count in zip(plays, parts, strict=True)
            if count.get(tool, 1.0) >= 1.0
        ] or plays[-1:]
        kept = [played for played in whole if played.load[mine].max() <= 1.0] or whole[:1]
        chosen[mine] = kept[-1].change_wear[mine]
    return chosen


def outside(situation: Situation, played: Play) -> dict[str, NDArray[np.bool_]]:
    """Return where factors lie outside the range in which the scenario's laws were measured, by names and ranges.

    Cuts of a line that take less than a tenth of its time in metal, as at the entry, do not count.
    """
    on, where = situation.engaged, {}
    time = np.bincount(situation.line, played.time * on)
    for name, measured, out in prediction.outside(
        situation.evidence or Evidence(), factors(situation, played)
    ):
        there = np.zeros(len(on), np.bool_)
        there[on] = out
        share = np.bincount(situation.line, played.time * there) / np.maximum(time, 1e-9)
        where[f"{name.replace('_', ' ')} outside the measured {measured}"] = (
            there & (share > BRIEF)[situation.line]
        )
    return where


def beyond(situation: Situation, played: Play) -> list[str]:
    """Return notes on cuts beyond what was measured, or above the machine's speed."""
    found = {
        text: set(situation.line[there].tolist())
        for text, there in outside(situation, played).items()
    }
    notes = [f"* {at_lines(lines)}: {text}" for text, lines in found.items() if lines]
    highest = situation.scenario.machine.cutting_speed_max
    fast = situation.engaged & (played.cutting_speed > 1.001 * highest)
    if fast.any():
        speeds = f"cutting speeds up to {played.cutting_speed[fast].max():.0f} m/min"
        text = f"{speeds} are above machine.cutting_speed_max, {highest:g} m/min"
        notes.append(f"{at_lines(situation.line[fast].tolist())}: {text}")
    return notes
