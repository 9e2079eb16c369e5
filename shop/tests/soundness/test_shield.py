"""Whatever a policy does, the shield breaks no edge and is seldom over a limit.

Hypothesis searches for adversaries: waves of speed and feed that react to what they observe.
"""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from leaderboard.seeds import tuning_seeds
from shop.tests.turning_control.guarded import Adversary, Wave, play_guarded
from tests.soundness.acting import tried
from turning_env import Scenario

MAX_SEVERE = 0.01  # share of cutting time more than 5 % over a limit [-]
NUM_SEEDS = 4


def shortened(preset: str, minutes: float) -> Scenario:
    """Return a scenario whose episodes end after some minutes."""
    scenario = Scenario.load(preset)
    control = scenario.control.model_copy(update={"time_limit": minutes})
    return scenario.model_copy(update={"control": control})


SCENARIOS = {
    "rough_turning": shortened("rough_turning", minutes=1.0),
    "override": shortened("override", minutes=0.07),
}
level = st.floats(-1.0, 1.0)


@st.composite
def waves(draw: st.DrawFn) -> Wave:
    """Return a wave of actions."""
    low, high = sorted((draw(level), draw(level)))
    if draw(st.booleans()):
        # Between the ends of the range most damage is done.
        low, high = -1.0, 1.0
    period = draw(st.integers(2, 200))
    return Wave(low=low, high=high, period=period, share=draw(st.floats(0.05, 1.0)))


@pytest.mark.slow
@pytest.mark.parametrize("preset", SCENARIOS)
@given(speed=waves(), feed=waves(), threshold=st.floats(0.3, 1.1), entry_steps=st.integers(1, 100))
@tried(short=2, soak=300)
def test_no_adversary_gets_past_the_shield(preset: str, **values: Any) -> None:
    scenario = SCENARIOS[preset]
    adversary = Adversary(scenario, NUM_SEEDS, **values)
    played = play_guarded(scenario, adversary, tuning_seeds(NUM_SEEDS))
    assert played.edges_broken == 0
    assert played.severe <= MAX_SEVERE
