"""The compiled equations of ``load_filter.py``, one environment at a time."""

import math

import numpy as np

from turning_env.numerics.compilation import compiled, compiled_entry
from turning_env.numerics.functions import exp, log

DEPTH, DEPTH_SLOPE, HARDNESS, HARDNESS_SLOPE, INSERT, HISTORY, LOT, WEAR_SPEED, WEAR_FEED, LAWS = (
    range(10)
)
"""States: relative deviation of depth [-], its slope [1/mm], log hardness [-], its slope [1/mm]; log wear factors [-] of the
insert, of the depth and hardness that its edge has cut, and of the lot; errors of the exponents of speed and feed in the law of
wear [-]; from ``LAWS`` on those of the force law, then of the power law: bias and exponents of speed, feed and wear [-]."""
ERRORS = 4
STATES = LAWS + 2 * ERRORS
MIN_DEPTH = 0.05  # least expected depth over the nominal depth [-]: the logarithm has no linear approximation near 0
MAX_SPREAD = 1.0  # upper bound of the log standard deviation of a load [-]: the linear approximation fails beyond it
MIN_READING = 0.01  # share of the expected reading below which a reading is ignored [-]: the tool does not cut
INSPECTION_DEVIATION = (
    0.05  # log standard deviation of a removed edge's wear by its unknown cuts [-] (assumption)
)

_FIELDS = [
    ("path", np.float64),  # travelled distance in air and metal [mm]
    ("speed", np.float64),  # at the last reading [m/min]; 0 before the first
    ("feed", np.float64),  # likewise [mm/rev]
    ("cutting_time", np.float64),  # likewise [min]
    ("nominal_wear", np.float64),  # likewise [mm]
    ("expected", np.float64, 2),  # nominal force [N] and power [kW] behind the sensors' lags
    (
        "idle",
        np.float64,
    ),  # power of the idling spindle over that of the cut in the nominal model [-]
    (
        "pace",
        np.float64,
        2,
    ),  # mean log speed and log feed of the edge over the references, by the life that it used
    ("slack", np.float64),  # how much farther the tool may be [mm]
    ("measured", np.int64),
]
MEMORY = np.dtype((np.record, _FIELDS))


@compiled_entry
def follow(parameters, memory, means, covariances, readings, chosen):
    """Predict up to readings and correct the estimates by them in chosen environments, see ``LoadFilter.observe``."""
    work = np.empty((6, STATES))
    for i in chosen:
        p, m, mean, covariance, reading = (
            parameters[i % len(parameters)],
            memory[i],
            means[i],
            covariances[i],
            readings[i],
        )
        (
            commanded_speed,
            commanded_feed,
            speed,
            feed,
            cutting_time,
            nominal_wear,
            removed_wear,
            force,
            power,
            in_metal,
        ) = reading
        first = m.speed == 0.0
        fresh_edge = cutting_time < m.cutting_time
        if fresh_edge:
            if removed_wear > 0.0 and m.nominal_wear > 0.0:
                learn_wear(
                    m,
                    mean,
                    covariance,
                    log(removed_wear / m.nominal_wear),
                    INSPECTION_DEVIATION**2,
                    work,
                )
            forget(mean, covariance, INSERT, HISTORY + 1, p)
            m.expected[:] = 0.0
        moved = 0.0 if first else distance_moved(p, m, commanded_speed, commanded_feed)
        if (
            fresh_edge and cutting_time == 0.0
        ):  # an edge that is found worn or broken ends the step early, somewhere
            moved *= 0.5
            m.slack = max(m.slack, moved)
        if in_metal == 0.0:
            m.slack = min(m.slack, p.approach)
        bar = math.floor(m.path / p.pitch)
        m.path = on_track(p, m.path + moved, in_metal > 0.0)
        if math.floor(m.path / p.pitch) > bar:
            forget(mean, covariance, DEPTH, INSERT, p)
            m.measured = 0
        metal = max(
            m.path - p.pitch * math.floor(m.path / p.pitch) - p.approach, 0.0
        )  # of this bar, behind the tool [mm]
        cut = min(moved, metal)
        move_on(p, mean, covariance, cut)
        covariance[INSERT, INSERT] += p.history * cut / p.bar_length
        if nominal_wear > 0.0:
            wear_edge(
                p,
                m,
                mean,
                covariance,
                log(speed),
                log(feed),
                0.0 if fresh_edge else m.nominal_wear / nominal_wear,
            )
        time_in_metal = 0.0 if first else min(metal / (p.velocity * (speed * feed)), p.interval)
        wear_in_metal = nominal_wear if in_metal > 0.0 else 0.0
        learn(
            p, m, mean, covariance, speed, feed, wear_in_metal, (force, power), time_in_metal, work
        )
        m.speed, m.feed, m.cutting_time, m.nominal_wear = speed, feed, cutting_time, nominal_wear


