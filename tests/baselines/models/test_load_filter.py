"""The filter finds what it cannot see, and forgets what has been replaced."""

import math

import numpy as np
import pytest

from baselines.models.kalman_steps import (
    BIAS,
    DEPTH,
    ERRORS,
    FEED_ERROR,
    FORCE,
    HARDNESS,
    HISTORY,
    INSERT,
    LAWS,
    LOT,
    POWER,
    SPEED_ERROR,
    STATES,
    WEAR_ERROR,
    WEAR_FEED,
    WEAR_SPEED,
    TrueStates,
)
from baselines.models.load_filter import (
    MISFIT,
    READING_DEVIATION,
    SLOPE,
    LawErrors,
    LoadFilter,
    filter_numbers_of,
    model_of,
    records,
)
from tests.turning_env.playing import NO_SPREAD, changed
from turning_env import Reading, RoughTurningVectorEnv, Scenario, read

NOMINAL = Scenario()
QUIET = changed(
    NOMINAL, workpiece=NO_SPREAD, tool={"wear_factor_spread": 0.0, "edge_strength": 1e6}
)
NUM_ENVS = 4
ALL = np.ones(NUM_ENVS, np.bool_)


def heavier(factor: float) -> Scenario:
    """Return a task whose bars all take so many times the nominal force and power."""
    material = {}
    for name in ("thrust_force", "power"):
        law = getattr(QUIET.material, name).model_dump()
        material[name] = law | {"coefficient": factor * law["coefficient"]}
    return changed(QUIET, material=material)


def follow(played: Scenario, nominal: Scenario, steps: int) -> tuple[LoadFilter, Reading]:
    """Return a filter after a play at constant speed and feed, and its last reading."""
    env = RoughTurningVectorEnv(NUM_ENVS, played)
    estimate = LoadFilter([nominal], NUM_ENVS)
    observations, _ = env.reset(seed=0)
    estimate.reset(ALL)
    for _ in range(steps):
        reading = read(observations, nominal)
        estimate.observe(reading)
        observations, *_ = env.step(np.zeros((NUM_ENVS, 2)))
    return estimate, reading


@pytest.mark.compiled
@pytest.mark.parametrize("factor", [0.85, 1.15])
def test_it_finds_by_how_much_the_loads_differ(factor: float) -> None:
    estimate, reading = follow(heavier(factor), NOMINAL, steps=60)
    assert reading.cutting.all()
    distance = np.zeros((NUM_ENVS, 1))
    outlook = estimate.outlook(distance, entering=np.zeros((NUM_ENVS, 1), np.bool_))
    expected = np.full((NUM_ENVS, 1), np.log(factor))
    assert outlook.log_force == pytest.approx(expected, abs=0.04)
    assert outlook.log_power == pytest.approx(expected, abs=0.03)


@pytest.mark.compiled
def test_it_finds_the_wear_of_an_edge_by_a_law_with_a_fresh_edges_share() -> None:
    """The nominal model is that of the lathe, but for the edge, which wears faster."""
    force = QUIET.material.thrust_force.model_dump()
    force |= {"coefficient": 17000.0, "wear": 1.0, "wear_growth": 6.0}
    nominal = changed(QUIET, material={"thrust_force": force}, tool={"wear_factor_spread": 0.3})
    played = changed(nominal, mismatch={"wear_factor": 1.4}, tool={"wear_factor_spread": 0.0})
    estimate, reading = follow(played, nominal, steps=60)
    assert (reading.nominal_wear > 0.05).all()
    assert estimate.log_wear_factor == pytest.approx(np.full(NUM_ENVS, np.log(1.4)), abs=0.08)


@pytest.mark.compiled
def test_it_learns_the_lot_from_the_wear_of_removed_edges() -> None:
    nominal = changed(
        QUIET,
        sensors={"inspects_edges": True},
        control={"edge_changes": "commanded"},
    )
    played = changed(nominal, mismatch={"wear_factor": 1.3})
    # Only the law of wear is in doubt: its error has the mean 0.2 and the variance 1.
    errors = LawErrors(mean=np.zeros(11), covariance=np.zeros((11, 11)))
    errors.mean[0] = 0.2
    errors.covariance[0, 0] = 1.0
    env = RoughTurningVectorEnv(NUM_ENVS, played)
    estimate = LoadFilter([nominal], NUM_ENVS, errors)
    observations, _ = env.reset(seed=0)
    estimate.reset(ALL)
    start = estimate.mean[0, LOT]
    assert start == pytest.approx(0.2 * nominal.material.wear.time)
    actions = np.zeros((NUM_ENVS, 3))
    for step in range(61):
        estimate.observe(read(observations, nominal))
        # An edge is changed every half minute.
        actions[:, 2] = 1.0 if step % 30 == 29 else -1.0
        observations, *_ = env.step(actions)
    assert estimate.mean[:, LOT] == pytest.approx(np.log(1.3), abs=0.05)
    assert estimate.mean[:, INSERT] == pytest.approx(0.0, abs=0.05)
    estimate.reset(ALL)
    assert (estimate.mean[:, LOT] == start).all()


