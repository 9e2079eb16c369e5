import numpy as np
import pytest

from turning_env.scoring.overload import severe_limit, severe_share
from turning_env.scoring.statistics import CONFIDENCE, Bootstrap

ENGAGED = np.array([100.0, 300.0, 200.0, 50.0, 250.0])
SEVERE = np.array([10.0, 0.0, 4.0, 0.0, 30.0])


def test_the_limit_is_the_leaderboards() -> None:
    bootstrap = Bootstrap(len(ENGAGED))
    shares = bootstrap.means(SEVERE[np.newaxis], "rule") / bootstrap.means(ENGAGED[np.newaxis], "rule")
    assert severe_limit(SEVERE, ENGAGED) == pytest.approx(float(np.quantile(shares, CONFIDENCE)), rel=1e-12)
    assert severe_limit(SEVERE, ENGAGED) > severe_share(SEVERE, ENGAGED)


def test_who_never_cuts_overloads_nothing() -> None:
    nothing = np.zeros(4)
    assert severe_share(nothing, nothing) == severe_limit(nothing, nothing) == 0.0
