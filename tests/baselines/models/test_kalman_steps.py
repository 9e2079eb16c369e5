"""The filter's equations against matrices of NumPy and SciPy, and by hand."""

import inspect
import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from baselines.models.kalman_steps import (
    BIAS,
    DEPTH,
    DEPTH_SLOPE,
    ERRORS,
    FEED_ERROR,
    FORCE,
    HARDNESS,
    HARDNESS_SLOPE,
    HISTORY,
    INSERT,
    LAWS,
    LOT,
    MEMORY,
    ON_EDGE,
    POWER,
    SPEED_ERROR,
    STATES,
    WEAR_ERROR,
    WEAR_FEED,
    WEAR_SPEED,
    Place,
    TrueStates,
    bar_ahead,
    compare_load,
    correct,
    decay,
    distance_moved,
    follow_one,
    forget,
    growth,
    learn_loads,
    learn_state,
    learn_states,
    learn_wear,
    load_of_bar,
    load_of_edge,
    log_load_ratio,
    log_wear_factor,
    look_ahead,
    move_on,
    new_scratch,
    on_track,
    replace_edge,
    spread_of_load,
    transition,
    variance_of_edge,
    wear_edge,
)
from baselines.models.load_filter import Outlook

PRIOR = np.array([0.04, 0.0004, 0.01, 0.00001, 0.02, *[0.0] * (STATES - 5)])
MODEL: dict[str, Any] = {
    "depth_of_cut": 2.0,
    "approach": 20.0,
    "bar_length": 300.0,
    "pitch": 320.0,
    "velocity": 0.05,
    "depth_rate": 0.1,
    "hardness_rate": 0.03,
    "prior": PRIOR,
    "history": 0.004,
    "wear_by_depth": 0.3,
    "wear_by_hardness": 0.5,
    "wear_time": 0.5,
    "separates_idle": 1.0,
    "log_coefficients": (7.0, -1.0),
    "speed_exponents": (-0.4, 0.8),
    "feed_exponents": (0.3, 0.6),
    "wear_exponents": (1.1, 0.35),
    "wear_growths": (0.0, 4.0),
    "depth_exponents": (0.75, 0.95),
    "hardness_exponents": (0.7, 0.8),
    "reference_log_speed": math.log(100.0),
    "reference_log_feed": math.log(0.2),
    "reference_log_wear": math.log(0.15),
    "lags": (0.5, 2.0),
    "noise": (0.0025, 0.0004),
    "interval": 1.0,
    "sub_step": 0.1,
    "spindle_left": 4.0,
    "feed_left": 2.0,
    "both_left": 1.5,
    "sub_steps": 10,
    "wear_criterion": 0.3,
    "idle_power": 0.002,
}


def model(**changes: Any) -> Any:
    return SimpleNamespace(**(MODEL | changes))


def memory(**values: Any) -> Any:
    """Return a memory in the middle of the second bar."""
    record = np.zeros(1, MEMORY)[0]
    usual = {"path": 500.0, "speed": 120.0, "feed": 0.3, "cutting_time": 2.0, "nominal_wear": 0.1}
    usual |= {"mean_log_speed": 0.2, "mean_log_feed": -0.1}
    for name, value in (usual | values).items():
        record[name] = value
    return record


def estimate(seed: int = 0) -> tuple[Any, Any]:
    """Return a random mean and covariance."""
    random = np.random.default_rng(seed)
    root = random.normal(0.0, 0.1, (STATES, STATES))
    return random.normal(0.0, 0.1, STATES), root @ root.T + 0.001 * np.eye(STATES)


def reading(**values: float) -> Any:
    usual = {
        "commanded_cutting_speed": 120.0,
        "commanded_feed": 0.3,
        "cutting_speed": 120.0,
        "feed": 0.3,
        "cutting_time": 2.1,
        "nominal_wear": 0.11,
        "removed_wear": 0.0,
        "thrust_force": 500.0,
        "power": 8.0,
        "cutting": 1,
    }
    return SimpleNamespace(**(usual | values))


def updated(mean: Any, covariance: Any, rows: Any, surprise: Any, noise: Any) -> tuple[Any, Any]:
    """Return an estimate after some measurements at once, by dense matrices."""
    innovation = rows @ covariance @ rows.T + np.diag(noise)
    gain = covariance @ rows.T @ np.linalg.inv(innovation)
    return mean + gain @ surprise, covariance - gain @ innovation @ gain.T