BY_HAND = changed(
    Scenario(),
    material={
        "wear": {
            "coefficient": 0.02,
            "cutting_speed": 0.75,
            "feed": 0.5,
            "depth_of_cut": 0.5,
            "time": 0.25,
            "hardness": 0.3,
        },
        "thrust_force": {
            "coefficient": 3000.0,
            "cutting_speed": -0.25,
            "feed": 0.5,
            "depth_of_cut": 0.8,
            "wear": 1.5,
            "hardness": 0.6,
        },
        "power": {
            "coefficient": 0.05,
            "cutting_speed": 1.0,
            "feed": 0.75,
            "depth_of_cut": 0.9,
            "wear": 0.5,
            "wear_growth": 4.0,
            "hardness": 0.4,
        },
    },
    tool={"wear_criterion": 0.4, "wear_factor_spread": 0.12},
    sensors={
        "force_noise": 0.05,
        "power_noise": 0.02,
        "force_time_constant": 0.5,
        "power_time_constant": 0.25,
    },
    machine={"spindle_time_constant": 0.8, "feed_time_constant": 0.0},
    spindle={"idle_torque": 6.0},
    workpiece={
        "diameter": 100.0,
        "bar_length": 300.0,
        "approach": 20.0,
        "depth_of_cut": 2.0,
        "depth_bar_spread": 0.3,
        "depth_along_spread": 0.4,
        "depth_correlation_length": 25.0,
        "hardness_bar_spread": 0.05,
        "hardness_along_spread": 0.12,
        "hardness_correlation_length": 40.0,
    },
    control={
        "interval": 2.0,
        "sub_steps": 4,
        "initial_cutting_speed": 100.0,
        "initial_feed": 0.2,
    },
)
# The spreads are those of triangles: 0.3 and 0.4 of 2 mm make 25 %, 5 and 12 per cent 13 %.
DEPTH_SPREAD = 0.25
DEPTH_RATE = SLOPE * 0.2 / 25.0
HARDNESS_SPREAD = 0.13
HARDNESS_RATE = SLOPE * 0.12 / 40.0


@pytest.mark.parametrize("errors", [False, True])
def test_the_numbers_of_a_nominal_model_by_hand(errors: bool) -> None:
    numbers = filter_numbers_of(BY_HAND, errors)
    history = (0.5 * DEPTH_SPREAD) ** 2 + (0.3 * HARDNESS_SPREAD) ** 2
    insert = 0.12**2 if errors else 0.12**2 + history
    prior = [DEPTH_SPREAD**2, DEPTH_RATE**2, HARDNESS_SPREAD**2, HARDNESS_RATE**2, insert]
    noise = np.array([0.05**2 + 1e-6, 0.02**2 + 1e-6])
    spindle = np.exp(-0.5 * np.arange(1, 5) / 0.8)
    expected = {
        "depth_of_cut": 2.0,
        "approach": 20.0,
        "bar_length": 300.0,
        "pitch": 320.0,
        # 1 m/min at 0.1 pi m a turn, and 1 mm a turn.
        "velocity": 1.0 / (0.1 * math.pi) / 60.0,
        "depth_rate": DEPTH_RATE / DEPTH_SPREAD,
        "hardness_rate": HARDNESS_RATE / HARDNESS_SPREAD,
        "prior": [*prior, *[0.0] * (STATES - 5)],
        "history": 0.0 if errors else history,
        "wear_by_depth": 0.5 if errors else 0.0,
        "wear_by_hardness": 0.3 if errors else 0.0,
        "wear_time": 0.25,
        "separates_idle": float(errors),
        # At a wear of 1 mm, or of a fresh edge.
        "log_coefficients": [math.log(3000.0 * 0.8**0.8), math.log(0.05 * 0.8**0.9)],
        "speed_exponents": [-0.25, 1.0],
        "feed_exponents": [0.5, 0.75],
        "wear_exponents": [1.5, 0.5],
        "wear_growths": [0.0, 4.0],
        "depth_exponents": [0.8, 0.9],
        "hardness_exponents": [0.6, 0.4],
        "reference_log_speed": math.log(100.0),
        "reference_log_feed": math.log(0.2),
        "reference_log_wear": math.log(0.2),
        "lags": [0.5, 0.25],
        "noise": noise + 0.02**2 if errors else noise,
        "interval": 2.0,
        "sub_step": 0.5,
        "spindle_left": spindle.sum(),
        "feed_left": 0.0,
        "both_left": 0.0,
        "sub_steps": 4,
        "wear_criterion": 0.4,
        # 6 N m at 120 m/min and 100 mm, 40 rad/s, are 0.24 kW.
        "idle_power": 0.002,
    }
    assert numbers.keys() == expected.keys()
    for name, value in expected.items():
        assert np.asarray(numbers[name], float) == pytest.approx(np.asarray(value)), name
    assert (SLOPE, READING_DEVIATION, MISFIT) == (1.603, 1e-3, 0.02)
    # The mean square slope of nodes' fields is that of pi / 2 + 1.
    assert pytest.approx(math.sqrt(math.pi / 2.0 + 1.0), abs=1e-3) == SLOPE


