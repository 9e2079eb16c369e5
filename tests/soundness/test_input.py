"""Outputs are finite and within their spaces, or the environment refuses.

This holds for any scenario, actions and seed.
"""

import copy
import decimal
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from tests.soundness.acting import SEEDS, action, assert_sound, tried
from tests.soundness.scenarios import FIELDS, reconciled, values
from tests.turning_env.playing import assert_same_answers
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario

ADDRESSES = {".".join(path) for path in FIELDS} | {path[-1] for path in FIELDS}
"""Names of all values in refusals."""


def changed_at(path: tuple[str, ...], value: float) -> Scenario:
    """Return the default scenario with another value in one place."""
    values = Scenario().model_dump(exclude={"nominal_model"})
    section = values
    for name in path[:-1]:
        section = section[name]
    section[path[-1]] = value
    return Scenario.model_validate(values)


def play_and_check(data: st.DataObject, scenario: Scenario, seed: int) -> None:
    """Take a few steps, across the ends of episodes, and check what each returns."""
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


ENDS = [
    pytest.param(path, FIELDS[path][end], id=f"{'.'.join(path)}-{end}")
    for path in FIELDS
    for end in ("minimum", "maximum")
    if end in FIELDS[path]
]


@pytest.mark.slow
@pytest.mark.parametrize(("path", "value"), ENDS)
def test_a_value_alone_at_an_end_of_its_range_is_played_or_refused_by_name(
    path: tuple[str, ...], value: float
) -> None:
    """Refused are values that contradict others, such as a lowest feed above the highest."""
    try:
        scenario = changed_at(path, value)
    except ValidationError as refusal:
        message = str(refusal)
        assert path[-1] in message or ".".join(path[:-1]) in message
        return
    env = RoughTurningEnv(scenario)
    observation, info = env.reset(seed=1)
    assert_sound(env, observation, 0.0, info)
    size = env.action_space.shape[0]
    for number in (1.0, -1.0):
        observation, reward, terminated, truncated, info = env.step(np.full(size, number))
        assert_sound(env, observation, reward, info)
        if terminated or truncated:
            env.reset()


@tried(short=20, soak=5_000)
@given(st.integers(1, 70), st.data(), st.sampled_from((np.nan, np.inf, -np.inf)))
def test_an_action_that_is_not_finite_is_refused_by_environment_and_nothing_moves(
    num_envs, data, unfit
) -> None:
    envs = RoughTurningVectorEnv(num_envs)
    envs.reset(seed=1)
    untouched = copy.deepcopy(envs)
    env_index = data.draw(st.integers(0, num_envs - 1))
    entry = data.draw(st.integers(0, 1))
    good = np.zeros((num_envs, 2))
    bad = good.copy()
    bad[env_index, entry] = unfit
    with pytest.raises(ValueError, match=f"environment {env_index} must be finite"):
        envs.step(bad)
    assert_same_answers(envs.step(good), untouched.step(good))


NO_ACTIONS = [
    pytest.param(None, id="None"),
    pytest.param("ab", id="text"),
    pytest.param({"speed": 1.0, "feed": 1.0}, id="dict"),
    pytest.param(0.0, id="number"),
    pytest.param([0.0, 0.0, 0.0], id="three numbers"),
    pytest.param([0.0, math.nan], id="NaN"),
    pytest.param([math.inf, 0.0], id="infinity"),
    pytest.param([0.0, -math.inf], id="negative infinity"),
    pytest.param([0.0, [0.0]], id="ragged"),
    pytest.param([True, False], id="truth values"),
    pytest.param([1j, 0.0], id="complex"),
    pytest.param(["0", "0"], id="digits"),
    pytest.param([2**70, 0], id="huge integer"),
    pytest.param([decimal.Decimal(0), 0], id="decimal"),
    pytest.param(np.zeros(2, "datetime64[s]"), id="times"),
    pytest.param((number for number in (0.0, 0.0)), id="generator"),
    pytest.param(np.longdouble([1.0, 1.0]) * np.longdouble(2) ** 5_000, id="beyond float64"),
]


@pytest.mark.parametrize("unfit", NO_ACTIONS)
def test_a_malformed_action_is_refused_and_nothing_moves(unfit: object) -> None:
    env = RoughTurningEnv()
    env.reset(seed=1)
    untouched = copy.deepcopy(env)
    with pytest.raises(ValueError, match="an action must be 2 finite numbers, got "):
        env.step(unfit)
    observation, *_ = env.step(np.zeros(2))
    expected, *_ = untouched.step(np.zeros(2))
    assert observation.tobytes() == expected.tobytes()


@pytest.mark.parametrize("unfit", NO_ACTIONS)
def test_malformed_actions_of_a_batch_are_refused_and_nothing_moves(unfit: object) -> None:
    envs = RoughTurningVectorEnv(2)
    envs.reset(seed=1)
    untouched = copy.deepcopy(envs)
    complaint = r"actions must (be numbers of|have) shape \(2, 2\)|environment 0 must be finite"
    with pytest.raises(ValueError, match=complaint):
        envs.step([unfit, unfit])
    good = np.zeros((2, 2))
    assert_same_answers(envs.step(good), untouched.step(good))