@compiled
def wear_factor(m, mean):
    """Return the expected log ratio of the edge's wear to the nominal model."""
    return (
        mean[INSERT]
        + mean[HISTORY]
        + mean[LOT]
        + mean[WEAR_SPEED] * m.pace[0]
        + mean[WEAR_FEED] * m.pace[1]
    )


@compiled
def set_wear_factor(m, derivatives, value):
    """Set the derivatives by the states of something that changes by ``value`` with the log wear factor."""
    derivatives[INSERT:LAWS] = value, value, value, value * m.pace[0], value * m.pace[1]


@compiled
def learn_wear(m, mean, covariance, log_factor, variance, work):
    """Correct the estimate by a measured log ratio of wear to the nominal wear."""
    work[0] = 0.0
    set_wear_factor(m, work[0], 1.0)
    correct(mean, covariance, work[0], log_factor - wear_factor(m, mean), variance, work[1])


@compiled
def wear_edge(p, m, mean, covariance, log_speed, log_feed, old_wear):
    """Add the present depth, hardness, speed and feed to those that the edge has cut; ``old_wear``: share of its wear."""
    fresh = 1.0 - exp(log(old_wear) / p.wear_time) if old_wear > 0.0 else 1.0
    m.pace[0] += fresh * (log_speed - p.references[0] - m.pace[0])
    m.pace[1] += fresh * (log_feed - p.references[1] - m.pace[1])
    of_depth, of_hardness = fresh * p.history_exponents[0], fresh * p.history_exponents[1]
    mean[HISTORY] += of_depth * mean[DEPTH] + of_hardness * mean[HARDNESS] - fresh * mean[HISTORY]
    columns = covariance.T
    covariance[HISTORY] += (
        of_depth * covariance[DEPTH]
        + of_hardness * covariance[HARDNESS]
        - fresh * covariance[HISTORY]
    )
    columns[HISTORY] += (
        of_depth * columns[DEPTH] + of_hardness * columns[HARDNESS] - fresh * columns[HISTORY]
    )


@compiled
def forget(mean, covariance, first, last, p):
    """Reset some states to the prior, which has the mean 0."""
    for k in range(first, last):
        mean[k] = 0.0
        covariance[k, :] = 0.0
        covariance[:, k] = 0.0
        covariance[k, k] = p.prior[k]


@compiled
def distance_moved(p, m, speed, feed):
    """Return the distance since the last reading [mm], from the drives' response to their commands."""
    over_speed, over_feed = m.speed - speed, m.feed - feed
    moved = p.sub_steps * (speed * feed) + over_speed * feed * p.spindle_left
    return (
        p.sub_step
        * p.velocity
        * (moved + speed * over_feed * p.feed_left + over_speed * over_feed * p.both_left)
    )


@compiled
def on_track(p, path, cutting):
    """Return the distance [mm], corrected if it contradicts the reading on whether the tool cuts."""
    start = p.pitch * math.floor(path / p.pitch)
    along = path - start
    in_air = along < p.approach
    if cutting and in_air:
        return start + p.approach if along > 0.5 * p.approach else max(start - 1e-6, 0.0)
    if not cutting and not in_air:
        return start + (p.pitch + 1e-6 if along > 0.5 * p.pitch else max(p.approach - 1e-6, 0.0))
    return path


@compiled
def transition(rate, distance):
    """Return the transition of a field and its slope over a distance [mm]: four numbers of a matrix."""
    step = rate * distance
    left = exp(-step)
    return (1.0 + step) * left, distance * left, -rate * step * left, (1.0 - step) * left


@compiled
def growth(p, k, a, b, c, d):
    """Return the increments of variances and covariance of the states k and k + 1 by the transition (a, b; c, d)."""
    u, v = p.prior[k], p.prior[k + 1]
    return u - (a * a * u + b * b * v), -(a * c * u + b * d * v), v - (c * c * u + d * d * v)


