"""The compiled dynamic programming of ``clairvoyant.py``.

It looks up the true fields of a row of bars, and finds the best return over their cells.
"""

from typing import Any, NamedTuple

import numpy as np

from turning_env.numerics.compilation import FIRST_ENV, compiled, compiled_entry
from turning_env.numerics.functions import exp, log
from turning_env.numerics.wear_term import log_wear_term
from turning_env.physics.lathe import start_episode
from turning_env.physics.workpiece import look_up_fields

# Rows of the fields that ``survey`` fills in.
LOG_DEPTH = 0  # log depth of cut [log mm]
LOG_HARDNESS = 1
LOG_WEAR_FACTOR = 2

MIN_USED_LIFE = 1e-9  # in place of 0, before its logarithm is taken
FEED_TOLERANCE = 1e-9  # by which a log feed may lie out of its range


class Options(NamedTuple):
    """The set points that are compared."""

    log_speeds: Any  # ladder of cutting speeds, ascending [log m/min]
    min_log_feed: float  # [log mm/rev]
    max_log_feed: float  # [log mm/rev]
    feed_steps: Any  # log steps from the feed at the limit of force or power


class Factors(NamedTuple):
    """Effects of ``Options.feed_steps``: factors on the values at the limit [-], arrays."""

    time: Any
    used_life: Any
    force: Any
    power: Any


class BarCell(NamedTuple):
    """A stretch of a bar, with all numbers that do not depend on set point and edge."""

    number: int  # from the row's start
    time: float  # to cross it at 1 m/min and 1 mm/rev [s]
    metal_value: float  # [s]
    log_depth: float  # lowest in a turn [log mm]
    log_hardness: float  # [-]
    log_life_rate: float  # rate at which life is used at 1 m/min and 1 mm/rev [log 1/s]


class LogLoads(NamedTuple):
    """Log force and log power over their limits at 1 m/min and 1 mm/rev."""

    force: float
    power: float


class Outcomes(NamedTuple):
    """The best outcome from a cell on at each used life, arrays of shape (lives + 1,)."""

    value: Any  # return [s]
    end: Any  # cell in which the edge ends


class Outcome(NamedTuple):
    """The best outcome from a cell on."""

    value: float  # return [s]
    end: float  # cell in which the edge ends


@compiled
def between(values, place):
    """Return the value between nodes by cubic interpolation through two nodes on either side.

    The polynomial is that of Catmull and Rom 1974.
    """
    last = values.shape[0] - 1
    node = min(int(place), last - 1)
    x = place - node
    b = values[node]
    c = values[node + 1]
    a = values[node - 1] if node > 0 else 2.0 * b - c
    d = values[node + 2] if node + 1 < last else 2.0 * c - b
    cubic = 3.0 * (b - c) + d - a
    square = 2.0 * a - 5.0 * b + 4.0 * c - d + x * cubic
    return b + 0.5 * x * (c - a + x * square)


@compiled
def factors_of(log_steps, exponent):
    """Return the factors that steps of a log feed bring to a power of the feed."""
    return np.array([exp(exponent * step) for step in log_steps])


@compiled_entry
def start_episode_of(states, parameters, scratches):
    """Start an episode of the first environment of the only block, and of no other one."""
    scratch = scratches[0]
    start_episode(states[0], scratch.work, scratch.report, FIRST_ENV, parameters[0])


@compiled_entry
def survey(states, parameters, scratches, fields, cells):
    """Fill in the true fields in the middle of each cell, shape (3, bars * cells).

    ``cells``: number of cells of a bar. The rows are ``LOG_DEPTH`` [log mm], ``LOG_HARDNESS`` [-]
    and ``LOG_WEAR_FACTOR`` [-].
    """
    state = states[0]
    p = parameters[0]
    work = scratches[0].work
    work.engaged[0] = 1.0
    for i in range(fields.shape[1]):
        work.middle[0] = (i + 0.5) * p.bar_length[0] / cells
        look_up_fields(state, work, 0, 1, p)
        fields[LOG_DEPTH, i] = log(state.depth_of_cut[0])
        fields[LOG_HARDNESS, i] = state.log_hardness[0]
        fields[LOG_WEAR_FACTOR, i] = state.log_wear_factor[0] + state.log_skin_wear[0]


