"""The compiled dynamic programming of ``clairvoyant.py``: true fields of a row of bars, and the best return over its cells."""

import numpy as np

from turning_env.numerics.compilation import compiled, compiled_entry
from turning_env.numerics.functions import exp, log
from turning_env.physics.lathe import start_episode
from turning_env.physics.workpiece import look_up_fields


@compiled
def between(values, place):
    """Return the value between nodes by cubic interpolation through two nodes on either side (Catmull and Rom 1974)."""
    last = values.shape[0] - 1
    node = min(int(place), last - 1)
    x = place - node
    b, c = values[node], values[node + 1]
    a = values[node - 1] if node > 0 else 2.0 * b - c
    d = values[node + 2] if node + 1 < last else 2.0 * c - b
    return b + 0.5 * x * (
        c - a + x * (2.0 * a - 5.0 * b + 4.0 * c - d + x * (3.0 * (b - c) + d - a))
    )


@compiled
def corners(speeds, ladder, log_feeds, force, power, force_law, power_law):
    """Append to the ladder the speeds within it at which two of the limits of force, power and feed meet: often the optimum."""
    rungs = ladder.shape[0]
    for k in range(rungs, speeds.shape[0]):
        if k == rungs:
            above = force_law.feed[0] * power - power_law.feed[0] * force
            slope = (
                power_law.feed[0] * force_law.cutting_speed[0]
                - force_law.feed[0] * power_law.cutting_speed[0]
            )
        elif k == rungs + 1:
            above, slope = force + force_law.feed[0] * log_feeds[1], -force_law.cutting_speed[0]
        else:
            above, slope = power + power_law.feed[0] * log_feeds[1], -power_law.cutting_speed[0]
        corner = above / slope if slope != 0.0 else ladder[0]
        speeds[k] = min(max(corner, ladder[0]), ladder[rungs - 1])


@compiled
def raised(log_values, exponent):
    """Return values, given by their logarithms, to the power of an exponent."""
    return np.array([exp(exponent * each) for each in log_values])


@compiled_entry
def start_episode_of(states, parameters, scratches):
    """Start an episode of the first environment of the only block; the other environments are not used."""
    scratch = scratches[0]
    start_episode(states[0], scratch.work, scratch.report, 0, parameters[0])


@compiled_entry
def survey(states, parameters, scratches, fields, cells):
    """Fill ``fields`` with log depth of cut [mm], log hardness and log wear factor [-] in the middle of each bar's ``cells``."""
    state, p, work = states[0], parameters[0], scratches[0].work
    work.engaged[0] = 1.0
    for i in range(fields.shape[1]):
        work.middle[0] = (i + 0.5) * p.bar_length[0] / cells
        look_up_fields(state, work, 0, 1, p)
        fields[0, i] = log(state.depth_of_cut[0])
        fields[1, i] = state.log_hardness[0]
        fields[2, i] = state.log_wear_factor[0] + state.log_skin_wear[0]


