"""Roughness by hand, and its reference in periods."""

import math

import pytest

from tests.turning_env.physics.one_env import ENV, put, records_of
from turning_env.numerics.keyed_random import REFERENCE_CHANNEL, uniform
from turning_env.physics.surface import draw_reference, roughness


@pytest.mark.parametrize(
    ("force", "expected"),
    [
        # The roughness control paper's numbers: Ra = 0.2401 exp(0.0034 F) um.
        pytest.param(0.0, 0.2401, id="no force"),
        pytest.param(500.0, 0.2401 * math.exp(1.7), id="usual"),
        pytest.param(1e6, 0.2401 * math.exp(300.0), id="absurd, but finite"),
    ],
)
def test_roughness_is_exponential_in_the_force(force: float, expected: float) -> None:
    p = records_of(roughness_at_no_force=0.2401, roughness_rate=0.0034).p
    assert roughness(p, ENV, force) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("clock", "period"),
    [
        pytest.param(0.0, 0, id="start"),
        pytest.param(1.4, 0, id="first period"),
        pytest.param(1.44, 0, id="before half a sub-step"),
        pytest.param(1.46, 1, id="within half a sub-step of the end"),
        pytest.param(1.5, 1, id="second period"),
        pytest.param(4.6, 3, id="fourth period"),
    ],
)
def test_the_reference_is_drawn_for_each_period_on_a_log_scale(clock: float, period: int) -> None:
    records = records_of(reference_time=1.5, sub_step=0.1)
    put(records.p, log_reference_min=math.log(0.5), log_reference_span=math.log(8.0))
    put(records.state, seed=3, episode=1, clock=clock)
    share = uniform(records.state, ENV, channel=REFERENCE_CHANNEL, bar=0, index=period)
    draw_reference(records.state, ENV, records.p)
    assert records.state.roughness_reference[ENV] == pytest.approx(0.5 * 8.0**share)
