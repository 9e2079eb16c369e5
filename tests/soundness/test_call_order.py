"""In any order of calls, a batch matches single environments, and neither goes on without a reset."""

from typing import Any

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from hypothesis import given
from hypothesis import strategies as st

from tests.soundness.acting import SEEDS, tried
from tests.turning_env.playing import SHORT_LIVED, changed
from turning_env import RoughTurningEnv, RoughTurningVectorEnv

MORTAL = changed(SHORT_LIVED, control={"time_limit": 0.1}, workpiece={"approach": 0.0})
"""Episodes of at most 6 intervals."""
VECTOR_SEEDS = st.integers(0, 2**64 - 8)


class Singles:
    """Single environments behind the interface of a vector environment with ``DISABLED`` autoreset."""

    def __init__(self, num_envs: int) -> None:
        self.envs = [RoughTurningEnv(MORTAL) for _ in range(num_envs)]
        self.ended = np.zeros(num_envs, np.bool_)

    def reset(self, mask: Any, seed: int | None) -> list[Any]:
        """Return the observations of the environments in the mask."""
        self.ended &= ~mask
        return [env.reset(seed=None if seed is None else seed + i)[0] for i, env in enumerate(self.envs) if mask[i]]

    def step(self, actions: Any) -> list[tuple[Any, ...]]:
        """Return the outputs of all environments."""
        given_back = [env.step(row) for env, row in zip(self.envs, actions, strict=True)]
        self.ended = np.array([terminated or truncated for _, _, terminated, truncated, _ in given_back])
        return given_back


@pytest.mark.slow
@tried(short=60, soak=5_000)
@given(st.data(), st.integers(1, 6), VECTOR_SEEDS)
def test_resets_and_steps_in_any_order_are_those_of_single_environments(data: st.DataObject, num_envs: int, seed: int) -> None:
    envs, singles = RoughTurningVectorEnv(num_envs, MORTAL, "Disabled"), Singles(num_envs)
    every = np.ones(num_envs, np.bool_)
    observations, _ = envs.reset(seed=seed)
    assert observations.tobytes() == b"".join(row.tobytes() for row in singles.reset(every, seed))
    for _ in range(data.draw(st.integers(1, 12))):
        if data.draw(st.booleans()) or singles.ended.any():
            mask = np.array(data.draw(st.lists(st.booleans(), min_size=num_envs, max_size=num_envs)))
            anew = data.draw(st.none() | VECTOR_SEEDS)
            observations, _ = envs.reset(seed=anew, options={"reset_mask": mask})
            assert observations[mask].tobytes() == b"".join(row.tobytes() for row in singles.reset(mask, anew))
        actions = np.array(data.draw(st.lists(st.tuples(*[st.floats(-1, 1)] * 2), min_size=num_envs, max_size=num_envs)))
        if singles.ended.any():
            with pytest.raises(ResetNeeded):
                envs.step(actions)
            continue
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        for i, (observation, reward, worn, late, info) in enumerate(singles.step(actions)):
            assert observations[i].tobytes() == observation.tobytes()
            assert (rewards[i], terminated[i], truncated[i]) == (reward, worn, late)
            assert {name: infos[name][i] for name in info} == info


@tried(short=40, soak=5_000)
@given(SEEDS, st.lists(st.sampled_from(("reset", "seed", "step", "copy")), max_size=25))
def test_an_episode_is_that_of_its_seed_and_number_whatever_was_called_before(seed: int, calls: list[str]) -> None:
    env = RoughTurningEnv(MORTAL)
    episode, under_way = -1, False
    for call in calls:
        if call == "seed" or (call == "reset" and episode < 0):
            observation, _ = env.reset(seed=seed)
            episode, under_way = 0, True
        elif call == "reset":
            observation, _ = env.reset()
            episode, under_way = episode + 1, True
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
            observation, expected = env.step(np.ones(2))[0], other.step(np.ones(2))[0]