@compiled_entry
def best_return(
    states, parameters, scratches, fields, cells, log_speeds, log_feeds, steps, ripple, lives
):
    """Return (bound on the return [s], cell of the end of the edge at best); ``steps``: log steps from the feed at the limit."""
    state, p = states[0], parameters[0]
    wear_law, force_law, power_law = p.wear_law, p.force_law, p.power_law
    length = p.bar_length[0] / cells  # [mm]
    metal = (
        length * 60.0 / p.revolutions_per_metre[0] / p.reference_removal_rate[0]
    )  # worth of a cell 1 mm deep [s]
    crossing = 60.0 / p.revolutions_per_metre[0]  # time [s] of 1 mm at 1 m/min and 1 mm/rev
    air = p.approach[0] * crossing * exp(-log_speeds[-1] - log_feeds[1])
    life_by_feed = wear_law.feed[0] * p.life_exponent[0]
    feed_factors, life_factors = raised(steps, -1.0), raised(steps, life_by_feed - 1.0)
    force_factors, power_factors = (
        raised(steps, force_law.feed[0]),
        raised(steps, power_law.feed[0]),
    )
    shallowest = log(1.0 - ripple)  # relative amplitude of the depth's run-out
    values, ends = np.zeros(lives + 1), np.full(lives + 1, float(fields.shape[1]))
    next_values, next_ends = values.copy(), ends.copy()
    speeds = np.empty(log_speeds.shape[0] + 3 * (log_speeds.shape[0] > 1))
    speeds[: log_speeds.shape[0]] = log_speeds
    for i in range(fields.shape[1] - 1, -1, -1):
        log_depth, log_hardness = fields[0, i] + shallowest, fields[1, i]
        worth = metal * exp(fields[0, i]) * (1.0 + ripple)
        life = (
            wear_law.log_coefficient[0]
            + wear_law.depth_of_cut[0] * log_depth
            + wear_law.hardness[0] * log_hardness
        )
        life = (life + fields[2, i] - p.log_wear_criterion[0]) * p.life_exponent[0] - log(60.0)
        for j in range(lives):
            used = j / lives
            log_wear = p.log_wear_criterion[0] + wear_law.time[0] * log(max(used, 1e-9))
            force = (
                force_law.log_coefficient[0]
                + force_law.depth_of_cut[0] * log_depth
                + force_law.hardness[0] * log_hardness
            )
            force += force_law.wear[0] * log_wear - log(p.thrust_force_limit[0])
            power = (
                power_law.log_coefficient[0]
                + power_law.depth_of_cut[0] * log_depth
                + power_law.hardness[0] * log_hardness
            )
            power += power_law.wear[0] * log_wear - log(p.power_limit[0])
            corners(speeds, log_speeds, log_feeds, force, power, force_law, power_law)
            best, best_end = -np.inf, 0.0
            for log_speed in speeds:
                force_here = force + force_law.cutting_speed[0] * log_speed
                power_here = power + power_law.cutting_speed[0] * log_speed
                kink = log_feeds[1]
                if force_law.feed[0] > 0.0:
                    kink = min(kink, -force_here / force_law.feed[0])
                if power_law.feed[0] > 0.0:
                    kink = min(kink, -power_here / power_law.feed[0])
                kink = max(kink, log_feeds[0])
                time_at_kink = length * crossing * exp(-log_speed - kink)
                life_rate = exp(
                    life
                    + wear_law.cutting_speed[0] * p.life_exponent[0] * log_speed
                    + life_by_feed * kink
                )
                used_at_kink = life_rate * time_at_kink
                force_at_kink = exp(force_here + force_law.feed[0] * kink)
                power_at_kink = exp(power_here + power_law.feed[0] * kink)
                for k in range(steps.shape[0]):
                    if not log_feeds[0] - 1e-9 <= kink + steps[k] <= log_feeds[1] + 1e-9:
                        continue
                    time = time_at_kink * feed_factors[k]
                    excess = max(force_at_kink * force_factors[k] - 1.0, 0.0) + max(
                        power_at_kink * power_factors[k] - 1.0, 0.0
                    )
                    using = used_at_kink * life_factors[k]
                    gain = (
                        worth
                        - time * (1.0 + p.overload_price[0] * excess)
                        - p.edge_price[0] * using
                    )
                    after = used + using
                    if after >= 1.0:
                        gain *= (1.0 - used) / using
                    else:
                        gain += between(next_values, after * lives)
                    if gain > best:
                        best, best_end = (
                            gain,
                            i + (1.0 - used) / using
                            if after >= 1.0
                            else between(next_ends, after * lives),
                        )
            values[j], ends[j] = best, best_end
        values[lives], ends[lives] = 0.0, float(i)
        if i % cells == 0:
            values[:lives] -= air
        values, next_values = next_values, values
        ends, next_ends = next_ends, ends
    start = min(state.used_life[0], 1.0) * lives
    return between(next_values, start), between(next_ends, start)