def test_the_states_have_places_of_their_own() -> None:
    places = [DEPTH, DEPTH_SLOPE, HARDNESS, HARDNESS_SLOPE, INSERT, HISTORY, LOT]
    places += [WEAR_SPEED, WEAR_FEED]
    for law in (FORCE, POWER):
        for error in (BIAS, SPEED_ERROR, FEED_ERROR, WEAR_ERROR):
            places.append(LAWS + ERRORS * law + error)
    assert sorted(places) == list(range(STATES))
    # The slopes follow their fields.
    assert (DEPTH_SLOPE, HARDNESS_SLOPE) == (DEPTH + 1, HARDNESS + 1)


def test_a_correction_is_kalmans() -> None:
    mean, covariance = estimate()
    row = np.random.default_rng(1).normal(size=STATES)
    expected = updated(mean, covariance, row[np.newaxis], np.array([0.3]), [0.02])
    correct(mean, covariance, row, 0.3, 0.02, np.empty(STATES))
    assert mean == pytest.approx(expected[0])
    assert covariance == pytest.approx(expected[1])
    np.testing.assert_array_equal(covariance, covariance.T)


@pytest.mark.parametrize(("rate", "distance"), [(0.1, 3.0), (0.02, 80.0), (0.5, 0.0)])
def test_a_field_moves_as_the_matern_process_of_scipy(rate: float, distance: float) -> None:
    """The process with correlation (1 + a) exp(-a) has d2f/dx2 = -rate^2 f - 2 rate df/dx."""
    matrix = expm(distance * np.array([[0.0, 1.0], [-rate * rate, -2.0 * rate]]))
    moved = np.array(transition(rate, distance)).reshape(2, 2)
    assert moved == pytest.approx(matrix, abs=1e-12)
    prior = np.zeros(STATES)
    prior[HARDNESS] = 0.04
    prior[HARDNESS + 1] = 0.04 * rate * rate
    added = growth(model(prior=prior), HARDNESS, transition(rate, distance))
    stationary = np.diag(prior[HARDNESS : HARDNESS + 2])
    noise = stationary - matrix @ stationary @ matrix.T
    assert added.field == pytest.approx(noise[0, 0], abs=1e-15)
    assert added.both == pytest.approx(noise[0, 1], abs=1e-15)
    assert added.slope == pytest.approx(noise[1, 1], abs=1e-15)


def test_depth_and_hardness_move_along_the_bar_each_with_its_rate() -> None:
    mean, covariance = estimate()
    matrix = np.eye(STATES)
    noise = np.zeros((STATES, STATES))
    for place, rate in ((DEPTH, 0.1), (HARDNESS, 0.03)):
        part = slice(place, place + 2)
        step = expm(5.0 * np.array([[0.0, 1.0], [-rate * rate, -2.0 * rate]]))
        prior = np.diag(PRIOR[part])
        matrix[part, part] = step
        noise[part, part] = prior - step @ prior @ step.T
    expected_mean = matrix @ mean
    expected_covariance = matrix @ covariance @ matrix.T + noise
    move_on(model(), mean, covariance, 5.0)
    assert mean == pytest.approx(expected_mean)
    assert covariance == pytest.approx(expected_covariance)


def test_forgotten_states_have_the_prior_and_no_covariance() -> None:
    mean, covariance = estimate()
    kept_mean = mean.copy()
    kept = covariance.copy()
    forget(mean, covariance, HARDNESS, HISTORY, model())
    forgotten = slice(HARDNESS, HISTORY)
    assert mean[forgotten].tolist() == [0.0] * 3
    assert covariance[forgotten, forgotten] == pytest.approx(np.diag(PRIOR[forgotten]))
    others = [k for k in range(STATES) if not HARDNESS <= k < HISTORY]
    assert not covariance[forgotten][:, others].any()
    assert not covariance[others][:, forgotten].any()
    np.testing.assert_array_equal(mean[others], kept_mean[others])
    np.testing.assert_array_equal(covariance[np.ix_(others, others)], kept[np.ix_(others, others)])


def wear_row(mean_log_speed: float = 0.2, mean_log_feed: float = -0.1) -> Any:
    row = np.zeros(STATES)
    row[[INSERT, HISTORY, LOT]] = 1.0
    row[WEAR_SPEED] = mean_log_speed
    row[WEAR_FEED] = mean_log_feed
    return row


def test_the_log_wear_factor_is_a_sum_of_states() -> None:
    mean, _ = estimate()
    assert log_wear_factor(memory(), mean) == pytest.approx(wear_row() @ mean)


