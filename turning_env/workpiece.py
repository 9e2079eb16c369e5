"""Bars: hardness and depth of cut as fields over position, not over time.

The tool runs along an endless row of bars, each preceded by an approach of air. Two coordinates describe where it is:
the path [mm], which counts air and metal, and the cut [mm], which counts metal only. Both fields are functions of the
cut coordinate: an offset drawn per bar plus noise along the bar, which blends independent normal nodes one correlation
length apart and has unit variance everywhere.

Relative hardness is log-normal, so it stays positive. The depth of cut is the nominal depth plus the allowance's
deviation, and never falls below 1 % of nominal (assumption: a blank that measures under size is still just scraped).
The nominal depth may step along a bar, and the depth ripple with the spindle's turns (run-out). A pass of several cuts what
stands between its floor and its ceiling. A blank may carry a skin, harder and more abrasive than the metal beneath: hardness and
wear are means over the cut's depth (assumption), so that a shallow cut, nearly all skin, is the worst.
"""

import math

import numpy as np

from turning_env.compilation import compiled
from turning_env.keyed_random import BAR_CHANNEL, DEPTH_CHANNEL, HARDNESS_CHANNEL, standard_normals

LEAST_DEPTH_SHARE = 0.01


@compiled
def position_in_row(parameters, path):
    """Where a path coordinate [mm] lies: (length of metal behind the tool [mm], whether the tool is in metal)."""
    bar = np.floor(path * parameters.bars_per_path)
    along = path - bar * parameters.bar_pitch - parameters.approach
    return bar * parameters.bar_length + max(along, 0.0), along >= 0.0


@compiled
def enter_bar(lane, bar):
    """Draw the offsets of a bar, and forget the nodes of the bar before."""
    lane.bar = bar
    lane.bar_hardness_normal, lane.bar_depth_normal = standard_normals(lane, BAR_CHANNEL, bar, 0)
    lane.hardness_cell = -1
    lane.depth_cell = -1


@compiled
def between_nodes(left, right, share):
    """Unit-variance noise between two independent normal nodes, at a share 0..1 of the way.

    The nodes' weights run along a quarter of the unit circle, so their squares add up to 1 everywhere.
    """
    square = share * share
    return ((1.0 - square) * left + 2.0 * share * right) / (1.0 + square)


@compiled
def look_up_fields(lane, parameters, cut):
    """Set the lane's log hardness [-] and depth of cut [mm, 0 or less in air] to those at a cut coordinate [mm].

    The nodes on either side are kept in the lane until the tool has passed them: they cost more than all the rest.
    """
    bar = np.floor(cut * parameters.bars_per_cut)
    if bar != lane.bar:
        enter_bar(lane, bar)
    along = max(cut - bar * parameters.bar_length, 0.0)  # rounding must not ask for a node before the first

    hardness_nodes = along * parameters.hardness_nodes_per_length
    cell = np.floor(hardness_nodes)
    if cell != lane.hardness_cell:
        lane.hardness_cell = cell
        lane.hardness_left = standard_normals(lane, HARDNESS_CHANNEL, bar, cell)[0]
        lane.hardness_right = standard_normals(lane, HARDNESS_CHANNEL, bar, cell + 1)[0]
    hardness_noise = between_nodes(lane.hardness_left, lane.hardness_right, hardness_nodes - cell)
    lane.log_hardness = (
        parameters.log_lot_hardness
        + parameters.hardness_bar_spread * lane.bar_hardness_normal
        + parameters.hardness_along_spread * hardness_noise
    )

    depth_nodes = along * parameters.depth_nodes_per_length
    cell = np.floor(depth_nodes)
    if cell != lane.depth_cell:
        lane.depth_cell = cell
        lane.depth_left = standard_normals(lane, DEPTH_CHANNEL, bar, cell)[0]
        lane.depth_right = standard_normals(lane, DEPTH_CHANNEL, bar, cell + 1)[0]
    depth_noise = between_nodes(lane.depth_left, lane.depth_right, depth_nodes - cell)
    nominal = parameters.depth_of_cut
    if parameters.depth_sections > 0:
        section = int(along * parameters.bars_per_cut * parameters.depth_sections)
        nominal = parameters.depth_profile[min(section, parameters.depth_sections - 1)]
    depth = nominal + parameters.depth_bar_spread * lane.bar_depth_normal + parameters.depth_along_spread * depth_noise
    if parameters.depth_ripple > 0.0:
        depth *= 1.0 + parameters.depth_ripple * math.sin(parameters.depth_ripple_angle_per_turn * lane.turns)
    depth = max(depth, LEAST_DEPTH_SHARE * nominal)
    lane.depth_of_cut = min(depth, lane.pass_ceiling) - lane.pass_floor
    lane.log_skin_wear = 0.0
    if parameters.skin_thickness > 0.0 and lane.depth_of_cut > 0.0:
        cut_skin(lane, parameters, depth)


@compiled
def cut_skin(lane, parameters, depth):
    """Let what the cut holds of the skin, the outermost of a blank's depth [mm], harden the cut and wear the edge."""
    lowest = max(depth - parameters.skin_thickness, lane.pass_floor)
    share = max(min(depth, lane.pass_ceiling) - lowest, 0.0) / lane.depth_of_cut
    lane.log_hardness += math.log1p(share * (parameters.skin_hardness - 1.0))
    lane.log_skin_wear = math.log1p(share * (parameters.skin_wear - 1.0))


@compiled
def probe_next_bar(lane, parameters):
    """Measure the mean depth [mm] of what is to be cut of the bar before which the tool stands."""
    bar = np.rint(lane.path * parameters.bars_per_path)
    depth = parameters.depth_of_cut + parameters.depth_bar_spread * standard_normals(lane, BAR_CHANNEL, bar, 0)[1]
    lane.probed_depth = max(depth, LEAST_DEPTH_SHARE * parameters.depth_of_cut)