@compiled_entry
def best_return(states, parameters, fields, cells, options, ripple, lives):
    """Return the bound on the return, by dynamic programming from the last cell to the first.

    Args:
        states: state records of the only block; the first environment counts.
        parameters: parameter records of the block.
        fields: depth, hardness and wear factor of the cells, as ``survey`` fills them in.
        cells: number of cells of a bar.
        options: set points that are compared.
        ripple: relative amplitude of the depth's run-out [-].
        lives: steps of the used life.

    Returns:
        The bound [s], and the cell in which the edge ends at best.
    """
    state = states[0]
    p = parameters[0]
    crossing = 60.0 / p.revolutions_per_metre[0]  # time [s] of 1 mm at 1 m/min and 1 mm/rev
    air = p.approach[0] * crossing * exp(-options.log_speeds[-1] - options.max_log_feed)
    steps = options.feed_steps
    life_by_feed = p.wear_law.feed[0] * p.life_exponent[0]
    factors = Factors(
        time=factors_of(steps, -1.0),
        used_life=factors_of(steps, life_by_feed - 1.0),
        force=factors_of(steps, p.force_law.feed[0]),
        power=factors_of(steps, p.power_law.feed[0]),
    )
    num_cells = fields.shape[1]
    rungs = options.log_speeds.shape[0]
    speeds = np.empty(rungs + 3 if rungs > 1 else rungs)
    speeds[:rungs] = options.log_speeds
    outcomes = Outcomes(np.zeros(lives + 1), np.full(lives + 1, float(num_cells)))
    later = Outcomes(outcomes.value.copy(), outcomes.end.copy())
    for i in range(num_cells - 1, -1, -1):
        cell = cell_at(p, fields, i, cells=cells, ripple=ripple)
        for j in range(lives):
            used_life = j / lives
            loads = loads_of(p, cell, used_life)
            add_corners(speeds, options, p.force_law, p.power_law, loads)
            best = best_in_cell(p, options, factors, speeds, cell, loads, used_life, later)
            outcomes.value[j] = best.value
            outcomes.end[j] = best.end
        outcomes.value[lives] = 0.0
        outcomes.end[lives] = float(i)
        if i % cells == 0:
            outcomes.value[:lives] -= air
        outcomes, later = later, outcomes
    start = min(state.used_life[0], 1.0) * lives
    return between(later.value, start), between(later.end, start)


@compiled
def cell_at(p, fields, number, cells, ripple):
    """Return the ``BarCell`` of a ``number`` in the row of bars.

    Its loads are those of the lowest depth in a turn, its metal that of the highest. Both raise the
    bound. ``fields``: as ``survey`` fills them in; ``cells``: number of cells of a bar;
    ``ripple``: relative amplitude of the depth's run-out [-].
    """
    length = p.bar_length[0] / cells  # [mm]
    # Value of the metal of a cell 1 mm deep [s].
    metal = length * 60.0 / p.revolutions_per_metre[0] / p.reference_removal_rate[0]
    law = p.wear_law
    log_depth = fields[LOG_DEPTH, number] + log(1.0 - ripple)
    log_hardness = fields[LOG_HARDNESS, number]
    log_wear = (
        law.log_coefficient[0]
        + law.depth_of_cut[0] * log_depth
        + law.hardness[0] * log_hardness
        + fields[LOG_WEAR_FACTOR, number]
    )
    crossing = 60.0 / p.revolutions_per_metre[0]
    return BarCell(
        number=number,
        time=length * crossing,
        metal_value=metal * exp(fields[LOG_DEPTH, number]) * (1.0 + ripple),
        log_depth=log_depth,
        log_hardness=log_hardness,
        log_life_rate=(log_wear - p.log_wear_criterion[0]) * p.life_exponent[0] - log(60.0),
    )


@compiled
def loads_of(p, cell, used_life):
    """Return the ``LogLoads`` in a cell by an edge at a used life [-]."""
    # The edge is taken as sharp as at the cell's start, which raises the bound.
    log_used = log(max(used_life, MIN_USED_LIFE))
    log_wear = p.log_wear_criterion[0] + p.wear_law.time[0] * log_used
    force = log_load(p.force_law, cell, log_wear, log(p.thrust_force_limit[0]))
    power = log_load(p.power_law, cell, log_wear, log(p.power_limit[0]))
    return LogLoads(force, power)


@compiled
def log_load(law, cell, log_wear, log_limit):
    """Return a log load over its limit at 1 m/min and 1 mm/rev."""
    sharp = (
        law.log_coefficient[0]
        + law.depth_of_cut[0] * cell.log_depth
        + law.hardness[0] * cell.log_hardness
    )
    return sharp + (law.wear[0] * log_wear_term(law.wear_growth[0], log_wear) - log_limit)