def test_measured_wear_and_states_correct_the_estimate() -> None:
    mean, covariance = estimate()
    row = wear_row()
    expected = updated(mean, covariance, row[np.newaxis], np.array([0.4 - row @ mean]), [0.01])
    learn_wear(memory(), mean, covariance, 0.4, 0.01, new_scratch())
    assert mean == pytest.approx(expected[0])
    assert covariance == pytest.approx(expected[1])

    mean, covariance = estimate()
    row = np.eye(STATES)[HARDNESS]
    surprise = np.array([0.3 - mean[HARDNESS]])
    expected = updated(mean, covariance, row[np.newaxis], surprise, [0.02])
    learn_state(mean, covariance, HARDNESS, 0.3, 0.02, new_scratch())
    assert mean == pytest.approx(expected[0])
    assert covariance == pytest.approx(expected[1])


def test_true_states_of_chosen_environments_are_learnt() -> None:
    random = np.random.default_rng(3)
    means = random.normal(0.0, 0.1, (2, STATES))
    covariances = np.stack([estimate(4)[1], estimate(5)[1]])
    memories = np.zeros(2, MEMORY)
    memories["mean_log_speed"] = 0.2
    memories["mean_log_feed"] = -0.1
    before = means[0].copy()
    rows = np.stack([np.eye(STATES)[DEPTH], np.eye(STATES)[HARDNESS], wear_row()])
    surprise = np.array([0.1, 0.2, 0.3]) - rows @ means[1]
    expected = updated(means[1], covariances[1], rows, surprise, [0.01] * 3)
    truth = TrueStates(
        depth=np.array([9.0, 0.1]),
        log_hardness=np.array([9.0, 0.2]),
        log_wear_factor=np.array([9.0, 0.3]),
    )
    learn_states(memories, means, covariances, np.array([1]), truth, 0.01)
    assert means[1] == pytest.approx(expected[0])
    assert covariances[1] == pytest.approx(expected[1])
    np.testing.assert_array_equal(means[0], before)
    assert memories["measured"].tolist() == [0, 1]


@pytest.mark.parametrize(
    ("removed_wear", "nominal_wear", "learns"),
    [(0.12, 0.1, True), (0.0, 0.1, False), (0.12, 0.0, False)],
)
def test_a_removed_edge_tells_its_wear_and_takes_its_states_along(
    removed_wear: float, nominal_wear: float, learns: bool
) -> None:
    mean, covariance = estimate()
    expected_mean = mean.copy()
    expected_covariance = covariance.copy()
    if learns:
        row = wear_row()
        surprise = np.array([math.log(1.2) - row @ mean])
        # 5 per cent.
        expected_mean, expected_covariance = updated(
            mean, covariance, row[np.newaxis], surprise, [0.0025]
        )
    record = memory(nominal_wear=nominal_wear, expected=(3.0, 4.0))
    replace_edge(model(), record, mean, covariance, removed_wear, new_scratch())
    others = [k for k in range(STATES) if k not in (INSERT, HISTORY)]
    assert mean[others] == pytest.approx(expected_mean[others])
    block = np.ix_(others, others)
    assert covariance[block] == pytest.approx(expected_covariance[block])
    assert mean[[INSERT, HISTORY]].tolist() == [0.0, 0.0]
    assert covariance[INSERT, INSERT] == PRIOR[INSERT]
    assert covariance[HISTORY, HISTORY] == 0.0
    assert record.expected.tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("old_wear", "fresh"),
    [
        # W = a t^(1/2): 80 % of the wear are 64 % of the life.
        pytest.param(0.8, 0.36, id="worn"),
        pytest.param(0.0, 1.0, id="fresh edge"),
    ],
)
def test_the_history_is_the_mean_over_the_used_life(old_wear: float, fresh: float) -> None:
    mean, covariance = estimate()
    record = memory()
    matrix = np.eye(STATES)
    matrix[HISTORY, HISTORY] = 1.0 - fresh
    matrix[HISTORY, DEPTH] = fresh * 0.3
    matrix[HISTORY, HARDNESS] = fresh * 0.5
    expected_mean = matrix @ mean
    expected_covariance = matrix @ covariance @ matrix.T
    wear_edge(model(), record, mean, covariance, reading(cutting_speed=150.0, feed=0.25), old_wear)
    assert mean == pytest.approx(expected_mean)
    assert covariance == pytest.approx(expected_covariance)
    assert record.mean_log_speed == pytest.approx(0.2 + fresh * (math.log(1.5) - 0.2))
    assert record.mean_log_feed == pytest.approx(-0.1 + fresh * (math.log(1.25) + 0.1))


