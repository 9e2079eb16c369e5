import numpy as np
import pytest

from baselines.models.part_program import PartProgram
from baselines.tmac import LEARNING_TIME, SETTLING_TIME, STOP, UNDERCUT, WEAR_TIME, LearnedPower
from tests.baselines.observing import observe, override_of
from tests.turning_env.playing import changed
from turning_env import Scenario

OVERRIDE = changed(Scenario.load("override"), control={"interval": 0.1})
SHIFT = Scenario.load("shift")
REFERENCE = 0.3
"""Load of the learned cut [-]."""


def learned(scenario: Scenario = OVERRIDE, num_envs: int = 1, **parameters: float) -> LearnedPower:
    """A control that has learned a cut at the programmed feed."""
    settings = {"target": 1.0, "gain": 5.0, "extreme": 2.5, "wear": 1.4} | parameters
    policy = LearnedPower(PartProgram(scenario, {}), num_envs, **settings)
    for second in np.arange(0.0, LEARNING_TIME + 0.05, 0.1):
        load = np.full(num_envs, REFERENCE if second >= SETTLING_TIME - 1e-6 else 0.1)  # rising at first
        policy.act(observe(scenario, load=load, cutting_time=second / 60.0))
    return policy


def asked(policy: LearnedPower, **seen: float) -> float:
    """The override that is asked for [-]."""
    return float(override_of(policy.act(observe(OVERRIDE, **seen)), OVERRIDE)[0])


def test_it_learns_at_the_programmed_feed() -> None:
    policy = LearnedPower(PartProgram(OVERRIDE, {}), 1, 1.0, 5.0, 2.5, 1.4)
    for second in (0.0, 0.6, 1.4):
        assert asked(policy, load=0.5, override=1.4, cutting_time=second / 60.0) == pytest.approx(1.0)
    assert asked(policy, load=0.5, override=1.4, cutting_time=1.6 / 60.0) > 1.4


def test_then_it_keeps_the_power_constant() -> None:
    for load, sign in ((0.5, 1.0), (0.6, 0.0), (0.7, -1.0)):
        change = asked(learned(), load=load, override=1.2) - 1.2
        assert np.sign(round(change, 5)) == sign


def test_the_feed_is_held_back_at_the_extreme_limit_and_stops_beyond_it() -> None:
    extreme = 1.5 * REFERENCE  # below the target of 60 %
    assert asked(learned(extreme=1.5), load=extreme * 1.001, override=1.5) < 1.5
    assert asked(learned(extreme=1.5), load=extreme * 0.999, override=1.5) > 1.5
    assert asked(learned(extreme=1.5), load=extreme * STOP * 1.001, override=1.5) == pytest.approx(0.01, rel=1e-3)
    assert asked(learned(extreme=9.0), load=extreme * STOP * 1.001, override=1.5) > 0.5


def test_where_metal_is_missing_the_feed_is_the_programmed_one() -> None:
    assert asked(learned(), load=0.999 * UNDERCUT * REFERENCE, override=1.0) == pytest.approx(1.0)
    assert asked(learned(), load=1.001 * UNDERCUT * REFERENCE, override=1.0) > 1.0
    # The same power at twice the feed is less at the programmed one.
    assert asked(learned(), load=1.001 * UNDERCUT * REFERENCE, override=2.0) == pytest.approx(1.0)
    assert asked(learned(), load=0.0, override=2.0, cutting=False) == pytest.approx(1.0)


def changes(policy: LearnedPower, load: float, minutes: float, override: float = 1.0) -> bool:
    """Whether an edge change is asked for when a load lasts, in the shift."""
    answers = [
        policy.act(observe(SHIFT, load=load, override=override, cutting_time=1.0 + second / 60.0))[0, 2]
        for second in range(int(60 * minutes))
    ]
    return max(answers) > 0.0


def test_growth_of_power_at_constant_feed_changes_the_edge() -> None:
    limit = 1.4 * REFERENCE
    lasting = 5.0 * WEAR_TIME / 60.0
    assert changes(learned(SHIFT), limit * 1.02, lasting)
    assert not changes(learned(SHIFT), limit * 0.98, lasting)
    assert not changes(learned(SHIFT), limit * 1.2, 0.1 * WEAR_TIME / 60.0)  # a hard spot
    assert not changes(learned(SHIFT), limit * 1.2, lasting, override=2.0)  # more feed, not more wear


def test_a_fresh_edge_is_learned_anew() -> None:
    policy = learned(SHIFT)
    assert changes(policy, REFERENCE * 1.8, 5.0)
    for second in range(4):
        policy.act(observe(SHIFT, load=REFERENCE * 1.8, cutting_time=second / 60.0))
    assert not changes(policy, REFERENCE * 1.8, 5.0)
