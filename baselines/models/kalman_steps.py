"""The compiled equations of the load filter, one environment at a time.

``load_filter.py`` describes the states and is the interface; nothing else should call this file,
except for ``distance_moved``, by which agents follow the tool, too (``train/agent_inputs.py``). In
all functions, ``model`` is a record of the nominal model (``load_filter.filter_numbers_of``),
``memory`` one of ``MEMORY``, and ``mean`` and ``covariance`` are the estimate, of shapes (STATES,)
and (STATES, STATES).

The filter is an extended Kalman filter (Särkkä 2013, "Bayesian Filtering and Smoothing", section
5.2). Its states move by linear equations, so only the measurements are linearised.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from turning_env.numerics.compilation import compiled, compiled_entry
from turning_env.numerics.functions import exp, log
from turning_env.numerics.wear_term import log_wear_term, term_of_factor, wear_term_slope

# Places of the states in the estimate. The fields along the bar come first, each before its slope.
DEPTH = 0  # relative deviation of the depth of cut [-]
DEPTH_SLOPE = 1  # [1/mm]
HARDNESS = 2  # log hardness [-]
HARDNESS_SLOPE = 3  # [1/mm]
# Terms of the log wear factor: log ratio of the edge's wear to the nominal wear.
INSERT = 4  # log wear factor of the insert [-]
HISTORY = 5  # log wear factor of the depth and hardness that the edge has cut [-]
LOT = 6  # log wear factor of all edges of the job [-]
WEAR_SPEED = 7  # error of the exponent of cutting speed in the law of wear [-]
WEAR_FEED = 8  # error of the exponent of feed in the law of wear [-]
# Errors of the law of force, then the same ones of the law of power.
LAWS = 9
BIAS = 0  # log error at the references [-]
SPEED_ERROR = 1  # error of the exponent of cutting speed [-]
FEED_ERROR = 2  # error of the exponent of feed [-]
WEAR_ERROR = 3  # error of the exponent of wear [-]
ERRORS = 4  # number of errors of a law
STATES = LAWS + 2 * ERRORS

# Places of the two laws in arrays that have one entry for each.
FORCE = 0
POWER = 1

MIN_DEPTH = 0.05
"""Lower bound of the expected depth over the nominal depth [-]: near 0, the logarithm is not
linear."""
MAX_SPREAD = 1.0
"""Upper bound of the log standard deviation of a load [-]: beyond it, the linearisation fails."""
MIN_READING = 0.01
"""Share of the expected reading below which a reading is ignored [-]: the tool does not cut."""
INSPECTION_DEVIATION = 0.05
"""Log standard deviation of a removed edge's wear, because its cuts are not known exactly [-]
(assumption)."""
ON_EDGE = 1e-6  # distance by which a corrected position lies beyond the end of a bar [mm]

READING = np.dtype(
    (
        np.record,
        [
            ("commanded_cutting_speed", np.float64),  # [m/min]
            ("commanded_feed", np.float64),  # [mm/rev]
            ("cutting_speed", np.float64),  # [m/min]
            ("feed", np.float64),  # [mm/rev]
            ("cutting_time", np.float64),  # of the edge [min]
            ("nominal_wear", np.float64),  # [mm]
            ("removed_wear", np.float64),  # of the edge that was removed last [mm]
            ("thrust_force", np.float64),  # [N]
            ("power", np.float64),  # [kW]
            ("cutting", np.int64),  # 1 in metal, else 0
        ],
    )
)
"""The part of ``turning_env.Reading`` that the filter uses, with its names."""

MEMORY = np.dtype(
    (
        np.record,
        [
            ("path", np.float64),  # travelled distance in air and metal [mm]
            ("speed", np.float64),  # at the last reading [m/min]; 0 before the first
            ("feed", np.float64),  # at the last reading [mm/rev]
            ("cutting_time", np.float64),  # at the last reading [min]
            ("nominal_wear", np.float64),  # at the last reading [mm]
            # Nominal force [N] and power [kW] behind the lags of the sensors.
            ("expected", np.float64, 2),
            # Power of the idling spindle over that of the cut in the nominal model [-].
            ("idle", np.float64),
            # Mean log speed and log feed of the edge over the references [-], by used life.
            ("mean_log_speed", np.float64),
            ("mean_log_feed", np.float64),
            ("slack", np.float64),  # how much farther the tool may be [mm]
            ("measured", np.int64),  # 1 if this bar has been measured, else 0
        ],
    )
)
"""State of the filter of an environment, beside the estimate."""


class Place(NamedTuple):
    """A point at which laws are taken: logarithms of speed and feed over the references [-]."""

    log_speed: float
    log_feed: float
    log_wear: float  # nominal [log mm]


class Transition(NamedTuple):
    """The step of a field and its slope from an earlier place.

    The field is ``field_field`` times the earlier field plus ``field_slope`` times the earlier
    slope; likewise for the slope.
    """

    field_field: float  # [-]
    field_slope: float  # [mm]
    slope_field: float  # [1/mm]
    slope_slope: float  # [-]


class Growth(NamedTuple):
    """Increments of the variances and the covariance of a field and its slope."""

    field: float
    both: float
    slope: float


class BarAhead(NamedTuple):
    """Depth and hardness expected at a point ahead of the tool."""

    depth_ratio: float  # over the nominal depth [-]
    log_hardness: float  # [-]
    depth_variance: float  # that the distance adds [-]
    hardness_variance: float  # likewise [-]
    # Derivatives by the states.
    depth_by_depth: float
    depth_by_slope: float
    hardness_by_hardness: float
    hardness_by_slope: float


class TrueStates(NamedTuple):
    """True states of the environments, each of shape (num_envs,)."""

    depth: Any  # relative deviation of the depth of cut [-]
    log_hardness: Any  # [-]
    log_wear_factor: Any  # [-]


class Scratch(NamedTuple):
    """Arrays that a correction overwrites, allocated once for all environments."""

    derivatives: Any  # of log force and log power by the states, shape (2, STATES)
    gain: Any  # covariance of a measurement and the states, shape (STATES,)
    mean_before: Any  # the mean before the corrections, shape (STATES,)
    surprise: Any  # log measured load over expected load, shape (2,)
    variance: Any  # of the measurement, 0 for none, shape (2,)


@compiled
def new_scratch():
    """Return arrays that corrections overwrite."""
    return Scratch(
        derivatives=np.empty((2, STATES)),
        gain=np.empty(STATES),
        mean_before=np.empty(STATES),
        surprise=np.empty(2),
        variance=np.empty(2),
    )


@compiled_entry
def follow(models, memories, means, covariances, readings, chosen):
    """Predict up to readings and correct the estimates by them in chosen environments.

    See ``LoadFilter.observe``.
    """
    scratch = new_scratch()
    for i in chosen:
        model = models[i % len(models)]
        follow_one(model, memories[i], means[i], covariances[i], readings[i], scratch)


@compiled
def follow_one(model, memory, mean, covariance, reading, scratch):
    """Predict up to a reading and correct the estimate by it."""
    first = memory.speed == 0.0
    fresh_edge = reading.cutting_time < memory.cutting_time
    if fresh_edge:
        replace_edge(model, memory, mean, covariance, reading.removed_wear, scratch)

    moved = 0.0 if first else distance_moved(model, memory, reading)
    if fresh_edge and reading.cutting_time == 0.0:
        # An edge that is found worn or broken ends the step early, somewhere.
        moved *= 0.5
        memory.slack = max(memory.slack, moved)
    if reading.cutting == 0:
        memory.slack = min(memory.slack, model.approach)
    bar = math.floor(memory.path / model.pitch)
    memory.path = on_track(model, memory.path + moved, reading.cutting != 0)
    if math.floor(memory.path / model.pitch) > bar:
        forget(mean, covariance, DEPTH, INSERT, model)
        memory.measured = 0

    bar_start = model.pitch * math.floor(memory.path / model.pitch)
    metal = max(memory.path - bar_start - model.approach, 0.0)  # of this bar, behind the tool [mm]
    cut = min(moved, metal)
    move_on(model, mean, covariance, cut)
    # Wear by unknown bars is a random walk: its variance grows by ``history`` with each bar.
    covariance[INSERT, INSERT] += model.history * cut / model.bar_length
    if reading.nominal_wear > 0.0:
        old_wear = 0.0 if fresh_edge else memory.nominal_wear / reading.nominal_wear
        wear_edge(model, memory, mean, covariance, reading, old_wear)

    time_in_metal = 0.0
    if not first:
        velocity = model.velocity * (reading.cutting_speed * reading.feed)
        time_in_metal = min(metal / velocity, model.interval)
    learn_loads(model, memory, mean, covariance, reading, time_in_metal, scratch)
    memory.speed = reading.cutting_speed
    memory.feed = reading.feed
    memory.cutting_time = reading.cutting_time
    memory.nominal_wear = reading.nominal_wear


@compiled
def replace_edge(model, memory, mean, covariance, removed_wear, scratch):
    """Learn from the removed edge's wear, if it is measured, and reset the edge's states."""
    if removed_wear > 0.0 and memory.nominal_wear > 0.0:
        log_factor = log(removed_wear / memory.nominal_wear)
        learn_wear(memory, mean, covariance, log_factor, INSPECTION_DEVIATION**2, scratch)
    forget(mean, covariance, INSERT, HISTORY + 1, model)
    memory.expected[:] = 0.0


@compiled
def log_wear_factor(memory, mean):
    """Return the expected log ratio of the edge's wear to the nominal wear [-]."""
    return (
        mean[INSERT]
        + mean[HISTORY]
        + mean[LOT]
        + mean[WEAR_SPEED] * memory.mean_log_speed
        + mean[WEAR_FEED] * memory.mean_log_feed
    )


