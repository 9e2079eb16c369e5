"""Outputs are finite and within their spaces, or the environment refuses.

This holds for any scenario, actions and seed.
"""

import copy
import decimal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.soundness.acting import SEEDS, action, assert_sound, tried
from tests.soundness.scenarios import FIELDS, reconciled, values
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario

ADDRESSES = {".".join(path) for path in FIELDS} | {path[-1] for path in FIELDS}
"""Names of all values in refusals."""


def play_and_check(data: st.DataObject, scenario: Scenario, seed: int) -> None:
    """A few intervals, across episodes' ends."""
    env = RoughTurningEnv(scenario)
    observation, info = env.reset(seed=seed)
    assert_sound(env, observation, 0.0, info)
    for chosen in data.draw(st.lists(action(scenario), min_size=1, max_size=8)):
        observation, reward, terminated, truncated, info = env.step(chosen)
        assert_sound(env, observation, reward, info)
        if terminated or truncated:
            observation, info = env.reset()
            assert_sound(env, observation, 0.0, info)


@pytest.mark.slow
@tried(short=120, soak=15_000)
@given(
    st.data(),
    values(laws=True) | values(laws=True).map(reconciled) | values().map(reconciled),
    SEEDS,
)
def test_any_values_are_played_or_refused_by_name(
    data: st.DataObject, drawn: dict[str, object], seed: int
) -> None:
    try:
        scenario = Scenario.model_validate(drawn)
    except ValidationError as refusal:
        for detail in refusal.errors():
            assert any(address in detail["msg"] for address in ADDRESSES), detail
        return
    play_and_check(data, scenario, seed)


@tried(short=20, soak=5_000)
@given(st.integers(1, 70), st.data(), st.sampled_from((np.nan, np.inf, -np.inf)))
def test_an_action_that_is_not_finite_is_refused_by_environment_and_nothing_moves(
    num_envs, data, unfit
) -> None:
    envs = RoughTurningVectorEnv(num_envs)
    envs.reset(seed=1)
    good = np.zeros((num_envs, 2))
    bad, place = good.copy(), data.draw(st.tuples(st.integers(0, num_envs - 1), st.integers(0, 1)))
    bad[place] = unfit
    other = copy.deepcopy(envs)
    with pytest.raises(ValueError, match=f"environment {place[0]} must be finite"):
        envs.step(bad)
    for ours, theirs in zip(envs.step(good)[:4], other.step(good)[:4], strict=True):
        assert ours.tobytes() == theirs.tobytes()


@pytest.mark.parametrize(
    "unfit",
    [
        None,
        "ab",
        {"speed": 1.0, "feed": 1.0},
        0.0,
        [0.0, 0.0, 0.0],
        [0.0, [0.0]],
        [True, False],
        [1j, 0.0],
        ["0", "0"],
        [2**70, 0],
        [decimal.Decimal(0), 0],
        np.zeros(2, "datetime64[s]"),
        iter([0.0, 0.0]),
        np.longdouble([1.0, 1.0]) * np.longdouble(2) ** 5_000,
    ],
    ids=lambda unfit: repr(unfit)[:30].split(" object")[0],
)
def test_what_is_no_action_is_refused_and_nothing_moves(unfit: object) -> None:
    env, envs = RoughTurningEnv(), RoughTurningVectorEnv(2)
    env.reset(seed=1)
    envs.reset(seed=1)
    with pytest.raises(ValueError, match="an action must be 2 finite numbers, got "):
        env.step(unfit)
    with pytest.raises(
        ValueError,
        match=r"actions must (be numbers of|have) shape \(2, 2\)|environment 0 must be finite",
    ):
        envs.step([unfit, unfit])
    alone, _, _, _, _ = env.step(np.zeros(2))
    beside, *_ = envs.step(np.zeros((2, 2)))
    assert alone.tobytes() == beside[0].tobytes()
