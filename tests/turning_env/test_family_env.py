"""``RoughTurning-Family-v1``: single, batch and a job's own scenario give the same bits."""

from typing import NamedTuple

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from turning_env import FAMILY_ID, Family, FamilyEnv, FamilyVectorEnv, RoughTurningEnv
from turning_env.observation import layout

BRIEF = Family.load("shop").model_dump(mode="json", exclude_none=True)
BRIEF |= {"name": "brief", "jobs": 64}
BRIEF["planned"] |= {"control.time_limit": "0.4 + 0.2 * best_life / 20"}
BRIEF_FAMILY = Family.load(BRIEF)
"""The family itself: a family that has been loaded keeps the jobs that it has drawn."""
STEPS = 60
NUM_ENVS = 35  # more than a block
SEED = 7


def random_actions():
    drawn = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, NUM_ENVS, 3))
    drawn[:, :, 2] -= 0.9  # few edges are changed
    return drawn.astype(np.float32)


class Answer(NamedTuple):
    """The outcome of a step of a batch."""

    observations: np.ndarray
    rewards: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    infos: dict


def play_batch(actions, mode):
    """Return the first observations of a batch, and the answers to its steps."""
    env = FamilyVectorEnv(NUM_ENVS, BRIEF_FAMILY, autoreset_mode=mode)
    observations, _ = env.reset(seed=SEED)
    answers = [Answer(*env.step(action)) for action in actions]
    return observations, answers


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("index", [0, 33])
def test_a_batch_plays_each_job_as_the_single_environment_and_as_its_scenario(mode, index):
    actions = random_actions()
    first_observations, answers = play_batch(actions, mode)

    seed = SEED + index
    env = FamilyEnv(BRIEF_FAMILY)
    observation, info = env.reset(seed=seed)
    job_env = RoughTurningEnv(env.job().scenario)
    job_observation, _ = job_env.reset(seed=seed)
    entries = len(layout(job_env.scenario))
    assert np.array_equal(observation, first_observations[index])
    assert np.array_equal(observation[:entries], job_observation)

    for action, answer in zip(actions[:, index], answers, strict=True):
        observation, reward, _, truncated, info = env.step(action)
        job_observation, job_reward, _, _, _ = job_env.step(action)
        assert reward == answer.rewards[index]
        assert reward == job_reward
        assert truncated == answer.truncated[index]
        # In mode SAME_STEP, the last answer of an episode is the start of the next.
        if mode is AutoresetMode.NEXT_STEP or not truncated:
            assert info["job"] == answer.infos["job"][index]
            assert np.array_equal(observation, answer.observations[index])
            assert np.array_equal(observation[:entries], job_observation)
        if truncated:
            break
    assert truncated
    _, next_info = env.reset()
    assert next_info["job"] == env.family.number(seed, 1, "train")
    assert next_info["job"] != info["job"]


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_refused_actions_change_no_job(mode):
    """Also where an episode has ended, whose next step would begin another job."""
    actions = random_actions()
    env = FamilyVectorEnv(NUM_ENVS, BRIEF_FAMILY, autoreset_mode=mode)
    env.reset(seed=SEED)
    _, expected = play_batch(actions, mode)
    for action, answer in zip(actions, expected, strict=True):
        with pytest.raises(ValueError, match="finite"):
            env.step(action * np.nan)
        observations, _, _, _, infos = env.step(action)
        assert infos["job"].tolist() == answer.infos["job"].tolist()
        assert np.array_equal(observations, answer.observations)


def test_context_can_be_hidden():
    told = FamilyEnv(context="told")
    hidden = FamilyEnv(context="hidden")
    observation, _ = told.reset(seed=3)
    hidden_observation, _ = hidden.reset(seed=3)
    assert np.array_equal(observation[:12], hidden_observation)
    assert observation[12:] == pytest.approx(told.job().context, abs=1e-6)


def test_an_unknown_context_is_refused():
    with pytest.raises(ValueError, match='must be "told" or "hidden"'):
        FamilyEnv(context="shown")


def test_gymnasium_makes_it_from_its_specification():
    env = gymnasium.make(FAMILY_ID, split="unseen_machines", context="hidden")
    check_env(env.unwrapped, skip_render_check=True)
    again = gymnasium.make(EnvSpec.from_json(env.spec.to_json())).unwrapped
    assert again.split == "unseen_machines"
    assert again.family == env.unwrapped.family


def test_a_vector_environment_has_a_specification():
    env = gymnasium.make_vec(
        FAMILY_ID,
        3,
        vectorization_mode="vector_entry_point",
        family=BRIEF,
    )
    assert '"brief"' in env.spec.to_json()