@pytest.mark.parametrize(
    ("along", "cutting", "expected"),
    [
        # A bar has 20 mm of air and 300 mm of metal.
        pytest.param(5.0, False, 5.0, id="in air, as read"),
        pytest.param(100.0, True, 100.0, id="in metal, as read"),
        pytest.param(20.0, True, 20.0, id="at the beginning of the metal"),
        pytest.param(15.0, True, 20.0, id="must have entered"),
        pytest.param(10.0, True, -ON_EDGE, id="half-way: must still be in the bar before"),
        pytest.param(5.0, True, -ON_EDGE, id="must still be in the bar before"),
        pytest.param(20.0, False, 20.0 - ON_EDGE, id="must not have entered"),
        pytest.param(160.0, False, 20.0 - ON_EDGE, id="half-way: must not have entered"),
        pytest.param(161.0, False, 320.0 + ON_EDGE, id="must have left"),
    ],
)
def test_a_position_moves_to_the_nearer_end_of_where_it_cannot_be(
    along: float, cutting: bool, expected: float
) -> None:
    found = on_track(model(), 320.0 + along, cutting)
    assert found == pytest.approx(320.0 + expected, abs=1e-12, rel=1e-15)
    assert ON_EDGE == 1e-6


def test_positions_stay_at_or_above_the_start() -> None:
    assert on_track(model(), 5.0, True) == 0.0
    assert on_track(model(approach=0.0), 5.0, False) == 0.0


def test_the_distance_is_that_of_drives_with_lags() -> None:
    """Compared with the sum over ten sub-steps of 0.1 s, of lags of 0.2 and 0.4 s."""
    times = 0.1 * np.arange(1, 11)
    spindle = np.exp(-times / 0.2)
    feed = np.exp(-times / 0.4)
    numbers = model(
        spindle_left=spindle.sum(), feed_left=feed.sum(), both_left=(spindle * feed).sum()
    )
    speeds = 150.0 + (120.0 - 150.0) * spindle
    feeds = 0.2 + (0.3 - 0.2) * feed
    now = reading(commanded_cutting_speed=150.0, commanded_feed=0.2)
    moved = distance_moved(numbers, memory(), now)
    assert moved == pytest.approx(0.1 * 0.05 * (speeds * feeds).sum())


@pytest.mark.parametrize(
    ("time", "constant", "left"),
    [(2.0, 4.0, math.exp(-0.5)), (2.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, 4.0, 1.0)],
)
def test_a_deviation_decays(time: float, constant: float, left: float) -> None:
    assert decay(time, constant) == pytest.approx(left)


PLACE = Place(log_speed=0.3, log_feed=-0.2, log_wear=math.log(0.2))


def wear_term(law: int, wear: float) -> float:
    return 1.0 + 4.0 * wear if law == POWER else wear


def expected_load(law: int, mean: Any) -> float:
    """Return the log ratio of the equation of ``load_filter.py``."""
    first = LAWS + ERRORS * law
    wear = 0.2 * math.exp(wear_row() @ mean)
    term = math.log(wear_term(law, wear) / wear_term(law, 0.2))
    over_reference = math.log(wear_term(law, wear) / wear_term(law, 0.15))
    return (
        MODEL["depth_exponents"][law] * math.log(max(1.0 + mean[DEPTH], 0.05))
        + MODEL["hardness_exponents"][law] * mean[HARDNESS]
        + MODEL["wear_exponents"][law] * term
        + mean[first + BIAS]
        + mean[first + SPEED_ERROR] * 0.3
        + mean[first + FEED_ERROR] * -0.2
        + mean[first + WEAR_ERROR] * over_reference
    )


@pytest.mark.parametrize("law", [FORCE, POWER])
def test_the_log_load_is_that_of_its_equation_and_derivatives_are_differences(law: int) -> None:
    mean, _ = estimate()
    derivatives = np.empty(STATES)
    load = log_load_ratio(
        model(), memory(), mean, law, mean[DEPTH], mean[HARDNESS], PLACE, derivatives
    )
    assert load == pytest.approx(expected_load(law, mean))
    step = 1e-6
    for k in range(STATES):
        above = mean.copy()
        above[k] += step
        below = mean.copy()
        below[k] -= step
        slope = (expected_load(law, above) - expected_load(law, below)) / (2.0 * step)
        assert derivatives[k] == pytest.approx(slope, abs=1e-7), k


def test_a_depth_near_0_is_taken_as_a_twentieth() -> None:
    mean = np.zeros(STATES)
    derivatives = np.empty(STATES)
    load = log_load_ratio(model(), memory(), mean, FORCE, -2.0, 0.0, PLACE, derivatives)
    assert load == pytest.approx(0.75 * math.log(0.05))
    assert derivatives[DEPTH] == pytest.approx(0.75 / 0.05)