@compiled
def turn(rows, k, a, b, c, d):
    """Multiply the rows k and k + 1 of a matrix by the transition (a, b; c, d)."""
    for j in range(STATES):
        here, slope = rows[k, j], rows[k + 1, j]
        rows[k, j], rows[k + 1, j] = a * here + b * slope, c * here + d * slope


@compiled
def move_on(p, mean, covariance, distance):
    """Move the estimate of depth and hardness along the bar by a distance [mm]."""
    for field in range(2):
        k = 2 * field
        a, b, c, d = transition(p.rates[field], distance)
        mean[k], mean[k + 1] = a * mean[k] + b * mean[k + 1], c * mean[k] + d * mean[k + 1]
        turn(covariance, k, a, b, c, d)
        turn(covariance.T, k, a, b, c, d)
        first, both, second = growth(p, k, a, b, c, d)
        covariance[k, k] += first
        covariance[k, k + 1] += both
        covariance[k + 1, k] += both
        covariance[k + 1, k + 1] += second


@compiled
def log_load(p, m, mean, law, depth, hardness, place, derivatives):
    """Return the log ratio of a law's load to the nominal model, and set its derivatives by the states.

    ``place``: logarithms of speed, feed and nominal wear over the references. ``depth`` and ``hardness``: relative deviation of
    depth and log hardness; derivatives by the other states do not depend on them.
    """
    speed, feed, wear = place
    first = LAWS + ERRORS * law
    factor = wear_factor(m, mean)
    share = max(1.0 + depth, MIN_DEPTH)
    exponent = p.log_laws[law, 3] + mean[first + 3]
    derivatives[:] = 0.0
    derivatives[DEPTH] = p.bar_exponents[law, 0] / share
    derivatives[HARDNESS] = p.bar_exponents[law, 1]
    set_wear_factor(m, derivatives, exponent)
    derivatives[first : first + ERRORS] = 1.0, speed, feed, wear + factor
    of_bar = p.bar_exponents[law, 0] * log(share) + p.bar_exponents[law, 1] * hardness
    of_law = mean[first] + mean[first + 1] * speed + mean[first + 2] * feed + mean[first + 3] * wear
    return of_bar + exponent * factor + of_law


@compiled
def learn(p, m, mean, covariance, speed, feed, nominal_wear, loads, time_in_metal, work):
    """Correct the estimate by measured force and power; without wear the tool does not cut."""
    derivatives, gain, before, surprise, variance = work[:2], work[2], work[3], work[4], work[5]
    cutting = nominal_wear > 0.0
    log_speed, log_feed = log(speed), log(feed)
    log_wear = log(nominal_wear if cutting else p.wear_criterion)
    place = log_speed - p.references[0], log_feed - p.references[1], log_wear - p.references[2]
    for law in range(2):
        own, lag = p.log_laws[law], p.lags[law]
        nominal = (
            exp(own[0] + own[1] * log_speed + own[2] * log_feed + own[3] * log_wear)
            if cutting
            else 0.0
        )
        load = loads[law]
        if law == 1 and cutting:
            m.idle = p.idle_power * speed / nominal
            if p.separates_idle > 0.0:
                load -= p.idle_power * speed
            else:
                nominal += p.idle_power * speed
        expected = m.expected[law] * decay(p.interval, lag) + nominal * (
            1.0 - decay(time_in_metal, lag)
        )
        m.expected[law] = expected
        variance[law] = 0.0
        if cutting and expected > 0.5 * nominal and load > MIN_READING * nominal:
            # Behind its lag a reading depends on when the tool entered, which is known to a sub-step.
            timing = 0.5 * p.sub_step * (nominal / expected - 1.0) / lag if lag > 0.0 else 0.0
            variance[law] = p.noise[law] + timing * timing
            surprise[law] = log(load / expected) - log_load(
                p, m, mean, law, mean[DEPTH], mean[HARDNESS], place, derivatives[law]
            )
            m.measured = 1
    before[:] = mean
    for law in range(2):
        if variance[law] > 0.0:
            for k in range(
                STATES
            ):  # the second measurement meets an estimate that the first has moved
                surprise[law] -= derivatives[law, k] * (mean[k] - before[k])
            correct(mean, covariance, derivatives[law], surprise[law], variance[law], gain)


@compiled
def decay(time, time_constant):
    """Return the share of a deviation that remains after a time [s]: exp(-time / time_constant), 0 for a time constant of 0."""
    if time_constant > 0.0:
        return exp(-time / time_constant)
    return 0.0 if time > 0.0 else 1.0