@compiled
def set_wear_derivatives(memory, derivatives, value):
    """Set the derivatives by the states of a term that is ``value`` times the log wear factor."""
    derivatives[INSERT] = value
    derivatives[HISTORY] = value
    derivatives[LOT] = value
    derivatives[WEAR_SPEED] = value * memory.mean_log_speed
    derivatives[WEAR_FEED] = value * memory.mean_log_feed


@compiled
def learn_wear(memory, mean, covariance, log_factor, variance, scratch):
    """Correct the estimate by a measured log ratio of wear to the nominal wear."""
    derivatives = scratch.derivatives[0]
    derivatives[:] = 0.0
    set_wear_derivatives(memory, derivatives, 1.0)
    surprise = log_factor - log_wear_factor(memory, mean)
    correct(mean, covariance, derivatives, surprise, variance, scratch.gain)


@compiled
def wear_edge(model, memory, mean, covariance, reading, old_wear):
    """Add the present depth, hardness, speed and feed to those that the edge has cut.

    ``old_wear``: share of its wear that it had before this step, 0 for a fresh edge.
    """
    # Wear grows as W = a t^n under constant conditions. So the share of the used life that this
    # step added is 1 - (old wear / wear)^(1/n). The history is the mean over the used life:
    #     history becomes (1 - fresh) * history + fresh * (c * depth + h * hardness)
    fresh = 1.0 - exp(log(old_wear) / model.wear_time) if old_wear > 0.0 else 1.0
    log_speed = log(reading.cutting_speed)
    log_feed = log(reading.feed)
    memory.mean_log_speed += fresh * (log_speed - model.reference_log_speed - memory.mean_log_speed)
    memory.mean_log_feed += fresh * (log_feed - model.reference_log_feed - memory.mean_log_feed)
    by_depth = fresh * model.wear_by_depth
    by_hardness = fresh * model.wear_by_hardness
    mean[HISTORY] += by_depth * mean[DEPTH] + by_hardness * mean[HARDNESS] - fresh * mean[HISTORY]
    # P <- T P T', where T changes the history alone: first its row, then its column.
    covariance[HISTORY] += (
        by_depth * covariance[DEPTH]
        + by_hardness * covariance[HARDNESS]
        - fresh * covariance[HISTORY]
    )
    columns = covariance.T
    columns[HISTORY] += (
        by_depth * columns[DEPTH] + by_hardness * columns[HARDNESS] - fresh * columns[HISTORY]
    )