def test_both_lags_multiply() -> None:
    scenario = changed(BY_HAND, machine={"feed_time_constant": 0.4})
    numbers = filter_numbers_of(scenario, errors=False)
    times = 0.5 * np.arange(1, 5)
    both = np.exp(-times / 0.8) * np.exp(-times / 0.4)
    assert numbers["both_left"] == pytest.approx(both.sum())
    assert numbers["feed_left"] == pytest.approx(np.exp(-times / 0.4).sum())


def test_bars_of_one_metal_have_no_rates() -> None:
    numbers = filter_numbers_of(changed(BY_HAND, workpiece=NO_SPREAD), errors=False)
    assert (numbers["depth_rate"], numbers["hardness_rate"]) == (0.0, 0.0)
    assert numbers["prior"][:4].tolist() == [0.0] * 4


def test_rows_of_numbers_become_records() -> None:
    found = records([{"one": 1.0, "two": [2.0, 3.0]}, {"one": 4.0, "two": [5.0, 6.0]}])
    assert found["one"].tolist() == [1.0, 4.0]
    assert found[1].two.tolist() == [5.0, 6.0]


def law_errors() -> LawErrors:
    """Return errors with eleven different means, and a covariance of full rank."""
    root = np.random.default_rng(1).normal(0.0, 0.1, (11, 11))
    return LawErrors(mean=0.01 * np.arange(1.0, 12.0), covariance=root @ root.T)


def test_a_model_without_errors_starts_from_the_spreads() -> None:
    model = model_of([BY_HAND, QUIET])
    assert model.mean.shape == (2, STATES)
    assert not model.mean.any()
    assert model.covariance[0] == pytest.approx(np.diag(filter_numbers_of(BY_HAND, False)["prior"]))
    assert model.parameters["wear_criterion"].tolist() == [0.4, 0.3]


def test_errors_of_used_life_become_those_of_wear() -> None:
    """Wear is the used life to the power n = 0.25; the error of its exponent is relative."""
    errors = law_errors()
    model = model_of([BY_HAND], errors)
    scales = np.array([0.25, 0.75, 0.25, *[1.0] * 8])
    assert model.mean[0, LOT:] == pytest.approx(scales * errors.mean)
    expected = errors.covariance * np.outer(scales, scales)
    assert model.covariance[0, LOT:, LOT:] == pytest.approx(expected)
    prior = filter_numbers_of(BY_HAND, True)["prior"]
    assert model.covariance[0, :LOT, :LOT] == pytest.approx(np.diag(prior[:LOT]))
    assert not model.covariance[0, :LOT, LOT:].any()


def filled(errors: LawErrors | None = None) -> LoadFilter:
    """Return a filter of two environments with an estimate by random numbers."""
    estimate = LoadFilter([BY_HAND, QUIET], 2, errors)
    random = np.random.default_rng(2)
    roots = random.normal(0.0, 0.1, (2, STATES, STATES))
    estimate.mean[:] = random.normal(0.0, 0.1, (2, STATES))
    estimate.covariance[:] = roots @ roots.transpose(0, 2, 1)
    estimate.memory["mean_log_speed"] = (0.2, 0.3)
    estimate.memory["mean_log_feed"] = (-0.1, 0.4)
    return estimate