def nominal_load(law: int, speed: float = 120.0, feed: float = 0.3, wear: float = 0.11) -> float:
    return float(
        math.exp(MODEL["log_coefficients"][law])
        * speed ** MODEL["speed_exponents"][law]
        * feed ** MODEL["feed_exponents"][law]
        * wear_term(law, wear) ** MODEL["wear_exponents"][law]
    )


@pytest.mark.parametrize("separates", [1.0, 0.0])
@pytest.mark.parametrize("law", [FORCE, POWER])
def test_a_reading_is_compared_with_the_nominal_load_behind_the_sensors_lag(
    law: int, separates: float
) -> None:
    mean, _ = estimate()
    before = (400.0, 6.0)
    record = memory(expected=before)
    scratch = new_scratch()
    compare_load(
        model(separates_idle=separates), record, mean, law, reading(), 0.8, scratch=scratch
    )
    nominal = nominal_load(law)
    idle = 0.002 * 120.0 if law == POWER else 0.0
    load = (500.0, 8.0)[law]
    if law == POWER:
        assert record.idle == pytest.approx(idle / nominal)
    else:
        assert record.idle == 0.0
    if separates:
        load -= idle
    else:
        nominal += idle
    lag = (0.5, 2.0)[law]
    expected = before[law] * math.exp(-1.0 / lag) + nominal * (1.0 - math.exp(-0.8 / lag))
    assert record.expected[law] == pytest.approx(expected)
    place = Place(math.log(1.2), math.log(1.5), log_wear=math.log(0.11))
    derivatives = np.empty(STATES)
    ratio = log_load_ratio(
        model(), memory(), mean, law, mean[DEPTH], mean[HARDNESS], place, derivatives
    )
    assert scratch.surprise[law] == pytest.approx(math.log(load / expected) - ratio)
    # Half a sub-step of 0.1 s in the time of entry.
    timing = 0.05 * (nominal / expected - 1.0) / lag
    assert scratch.variance[law] == pytest.approx((0.0025, 0.0004)[law] + timing**2)
    assert scratch.derivatives[law] == pytest.approx(derivatives)
    assert record.measured == 1


@pytest.mark.parametrize(
    ("changes", "time_in_metal", "tells"),
    [
        pytest.param({}, 1.0, True, id="usual"),
        pytest.param({"cutting": 0}, 1.0, False, id="in air"),
        pytest.param({"nominal_wear": 0.0}, 1.0, False, id="an edge that has not cut"),
        # Half of its way takes 0.5 s * log 2 = 0.347 s.
        pytest.param({}, 0.34, False, id="less than half of the way"),
        pytest.param({}, 0.36, True, id="more than half of the way"),
        pytest.param({"thrust_force": 0.005}, 1.0, False, id="hardly any force"),
    ],
)
def test_readings_that_tell_nothing_have_no_variance(
    changes: dict[str, float], time_in_metal: float, tells: bool
) -> None:
    record = memory()
    scratch = new_scratch()
    scratch.variance[:] = 9.0
    compare_load(
        model(), record, estimate()[0], FORCE, reading(**changes), time_in_metal, scratch=scratch
    )
    assert (scratch.variance[FORCE] > 0.0) == tells
    assert record.measured == int(tells)
    if not tells and changes:
        still = 0.0 if "thrust_force" not in changes else record.expected[FORCE]
        assert record.expected[FORCE] == still


@pytest.mark.parametrize(("share", "tells"), [(0.009, False), (0.011, True)])
def test_a_force_below_a_hundredth_of_the_nominal_one_is_no_cut(share: float, tells: bool) -> None:
    scratch = new_scratch()
    now = reading(thrust_force=share * nominal_load(FORCE))
    compare_load(model(), memory(), estimate()[0], FORCE, now, 1.0, scratch=scratch)
    assert (scratch.variance[FORCE] > 0.0) == tells


def test_a_sensor_without_lag_has_no_timing() -> None:
    scratch = new_scratch()
    record = memory()
    compare_load(model(lags=(0.0, 0.0)), record, estimate()[0], FORCE, reading(), 1.0, scratch)
    assert scratch.variance[FORCE] == 0.0025
    assert record.expected[FORCE] == pytest.approx(nominal_load(FORCE))


