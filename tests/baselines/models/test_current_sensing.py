"""Force from the servo current: filter, root mean square, lag; and the feed that is limited by it."""

import numpy as np
import pytest
from scipy.signal import butter, sosfilt, sosfreqz

from baselines.current_limit import RULES, CurrentLimit
from baselines.fixed import FixedParameters
from baselines.models.current_sensing import ORDER, Butterworth, ForceEstimator, MovingWindow, delay
from baselines.models.part_program import PartProgram
from tests.turning_env.playing import changed
from turning_env import Reading, RoughTurningVectorEnv, Scenario, read
from turning_env.observation import bounds
from turning_env.physics.drives import steady_current
from turning_env.physics.quantities import OBS
from turning_env.physics.records import parameter_records
from turning_env.score.play import play
from turning_env.score.seeds import tuning_seeds
from turning_env.wrappers import FEED_GRADES

CURRENT = Scenario.load("override_current")
STEADY = changed(
    CURRENT,
    workpiece={
        "depth_profile": [],
        "depth_ripple": 0.0,
        "depth_bar_spread": 0.0,
        "depth_along_spread": 0.0,
        "hardness_bar_spread": 0.0,
        "hardness_along_spread": 0.0,
    },
)
EVERY = np.ones(3, np.bool_)


def reading(scenario: Scenario, current: list[float], feed: float = 0.4, force: float = 0.0) -> Reading:
    """Readings of lanes in metal at measured currents [A]."""
    lanes = len(current)
    values = {name: np.zeros(lanes) for name in Reading._fields} | {
        "servo_current": np.array(current),
        "thrust_force": np.full(lanes, force),
        "cutting_speed": np.full(lanes, scenario.control.initial_cutting_speed),
        "feed": np.full(lanes, feed),
    }
    return Reading(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize("preset", ["override", "rough_turning"])
def test_the_presets_with_current_differ_from_their_base_in_the_sensor_alone(preset: str) -> None:
    base, other = Scenario.load(preset), Scenario.load(f"{preset}_current")
    assert changed(base, sensors={"force": "servo_current"}).digest() == other.digest()


def test_the_filter_is_scipys_lane_by_lane() -> None:
    rng = np.random.default_rng(0)
    samples = rng.normal(size=(50, 3, 2))
    ours = Butterworth(3, 2, 0.3)
    filtered = np.array([ours.update(row) for row in samples])
    sections = butter(ORDER, 0.3, output="sos")
    for lane in range(3):
        for signal in range(2):
            # As if the first sample had lasted for ever.
            before = np.full(400, samples[0, lane, signal])
            whole = sosfilt(sections, np.concatenate([before, samples[:, lane, signal]]))
            assert filtered[:, lane, signal] == pytest.approx(whole[400:], abs=1e-9)


def test_a_lane_that_is_reset_starts_anew_and_the_others_go_on() -> None:
    one, other = Butterworth(2, 1, 0.2), Butterworth(2, 1, 0.2)
    for value in (1.0, 5.0, 2.0):
        one.update(np.full((2, 1), value))
        other.update(np.full((2, 1), value))
    one.reset(np.array([True, False]))
    assert one.update(np.full((2, 1), 7.0))[:, 0] == pytest.approx([7.0, other.update(np.full((2, 1), 7.0))[1, 0]])


@pytest.mark.parametrize("cutoff", [0.1, 0.5, 0.9])
def test_the_filters_delay_is_the_slope_of_its_phase(cutoff: float) -> None:
    frequency = 1e-3
    _, response = sosfreqz(butter(ORDER, cutoff, output="sos"), [frequency])
    assert delay(cutoff) == pytest.approx(-np.angle(response[0]) / frequency, rel=1e-3)


def test_the_root_mean_square_is_that_of_the_last_samples() -> None:
    window = MovingWindow(2, 1, 3)
    seen = [window.update(np.array([[value], [2.0]]))[:, 0] for value in (3.0, 4.0, 5.0, 6.0)]
    assert [row[0] for row in seen] == pytest.approx(np.sqrt([9.0, 12.5, 50 / 3, 77 / 3]))
    assert [row[1] for row in seen] == pytest.approx([2.0] * 4)
    window.reset(np.array([True, False]))
    assert window.update(np.array([[1.0], [2.0]]))[:, 0] == pytest.approx([1.0, 2.0])


@pytest.mark.parametrize("force", [0.0, 300.0, 1500.0])
@pytest.mark.parametrize("feed", [0.1, 0.4])
def test_a_current_that_does_not_change_gives_its_force(force: float, feed: float) -> None:
    parameters = parameter_records(CURRENT)[0]
    velocity = CURRENT.control.initial_cutting_speed * parameters.revolutions_per_metre * feed
    current = steady_current(parameters, force, velocity)
    estimator = ForceEstimator(CURRENT, 3, 0.3, 4)
    for _ in range(5):
        estimate = estimator.update(reading(CURRENT, [current] * 3, feed))
    assert estimate.thrust_force == pytest.approx(np.full(3, force), abs=1e-6)
    assert estimate.feed == pytest.approx(np.full(3, feed))


def test_a_current_below_that_of_no_load_is_no_force() -> None:
    estimate = ForceEstimator(CURRENT, 3, 0.3, 4).update(reading(CURRENT, [0.0, 0.1, 0.5]))
    assert estimate.thrust_force.tolist() == [0.0, 0.0, 0.0]


def test_with_a_dynamometer_its_force_is_filtered() -> None:
    scenario = Scenario.load("override")
    estimate = ForceEstimator(scenario, 2, 0.3, 4).update(reading(scenario, [np.nan] * 2, force=700.0))
    assert estimate.thrust_force == pytest.approx([700.0, 700.0])


def test_a_jump_of_the_feed_leaves_it_within_the_machines_range() -> None:
    estimator = ForceEstimator(CURRENT, 1, 0.3, 1)
    machine = CURRENT.machine
    for feed in [machine.feed_max] * 5 + [machine.feed_min] * 20:
        estimate = estimator.update(reading(CURRENT, [1.0], feed))
        assert machine.feed_min <= estimate.feed[0] <= machine.feed_max


def test_filtered_the_error_in_steady_cutting_is_less_than_half() -> None:
    estimator, env = ForceEstimator(STEADY, 4, 0.5, 5), RoughTurningVectorEnv(4, STEADY)
    seen, _ = env.reset(seed=0)
    plain, filtered = [], []
    for step in range(500):
        seen, _, _, _, infos = env.step(np.zeros((4, 1), np.float32))
        values = read(seen, STEADY)
        estimate = estimator.update(values).thrust_force
        if step > 150:
            plain.append(values.thrust_force / infos["thrust_force"] - 1.0)
            filtered.append(estimate / infos["thrust_force"] - 1.0)
    assert np.std(plain) > 0.05
    assert np.std(filtered) < 0.5 * np.std(plain)
    assert abs(np.mean(filtered)) < 0.01


def limit(scenario: Scenario, num_envs: int, share: float = 0.38, hysteresis: float = 0.05) -> CurrentLimit:
    return CurrentLimit(PartProgram(scenario, {}), num_envs, share, hysteresis)


def overrides_played(scenario: Scenario, policy: CurrentLimit, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Override [-] and true thrust force [N] of every interval, shape (steps, 4)."""
    env = RoughTurningVectorEnv(4, scenario)
    seen, _ = env.reset(seed=tuning_seeds(4))
    overrides, forces = [], []
    for _ in range(steps):
        seen, _, _, _, infos = env.step(policy.act(seen))
        overrides.append(infos["commanded_feed"] / scenario.control.initial_feed)
        forces.append(infos["thrust_force"])
    return np.array(overrides), np.array(forces)


def test_the_feed_goes_through_the_grades_alone() -> None:
    overrides, _ = overrides_played(CURRENT, limit(CURRENT, 4), 1000)
    reached = np.maximum(FEED_GRADES, CURRENT.machine.feed_min / CURRENT.control.initial_feed)
    distances = np.abs(overrides[..., np.newaxis] - reached)
    assert distances.min(axis=-1).max() < 1e-6
    assert len(np.unique(distances.argmin(axis=-1))) > 4


@pytest.mark.parametrize("share", [0.25, 0.4])
def test_in_steady_cutting_the_highest_grade_within_the_limit_is_held(share: float) -> None:
    overrides, forces = overrides_played(STEADY, limit(STEADY, 4, share), 700)
    assert np.all(forces[-100:] < 1.02 * share * STEADY.limits.thrust_force)
    law, control = STEADY.material.thrust_force, STEADY.control
    next_grade = FEED_GRADES[FEED_GRADES.index(round(float(overrides[-1, 0]), 1)) + 1]
    next_force = law(control.initial_cutting_speed, next_grade * control.initial_feed, STEADY.workpiece.depth_of_cut)
    assert next_force > 0.93 * share * STEADY.limits.thrust_force


def test_hysteresis_keeps_the_switch_from_chattering() -> None:
    changes = {}
    for hysteresis in (0.0, 0.15):
        overrides, _ = overrides_played(STEADY, limit(STEADY, 4, 0.33, hysteresis), 1200)
        changes[hysteresis] = int((np.abs(np.diff(overrides[300:], axis=0)) > 1e-6).sum())
    assert changes[0.0] > 20
    assert changes[0.15] < 0.2 * changes[0.0]


def test_in_air_and_until_the_estimate_has_settled_the_programmed_feed_is_commanded() -> None:
    policy, env = limit(CURRENT, 2), RoughTurningVectorEnv(2, CURRENT)
    seen, _ = env.reset(seed=0)
    in_metal = 0
    while in_metal <= policy.settling_intervals:
        action = policy.act(seen)
        assert action[:, 0] == pytest.approx([0.0, 0.0])  # half of 200 %
        seen, _, _, _, infos = env.step(action)
        in_metal += int(infos["cutting"][0])
    assert policy.settling_intervals > 3


def test_only_the_lanes_that_are_reset_forget() -> None:
    one, other, env = limit(CURRENT, 3), limit(CURRENT, 3), RoughTurningVectorEnv(3, CURRENT)
    seen, _ = env.reset(seed=0)
    for _ in range(600):
        one.act(seen)
        action = other.act(seen)
        seen = env.step(action)[0]
    one.reset(np.array([False, True, False]))
    reset, remembering = one.act(seen)[:, 0], other.act(seen)[:, 0]
    assert reset[1] == pytest.approx(0.0)
    assert remembering[1] < -0.2
    assert reset[[0, 2]].tolist() == remembering[[0, 2]].tolist()


def test_sensing_the_current_costs_little_and_beats_the_programmed_feed() -> None:
    measured = Scenario.load("override")
    draws = tuning_seeds(4)
    with_current = play(lambda num_envs: limit(CURRENT, num_envs), CURRENT, draws)["return"].mean()
    with_force = play(lambda num_envs: limit(measured, num_envs), measured, draws)["return"].mean()
    control = CURRENT.control
    fixed = FixedParameters(CURRENT, control.initial_cutting_speed, control.initial_feed)
    programmed = play(lambda num_envs: fixed, CURRENT, draws)["return"].mean()
    assert with_current > 1.2 * with_force
    assert with_current > 0.8 * programmed  # both are below 0


def test_it_plays_where_feed_is_set_and_force_is_to_be_limited() -> None:
    def plays(scenario: Scenario) -> bool:
        return any(rule.plays(scenario) for rule in RULES.values())

    for preset in ("override", "override_current", "rough_turning", "rough_turning_current", "shift", "paper"):
        assert plays(Scenario.load(preset)), preset
    assert not plays(Scenario.load("surface"))
    assert not plays(Scenario.load("batch_casting"))
    falling = changed(CURRENT, material={"thrust_force": CURRENT.material.thrust_force.model_copy(update={"feed": -0.1})})
    assert not plays(falling)
    with pytest.raises(ValueError, match=r"material\.thrust_force\.feed is -0\.1"):
        limit(falling, 1)


@pytest.mark.parametrize("preset", ["rough_turning", "shift", "override", "override_current"])
@pytest.mark.parametrize("cutoff", [0.1, 0.9])
def test_actions_are_finite_whatever_is_observed(preset: str, cutoff: float) -> None:
    """Warnings count as errors throughout this suite."""
    scenario = Scenario.load(preset)
    low, high = bounds(scenario)
    rng = np.random.default_rng(0)
    policy = CurrentLimit(PartProgram(scenario, {}), 64, cutoff=cutoff, window=1)
    for _ in range(100):
        anywhere = rng.uniform(low, high, (64, len(low)))
        seen = np.where(rng.random(anywhere.shape) < 0.5, anywhere, rng.choice([low, high], size=64))
        seen[:, OBS.cutting] = rng.random(64) < 0.98
        assert np.all(np.abs(policy.act(seen.astype(np.float32))) <= 1.0)


@pytest.mark.parametrize("preset", ["rough_turning_current", "shift"])
def test_it_plays_at_intervals_of_a_second_with_its_own_program(preset: str) -> None:
    scenario = Scenario.load(preset)
    parameters = {"force_share": 0.9, "cutting_speed": 150.0, "feed": 0.2}
    policy, env = RULES["current_limit_with_speed"].build(scenario, 3, parameters), RoughTurningVectorEnv(3, scenario)
    seen, _ = env.reset(seed=tuning_seeds(3))
    for _ in range(60):
        seen, _, _, _, infos = env.step(policy.act(seen))
    assert infos["commanded_cutting_speed"] == pytest.approx(np.full(3, 150.0), rel=1e-4)
    grades = infos["commanded_feed"] / 0.2
    assert np.abs(grades[:, np.newaxis] - FEED_GRADES).min(axis=1).max() < 1e-4
