import numpy as np
import pytest

from baselines.models.part_program import PartProgram
from baselines.omative import ENTRY_TIME, AirGapControl
from tests.baselines.observing import observe, override_of
from turning_env import Scenario

OVERRIDE = Scenario.load("override")
INTERVAL = OVERRIDE.control.interval


def control(scenario: Scenario = OVERRIDE, num_envs: int = 1, rise: float = 5.0) -> AirGapControl:
    return AirGapControl(PartProgram(scenario, {}), num_envs, target=1.0, entry=0.6, rise=rise)


def in_metal(rise: float = 5.0) -> AirGapControl:
    """A control that has entered the metal."""
    policy = control(rise=rise)
    for _ in range(int(ENTRY_TIME / INTERVAL) + 2):
        policy.act(observe(OVERRIDE, load=0.6))
    return policy


def asked(policy: AirGapControl, **seen: float) -> float:
    """The override that is asked for [-]."""
    return float(override_of(policy.act(observe(OVERRIDE, **seen)), OVERRIDE)[0])


def test_air_is_crossed_fast_and_metal_entered_gently() -> None:
    policy = control()
    assert asked(policy, cutting=False) == pytest.approx(2.0)
    entry = [asked(policy, load=0.1, override=2.0) for _ in range(int(ENTRY_TIME / INTERVAL))]
    assert entry == pytest.approx([0.6] * len(entry), rel=1e-4)
    for _ in range(2):
        later = asked(policy, load=0.1, override=0.6)
    assert later > 0.6
    assert asked(policy, cutting=False) == pytest.approx(2.0)
    assert asked(policy, load=0.1, override=2.0) == pytest.approx(0.6)


def test_the_feed_falls_at_once_to_what_the_metal_allows() -> None:
    # Twice the load at the actual feed: the law's exponent 0.74 tells by how much the feed must fall.
    assert asked(in_metal(), load=1.2, override=1.5, actual_override=1.0) == pytest.approx(0.5 ** (1 / 0.74), rel=1e-3)


def test_and_rises_gradually() -> None:
    slow, fast = (asked(in_metal(rise), load=0.3, override=0.5) for rise in (1.0, 10.0))
    assert 0.5 < slow < fast < 0.5 * 2 ** (1 / 0.74)
    assert slow - 0.5 == pytest.approx((0.5 * 2 ** (1 / 0.74) - 0.5) * (1 - np.exp(-INTERVAL)), rel=0.01)