def test_a_reset_returns_environments_of_a_mask_to_their_models() -> None:
    estimate = filled(law_errors())
    before = estimate.mean[0].copy()
    estimate.memory["path"] = 7.0
    estimate.reset(np.array([False, True]))
    prior = model_of([BY_HAND, QUIET], law_errors())
    np.testing.assert_array_equal(estimate.mean[1], prior.mean[1])
    np.testing.assert_array_equal(estimate.covariance[1], prior.covariance[1])
    np.testing.assert_array_equal(estimate.mean[0], before)
    assert estimate.memory["path"].tolist() == [7.0, 0.0]


def test_an_environment_can_get_another_model() -> None:
    estimate = filled(law_errors())
    before = estimate.mean[0].copy()
    model = model_of([BY_HAND], law_errors())
    estimate.assign(1, model)
    assert estimate.parameters["wear_criterion"].tolist() == [0.4, 0.4]
    np.testing.assert_array_equal(estimate.mean[1], model.mean[0])
    np.testing.assert_array_equal(estimate.covariance[1], model.covariance[0])
    np.testing.assert_array_equal(estimate.mean[0], before)


def test_one_model_serves_all_environments() -> None:
    estimate = LoadFilter([BY_HAND], 3)
    estimate.reset(np.ones(3, np.bool_))
    expected = model_of([BY_HAND]).covariance[0]
    for covariance in estimate.covariance:
        np.testing.assert_array_equal(covariance, expected)


def test_the_deviations_of_the_prior_give_the_history_the_scale_of_the_insert() -> None:
    deviations = LoadFilter([BY_HAND], 1, law_errors()).prior_deviations[0]
    covariance = model_of([BY_HAND], law_errors()).covariance[0]
    expected = np.sqrt(np.diag(covariance))
    expected[HISTORY] = 0.12
    assert deviations == pytest.approx(expected)


def test_the_position_is_counted_from_the_bars_approach() -> None:
    estimate = filled()
    pitch = QUIET.workpiece.bar_length + QUIET.workpiece.approach
    estimate.memory["path"] = (700.0, 0.9 * pitch)
    assert estimate.along == pytest.approx([60.0, 0.9 * pitch])


def test_the_wear_factor_and_its_deviation_are_a_weighted_sum() -> None:
    estimate = filled()
    for i, (by_speed, by_feed) in enumerate(((0.2, -0.1), (0.3, 0.4))):
        row = np.zeros(STATES)
        row[[INSERT, HISTORY, LOT]] = 1.0
        row[[WEAR_SPEED, WEAR_FEED]] = (by_speed, by_feed)
        assert estimate.log_wear_factor[i] == pytest.approx(row @ estimate.mean[i])
        variance = row @ estimate.covariance[i] @ row
        assert estimate.wear_deviation[i] == pytest.approx(math.sqrt(variance))
    estimate.covariance[0] = -np.eye(STATES)
    assert estimate.wear_deviation[0] == 0.0


def test_the_expected_errors_of_the_laws_count_from_their_references() -> None:
    estimate = filled()
    mean = estimate.mean[0]
    wear = estimate.wear_errors
    # At 1 m/min and 1 mm/rev instead of 100 and 0.2.
    log_wear = mean[LOT] - mean[WEAR_SPEED] * math.log(100.0) - mean[WEAR_FEED] * math.log(0.2)
    assert wear.log_wear[0] == pytest.approx(log_wear)
    assert wear.speed_exponent[0] == mean[WEAR_SPEED]
    assert wear.feed_exponent[0] == mean[WEAR_FEED]

    loads = estimate.load_errors
    exponents = estimate.exponents
    for law, terms in ((FORCE, (0.4, 0.2)), (POWER, (1.0 + 4.0 * 0.4, 1.0 + 4.0 * 0.2))):
        first = LAWS + ERRORS * law
        worn_out, reference = terms
        expected = (
            mean[first + BIAS]
            - mean[first + SPEED_ERROR] * math.log(100.0)
            - mean[first + FEED_ERROR] * math.log(0.2)
            + mean[first + WEAR_ERROR] * math.log(worn_out / reference)
        )
        assert loads[law, 0] == pytest.approx(expected)
        nominal = (-0.25, 0.5, 1.5) if law == FORCE else (1.0, 0.75, 0.5)
        assert exponents.speed[law, 0] == pytest.approx(nominal[0] + mean[first + SPEED_ERROR])
        assert exponents.feed[law, 0] == pytest.approx(nominal[1] + mean[first + FEED_ERROR])
        assert exponents.wear[law, 0] == pytest.approx(nominal[2] + mean[first + WEAR_ERROR])


def test_the_growth_of_wear_terms_is_that_at_the_criterion() -> None:
    growths = LoadFilter([BY_HAND], 3).worn_out_growths
    assert growths.shape == (2, 3)
    assert growths[FORCE].tolist() == [0.0] * 3
    assert growths[POWER] == pytest.approx([1.6] * 3)