def test_force_and_power_correct_the_estimate_as_one_measurement_of_both() -> None:
    mean, covariance = estimate()
    scratch = new_scratch()
    record = memory(expected=(400.0, 6.0))
    for law in (FORCE, POWER):
        compare_load(model(), record, mean, law, reading(), 0.8, scratch=scratch)
    rows = scratch.derivatives.copy()
    expected = updated(mean, covariance, rows, scratch.surprise.copy(), scratch.variance.copy())
    again = memory(expected=(400.0, 6.0))
    learn_loads(model(), again, mean, covariance, reading(), 0.8, new_scratch())
    assert mean == pytest.approx(expected[0])
    assert covariance == pytest.approx(expected[1])


def follow(record: Any, now: Any, **numbers: Any) -> tuple[Any, Any]:
    mean, covariance = estimate()
    follow_one(model(**numbers), record, mean, covariance, now, new_scratch())
    return mean, covariance


def test_a_step_in_metal_moves_wears_and_measures_in_this_order() -> None:
    record = memory(expected=(400.0, 6.0))
    now = reading(commanded_cutting_speed=150.0)
    mean, covariance = estimate()
    moved = distance_moved(model(), memory(), now)
    expected_record = memory(expected=(400.0, 6.0))
    move_on(model(), mean, covariance, moved)
    covariance[INSERT, INSERT] += 0.004 * moved / 300.0
    wear_edge(model(), expected_record, mean, covariance, now, 0.1 / 0.11)
    learn_loads(model(), expected_record, mean, covariance, now, 1.0, new_scratch())
    found = follow(record, now)
    assert found[0] == pytest.approx(mean)
    assert found[1] == pytest.approx(covariance)
    assert record.path == pytest.approx(500.0 + moved)
    names = ("speed", "feed", "cutting_time", "nominal_wear")
    assert [float(record[name]) for name in names] == [120.0, 0.3, 2.1, 0.11]
    assert record.expected == pytest.approx(expected_record.expected)


def test_the_first_reading_moves_nothing() -> None:
    record = memory(path=0.0, speed=0.0, feed=0.0, cutting_time=0.0, nominal_wear=0.0)
    mean, covariance = estimate()
    found = follow(record, reading(cutting=0, cutting_time=0.0, nominal_wear=0.0))
    assert found[0] == pytest.approx(mean)
    assert found[1] == pytest.approx(covariance)
    assert record.path == 0.0
    assert record.speed == 120.0


def test_a_new_bar_is_unknown() -> None:
    record = memory(path=639.99, measured=1)
    now = reading(cutting=0)
    mean, covariance = follow(record, now)
    # The bar is new; the edge and the laws are not.
    assert record.path == pytest.approx(640.0, abs=2.0)
    assert record.path >= 640.0
    assert record.measured == 0
    assert mean[:INSERT].tolist() == [0.0] * 4
    assert np.diag(covariance)[:INSERT] == pytest.approx(PRIOR[:INSERT])
    assert mean[LOT] == estimate()[0][LOT]


def test_only_the_metal_since_the_bar_began_counts_as_cut() -> None:
    """The tool moves 1.8 mm, of which 0.8 mm lie in metal."""
    record = memory(path=320.0 + 19.0, expected=(0.0, 0.0))
    now = reading()
    moved = distance_moved(model(), memory(), now)
    assert moved == pytest.approx(1.8)
    mean, covariance = estimate()
    expected_record = memory(expected=(0.0, 0.0))
    move_on(model(), mean, covariance, 0.8)
    covariance[INSERT, INSERT] += 0.004 * 0.8 / 300.0
    wear_edge(model(), expected_record, mean, covariance, now, 0.1 / 0.11)
    # 0.8 mm at 0.05 * 120 * 0.3 = 1.8 mm/s.
    learn_loads(model(), expected_record, mean, covariance, now, 0.8 / 1.8, new_scratch())
    found = follow(record, now)
    assert found[0] == pytest.approx(mean)
    assert found[1] == pytest.approx(covariance)
    assert record.expected == pytest.approx(expected_record.expected)


@pytest.mark.parametrize(
    ("changes", "slack", "path"),
    [
        # A step of 1.8 mm.
        pytest.param({}, 0.0, 501.8, id="no new edge"),
        pytest.param({"cutting_time": 0.5}, 0.0, 501.8, id="changed, and has cut since"),
        pytest.param({"cutting_time": 0.0}, 0.9, 500.9, id="found worn within the step"),
    ],
)
def test_where_an_edge_failed_the_tool_may_be_farther(
    changes: dict[str, float], slack: float, path: float
) -> None:
    record = memory()
    follow(record, reading(**changes))
    assert record.slack == pytest.approx(slack)
    assert record.path == pytest.approx(path)


