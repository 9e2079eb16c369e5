"""The greatest return of an edge for policies that know a bar only by its readings: a belief-state bound.

It is an information relaxation with penalties (Brown, Smith and Sun 2010, doi 10.1287/opre.1090.0796). The clairvoyant bound
knows the loads of every step and sets the feed right at the limit. Here, every action is scored by its expected gain given the
readings so far: the penalty takes back what the loads turned out to be. What is still known in advance is how beliefs will move,
and thus which bars will come.

The lathe is idealised, as for the clairvoyant bound: nothing lags, no force breaks the edge, any speed and feed may follow any
other, and wear is known. Settings are chosen once per stretch of metal of a fixed length, at whose start force and power are
read; a longer stretch means fewer readings and older ones. Then the beliefs do not depend on the actions, and dynamic
programming over the used share D of the edge's life gives the bound of a seed.
"""

import math

import numpy as np
from numpy.typing import NDArray

from baselines.models.normal import excess
from baselines.oracles.cells import between, start_episode_of, survey
from studies.exact_filter import WEAR, NodeFilter
from turning_env import Scenario
from turning_env.numerics.compilation import compiled, compiled_entry
from turning_env.physics.records import STATE, new_records, scratch_records

Array = NDArray[np.float64]

BARS = 24
"""Length of the row for a nominal insert, which lasts for half of it; the row's end hardly matters then."""
LIVES = 100
"""Steps of the used share of life."""
_POINTS = np.array([0.25, 0.75])  # of a stretch, at which loads are expected
_SPEEDS = np.array([-0.1, -0.05, 0.0, 0.05, 0.1])  # log steps from the speed at which force and power meet their limits
_LADDER = 4  # speeds beside them
_FEEDS = np.arange(-0.16, 0.09, 0.02)  # log steps from the feed at the limit


def bound(scenario: Scenario, seed: int, stretch: float = 3.2, lives: int = LIVES) -> float:
    """Return the bound on the return [s] of a seed's first episode.

    Args:
        scenario: task, which the clairvoyant bound must cover, without depth profile, skin or base speed.
        seed: seed of the episode.
        stretch: length of metal [mm] cut with one setting; 3.2 mm are a second of the best policies.
        lives: steps of the root of the used share of life.
    """
    scratch = scratch_records(scenario)
    states = new_records(STATE, 1)
    states["seed"][0, 0] = seed
    start_episode_of(states, scratch)
    cells = round(scenario.workpiece.bar_length / stretch)
    wear = scenario.material.wear
    fields = np.empty((3, cells))
    survey(states, scratch, fields, cells)
    log_wear_factor = fields[2, 0]
    bars = math.ceil(BARS * math.exp(-log_wear_factor / wear.time))
    fields = np.empty((3, bars * cells))
    survey(states, scratch, fields, cells)
    lengths, beliefs = _beliefs(scenario, fields, bars, np.random.default_rng(seed))
    life = wear.depth_of_cut * np.log(beliefs[0] / scenario.workpiece.depth_of_cut) + wear.hardness * beliefs[1]
    beliefs[1] = np.exp((life + log_wear_factor) / wear.time)
    return float(_best_return(states, scratch, lengths, beliefs, _SPEEDS, _LADDER, _FEEDS, lives))


def _beliefs(scenario: Scenario, fields: Array, bars: int, generator: np.random.Generator) -> tuple[Array, Array]:
    """Return the stretches' lengths [mm], shape (bars, stretches), and what is believed at their points before they are cut.

    The beliefs, shape (6, bars, stretches, points), are the fields of ``Outlook``.
    """
    work = scenario.workpiece
    truth = fields[:2].reshape(2, bars, -1)
    cells = truth.shape[2]
    length = work.bar_length / cells
    known = NodeFilter(scenario, bars)
    known._prior[WEAR] = known._history = 0.0
    known.reset(np.ones(bars, np.bool_))
    lengths, beliefs = np.full((bars, cells + 1), length), np.empty((6, bars, cells + 1, len(_POINTS)))
    lengths[:, [0, -1]] *= 0.5  # readings are in the middle of cells
    place = 0.0
    for i in range(cells + 1):
        passed = lengths[0, i - 1] if i else 0.0
        place += passed
        known._path[:] = work.approach + place
        transition, growth = known._transition(np.full(bars, passed))
        known._mean = np.einsum("nij,nj->ni", transition, known._mean)
        known._covariance = transition @ known._covariance @ transition.swapaxes(1, 2) + growth
        if i:
            log_depth, log_hardness = truth[0, :, i - 1] - np.log(work.depth_of_cut), truth[1, :, i - 1]
            loads, derivatives = known._loads(known._mean)
            factors = np.zeros((bars, 3))
            factors[:, 0], factors[:, 1] = log_depth, log_hardness
            noise = np.sqrt(known._noise) * generator.normal(size=loads.shape)
            known._correct(derivatives, factors @ known._exponents.T + noise - loads, np.broadcast_to(known._noise, loads.shape))
        beliefs[:, :, i] = known.ahead(np.outer(lengths[:, i], _POINTS))
    return lengths, beliefs


