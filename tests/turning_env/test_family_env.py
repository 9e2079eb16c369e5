"""``RoughTurning-Family-v0``: single, batch and a job's own scenario give the same bits."""

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from turning_env import FAMILY_ID, Family, FamilyEnv, FamilyVectorEnv, RoughTurningEnv
from turning_env.observation import layout

BRIEF = Family.load("shop").model_dump(mode="json", exclude_none=True) | {
    "name": "brief",
    "jobs": 64,
}
BRIEF["planned"] = BRIEF["planned"] | {"control.time_limit": "0.4 + 0.2 * best_life / 20"}
STEPS = 60


def actions(count, seed=0):
    drawn = np.random.default_rng(seed).uniform(-1.0, 1.0, (STEPS, count, 3))
    drawn[:, :, 2] -= 0.9  # few edges are changed
    return drawn.astype(np.float32)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_a_batch_plays_each_job_as_the_single_environment_and_as_its_scenario(mode):
    count = 35
    batch = FamilyVectorEnv(count, BRIEF, autoreset_mode=mode)
    played, ends = [batch.reset(seed=7)[0]], []
    given = actions(count)
    for action in given:
        with pytest.raises(ValueError, match="finite"):
            batch.step(action * np.nan)
        assert not ends or np.array_equal(batch._batch.job_numbers, ends[-1][2])
        observations, rewards, _, truncated, infos = batch.step(action)
        played.append(observations)
        ends.append((rewards, truncated, infos["job"]))
    for i in (0, 33):
        env = FamilyEnv(BRIEF)
        observation, info = env.reset(seed=7 + i)
        plain = RoughTurningEnv(env.job().scenario)
        entries = len(layout(plain.scenario))
        assert np.array_equal(observation, played[0][i])
        assert np.array_equal(observation[:entries], plain.reset(seed=7 + i)[0])
        for action, observations, (rewards, truncated, numbers) in zip(
            given[:, i], played[1:], ends, strict=True
        ):
            observation, reward, _, over, info = env.step(action)
            seen, same, *_ = plain.step(action)
            assert (reward, over, reward) == (rewards[i], truncated[i], same)
            if mode is AutoresetMode.NEXT_STEP or not over:
                assert info["job"] == numbers[i]
                assert np.array_equal(observation, observations[i])
                assert np.array_equal(observation[:entries], seen)
            if over:
                break
        assert over
        assert env.reset()[1]["job"] == batch.family.number(7 + i, 1, "train") != info["job"]


def test_context_can_be_hidden():
    told, hidden = FamilyEnv(), FamilyEnv(context="hidden")
    observation, _ = told.reset(seed=3)
    assert np.array_equal(observation[:12], hidden.reset(seed=3)[0])
    assert observation[12:] == pytest.approx(told.job().context, abs=1e-6)
    with pytest.raises(ValueError, match='must be "told" or "hidden"'):
        FamilyEnv(context="shown")


def test_it_is_made_by_gymnasium_and_described():
    env = gymnasium.make(FAMILY_ID, split="unseen_machines", context="hidden")
    check_env(env.unwrapped, skip_render_check=True)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json())).unwrapped
    assert (again.split, again.family) == ("unseen_machines", env.unwrapped.family)
    vector = gymnasium.make_vec(FAMILY_ID, 3, vectorization_mode="vector_entry_point", family=BRIEF)
    assert isinstance(vector.spec.to_json(), str)
