"""Constants by regression on the context are found where the context tells them."""

import numpy as np
import pytest
import torch

from research.studies.family_regression import (
    FEEDS,
    SPEEDS,
    best_constants,
    cross_validated,
    interpolated,
)

JOBS = 80


def surfaces(best_log_speed: torch.Tensor) -> torch.Tensor:
    """Return returns that fall with the distance from each job's best log speed share."""
    log_speeds = torch.log(torch.tensor(SPEEDS, dtype=torch.double))
    distance = (log_speeds[np.newaxis, :] - best_log_speed[:, np.newaxis]).abs()
    return (-5000.0 * distance)[:, :, np.newaxis].repeat(1, 1, len(FEEDS))


def test_returns_between_the_points_of_the_grid_are_interpolated() -> None:
    returns = torch.zeros(1, len(SPEEDS), len(FEEDS), dtype=torch.double)
    returns[0, 0, 0] = -100.0
    lowest_log_speed, next_log_speed = np.log(SPEEDS[:2])
    middle_log_speed = 0.5 * (lowest_log_speed + next_log_speed)
    middle = torch.tensor([[middle_log_speed, np.log(FEEDS[0])]])
    below_the_grid = torch.log(torch.tensor([[0.1, 0.1]], dtype=torch.double))
    assert interpolated(returns, middle).item() == pytest.approx(-50.0)
    assert interpolated(returns, below_the_grid).item() == pytest.approx(-100.0)


@pytest.mark.slow
@pytest.mark.parametrize("tells", [True, False])
def test_a_regression_leads_one_constant_where_the_context_tells_the_best_speed(
    tells: bool,
) -> None:
    generator = torch.Generator().manual_seed(3)
    context = torch.randn(
        JOBS,
        3,
        dtype=torch.double,
        generator=generator,
    ).sign()
    hidden = torch.randn(JOBS, dtype=torch.double, generator=generator).sign()
    cause = context[:, 1] if tells else hidden
    returns = surfaces(np.log(SPEEDS[1]) + 0.19 * cause)
    leads = cross_validated(context, returns, 0.01) - best_constants(returns)
    assert (leads.mean() > 100.0) == tells