@compiled
def correct(mean, covariance, derivatives, surprise, variance, gain):
    """Correct an estimate by a measurement; ``surprise`` is measured less expected, ``gain`` is overwritten."""
    spread = variance
    for i in range(STATES):
        gain[i] = 0.0
        for j in range(STATES):
            gain[i] += covariance[i, j] * derivatives[j]
        spread += derivatives[i] * gain[i]
    for i in range(STATES):
        share = gain[i] / spread
        mean[i] += share * surprise
        for j in range(i + 1):
            value = covariance[i, j] - share * gain[j]
            covariance[i, j] = value
            covariance[j, i] = value


@compiled_entry
def learn_states(memory, mean, covariance, chosen, states, variance):
    """Correct the estimates by true states, see ``LoadFilter.tell``."""
    work = np.empty((2, STATES))
    for i in chosen:
        memory[i].measured = 1
        for field in range(2):
            work[0] = 0.0
            work[0, 2 * field] = 1.0
            correct(
                mean[i],
                covariance[i],
                work[0],
                states[i, field] - mean[i, 2 * field],
                variance,
                work[1],
            )
        learn_wear(memory[i], mean[i], covariance[i], states[i, 2], variance, work)


@compiled_entry
def look_ahead(parameters, memory, means, covariances, distances, enterings, found):
    """Fill in ``Outlook``, shape (fields, num_envs, points), see ``LoadFilter.outlook``."""
    derivatives, variances, loads, products = (
        np.empty(STATES),
        np.empty(2),
        np.empty(2),
        np.empty((2, STATES)),
    )
    for env in range(len(memory)):
        p, m, mean, covariance = (
            parameters[env % len(parameters)],
            memory[env],
            means[env],
            covariances[env],
        )
        log_wear = log(m.nominal_wear) - p.references[2] if m.nominal_wear > 0.0 else 0.0
        place = log(m.speed) - p.references[0], log(m.feed) - p.references[1], log_wear
        origin = -p.references[0], -p.references[1], log(p.wear_criterion) - p.references[2]
        for law in range(2):  # what does not depend on the bar
            loads[law] = log_load(p, m, mean, law, 0.0, 0.0, origin, derivatives)
            here = log_load(p, m, mean, law, 0.0, 0.0, place, derivatives)
            if law == 1:
                loads[1] += log(1.0 + (m.idle * exp(-here) if p.separates_idle > 0.0 else m.idle))
            variances[law] = 0.0
            for i in range(STATES):
                total = 0.0
                for j in range(INSERT, STATES):
                    total += covariance[i, j] * derivatives[j]
                products[law, i] = total
                variances[law] += derivatives[i] * total if i >= INSERT else 0.0
        for k in range(distances.shape[1]):
            depth, hardness, free_depth, free_hardness = 0.0, 0.0, p.prior[DEPTH], p.prior[HARDNESS]
            a, b, e, f = 0.0, 0.0, 0.0, 0.0
            if not enterings[env, k]:
                a, b, c, d = transition(p.rates[0], distances[env, k])
                free_depth = growth(p, DEPTH, a, b, c, d)[0]
                e, f, c, d = transition(p.rates[1], distances[env, k])
                free_hardness = growth(p, HARDNESS, e, f, c, d)[0]
                depth = a * mean[DEPTH] + b * mean[DEPTH_SLOPE]
                hardness = e * mean[HARDNESS] + f * mean[HARDNESS_SLOPE]
            share = max(1.0 + depth, MIN_DEPTH)
            found[0, env, k], found[1, env, k] = p.depth_of_cut * share, hardness
            for law in range(2):
                by_depth, by_hardness = p.bar_exponents[law, 0] / share, p.bar_exponents[law, 1]
                derivatives[:INSERT] = by_depth * a, by_depth * b, by_hardness * e, by_hardness * f
                variance = (
                    variances[law]
                    + by_depth * by_depth * free_depth
                    + by_hardness * by_hardness * free_hardness
                )
                for i in range(INSERT):
                    total = 2.0 * products[law, i]
                    for j in range(INSERT):
                        total += covariance[i, j] * derivatives[j]
                    variance += derivatives[i] * total
                found[2 + law, env, k] = (
                    loads[law] + p.bar_exponents[law, 0] * log(share) + by_hardness * hardness
                )
                found[4 + law, env, k] = math.sqrt(min(max(variance, 0.0), MAX_SPREAD * MAX_SPREAD))