def first_reading() -> Reading:
    env = RoughTurningVectorEnv(2, BY_HAND)
    observations, _ = env.reset(seed=0)
    return read(observations, BY_HAND)


@pytest.mark.parametrize(("mask", "observed"), [(None, [1, 1]), ([False, True], [0, 1])])
def test_only_the_environments_of_a_mask_observe(
    mask: list[bool] | None, observed: list[int]
) -> None:
    estimate = LoadFilter([BY_HAND], 2)
    estimate.reset(np.ones(2, np.bool_))
    reading = first_reading()
    estimate.observe(reading, None if mask is None else np.array(mask))
    expected = np.where(observed, reading.cutting_speed, 0.0)
    assert estimate.memory["speed"] == pytest.approx(expected)
    assert estimate.memory["feed"] == pytest.approx(np.where(observed, reading.feed, 0.0))


def test_true_states_are_told_with_their_deviation() -> None:
    estimate = LoadFilter([BY_HAND], 2)
    estimate.reset(np.ones(2, np.bool_))
    truth = TrueStates(np.array([9.0, 0.1]), np.array([9.0, 0.2]), np.array([9.0, 0.0]))
    estimate.tell(np.array([False, True]), truth, deviation=0.25)
    # A prior variance of 0.25^2, as large as that of the measurement.
    assert estimate.mean[1, DEPTH] == pytest.approx(0.05)
    assert estimate.covariance[1, DEPTH, DEPTH] == pytest.approx(0.5 * 0.0625)
    hardness = 0.2 * HARDNESS_SPREAD**2 / (HARDNESS_SPREAD**2 + 0.0625)
    assert estimate.mean[1, HARDNESS] == pytest.approx(hardness)
    assert not estimate.mean[0].any()
    assert estimate.memory["measured"].tolist() == [0, 1]


def test_the_outlook_ahead_by_hand() -> None:
    """The state is certain but for the bars; a point ahead, and one on a new bar."""
    estimate = LoadFilter([BY_HAND], 2)
    estimate.reset(np.ones(2, np.bool_))
    estimate.covariance[:] = 0.0
    estimate.mean[1, DEPTH] = 0.1
    estimate.mean[1, HARDNESS] = -0.2
    estimate.mean[1, INSERT] = 0.3
    estimate.memory["speed"] = 100.0
    estimate.memory["feed"] = 0.2
    estimate.memory["nominal_wear"] = 0.1
    estimate.memory["idle"] = 0.05
    distance = np.tile([0.0, 10.0, 10.0], (2, 1))
    outlook = estimate.outlook(distance, np.tile([False, False, True], (2, 1)))

    step = DEPTH_RATE / DEPTH_SPREAD * 10.0
    depth = 0.1 * (1.0 + step) * math.exp(-step)
    hard_step = HARDNESS_RATE / HARDNESS_SPREAD * 10.0
    hardness = -0.2 * (1.0 + hard_step) * math.exp(-hard_step)
    assert outlook.depth_of_cut[1] == pytest.approx([2.2, 2.0 * (1.0 + depth), 2.0])
    assert outlook.log_hardness[1] == pytest.approx([-0.2, hardness, 0.0])
    wear = 0.4 * math.exp(0.3)
    force = 1.5 * 0.3
    power = 0.5 * math.log((1.0 + 4.0 * wear) / (1.0 + 4.0 * 0.4)) + math.log(1.05)
    bars = [(0.1, -0.2), (depth, hardness), (0.0, 0.0)]
    expected_force = [force + 0.8 * math.log(1.0 + d) + 0.6 * h for d, h in bars]
    expected_power = [power + 0.9 * math.log(1.0 + d) + 0.4 * h for d, h in bars]
    assert outlook.log_force[1] == pytest.approx(expected_force)
    assert outlook.log_power[1] == pytest.approx(expected_power)
    new_force = math.hypot(0.8 * DEPTH_SPREAD, 0.6 * HARDNESS_SPREAD)
    new_power = math.hypot(0.9 * DEPTH_SPREAD, 0.4 * HARDNESS_SPREAD)
    assert outlook.force_spread[1, [0, 2]] == pytest.approx([0.0, new_force])
    assert outlook.power_spread[1, [0, 2]] == pytest.approx([0.0, new_power])
    assert 0.0 < outlook.force_spread[1, 1] < new_force
    assert outlook.depth_of_cut[0] == pytest.approx([2.0] * 3)