@compiled
def add_corners(speeds, options, force_law, power_law, loads):
    """Fill in the last three of ``speeds`` [log m/min]: those at which two limits meet.

    The optimum often lies there. The first ones are the ladder of ``options``.
    """
    ladder = options.log_speeds
    rungs = ladder.shape[0]
    if speeds.shape[0] == rungs:
        return
    # Force and power: force + a_f x + b_f y = 0 and power + a_p x + b_p y = 0.
    height = force_law.feed[0] * loads.power - power_law.feed[0] * loads.force
    slope = (
        power_law.feed[0] * force_law.cutting_speed[0]
        - force_law.feed[0] * power_law.cutting_speed[0]
    )
    speeds[rungs] = corner(ladder, height, slope)
    # Force, and power, with the highest feed.
    height = loads.force + force_law.feed[0] * options.max_log_feed
    speeds[rungs + 1] = corner(ladder, height, -force_law.cutting_speed[0])
    height = loads.power + power_law.feed[0] * options.max_log_feed
    speeds[rungs + 2] = corner(ladder, height, -power_law.cutting_speed[0])


@compiled
def corner(ladder, height, slope):
    """Return the log speed height / slope, at which two lines meet, within the ladder's ends.

    Lines that are parallel meet nowhere: then it is the lowest speed of the ladder.
    """
    log_speed = height / slope if slope != 0.0 else ladder[0]
    return min(max(log_speed, ladder[0]), ladder[ladder.shape[0] - 1])


@compiled
def best_in_cell(p, options, factors, speeds, cell, loads, used_life, later):
    """Return the best ``Outcome`` from a cell on.

    Args:
        p: parameters of the block.
        options: feeds that are compared.
        factors: effects of their steps.
        speeds: cutting speeds that are compared [log m/min].
        cell: the cell.
        loads: loads in the cell by the edge.
        used_life: used life of the edge at the cell's start [-].
        later: best outcomes from the next cell on.
    """
    lives = later.value.shape[0] - 1
    best = Outcome(-np.inf, 0.0)
    for log_speed in speeds:
        # Where force or power meets its limit, the gain has a kink, which is often the optimum.
        force = loads.force + p.force_law.cutting_speed[0] * log_speed
        power = loads.power + p.power_law.cutting_speed[0] * log_speed
        kink = feed_at_kink(p, options, force, power)
        time_at_kink = cell.time * exp(-log_speed - kink)
        life_rate = exp(
            cell.log_life_rate
            + p.wear_law.cutting_speed[0] * p.life_exponent[0] * log_speed
            + p.wear_law.feed[0] * p.life_exponent[0] * kink
        )
        used_at_kink = life_rate * time_at_kink
        force_at_kink = exp(force + p.force_law.feed[0] * kink)
        power_at_kink = exp(power + p.power_law.feed[0] * kink)
        for k in range(options.feed_steps.shape[0]):
            log_feed = kink + options.feed_steps[k]
            if log_feed < options.min_log_feed - FEED_TOLERANCE:
                continue
            if log_feed > options.max_log_feed + FEED_TOLERANCE:
                continue
            time = time_at_kink * factors.time[k]
            excess = max(force_at_kink * factors.force[k] - 1.0, 0.0) + max(
                power_at_kink * factors.power[k] - 1.0, 0.0
            )
            life_in_cell = used_at_kink * factors.used_life[k]
            gain = (
                cell.metal_value
                - time * (1.0 + p.overload_price[0] * excess)
                - p.edge_price[0] * life_in_cell
            )
            used_life_after = used_life + life_in_cell
            if used_life_after >= 1.0:  # the edge ends within the cell
                gain *= (1.0 - used_life) / life_in_cell
            else:
                gain += between(later.value, used_life_after * lives)
            if gain > best.value:
                end = cell.number + (1.0 - used_life) / life_in_cell
                if used_life_after < 1.0:
                    end = between(later.end, used_life_after * lives)
                best = Outcome(gain, end)
    return best


@compiled
def feed_at_kink(p, options, force, power):
    """Return the highest log feed within the limits and the range, for log loads at 1 mm/rev."""
    log_feed = options.max_log_feed
    if p.force_law.feed[0] > 0.0:
        log_feed = min(log_feed, -force / p.force_law.feed[0])
    if p.power_law.feed[0] > 0.0:
        log_feed = min(log_feed, -power / p.power_law.feed[0])
    return max(log_feed, options.min_log_feed)
