"""The errors of nominal models over a family's training jobs, against the distributions of its file."""

import numpy as np
import pytest

from train.law_errors import ERRORS, LOADS, error_prior
from turning_env import Family

SHOP = Family.load("shop")


def pivot_of(family: Family) -> tuple[float, float]:
    means = dict(zip(family.context_names, family.context_scale[0].tolist(), strict=True))
    return means["speed_at_0.5"], means["feed_at_0.5"]


def test_errors_scatter_as_in_the_familys_file() -> None:
    mean, factor = error_prior(SHOP, pivot_of(SHOP))
    covariance = factor @ factor.T
    force, power = LOADS
    exponents = [0.2, 0.3, 0.1, 0.08, 0.15, 0.05, 0.045, 0.06]
    places = [1, 2, *range(force + 1, force + 4), *range(power + 1, power + 4)]
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)[places]), exponents, rtol=0.1)
    kc, share = 0.2**2, 0.12**2
    np.testing.assert_allclose(np.diag(covariance)[[force, power]], [kc + share, kc], rtol=0.15)
    np.testing.assert_allclose(covariance[force, power], kc, rtol=0.15)  # both loads follow from kc
    assert mean[0] == pytest.approx(-np.log(0.78), rel=0.1)


def test_life_is_more_in_doubt_far_from_the_pivot() -> None:
    speed, feed = pivot_of(SHOP)
    near, far = (error_prior(SHOP, (speed + more, feed))[1] for more in (0.0, 0.4))
    assert (far @ far.T)[0, 0] > 1.3 * (near @ near.T)[0, 0]


def test_a_nominal_model_that_is_right_has_no_errors() -> None:
    values = SHOP.model_dump(exclude_none=True) | {"jobs": 256}
    for each in (*values["variables"].values(), *values["tables"].values()):
        each.pop("truth", None)
    right = Family.model_validate(values)
    mean, factor = error_prior(right, pivot_of(right))
    np.testing.assert_allclose(mean, np.zeros(ERRORS), atol=1e-9)
    assert np.abs(factor).max() < 1e-3
