"""Bars: hardness and depth of cut as fields over position, not over time.

Two coordinates describe where the tool is in the row of bars: the path [mm], which counts air and
metal, and the cut [mm], which counts metal only. Both fields are functions of the cut: an offset
drawn per bar, and noise along the bar that blends independent normal nodes one correlation length
apart. The depth never falls below 1 % of nominal (assumption: a blank that measures under size is
still just scraped).

A tool path of several diameters is a bar of sections with lengths, depths (0 in air) and highest
cutting speeds of their own. A pass of several cuts what stands between its floor and its ceiling.
Sources: ``docs/models.md``.
"""

import numpy as np

from turning_env.numerics.compilation import compiled, env_range
from turning_env.numerics.functions import log, sine_and_cosine
from turning_env.numerics.keyed_random import (
    BAR_CHANNEL,
    DEPTH_CHANNEL,
    HARDNESS_CHANNEL,
    normals_of,
    standard_normals,
    words,
)
from turning_env.physics.sensors import warmth

MIN_DEPTH_SHARE = 0.01


@compiled
def position_in_row(p, i, path):
    """Locate a path coordinate [mm].

    Return the length of metal behind the tool [mm], and whether the tool is in metal.
    """
    bar = np.floor(path * p.bars_per_path[i])
    along = path - bar * p.bar_pitch[i] - p.approach[i]
    return bar * p.bar_length[i] + max(along, 0.0), along >= 0.0


@compiled
def section_at(p, i, along):
    """Return the section at a place along the bar [mm]."""
    section = 0
    if p.has_section_lengths:
        for k in range(1, p.depth_sections):
            section += 1 if along >= p.section_starts[k] else 0
        return section
    section = int(along * p.bars_per_cut[i] * p.depth_sections)
    return min(section, p.depth_sections - 1)


@compiled
def limit_of_section(p, i, path):
    """Return the highest cutting speed [m/min] at a path coordinate [mm]."""
    cut, _ = position_in_row(p, i, path)
    bar = np.floor(cut * p.bars_per_cut[i])
    along = max(cut - bar * p.bar_length[i], 0.0)
    return p.section_speeds[section_at(p, i, along)]


@compiled
def look_up_fields(state, work, first, last, p):
    """Set log hardness [-] and depth of cut [mm] to the values in the middle of the present cut.

    The depth is 0 or less in air. This holds for the block's ``engaged`` environments; the others
    keep their values.
    """
    if locate_along_bar(state, work, first, last, p) > 0:
        pass_nodes(state, work, first, last, p)
    set_blank(state, work, first, last, p)
    for i in env_range(first, last):
        set_depth_of_cut(state, work, i)
    if p.has_gradient:
        for i in env_range(first, last):
            add_gradient(state, work, i, p)
    if p.has_skin:
        for i in env_range(first, last):
            add_skin(state, work, i, p)


@compiled
def set_blank(state, work, first, last, p):
    """Set log hardness [-], and the height of the blank above the finished contour [mm]."""
    if p.depth_sections > 0:
        for i in env_range(first, last):
            work.nominal_depth[i] = p.depth_profile[section_at(p, i, work.along[i])]
    for i in env_range(first, last):
        set_hardness_of_bar(state, work, i, p)
        set_depth_of_blank(state, work, i, p)
    if p.ripples:
        for i in env_range(first, last):
            # Run-out: the depth varies as the spindle turns.
            sine, _ = sine_and_cosine(p.depth_ripples_per_turn[i] * state.turns[i])
            work.blank_depth[i] *= 1.0 + p.depth_ripple[i] * sine
    if p.warms_up:
        for i in env_range(first, last):
            work.blank_depth[i] += p.thermal_growth[i] * warmth(state, i, p)