@compiled
def forget(mean, covariance, first, last, model):
    """Reset the states ``first`` to ``last - 1`` to the prior, which has the mean 0."""
    for k in range(first, last):
        mean[k] = 0.0
        covariance[k, :] = 0.0
        covariance[:, k] = 0.0
        covariance[k, k] = model.prior[k]


@compiled
def distance_moved(model, memory, reading):
    """Return the distance since the last reading [mm], by the drives' response to commands.

    Numbers, arrays or tensors of PyTorch.

    Args:
        model: has ``load_filter.travel_numbers_of``.
        memory: has ``speed`` [m/min] and ``feed`` [mm/rev] at the last reading.
        reading: has the commands since then.
    """
    # Speed and feed approach their commands V and f from V + dV and f + df, as first-order lags.
    # With the shares r and s that remain in a sub-step, the distance is the sum over sub-steps of
    #     (V + dV r) (f + df s) = V f + dV f r + V df s + dV df r s
    speed = reading.commanded_cutting_speed
    feed = reading.commanded_feed
    over_speed = memory.speed - speed
    over_feed = memory.feed - feed
    moved = model.sub_steps * (speed * feed) + over_speed * feed * model.spindle_left
    return (
        model.sub_step
        * model.velocity
        * (moved + speed * over_feed * model.feed_left + over_speed * over_feed * model.both_left)
    )


