import numpy as np
import pytest

from research.studies.edge_probe import (
    area_under_curve,
    area_with_interval,
    explored,
    left_out_scores,
)
from turning_env import Family

SHORT = {"extends": "unmodelled", "planned": {"control.time_limit": 3.0}}
"""Jobs of a few minutes."""


def test_the_area_under_the_curve_is_the_chance_to_order_a_pair() -> None:
    present = np.array([True, True, False, False])
    assert area_under_curve(np.array([4.0, 3.0, 2.0, 1.0]), present) == 1.0
    assert area_under_curve(np.array([1.0, 2.0, 3.0, 4.0]), present) == 0.0
    assert area_under_curve(np.array([4.0, 1.0, 3.0, 2.0]), present) == 0.5
    assert area_under_curve(np.ones(4), present) == 0.5


@pytest.mark.slow
def test_left_out_jobs_are_told_apart_by_a_number_that_tells_and_not_by_noise() -> None:
    generator = np.random.default_rng(1)
    present = generator.random(400) < 0.5
    noise = generator.normal(size=(400, 5))
    telling = np.column_stack([noise, present + generator.normal(size=400)])
    area, low, high = area_with_interval(left_out_scores(telling, present), present)
    assert 0.65 < low < area < high < 0.85
    area, low, high = area_with_interval(left_out_scores(noise, present), present)
    assert low < 0.5 < high


@pytest.mark.slow
def test_each_job_has_the_numbers_of_its_history_whichever_others_are_played() -> None:
    family = Family.load(SHORT)
    both = explored(family, "train", 2)
    assert np.isfinite(both).all()
    assert (both[0] != both[1]).any()
    np.testing.assert_array_equal(explored(family, "train", 1)[0], both[0])