@compiled
def expected_excess(log_mean, spread):
    """Return the expectation of max(X - 1, 0), where log X is normal with this mean and standard deviation."""
    spread = max(spread, 1e-3)
    return 0.0 if log_mean < -6.0 * spread else excess(log_mean, spread)[0]


@compiled_entry
def _best_return(states, scratches, lengths, beliefs, speed_steps, ladder, feed_steps, lives):
    """Return the bound on the return [s]; ``beliefs`` as from ``_beliefs``, with the factor on the rate of wear in place 1."""
    state, p = states[0], scratches[0].parameters
    wear_law, force_law, power_law = p.wear_law, p.force_law, p.power_law
    low_speed, high_speed = np.log(p.cutting_speed_min), np.log(p.cutting_speed_max)
    low_feed, high_feed = np.log(p.feed_min), np.log(p.feed_max)
    crossing = 60.0 / p.revolutions_per_metre  # time [s] of 1 mm at 1 m/min and 1 mm/rev
    air = p.approach * crossing * np.exp(-high_speed - high_feed)
    log_depth = np.log(p.depth_of_cut)
    at_nominal = wear_law.log_coefficient + wear_law.depth_of_cut * log_depth - p.log_wear_criterion
    nominal_life = at_nominal * p.life_exponent - np.log(60.0)
    speeds = np.empty(speed_steps.shape[0] + 2 + ladder)
    values, next_values = np.zeros(lives + 1), np.zeros(lives + 1)
    points = beliefs.shape[3]
    meet = force_law.cutting_speed * power_law.feed - force_law.feed * power_law.cutting_speed
    for bar in range(lengths.shape[0] - 1, -1, -1):
        for i in range(lengths.shape[1] - 1, -1, -1):
            length = lengths[bar, i]
            depth, rate, force_mean, power_mean = 0.0, 0.0, 0.0, 0.0
            for q in range(points):
                depth += beliefs[0, bar, i, q] / points
                rate += beliefs[1, bar, i, q] / points
                force_mean += beliefs[2, bar, i, q] / points
                power_mean += beliefs[3, bar, i, q] / points
            worth = length * 60.0 / p.revolutions_per_metre / p.reference_removal_rate * depth
            for j in range(lives):
                used = (j / lives) ** 2
                log_wear = p.log_wear_criterion + wear_law.time * np.log(max(used, 1e-9))
                force = force_law.log_coefficient + force_law.depth_of_cut * log_depth + force_law.wear * log_wear
                force -= np.log(p.thrust_force_limit)
                power = power_law.log_coefficient + power_law.depth_of_cut * log_depth + power_law.wear * log_wear
                power -= np.log(p.power_limit)
                f, w = force + force_mean, power + power_mean
                for k in range(speeds.shape[0]):
                    if k < speed_steps.shape[0]:
                        speed = (w * force_law.feed - f * power_law.feed) / meet + speed_steps[k]
                    elif k == speed_steps.shape[0]:
                        speed = -(f + force_law.feed * high_feed) / force_law.cutting_speed
                    elif k == speed_steps.shape[0] + 1:
                        speed = -(w + power_law.feed * high_feed) / power_law.cutting_speed
                    else:
                        share = (k - speed_steps.shape[0] - 2) / max(ladder - 1, 1)
                        speed = low_speed + (high_speed - low_speed) * (0.4 + 0.6 * share)
                    speeds[k] = min(max(speed, low_speed), high_speed)
                best = -np.inf
                for speed in speeds:
                    kink = min(
                        -(f + force_law.cutting_speed * speed) / force_law.feed,
                        -(w + power_law.cutting_speed * speed) / power_law.feed,
                    )
                    kink = min(max(kink, low_feed), high_feed)
                    for step in feed_steps:
                        feed = min(max(kink + step, low_feed), high_feed)
                        time = length * crossing * np.exp(-speed - feed)
                        f_here = force + force_law.cutting_speed * speed + force_law.feed * feed
                        w_here = power + power_law.cutting_speed * speed + power_law.feed * feed
                        over = 0.0
                        for q in range(points):
                            over += expected_excess(f_here + beliefs[2, bar, i, q], beliefs[4, bar, i, q]) / points
                            over += expected_excess(w_here + beliefs[3, bar, i, q], beliefs[5, bar, i, q]) / points
                        taylor = nominal_life + (wear_law.cutting_speed * speed + wear_law.feed * feed) * p.life_exponent
                        using = rate * np.exp(taylor) * time
                        gain = worth - time * (1.0 + p.overload_price * over) - p.edge_price * using
                        after = used + using
                        if after >= 1.0:
                            gain *= (1.0 - used) / using
                        else:
                            gain += between(next_values, np.sqrt(after) * lives)
                        best = max(best, gain)
                values[j] = best
            values[lives] = 0.0
            if i == 0:
                values[:lives] -= air
            values, next_values = next_values, values
    return between(next_values, np.sqrt(min(state.used_life[0], 1.0)) * lives)