@compiled
def on_track(model, path, cutting):
    """Return the tool's path [mm], corrected if the reading says that it is elsewhere.

    ``cutting``: whether the tool is in metal by the reading.
    """
    start = model.pitch * math.floor(path / model.pitch)
    along = path - start
    in_air = along < model.approach
    # The position moves to the nearer end of the stretch that it cannot be on.
    if cutting and in_air:
        if along > 0.5 * model.approach:
            return start + model.approach
        return max(start - ON_EDGE, 0.0)
    if not cutting and not in_air:
        if along > 0.5 * model.pitch:
            return start + (model.pitch + ON_EDGE)
        return start + max(model.approach - ON_EDGE, 0.0)
    return path


@compiled
def transition(rate, distance):
    """Return the transition of a field and its slope over a distance [mm]."""
    # State-space form of a process with the Matern 3/2 correlation (Hartikainen and Särkkä 2010,
    # "Kalman filtering and smoothing solutions to temporal Gaussian process regression models").
    step = rate * distance
    left = exp(-step)
    return Transition(
        field_field=(1.0 + step) * left,
        field_slope=distance * left,
        slope_field=-rate * step * left,
        slope_slope=(1.0 - step) * left,
    )


@compiled
def growth(model, k, t):
    """Return the noise that the transition ``t`` adds to the states k and k + 1."""
    # The process is stationary: Q = P0 - T P0 T', where P0 is the prior.
    field = model.prior[k]
    slope = model.prior[k + 1]
    kept_field = t.field_field * t.field_field * field + t.field_slope * t.field_slope * slope
    kept_both = t.field_field * t.slope_field * field + t.field_slope * t.slope_slope * slope
    kept_slope = t.slope_field * t.slope_field * field + t.slope_slope * t.slope_slope * slope
    return Growth(field=field - kept_field, both=-kept_both, slope=slope - kept_slope)


@compiled
def turn(rows, k, t):
    """Multiply the rows k and k + 1 of a matrix by the transition ``t``."""
    for j in range(STATES):
        field = rows[k, j]
        slope = rows[k + 1, j]
        rows[k, j] = t.field_field * field + t.field_slope * slope
        rows[k + 1, j] = t.slope_field * field + t.slope_slope * slope


@compiled
def move_on(model, mean, covariance, distance):
    """Move the estimate of depth and hardness along the bar by a distance [mm]."""
    move_field(model, mean, covariance, DEPTH, transition(model.depth_rate, distance))
    move_field(model, mean, covariance, HARDNESS, transition(model.hardness_rate, distance))


@compiled
def move_field(model, mean, covariance, k, t):
    """Move the estimate of a field and its slope, the states k and k + 1, by a transition."""
    field = mean[k]
    slope = mean[k + 1]
    mean[k] = t.field_field * field + t.field_slope * slope
    mean[k + 1] = t.slope_field * field + t.slope_slope * slope
    # P <- T P T' + Q
    turn(covariance, k, t)
    turn(covariance.T, k, t)
    noise = growth(model, k, t)
    covariance[k, k] += noise.field
    covariance[k, k + 1] += noise.both
    covariance[k + 1, k] += noise.both
    covariance[k + 1, k + 1] += noise.slope