def test_slack_adds_up_to_the_most_and_air_bounds_it() -> None:
    record = memory(slack=5.0)
    follow(record, reading(cutting_time=0.0))
    assert record.slack == 5.0
    record = memory(slack=50.0, path=325.0)
    follow(record, reading(cutting=0))
    assert record.slack == 20.0


@pytest.mark.parametrize(("cutting_time", "replaced"), [(2.0, False), (1.99, True)])
def test_an_edge_is_new_if_its_cutting_time_has_fallen(cutting_time: float, replaced: bool) -> None:
    record = memory()
    mean, _ = follow(record, reading(cutting_time=cutting_time, thrust_force=0.0, power=0.0))
    before = estimate()[0]
    assert (mean[INSERT] == 0.0) == replaced
    assert mean[LOT] == before[LOT]
    # A fresh edge's wear is all of this step.
    fresh = 1.0 if replaced else 1.0 - (0.1 / 0.11) ** 2
    assert record.mean_log_speed == pytest.approx(0.2 + fresh * (math.log(1.2) - 0.2))


def test_an_unworn_edge_has_no_history() -> None:
    record = memory(nominal_wear=0.0)
    mean, _ = follow(record, reading(nominal_wear=0.0))
    assert record.mean_log_speed == 0.2
    assert mean[HISTORY] == estimate()[0][HISTORY]


@pytest.mark.parametrize("law", [FORCE, POWER])
@pytest.mark.parametrize("separates", [1.0, 0.0])
def test_the_load_of_an_edge_scales_the_nominal_law_with_the_expected_exponents(
    law: int, separates: float
) -> None:
    mean, _ = estimate()
    record = memory(idle=0.08)
    derivatives = np.empty(STATES)
    load = load_of_edge(model(separates_idle=separates), record, mean, law, derivatives)

    first = LAWS + ERRORS * law
    factor = math.exp(wear_row() @ mean)

    def cut(log_speed: float, log_feed: float, wear: float) -> float:
        """Return the log ratio of the cut's load on a nominal bar."""
        exponent = MODEL["wear_exponents"][law]
        term = math.log(wear_term(law, wear * factor) / wear_term(law, wear))
        over_reference = math.log(wear_term(law, wear * factor) / wear_term(law, 0.15))
        return float(
            exponent * term
            + mean[first + BIAS]
            + mean[first + SPEED_ERROR] * (log_speed - math.log(100.0))
            + mean[first + FEED_ERROR] * (log_feed - math.log(0.2))
            + mean[first + WEAR_ERROR] * over_reference
        )

    expected = cut(0.0, 0.0, 0.3)
    here = cut(math.log(120.0), math.log(0.3), 0.1)
    if law == POWER:
        idle = 0.08 * math.exp(-here) if separates else 0.08
        expected += math.log(1.0 + idle)
    assert load == pytest.approx(expected)
    # The derivatives are those at the present speed and feed.
    assert derivatives[first + SPEED_ERROR] == pytest.approx(math.log(1.2))
    assert derivatives[first + FEED_ERROR] == pytest.approx(math.log(1.5))


def test_an_unworn_edge_is_taken_at_half_the_criterion() -> None:
    mean, _ = estimate()
    derivatives = np.empty(STATES)
    load_of_edge(model(), memory(nominal_wear=0.0), mean, FORCE, derivatives)
    factor = wear_row() @ mean
    assert derivatives[LAWS + WEAR_ERROR] == pytest.approx(factor)


def test_a_new_bar_ahead_is_that_of_the_prior() -> None:
    mean, _ = estimate()
    ahead = bar_ahead(model(), mean, 5.0, True)
    assert ahead == (1.0, 0.0, PRIOR[DEPTH], PRIOR[HARDNESS], 0.0, 0.0, 0.0, 0.0)


def test_a_point_ahead_on_this_bar_follows_from_field_and_slope() -> None:
    mean, _ = estimate()
    ahead = bar_ahead(model(), mean, 5.0, False)
    depth = transition(0.1, 5.0)
    hardness = transition(0.03, 5.0)
    expected = depth.field_field * mean[DEPTH] + depth.field_slope * mean[DEPTH_SLOPE]
    assert ahead.depth_ratio == pytest.approx(1.0 + expected)
    expected = hardness.field_field * mean[HARDNESS]
    expected += hardness.field_slope * mean[HARDNESS_SLOPE]
    assert ahead.log_hardness == pytest.approx(expected)
    assert ahead.depth_variance == growth(model(), DEPTH, depth).field
    assert ahead.hardness_variance == growth(model(), HARDNESS, hardness).field
    assert ahead[4:6] == (depth.field_field, depth.field_slope)
    assert ahead[6:] == (hardness.field_field, hardness.field_slope)
    mean[DEPTH] = -9.0
    assert bar_ahead(model(), mean, 0.0, False).depth_ratio == 0.05


