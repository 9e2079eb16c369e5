"""What is kept of a long episode, and what a file of trajectories may hold."""

import numpy as np
import pytest
from pydantic import ValidationError

from leaderboard import run
from leaderboard.trajectories import MAX_ROWS, SERIES, Trajectory, kept, record
from tests.leaderboard.conftest import record_of
from turning_env import Scenario


def test_short_courses_are_kept_whole() -> None:
    course = {name: np.zeros(MAX_ROWS) for name in ("minutes", *SERIES)}
    np.testing.assert_array_equal(kept(course, Scenario()), np.arange(MAX_ROWS))


def test_thinning_loses_no_overload_and_prefers_metal() -> None:
    scenario, count = Scenario(), 5000
    course = {name: np.ones(count) for name in ("minutes", *SERIES)}
    course["depth_of_cut"][::7] = 0.0
    course["thrust_force"][::7] = 0.0
    course["power"][1234] = 2.0 * scenario.limits.power
    course["thrust_force"][4321] = 2.0 * scenario.limits.thrust_force
    course["depth_of_cut"][2000:2100] = 0.0
    rows = kept(course, scenario)
    assert len(rows) <= MAX_ROWS
    assert (np.diff(rows) > 0).all()
    assert {1234, 4321, count - 1} <= set(rows.tolist())
    in_air = rows[course["depth_of_cut"][rows] == 0.0]
    assert ((in_air >= 2000) & (in_air < 2100)).all()
    assert in_air.size


def test_of_a_part_its_means_are_recorded() -> None:
    scenario = Scenario.load("batch_casting")
    rule = run.rule("parts_mt", scenario)
    course = record(rule.policy, rule.make, scenario, 7)
    assert course.steps == scenario.workpiece.bars
    assert min(course.series["thrust_force"]) > 0.0
    assert min(course.series["power"]) > 0.0


@pytest.mark.parametrize("change", [{"steps": 1}, {"series": {"minutes": [1.0, 2.0]}}])
def test_series_must_fit(change: dict[str, object]) -> None:
    whole = {"policy": record_of("one"), "draw": 7, "steps": 2, "series": {name: [0.0, 1.0] for name in ("minutes", *SERIES)}}
    Trajectory.model_validate(whole)
    with pytest.raises(ValidationError, match="series"):
        Trajectory.model_validate(whole | change)
