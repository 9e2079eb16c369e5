"""Force from the servo current: filter, root mean square, lag; and the feed that is limited by it."""

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from baselines.current_limit import FEED_GRADES, ORDER, CurrentLimit, ForceEstimator, Smoother
from baselines.models.part_program import PartProgram
from turning_env import Reading, RoughTurningVectorEnv, Scenario
from turning_env.physics.drives import steady_current
from turning_env.physics.records import parameter_records
from turning_env.scoring.seeds import tuning_seeds

CURRENT = Scenario.load("override_current")


def test_the_filter_is_scipys_as_if_the_first_sample_had_lasted_for_ever() -> None:
    samples = np.random.default_rng(0).uniform(1.0, 2.0, (50, 3, 2))
    ours = Smoother(3, 2, 0.3, 1)
    filtered = np.array([ours.update(row) for row in samples])
    steady = np.concatenate([np.repeat(samples[:1], 400, axis=0), samples])
    assert filtered == pytest.approx(np.abs(sosfilt(butter(ORDER, 0.3, output="sos"), steady, axis=0)[400:]), abs=1e-9)


@pytest.mark.parametrize(("force", "feed"), [(0.0, 0.1), (1500.0, 0.4)])
def test_a_current_that_does_not_change_gives_its_force(force: float, feed: float) -> None:
    parameters, speed = parameter_records(CURRENT)[0], CURRENT.control.initial_cutting_speed
    current = steady_current(parameters, 0, force, speed * parameters.revolutions_per_metre[0] * feed)
    values = dict.fromkeys(Reading._fields, np.zeros(3)) | {
        name: np.full(3, value) for name, value in (("servo_current", current), ("cutting_speed", speed), ("feed", feed))
    }
    estimator = ForceEstimator(CURRENT, 3, 0.3, 4)
    for _ in range(5):
        estimate = estimator.update(Reading(**values))
    assert estimate[0] == pytest.approx(np.full(3, force), abs=1e-6)
    assert estimate[1] == pytest.approx(np.full(3, feed))


def test_the_feed_goes_through_the_grades_alone() -> None:
    env, policy = RoughTurningVectorEnv(4, CURRENT), CurrentLimit(PartProgram(CURRENT, {}), 4, 0.38)
    seen, _ = env.reset(seed=tuning_seeds(4))
    overrides = []
    for _ in range(1000):
        seen, _, _, _, infos = env.step(policy.act(seen))
        overrides.append(infos["commanded_feed"] / CURRENT.control.initial_feed)
    reached = np.maximum(FEED_GRADES, CURRENT.machine.feed_min / CURRENT.control.initial_feed)
    distances = np.abs(np.array(overrides)[..., np.newaxis] - reached)
    assert distances.min(axis=-1).max() < 1e-6
    assert len(np.unique(distances.argmin(axis=-1))) > 4
