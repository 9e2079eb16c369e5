"""Bars: hardness and depth of cut as fields over position, not over time (``docs/models_lathe.md``).

Two coordinates describe where the tool is in the row of bars: the path [mm], which counts air and metal, and the cut [mm], which
counts metal only. Both fields are functions of the cut: an offset drawn per bar plus noise along the bar, which blends
independent normal nodes one correlation length apart. The depth never falls below 1 % of nominal (assumption: a blank that
measures under size is still just scraped). A tool path of several diameters is a bar of sections with lengths, depths (0 in air)
and highest cutting speeds of their own. A pass of several cuts what stands between its floor and its ceiling.
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
    """Locate a path coordinate [mm]: return (length of metal behind the tool [mm], whether the tool is in metal)."""
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
    return p.section_speeds[
        section_at(p, i, max(cut - np.floor(cut * p.bars_per_cut[i]) * p.bar_length[i], 0.0))
    ]


@compiled
def look_up_fields(state, work, first, last, p):
    """Set log hardness [-] and depth of cut [mm, 0 or less in air] to the values in the middle of the present cut.

    This holds for the block's ``engaged`` environments. The nodes on either side are kept until the tool has passed them, because
    drawing them costs more than everything else.
    """
    passing = 0
    for i in env_range(first, last):
        cut = work.middle[i]
        bar = np.floor(cut * p.bars_per_cut[i])
        along = max(
            cut - bar * p.bar_length[i], 0.0
        )  # rounding must not ask for a node before the first
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
    if passing > 0:
        pass_nodes(state, work, first, last, p)
    if p.depth_sections > 0:
        for i in env_range(first, last):
            work.nominal_depth[i] = p.depth_profile[section_at(p, i, work.along[i])]
    for i in env_range(first, last):
        share = work.along[i] * p.hardness_nodes_per_length[i] - state.hardness_cell[i]
        noise = noise_between(state.hardness_left[i], state.hardness_right[i], share)
        hardness = (
            p.log_hardness_mismatch[i] + p.hardness_bar_spread[i] * state.bar_hardness_normal[i]
        )
        hardness += p.hardness_along_spread[i] * noise
        state.log_hardness[i] = hardness if work.engaged[i] > 0.0 else state.log_hardness[i]
        share = work.along[i] * p.depth_nodes_per_length[i] - state.depth_cell[i]
        noise = noise_between(state.depth_left[i], state.depth_right[i], share)
        depth = work.nominal_depth[i] + p.depth_bar_spread[i] * state.bar_depth_normal[i]
        work.blank_depth[i] = depth + p.depth_along_spread[i] * noise
    if p.ripples:
        for i in env_range(first, last):
            sine, _ = sine_and_cosine(p.depth_ripples_per_turn[i] * state.turns[i])
            work.blank_depth[i] *= 1.0 + p.depth_ripple[i] * sine
    if p.warms_up:
        for i in env_range(first, last):
            work.blank_depth[i] += p.thermal_growth[i] * warmth(state, i, p)
    for i in env_range(first, last):
        nominal = work.nominal_depth[i]
        work.blank_depth[i] = (
            max(work.blank_depth[i], MIN_DEPTH_SHARE * nominal) if nominal > 0.0 else 0.0
        )
        depth = min(work.blank_depth[i], state.pass_ceiling[i]) - state.pass_floor[i]
        state.depth_of_cut[i] = depth if work.engaged[i] > 0.0 else state.depth_of_cut[i]
    if p.has_gradient:
        for i in env_range(first, last):
            deeper = (
                state.depth_of_cut[i] / work.nominal_depth[i] - 1.0
                if work.nominal_depth[i] > 0.0
                else 0.0
            )
            state.log_hardness[i] += (
                0.5 * p.hardness_gradient[i] * deeper if work.engaged[i] > 0.0 else 0.0
            )
    if p.has_skin:  # the outermost depth [mm] of a blank
        for i in env_range(first, last):
            lowest = max(work.blank_depth[i] - p.skin_thickness[i], state.pass_floor[i])
            skin = max(min(work.blank_depth[i], state.pass_ceiling[i]) - lowest, 0.0)
            share = (
                skin / state.depth_of_cut[i]
                if min(work.engaged[i], state.depth_of_cut[i]) > 0.0
                else 0.0
            )
            state.log_hardness[i] += log(1.0 + share * (p.skin_hardness[i] - 1.0))
            wear = log(1.0 + share * (p.skin_wear[i] - 1.0))
            state.log_skin_wear[i] = wear if work.engaged[i] > 0.0 else state.log_skin_wear[i]


@compiled
def pass_nodes(state, work, first, last, p):
    """Enter bars, and draw the nodes on either side, in the environments that have passed their kept nodes.

    The nodes ahead are listed and drawn together. Without noise along the bar, the nodes do not change: they are multiplied by 0.
    """
    listed = 0
    for i in env_range(first, last):
        if work.passing[i] > 0:
            bar = np.floor(work.middle[i] * p.bars_per_cut[i])
            if bar != state.bar[i]:
                state.bar[i] = bar
                state.bar_hardness_normal[i], state.bar_depth_normal[i] = standard_normals(
                    state, i, BAR_CHANNEL, bar, 0
                )
                state.hardness_cell[i] = -1.0  # the nodes of the bar before do not count
                state.depth_cell[i] = -1.0
            nodes, spread = (
                (state.hardness_cell, state.hardness_left, state.hardness_right),
                p.hardness_along_spread[i],
            )
            listed += pass_node(
                state,
                work,
                i,
                listed,
                HARDNESS_CHANNEL,
                nodes,
                p.hardness_nodes_per_length[i],
                spread,
            )
            nodes, spread = (
                (state.depth_cell, state.depth_left, state.depth_right),
                p.depth_along_spread[i],
            )
            listed += pass_node(
                state, work, i, listed, DEPTH_CHANNEL, nodes, p.depth_nodes_per_length[i], spread
            )
    for k in range(listed):
        i = work.node_env[k]
        work.word_0[k], work.word_1[k] = words(
            state, i, work.node_channel[k], state.bar[i], work.node_number[k]
        )
    for k in range(listed):
        work.node_value[k] = normals_of(work.word_0[k], work.word_1[k])[0]
    for k in range(listed):
        if work.node_channel[k] == HARDNESS_CHANNEL:
            state.hardness_right[work.node_env[k]] = work.node_value[k]
        else:
            state.depth_right[work.node_env[k]] = work.node_value[k]


@compiled
def pass_node(state, work, i, k, channel, nodes, nodes_per_length, spread):
    """Keep the nodes of a field on either side: (cell, left, right) of the block's environments.

    If the node ahead is new, it is put at place k of the list of nodes to draw. Return the number of nodes put there.
    """
    cells, left, right = nodes
    cell, kept = np.floor(work.along[i] * nodes_per_length), cells[i]
    cells[i] = cell
    if cell == kept or spread == 0.0:
        return 0
    if cell == kept + 1.0 and kept >= 0.0:
        left[i] = right[i]
    else:
        left[i] = standard_normals(state, i, channel, state.bar[i], cell)[0]
    work.node_env[k] = i
    work.node_channel[k] = channel
    work.node_number[k] = cell + 1.0
    return 1


@compiled
def noise_between(left, right, share):
    """Return a field's unit-variance noise at a share of the way between two nodes.

    The nodes' weights run along a quarter of the unit circle, so their squares add up to 1 everywhere.
    """
    square = share * share
    return ((1.0 - square) * left + 2.0 * share * right) / (1.0 + square)


@compiled
def probe_next_bar(state, i, p):
    """Measure the mean allowance [mm] of the next bar."""
    bar = np.rint(state.path[i] * p.bars_per_path[i])
    depth = (
        p.depth_of_cut[i]
        + p.depth_bar_spread[i] * standard_normals(state, i, BAR_CHANNEL, bar, 0)[1]
    )
    state.probed_depth[i] = max(depth, MIN_DEPTH_SHARE * p.depth_of_cut[i])
