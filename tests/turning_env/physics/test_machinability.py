"""The three responses, by the coefficients of docs/models.md and by numbers of one digit."""

import math
from typing import Any

import pytest

from tests.turning_env.physics.one_env import ENV, Records, put_law, records_of
from turning_env.physics.machinability import (
    excess_over_further_limit,
    force_and_power,
    loads_with_fresh_share,
    log_response,
    log_wear_coefficient,
)
from turning_env.physics.parameters import FURTHER_LAW_RECORD

# exponent, then the factor: each product of the two logarithms is another one.
EXPONENTS = {"cutting_speed": 1.0, "feed": -2.0, "depth_of_cut": 3.0, "wear": 0.5, "hardness": 2.0}
LOGS: dict[str, Any] = {
    "log_cutting_speed": math.log(2.0),
    "log_feed": math.log(0.5),
    "log_depth_of_cut": math.log(3.0),
    "log_hardness": math.log(1.5),
}
# 7 * 2 * 0.5^-2 * 3^3 * 0.25^0.5 * 1.5^2 = 7 * 2 * 4 * 27 * 0.5 * 2.25
RESPONSE = 1701.0


def test_a_law_is_the_product_of_its_powers() -> None:
    law = records_of().p.force_law
    put_law(law, 7.0, **EXPONENTS)
    response = log_response(law, ENV, **LOGS, wear_term=math.log(0.25))
    assert math.exp(response) == pytest.approx(RESPONSE)


def published() -> Records:
    """Return the records of v0: 709M40, with the coefficients of docs/models.md."""
    return records_of()


def test_the_wear_of_a_fresh_edge_after_a_minute_is_that_of_the_table() -> None:
    wear = math.exp(log_wear_coefficient(published().p, ENV, **LOGS))
    expected = 0.00956410 * 2.0**0.577 * 0.5**0.168 * (3.0 / 2.5) ** 0.15 * 1.5**0.5
    assert wear == pytest.approx(expected, rel=1e-6)


def test_the_wear_of_a_fresh_edge_does_not_depend_on_its_wear() -> None:
    p = published().p
    before = log_wear_coefficient(p, ENV, **LOGS)
    p.wear_law.wear[ENV] = 0.5
    assert log_wear_coefficient(p, ENV, **LOGS) == before


@pytest.mark.parametrize("loads", [force_and_power, loads_with_fresh_share])
def test_force_and_power_are_those_of_the_table(loads: Any) -> None:
    force, power = loads(published().p, ENV, **LOGS, log_wear=math.log(0.25))
    depth = 3.0 / 2.5
    expected_force = 106580.08 * 2.0**-0.484 * 0.5**0.236 * depth**0.75 * 0.25**1.1 * 1.5**0.75
    expected_power = 0.30338170 * 2.0**0.820 * 0.5**0.627 * depth**0.95 * 0.25**0.342 * 1.5**0.75
    assert force == pytest.approx(expected_force, rel=1e-6)
    assert power == pytest.approx(expected_power, rel=1e-6)


def test_a_fresh_share_grows_with_wear_in_each_law_for_itself() -> None:
    p = published().p
    put_law(p.force_law, 100.0, wear=1.0, wear_growth=4.0)
    put_law(p.power_law, 3.0, wear=2.0, wear_growth=8.0)
    force, power = loads_with_fresh_share(p, ENV, **LOGS, log_wear=math.log(0.25))
    # The wear terms are 1 + 4 * 0.25 = 2 and 1 + 8 * 0.25 = 3, of which power takes the square.
    assert (force, power) == pytest.approx((200.0, 27.0))


@pytest.mark.parametrize(
    ("log_share", "excess"),
    [
        # 0.1 * 0.5^-2 * 3^3 * 1.5^2 = 24.3, which is 23.3 over the limit.
        pytest.param(math.log(0.1), 23.3, id="over the limit"),
        pytest.param(math.log(0.004), 0.0, id="within the limit"),
    ],
)
def test_the_excess_over_a_further_limit_is_relative(log_share: float, excess: float) -> None:
    p = records_of().p
    p.further_laws[1] = (log_share, -2.0, 3.0, 2.0)
    assert p.further_laws.dtype.names == FURTHER_LAW_RECORD.names
    over = excess_over_further_limit(
        p,
        1,
        log_feed=LOGS["log_feed"],
        log_depth_of_cut=LOGS["log_depth_of_cut"],
        log_hardness=LOGS["log_hardness"],
    )
    assert over == pytest.approx(excess)
