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
    middle = [[np.log(SPEEDS[0] * SPEEDS[1]) / 2, np.log(FEEDS[0])]]
    beyond = [[np.log(0.1), np.log(0.1)]]
    assert interpolated(returns, torch.tensor(middle)).item() == pytest.approx(-50.0)
    assert interpolated(returns, torch.tensor(beyond)).item() == pytest.approx(-100.0)


@pytest.mark.slow
@pytest.mark.parametrize("tells", [True, False])
def test_a_regression_leads_one_constant_where_the_context_tells_the_best_speed(
    tells: bool,
) -> None:
    generator = torch.Generator().manual_seed(3)
    context = torch.randn(JOBS, 3, dtype=torch.double, generator=generator).sign()
    other = torch.randn(JOBS, dtype=torch.double, generator=generator).sign()
    cause = context[:, 1] if tells else other
    returns = surfaces(np.log(SPEEDS[1]) + 0.19 * cause)
    lead = (cross_validated(context, returns, 0.01) - best_constants(returns)).mean()
    assert (lead > 100.0) == tells