@pytest.mark.parametrize("entering", [False, True])
@pytest.mark.parametrize("law", [FORCE, POWER])
def test_the_spread_of_a_load_ahead_is_that_of_dense_matrices(law: int, entering: bool) -> None:
    mean, covariance = estimate()
    covariance *= 0.1
    derivatives = np.empty(STATES)
    load_of_edge(model(), memory(), mean, law, derivatives)
    products = np.empty(STATES)
    variance = variance_of_edge(covariance, derivatives, products)
    edge = np.where(np.arange(STATES) >= INSERT, derivatives, 0.0)
    assert variance == pytest.approx(edge @ covariance @ edge)
    assert products == pytest.approx(covariance @ edge)

    ahead = bar_ahead(model(), mean, 5.0, entering)
    row = edge.copy()
    by_depth = MODEL["depth_exponents"][law] / ahead.depth_ratio
    by_hardness = MODEL["hardness_exponents"][law]
    row[DEPTH] = by_depth * ahead.depth_by_depth
    row[DEPTH_SLOPE] = by_depth * ahead.depth_by_slope
    row[HARDNESS] = by_hardness * ahead.hardness_by_hardness
    row[HARDNESS_SLOPE] = by_hardness * ahead.hardness_by_slope
    total = row @ covariance @ row
    total += by_depth**2 * ahead.depth_variance + by_hardness**2 * ahead.hardness_variance
    spread = spread_of_load(model(), law, ahead, covariance, variance, products)
    assert spread == pytest.approx(math.sqrt(total))
    load = load_of_bar(model(), law, ahead, 0.5)
    expected = 0.5 + MODEL["depth_exponents"][law] * math.log(ahead.depth_ratio)
    assert load == pytest.approx(expected + by_hardness * ahead.log_hardness)


@pytest.mark.parametrize(("variance", "spread"), [(9.0, 1.0), (0.64, 0.8), (-0.1, 0.0)])
def test_a_spread_lies_within_0_and_1(variance: float, spread: float) -> None:
    ahead = bar_ahead(model(prior=np.zeros(STATES)), np.zeros(STATES), 0.0, True)
    nothing = np.zeros((STATES, STATES))
    found = spread_of_load(model(), FORCE, ahead, nothing, variance, np.zeros(STATES))
    assert found == pytest.approx(spread)


def test_the_outlook_is_that_of_each_environment_and_point() -> None:
    """Three environments of two models; of the second point, the bar is entered."""
    models = [model(), model(depth_of_cut=3.0, separates_idle=0.0)]
    memories = [memory(), memory(speed=150.0), memory(feed=0.4)]
    estimates = [estimate(seed) for seed in range(3)]
    means = np.array([mean for mean, _ in estimates])
    covariances = np.array([covariance for _, covariance in estimates])
    distances = np.array([[5.0, 40.0], [10.0, 60.0], [0.0, 20.0]])
    entering = np.array([[False, True]] * 3)
    outlook = Outlook(*np.full((len(Outlook._fields), 3, 2), np.nan))
    # The function itself, as compiled code takes arrays of records and no keywords.
    inspect.unwrap(look_ahead)(
        models,
        memories,
        means,
        covariances,
        distances=distances,
        entering=entering,
        outlook=outlook,
    )
    for env, of_env in ((0, models[0]), (1, models[1]), (2, models[0])):
        mean, covariance = estimates[env]
        for k in range(2):
            ahead = bar_ahead(of_env, mean, distances[env, k], entering[env, k])
            depth = of_env.depth_of_cut * ahead.depth_ratio
            assert outlook.depth_of_cut[env, k] == pytest.approx(depth)
            assert outlook.log_hardness[env, k] == pytest.approx(ahead.log_hardness)
            for law, loads, spreads in (
                (FORCE, outlook.log_force, outlook.force_spread),
                (POWER, outlook.log_power, outlook.power_spread),
            ):
                derivatives = np.zeros(STATES)
                products = np.zeros(STATES)
                edge = load_of_edge(of_env, memories[env], mean, law, derivatives)
                variance = variance_of_edge(covariance, derivatives, products)
                assert loads[env, k] == pytest.approx(load_of_bar(of_env, law, ahead, edge))
                spread = spread_of_load(of_env, law, ahead, covariance, variance, products)
                assert spreads[env, k] == pytest.approx(spread)
