import numpy as np
import pytest

from baselines.load_override import RULES
from papers.stepped_bar import Trajectory, play_bar, stepped_bar
from turning_env import Scenario


def programmed(scenario: Scenario) -> Trajectory:
    return play_bar(lambda num_envs: RULES["programmed_feed"].build(scenario, num_envs, {}), scenario)


def test_there_is_no_randomness() -> None:
    run = programmed(stepped_bar((1.0, 3.0), 20.0))
    assert set(np.round(run.depth, 9)) == {0.0, 1.0, 3.0}
    for depth, load in ((1.0, 0.25), (3.0, 0.68)):
        np.testing.assert_allclose(run.at_depth(depth, 1.0).load, load, rtol=0.01)
        assert np.ptp(run.at_depth(depth, 1.0).load) < 1e-9
    np.testing.assert_allclose(run.override, 1.0)


def test_the_ripple_has_the_period_asked_for() -> None:
    run = programmed(stepped_bar((2.0,), 30.0, ripple_period=0.5)).after(1.0)
    assert run.depth.max() == pytest.approx(2.04, abs=1e-3)
    assert run.depth.min() == pytest.approx(1.96, abs=1e-3)
    rising = run.time[1:][(run.depth[:-1] < 2.0) & (run.depth[1:] >= 2.0)]
    np.testing.assert_allclose(np.diff(rising), 0.5, atol=0.0121)  # to one step


def test_a_stay_begins_anew_with_each_arrival() -> None:
    times = np.arange(8.0)
    depth = np.array([1.0, 1.0, 1.0, 3.0, 3.0, 1.0, 1.0, 0.0])
    run = Trajectory(times, depth, times, times)
    assert run.at_depth(1.0, 0.0).time.tolist() == [0.0, 1.0, 2.0, 5.0, 6.0]
    assert run.at_depth(1.0, 1.0).time.tolist() == [1.0, 2.0, 6.0]
    assert run.at_depth(3.0, 5.0).time.tolist() == []
    assert run.after(4.0).time.tolist() == [4.0, 5.0, 6.0]