@compiled
def locate_along_bar(state, work, first, last, p):
    """Set the place along the bar [mm], and return how many environments have passed a node.

    Fields of hardness and depth are interpolated between random nodes along the bar. The nodes on
    either side are kept until the tool has passed them, because drawing them costs more than
    everything else.
    """
    passing = 0
    for i in env_range(first, last):
        metal_behind = work.middle[i]  # length cut in all bars, up to the middle of this cut [mm]
        bar = np.floor(metal_behind * p.bars_per_cut[i])
        # Rounding must not ask for a node before the first.
        along = max(metal_behind - bar * p.bar_length[i], 0.0)
        hardness_cell = np.floor(along * p.hardness_nodes_per_length[i])
        depth_cell = np.floor(along * p.depth_nodes_per_length[i])
        moved = (
            abs(bar - state.bar[i])
            + abs(hardness_cell - state.hardness_cell[i])
            + abs(depth_cell - state.depth_cell[i])
        )
        work.along[i] = along
        work.nominal_depth[i] = p.depth_of_cut[i]
        work.passing[i] = 1 if min(moved, work.engaged[i]) > 0.0 else 0
        passing += work.passing[i]
    return passing


@compiled
def set_hardness_of_bar(state, work, i, p):
    """Set log hardness [-]: mismatch + bar offset + noise along the bar."""
    share = work.along[i] * p.hardness_nodes_per_length[i] - state.hardness_cell[i]
    noise = noise_between(state.hardness_left[i], state.hardness_right[i], share)
    bar_offset = p.hardness_bar_spread[i] * state.bar_hardness_normal[i]
    hardness = p.log_hardness_mismatch[i] + bar_offset
    hardness += p.hardness_along_spread[i] * noise
    state.log_hardness[i] = hardness if work.engaged[i] > 0.0 else state.log_hardness[i]


@compiled
def set_depth_of_blank(state, work, i, p):
    """Set the height of the blank above the finished contour [mm]: nominal + offset + noise."""
    share = work.along[i] * p.depth_nodes_per_length[i] - state.depth_cell[i]
    noise = noise_between(state.depth_left[i], state.depth_right[i], share)
    depth = work.nominal_depth[i] + p.depth_bar_spread[i] * state.bar_depth_normal[i]
    work.blank_depth[i] = depth + p.depth_along_spread[i] * noise


@compiled
def set_depth_of_cut(state, work, i):
    """Set the depth of cut [mm]: the blank between the floor and the ceiling of the pass."""
    nominal = work.nominal_depth[i]
    scraped = max(work.blank_depth[i], MIN_DEPTH_SHARE * nominal)
    work.blank_depth[i] = scraped if nominal > 0.0 else 0.0
    depth = min(work.blank_depth[i], state.pass_ceiling[i]) - state.pass_floor[i]
    state.depth_of_cut[i] = depth if work.engaged[i] > 0.0 else state.depth_of_cut[i]


@compiled
def add_gradient(state, work, i, p):
    """Harden the mean of a deeper cut: log H + 0.5 h (depth / nominal depth - 1).

    Bars cool from outside; the form is an assumption (``docs/models.md``).
    """
    nominal = work.nominal_depth[i]
    deeper = state.depth_of_cut[i] / nominal - 1.0 if nominal > 0.0 else 0.0
    change = 0.5 * p.hardness_gradient[i] * deeper
    state.log_hardness[i] += change if work.engaged[i] > 0.0 else 0.0


@compiled
def add_skin(state, work, i, p):
    """Mix the skin, the outermost depth [mm] of a blank, into the cut's hardness and wear.

    A share s of the cut lies in the skin; the cut takes the mean over its depth (assumption):
    H (1 + s (H_skin - 1)) and W (1 + s (W_skin - 1)).
    """
    blank = work.blank_depth[i]
    lowest = max(blank - p.skin_thickness[i], state.pass_floor[i])
    skin = max(min(blank, state.pass_ceiling[i]) - lowest, 0.0)
    cuts = min(work.engaged[i], state.depth_of_cut[i]) > 0.0
    share = skin / state.depth_of_cut[i] if cuts else 0.0
    state.log_hardness[i] += log(1.0 + share * (p.skin_hardness[i] - 1.0))
    wear = log(1.0 + share * (p.skin_wear[i] - 1.0))
    state.log_skin_wear[i] = wear if work.engaged[i] > 0.0 else state.log_skin_wear[i]