@compiled
def log_load_ratio(model, memory, mean, law, depth, hardness, place, derivatives):
    """Return the log ratio of a law's load to the nominal load, and set its derivatives.

    ``depth`` and ``hardness``: relative deviation of depth and log hardness [-]; derivatives by
    the other states do not depend on them. ``place``: speed, feed and wear. ``derivatives``, shape
    (STATES,), is overwritten. ``load_filter.py`` gives the equation.
    """
    first = LAWS + ERRORS * law
    depth_ratio = max(1.0 + depth, MIN_DEPTH)
    exponent = model.wear_exponents[law] + mean[first + WEAR_ERROR]
    # Log of the nominal wear term over that at the reference, and what the wear factor adds to it.
    growth = model.wear_growths[law]
    nominal_term = log_wear_term(growth, place.log_wear) - log_wear_term(
        growth, model.reference_log_wear
    )
    log_factor = log_wear_factor(memory, mean)
    factor = term_of_factor(growth, place.log_wear, log_factor)
    derivatives[:] = 0.0
    derivatives[DEPTH] = model.depth_exponents[law] / depth_ratio
    derivatives[HARDNESS] = model.hardness_exponents[law]
    slope = wear_term_slope(growth, place.log_wear + log_factor)
    set_wear_derivatives(memory, derivatives, exponent * slope)
    derivatives[first + BIAS] = 1.0
    derivatives[first + SPEED_ERROR] = place.log_speed
    derivatives[first + FEED_ERROR] = place.log_feed
    derivatives[first + WEAR_ERROR] = nominal_term + factor
    by_bar = (
        model.depth_exponents[law] * log(depth_ratio) + model.hardness_exponents[law] * hardness
    )
    by_errors = (
        mean[first + BIAS]
        + mean[first + SPEED_ERROR] * place.log_speed
        + mean[first + FEED_ERROR] * place.log_feed
        + mean[first + WEAR_ERROR] * nominal_term
    )
    return by_bar + exponent * factor + by_errors


@compiled
def learn_loads(model, memory, mean, covariance, reading, time_in_metal, scratch):
    """Correct the estimate by measured force and power; ``time_in_metal``: in this step [s]."""
    for law in (FORCE, POWER):
        compare_load(model, memory, mean, law, reading, time_in_metal, scratch)
    # Both loads were linearised at the same mean. The first correction moves the mean, so the
    # surprise of the second is taken at the moved mean.
    mean_before = scratch.mean_before
    mean_before[:] = mean
    for law in (FORCE, POWER):
        variance = scratch.variance[law]
        if variance > 0.0:
            derivatives = scratch.derivatives[law]
            surprise = scratch.surprise[law]
            for k in range(STATES):
                surprise -= derivatives[k] * (mean[k] - mean_before[k])
            correct(mean, covariance, derivatives, surprise, variance, scratch.gain)


@compiled
def compare_load(model, memory, mean, law, reading, time_in_metal, scratch):
    """Compare a measured load with the expected one; set its fields in ``scratch`` for ``correct``.

    The fields are the derivatives of the log load by the states, the surprise log(measured /
    expected) [-] and its variance, 0 if the reading tells nothing. ``law`` is ``FORCE`` or
    ``POWER``, ``time_in_metal`` the time in metal within the step [s].
    """
    speed = reading.cutting_speed
    cutting = reading.nominal_wear > 0.0 and reading.cutting != 0
    log_speed = log(speed)
    log_feed = log(reading.feed)
    log_wear = log(reading.nominal_wear if cutting else model.wear_criterion)
    nominal = 0.0
    if cutting:
        nominal = exp(
            model.log_coefficients[law]
            + model.speed_exponents[law] * log_speed
            + model.feed_exponents[law] * log_feed
            + model.wear_exponents[law] * log_wear_term(model.wear_growths[law], log_wear)
        )
    load = reading.power if law == POWER else reading.thrust_force
    if law == POWER and cutting:
        memory.idle = model.idle_power * speed / nominal
        if model.separates_idle > 0.0:
            load -= model.idle_power * speed
        else:
            nominal += model.idle_power * speed

    # The sensor is a first-order lag of the load, which stood still before the tool entered.
    lag = model.lags[law]
    expected = memory.expected[law] * decay(model.interval, lag) + nominal * (
        1.0 - decay(time_in_metal, lag)
    )
    memory.expected[law] = expected
    scratch.variance[law] = 0.0
    # Only a sensor that has covered half of its way to the load tells enough about it.
    if cutting and expected > 0.5 * nominal and load > MIN_READING * nominal:
        # Behind its lag a reading depends on when the tool entered, which is known to a sub-step:
        # half of one changes the log of the expected reading by ``timing``.
        timing = 0.0
        if lag > 0.0:
            timing = 0.5 * model.sub_step * (nominal / expected - 1.0) / lag
        place = Place(
            log_speed=log_speed - model.reference_log_speed,
            log_feed=log_feed - model.reference_log_feed,
            log_wear=log_wear,
        )
        derivatives = scratch.derivatives[law]
        depth = mean[DEPTH]
        hardness = mean[HARDNESS]
        estimate = log_load_ratio(model, memory, mean, law, depth, hardness, place, derivatives)
        scratch.surprise[law] = log(load / expected) - estimate
        scratch.variance[law] = model.noise[law] + timing * timing
        memory.measured = 1


