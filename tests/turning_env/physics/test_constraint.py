"""The constraint by hand: seconds of severe overload beyond the allowed share of cutting."""

import pytest

from turning_env.physics.constraint import COST_LIMIT, overload_cost


@pytest.mark.parametrize(
    ("severe", "engaged", "cost"),
    [
        pytest.param(3.0, 60.0, 0.0, id="just allowed: 5 % of a minute"),
        pytest.param(4.0, 60.0, 1.0, id="a second too much"),
        pytest.param(0.0, 60.0, -3.0, id="never"),
        pytest.param(0.0, 0.0, 0.0, id="no cutting"),
    ],
)
def test_severe_overload_costs_what_exceeds_its_allowance(
    severe: float, engaged: float, cost: float
) -> None:
    assert overload_cost(severe, engaged, 0.05) == pytest.approx(cost)
    assert COST_LIMIT == 0.0