@compiled
def pass_nodes(state, work, first, last, p):
    """Enter bars, and draw the nodes ahead, in the environments that have passed their kept nodes.

    The nodes ahead are listed and drawn together, because Philox is not vectorised one by one.
    """
    listed = 0
    for i in env_range(first, last):
        if work.passing[i] > 0:
            enter_bar(state, work, i, p)
            listed += pass_hardness_node(state, work, i, p, listed)
            listed += pass_depth_node(state, work, i, p, listed)
    for k in range(listed):
        i = work.node_env[k]
        work.word_0[k], work.word_1[k] = words(
            state, i, channel=work.node_channel[k], bar=state.bar[i], index=work.node_number[k]
        )
    for k in range(listed):
        work.node_value[k] = normals_of(work.word_0[k], work.word_1[k])[0]
    for k in range(listed):
        if work.node_channel[k] == HARDNESS_CHANNEL:
            state.hardness_right[work.node_env[k]] = work.node_value[k]
        else:
            state.depth_right[work.node_env[k]] = work.node_value[k]


@compiled
def enter_bar(state, work, i, p):
    """Draw the offsets of a bar that the tool has entered."""
    bar = np.floor(work.middle[i] * p.bars_per_cut[i])
    if bar != state.bar[i]:
        state.bar[i] = bar
        state.bar_hardness_normal[i], state.bar_depth_normal[i] = standard_normals(
            state, i, channel=BAR_CHANNEL, bar=bar, index=0
        )
        # The nodes of the bar before do not count.
        state.hardness_cell[i] = -1.0
        state.depth_cell[i] = -1.0


@compiled
def pass_hardness_node(state, work, i, p, k):
    """Keep the hardness nodes on either side of the tool.

    If the node ahead is new, it is put at place k of the list of nodes to draw. Return the number
    of nodes put there.
    """
    kept = state.hardness_cell[i]
    cell = np.floor(work.along[i] * p.hardness_nodes_per_length[i])
    state.hardness_cell[i] = cell
    # Without noise along the bar, nodes are multiplied by 0 and need not be drawn.
    if cell == kept or p.hardness_along_spread[i] == 0.0:
        return 0
    state.hardness_left[i] = node_behind(
        state, i, HARDNESS_CHANNEL, cell=cell, kept=kept, right=state.hardness_right[i]
    )
    list_node(work, i, k, channel=HARDNESS_CHANNEL, number=cell + 1.0)
    return 1


@compiled
def pass_depth_node(state, work, i, p, k):
    """Keep the depth nodes on either side, as ``pass_hardness_node`` does."""
    kept = state.depth_cell[i]
    cell = np.floor(work.along[i] * p.depth_nodes_per_length[i])
    state.depth_cell[i] = cell
    if cell == kept or p.depth_along_spread[i] == 0.0:
        return 0
    state.depth_left[i] = node_behind(
        state, i, DEPTH_CHANNEL, cell=cell, kept=kept, right=state.depth_right[i]
    )
    list_node(work, i, k, channel=DEPTH_CHANNEL, number=cell + 1.0)
    return 1


@compiled
def node_behind(state, i, channel, cell, kept, right):
    """Return the value of the node behind the tool."""
    # If the tool has passed one node, that which was ahead is behind now.
    if cell == kept + 1.0 and kept >= 0.0:
        return right
    return standard_normals(state, i, channel=channel, bar=state.bar[i], index=cell)[0]


@compiled
def list_node(work, i, k, channel, number):
    """Put a node at place k of the list of nodes to draw."""
    work.node_env[k] = i
    work.node_channel[k] = channel
    work.node_number[k] = number


@compiled
def noise_between(left, right, share):
    """Return a field's unit-variance noise at a share of the way between two nodes.

    The nodes' weights run along a quarter of the unit circle, so their squares add up to 1
    everywhere: (1 - s^2) / (1 + s^2) and 2 s / (1 + s^2).
    """
    square = share * share
    return ((1.0 - square) * left + 2.0 * share * right) / (1.0 + square)


@compiled
def probe_next_bar(state, i, p):
    """Measure the mean allowance [mm] of the next bar."""
    bar = np.rint(state.path[i] * p.bars_per_path[i])
    _, depth_normal = standard_normals(state, i, channel=BAR_CHANNEL, bar=bar, index=0)
    depth = p.depth_of_cut[i] + p.depth_bar_spread[i] * depth_normal
    state.probed_depth[i] = max(depth, MIN_DEPTH_SHARE * p.depth_of_cut[i])
