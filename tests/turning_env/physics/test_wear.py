"""Used life and wear, as functions and in the environment."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.turning_env.playing import UNDISTURBED, changed
from turning_env import RoughTurningEnv

RULES = ("equivalent_time", "clock_time")
SCENARIOS = {rule: changed(UNDISTURBED, tool={"wear_rule": rule}) for rule in RULES}
WEAR_LAW = UNDISTURBED.material.wear
WEAR_CRITERION = UNDISTURBED.tool.wear_criterion


@pytest.mark.parametrize("rule", RULES)
@settings(max_examples=25)
@given(
    set_points=st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
    interval=st.floats(0.5, 20),
    sub_steps=st.integers(1, 50),
)
def test_the_environment_wears_by_the_same_law(rule, set_points, interval, sub_steps):
    env = RoughTurningEnv(changed(SCENARIOS[rule], control={"interval": interval, "sub_steps": sub_steps}))
    env.reset(seed=0)
    for _ in range(10):
        *_, terminated, _, info = env.step(set_points)
        expected = WEAR_LAW(info["cutting_speed"], info["feed"], 2.5, time=info["cutting_time"])
        assert info["wear"] == pytest.approx(expected, rel=1e-9)
        assert terminated == (info["wear"] >= WEAR_CRITERION)
        if terminated:
            break