@compiled
def decay(time, time_constant):
    """Return the share of a deviation that remains after a time [s].

    It is exp(-time / time_constant), or 0 for a time constant of 0.
    """
    if time_constant > 0.0:
        return exp(-time / time_constant)
    return 0.0 if time > 0.0 else 1.0


@compiled
def correct(mean, covariance, derivatives, surprise, variance, gain):
    """Correct an estimate, in place, by a measured number.

    Args:
        mean: states, shape (STATES,).
        covariance: their covariance, shape (STATES, STATES).
        derivatives: those of the expected number by the states, shape (STATES,).
        surprise: measured less expected number.
        variance: that of the measurement's noise.
        gain: shape (STATES,), overwritten.
    """
    # Kalman's equations for one number, with the derivatives H and the variance R:
    #     g = P H',  S = H g + R,  mean += g / S * surprise,  P -= g g' / S
    spread = variance
    for i in range(STATES):
        gain[i] = 0.0
        for j in range(STATES):
            gain[i] += covariance[i, j] * derivatives[j]
        spread += derivatives[i] * gain[i]
    for i in range(STATES):
        share = gain[i] / spread
        mean[i] += share * surprise
        for j in range(i + 1):  # the lower triangle is copied, so P stays symmetric to the last bit
            value = covariance[i, j] - share * gain[j]
            covariance[i, j] = value
            covariance[j, i] = value


@compiled_entry
def learn_states(memories, means, covariances, chosen, true_states, variance):
    """Correct the estimates by ``TrueStates``, see ``LoadFilter.tell``."""
    scratch = new_scratch()
    for i in chosen:
        mean = means[i]
        covariance = covariances[i]
        memories[i].measured = 1
        learn_state(mean, covariance, DEPTH, true_states.depth[i], variance, scratch)
        learn_state(mean, covariance, HARDNESS, true_states.log_hardness[i], variance, scratch)
        log_factor = true_states.log_wear_factor[i]
        learn_wear(memories[i], mean, covariance, log_factor, variance, scratch)


@compiled
def learn_state(mean, covariance, k, value, variance, scratch):
    """Correct the estimate by a measurement of the state k."""
    derivatives = scratch.derivatives[0]
    derivatives[:] = 0.0
    derivatives[k] = 1.0
    correct(mean, covariance, derivatives, value - mean[k], variance, scratch.gain)


@compiled_entry
def look_ahead(models, memories, means, covariances, distances, entering, outlook):
    """Fill in an ``Outlook`` of arrays of shape (num_envs, points), see ``LoadFilter.outlook``."""
    # The states of edge and laws do not move with distance, so their part of load and variance
    # is computed once for all points. ``products``: their covariance with all states.
    derivatives = np.empty(STATES)
    products = np.empty((2, STATES))
    loads = np.empty(2)
    variances = np.empty(2)
    for env in range(len(memories)):
        model = models[env % len(models)]
        mean = means[env]
        covariance = covariances[env]
        for law in (FORCE, POWER):
            loads[law] = load_of_edge(model, memories[env], mean, law, derivatives)
            variances[law] = variance_of_edge(covariance, derivatives, products[law])
        for k in range(distances.shape[1]):
            bar = bar_ahead(model, mean, distances[env, k], entering[env, k])
            outlook.depth_of_cut[env, k] = model.depth_of_cut * bar.depth_ratio
            outlook.log_hardness[env, k] = bar.log_hardness
            outlook.log_force[env, k] = load_of_bar(model, FORCE, bar, loads[FORCE])
            outlook.log_power[env, k] = load_of_bar(model, POWER, bar, loads[POWER])
            outlook.force_spread[env, k] = spread_of_load(
                model, FORCE, bar, covariance, variances[FORCE], products[FORCE]
            )
            outlook.power_spread[env, k] = spread_of_load(
                model, POWER, bar, covariance, variances[POWER], products[POWER]
            )


