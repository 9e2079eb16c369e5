"""Calls in any order.

A batch does what as many single environments do, and neither goes on without a reset.
"""

import re

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from hypothesis import given
from hypothesis import strategies as st

from tests.soundness.acting import SEEDS, tried
from tests.turning_env.playing import SHORT_LIVED, assert_same_answers, changed
from turning_env import RoughTurningEnv, RoughTurningVectorEnv

MORTAL = changed(SHORT_LIVED, control={"time_limit": 0.1}, workpiece={"approach": 0.0})
"""Episodes of at most 6 intervals."""


@pytest.mark.slow
@tried(short=60, soak=5_000)
@given(st.data(), st.integers(1, 6), st.integers(0, 2**64 - 8))
def test_resets_and_steps_in_any_order_are_those_of_single_environments(
    data: st.DataObject, num_envs: int, seed: int
) -> None:
    disabled = AutoresetMode.DISABLED
    envs = RoughTurningVectorEnv(num_envs, MORTAL, disabled)
    singles = SyncVectorEnv([lambda: RoughTurningEnv(MORTAL)] * num_envs, autoreset_mode=disabled)
    observations, _ = envs.reset(seed=seed)
    expected, _ = singles.reset(seed=seed)
    assert observations.tobytes() == expected.tobytes()
    masks = st.lists(st.booleans(), min_size=num_envs, max_size=num_envs)
    pairs = st.tuples(st.floats(-1, 1), st.floats(-1, 1))
    actions_of_a_step = st.lists(pairs, min_size=num_envs, max_size=num_envs)
    ended = np.zeros(num_envs, np.bool_)
    for _ in range(data.draw(st.integers(1, 12))):
        mask = np.array(data.draw(masks))
        if mask.any() and (ended.any() or data.draw(st.booleans())):
            new_seed = data.draw(st.none() | st.integers(0, 2**64 - 8))
            observations, _ = envs.reset(seed=new_seed, options={"reset_mask": mask.copy()})
            expected, _ = singles.reset(seed=new_seed, options={"reset_mask": mask.copy()})
            assert observations[mask].tobytes() == expected[mask].tobytes()
            ended &= ~mask

        actions = np.array(data.draw(actions_of_a_step))
        if ended.any():
            numbers = np.flatnonzero(ended).tolist()
            complaint = re.escape(f"environments {numbers} have ended")
            with pytest.raises(ResetNeeded, match=complaint):
                envs.step(actions)
            continue
        answers = envs.step(actions)
        assert_same_answers(answers, singles.step(actions))
        _, _, terminated, truncated, _ = answers
        ended = terminated | truncated


@tried(short=40, soak=5_000)
@given(SEEDS, st.lists(st.sampled_from(("reset", "seed", "step", "copy")), max_size=25))
def test_an_episode_is_that_of_its_seed_and_number_whatever_was_called_before(
    seed: int, calls: list[str]
) -> None:
    env = RoughTurningEnv(MORTAL)
    episode = -1
    under_way = False
    for call in calls:
        if call == "seed" or (call == "reset" and episode < 0):
            observation, _ = env.reset(seed=seed)
            episode = 0
            under_way = True
        elif call == "reset":
            observation, _ = env.reset()
            episode += 1
            under_way = True
        elif not under_way:
            with pytest.raises(ResetNeeded):
                env.step(np.zeros(2))
        else:
            _, _, terminated, truncated, _ = env.step(np.ones(2))
            under_way = not (terminated or truncated)
    if episode >= 0 and calls[-1] in ("seed", "reset"):
        other = RoughTurningEnv(MORTAL)
        expected, _ = other.reset(seed=seed)
        for _ in range(episode):
            expected, _ = other.reset()
        for _ in range(3):
            assert observation.tobytes() == expected.tobytes()
            observation, *_ = env.step(np.ones(2))
            expected, *_ = other.step(np.ones(2))