@compiled
def load_of_edge(model, memory, mean, law, derivatives):
    """Return the log ratio of load to nominal load on a nominal bar, and set its derivatives.

    The ratio is that at 1 m/min, 1 mm/rev and the wear criterion: it scales the nominal law with
    the expected exponents. The derivatives are those at the present speed and feed.
    """
    log_wear = model.reference_log_wear
    if memory.nominal_wear > 0.0:
        log_wear = log(memory.nominal_wear)
    here = Place(
        log_speed=log(memory.speed) - model.reference_log_speed,
        log_feed=log(memory.feed) - model.reference_log_feed,
        log_wear=log_wear,
    )
    origin = Place(
        log_speed=-model.reference_log_speed,
        log_feed=-model.reference_log_feed,
        log_wear=log(model.wear_criterion),
    )
    load = log_load_ratio(model, memory, mean, law, 0.0, 0.0, origin, derivatives)
    load_here = log_load_ratio(model, memory, mean, law, 0.0, 0.0, here, derivatives)
    if law == POWER:
        # A separated idle power does not grow with the errors of the cut's power.
        idle = memory.idle * exp(-load_here) if model.separates_idle > 0.0 else memory.idle
        load += log(1.0 + idle)
    return load


@compiled
def variance_of_edge(covariance, derivatives, products):
    """Return the variance of a log load by the states of edge and laws.

    Set ``products``, the covariance of this part of the log load with all states.
    """
    variance = 0.0
    for i in range(STATES):
        total = 0.0
        for j in range(INSERT, STATES):
            total += covariance[i, j] * derivatives[j]
        products[i] = total
        variance += derivatives[i] * total if i >= INSERT else 0.0
    return variance


@compiled
def bar_ahead(model, mean, distance, entering):
    """Return the ``BarAhead`` at a distance ahead [mm].

    ``entering``: whether the point lies on a bar that has not been measured. Then depth and
    hardness are those of the prior.
    """
    if entering:
        return BarAhead(
            depth_ratio=1.0,
            log_hardness=0.0,
            depth_variance=model.prior[DEPTH],
            hardness_variance=model.prior[HARDNESS],
            depth_by_depth=0.0,
            depth_by_slope=0.0,
            hardness_by_hardness=0.0,
            hardness_by_slope=0.0,
        )
    t_depth = transition(model.depth_rate, distance)
    t_hardness = transition(model.hardness_rate, distance)
    depth = t_depth.field_field * mean[DEPTH] + t_depth.field_slope * mean[DEPTH_SLOPE]
    return BarAhead(
        depth_ratio=max(1.0 + depth, MIN_DEPTH),
        log_hardness=t_hardness.field_field * mean[HARDNESS]
        + t_hardness.field_slope * mean[HARDNESS_SLOPE],
        depth_variance=growth(model, DEPTH, t_depth).field,
        hardness_variance=growth(model, HARDNESS, t_hardness).field,
        depth_by_depth=t_depth.field_field,
        depth_by_slope=t_depth.field_slope,
        hardness_by_hardness=t_hardness.field_field,
        hardness_by_slope=t_hardness.field_slope,
    )


@compiled
def load_of_bar(model, law, bar, load_of_edge):
    """Return the log ratio of load to nominal load at a point ahead."""
    return (
        load_of_edge
        + model.depth_exponents[law] * log(bar.depth_ratio)
        + model.hardness_exponents[law] * bar.log_hardness
    )


@compiled
def spread_of_load(model, law, bar, covariance, variance_of_edge, products):
    """Return the standard deviation of a log load at a point ahead."""
    # Var(H x) with H = (bar, edge), split as H_b P_bb H_b' + 2 H_b P_be H_e' + H_e P_ee H_e'.
    by_depth = model.depth_exponents[law] / bar.depth_ratio
    by_hardness = model.hardness_exponents[law]
    derivatives = (
        by_depth * bar.depth_by_depth,
        by_depth * bar.depth_by_slope,
        by_hardness * bar.hardness_by_hardness,
        by_hardness * bar.hardness_by_slope,
    )
    variance = (
        variance_of_edge
        + by_depth * by_depth * bar.depth_variance
        + by_hardness * by_hardness * bar.hardness_variance
    )
    for i in range(INSERT):
        total = 2.0 * products[i]
        for j in range(INSERT):
            total += covariance[i, j] * derivatives[j]
        variance += derivatives[i] * total
    return math.sqrt(min(max(variance, 0.0), MAX_SPREAD * MAX_SPREAD))
