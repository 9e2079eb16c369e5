"""Many environments: each is the single environment with its seed.

The whole behaves as Gymnasium's own vector environments do.
"""

from concurrent.futures import ThreadPoolExecutor

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode

from tests.turning_env.playing import (
    FAILING,
    HOT_SPINDLE,
    SHORT_LIVED,
    STEPS,
    assert_plays_as_single_environments,
    assert_same_answers,
    changed,
    fixed_actions,
)
from turning_env import ALL_IDS, RoughTurningEnv, RoughTurningVectorEnv, Scenario, presets

CASES = [pytest.param(preset, AutoresetMode.NEXT_STEP, 3, id=preset) for preset in presets()]
CASES.append(pytest.param(changed(Scenario(), **FAILING), AutoresetMode.SAME_STEP, 3, id="failing"))
SLOW_CASES = [(f"short-lived, {mode.name}", SHORT_LIVED, mode, 3) for mode in AutoresetMode]
SLOW_CASES.append(("hot spindle, two blocks", HOT_SPINDLE, AutoresetMode.NEXT_STEP, 64))
SLOW_CASES.append(("short-lived, two blocks", SHORT_LIVED, AutoresetMode.SAME_STEP, 64))
for name, scenario, mode, num_envs in SLOW_CASES:
    CASES.append(pytest.param(scenario, mode, num_envs, id=name, marks=pytest.mark.slow))


@pytest.mark.parametrize(("scenario", "mode", "num_envs"), CASES)
def test_it_is_single_environments_side_by_side(scenario, mode, num_envs):
    assert_plays_as_single_environments(scenario, mode, num_envs)


def test_short_lived_environments_end_twice_in_the_steps_that_are_compared():
    envs = RoughTurningVectorEnv(3, SHORT_LIVED)
    envs.reset(seed=2**63)
    ended_count = np.zeros(3, int)
    for actions in fixed_actions(STEPS, 3, SHORT_LIVED):
        _, _, terminated, truncated, _ = envs.step(actions)
        ended_count += terminated | truncated
    assert ended_count.min() >= 2


def test_every_environment_may_have_a_seed_of_its_own():
    envs = RoughTurningVectorEnv(3)
    single = RoughTurningEnv()
    _, infos = envs.reset(seed=[7, 7, 9])
    expected = [single.reset(seed=seed)[1]["wear_factor"] for seed in (7, 7, 9)]
    assert infos["wear_factor"].tolist() == expected


def test_environments_without_a_seed_start_their_next_episode():
    envs = RoughTurningVectorEnv(3)
    single = RoughTurningEnv()
    envs.reset(seed=[7, 7, 9])
    _, infos = envs.reset(seed=[None, 1, None])
    single.reset(seed=7)
    next_of_7 = single.reset()[1]["wear_factor"]
    first_of_1 = single.reset(seed=1)[1]["wear_factor"]
    single.reset(seed=9)
    next_of_9 = single.reset()[1]["wear_factor"]
    assert infos["wear_factor"].tolist() == [next_of_7, first_of_1, next_of_9]


@pytest.mark.parametrize(
    "mask",
    [
        pytest.param([1, 0, 1], id="integers"),
        pytest.param([True, False], id="too short"),
        pytest.param("all", id="text"),
    ],
)
def test_bad_reset_masks_are_refused(mask):
    env = RoughTurningVectorEnv(3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"reset_mask must be bool of shape \(3,\)"):
        env.reset(options={"reset_mask": mask})


def test_the_first_reset_must_start_every_environment():
    env = RoughTurningVectorEnv(3)
    with pytest.raises(ResetNeeded, match="first reset"):
        env.reset(options={"reset_mask": [True, False, True]})


@pytest.mark.parametrize(
    ("seed", "message"),
    [
        pytest.param(-1, "seed -1 of environment 0", id="negative"),
        pytest.param(2**64 - 2, f"seed {2**64} of environment 2", id="too large"),
        pytest.param("abc", "seed 'a' of environment 0", id="text"),
        pytest.param(
            [1, 2], "2 seeds given, but there must be one for each of 3 environments", id="too few"
        ),
        pytest.param([1, 2.5, 3], "seed 2.5 of environment 1", id="broken number"),
    ],
)
def test_bad_seeds_are_refused_and_nothing_moves(seed, message):
    env = RoughTurningVectorEnv(3)
    untouched = RoughTurningVectorEnv(3)
    env.reset(seed=0)
    untouched.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.reset(seed=seed)
    for _ in range(5):
        assert_same_answers(env.step(np.ones((3, 2))), untouched.step(np.ones((3, 2))))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        pytest.param({"num_envs": 0}, "num_envs is 0, but must be at least 1", id="num_envs"),
        pytest.param(
            {"num_envs": 2, "render_mode": "rgb_array", "rendered_envs": 3},
            "rendered_envs is 3, but must be None or 1 to num_envs, which is 2",
            id="rendered_envs",
        ),
        pytest.param(
            {"render_mode": "human"},
            "render_mode is 'human', but must be None or one of 'rgb_array'",
            id="render_mode",
        ),
        pytest.param({"autoreset_mode": "Sometimes"}, "Sometimes", id="autoreset_mode"),
    ],
)
def test_bad_arguments_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        RoughTurningVectorEnv(**arguments)


def assert_same_infos(infos, expected):
    # rl-baselines3-zoo, which other tests import, lets Gymnasium's TimeLimit add an entry.
    expected = {key: values for key, values in expected.items() if "TimeLimit" not in key}
    assert infos.keys() == expected.keys()
    for key, values in expected.items():
        if isinstance(values, dict):
            assert_same_infos(infos[key], values)
        elif values.dtype == object:
            assert infos[key].dtype == object
            for observation, expected_observation in zip(infos[key], values, strict=True):
                np.testing.assert_array_equal(observation, expected_observation)
        else:
            np.testing.assert_array_equal(infos[key], values, err_msg=key)
            assert infos[key].dtype == values.dtype, key
            assert infos[key].flags.writeable == values.flags.writeable, key


@pytest.mark.slow
@pytest.mark.parametrize("mode", AutoresetMode)
@pytest.mark.parametrize("env_id", ALL_IDS)
def test_it_steps_and_is_truncated_as_gymnasiums_vector_environment(env_id, mode):
    envs = gymnasium.make_vec(env_id, 3, max_episode_steps=5, autoreset_mode=mode)
    expected_envs = gymnasium.make_vec(
        env_id,
        3,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": mode},
        max_episode_steps=5,
    )
    answer = envs.reset(seed=5)
    expected = expected_envs.reset(seed=5)
    np.testing.assert_array_equal(answer[0], expected[0])
    assert_same_infos(answer[1], expected[1])
    num_truncated = 0
    for actions in fixed_actions(14, 3, envs.scenario):
        step = envs.step(actions)
        expected_step = expected_envs.step(actions.astype(np.float32))
        for values, expected_values in zip(step[:4], expected_step[:4], strict=True):
            np.testing.assert_array_equal(values, expected_values)
            assert values.dtype == expected_values.dtype
        assert_same_infos(step[4], expected_step[4])
        num_truncated += step[3].sum()
        ended = step[2] | step[3]
        if mode is AutoresetMode.DISABLED and ended.any():
            answer = envs.reset(options={"reset_mask": ended})
            expected = expected_envs.reset(options={"reset_mask": ended})
            np.testing.assert_array_equal(answer[0], expected[0])
            assert_same_infos(answer[1], expected[1])
    assert num_truncated == 6


@pytest.mark.parametrize("steps", [0, -5, 2.5, "9"])
def test_a_number_of_steps_that_is_none_is_refused(steps):
    message = f"max_episode_steps is {steps!r}, but must be None, -1 or at least 1"
    with pytest.raises(ValueError, match=message):
        gymnasium.make_vec("RoughTurning-v0", max_episode_steps=steps)


def test_a_specification_states_the_number_of_steps():
    envs = gymnasium.make_vec("RoughTurning-v0", 2, max_episode_steps=5)
    assert envs.spec.max_episode_steps == 5
    again = gymnasium.make_vec(EnvSpec.from_json(envs.spec.to_json()))
    again.reset(seed=0)
    truncated = [again.step(np.zeros((2, 2)))[3].tolist() for _ in range(5)]
    assert truncated == [[False, False]] * 4 + [[True, True]]


@pytest.mark.parametrize("mode", AutoresetMode)
def test_arrays_are_the_callers_to_change(mode):
    envs = RoughTurningVectorEnv(3, SHORT_LIVED, mode)
    untouched = RoughTurningVectorEnv(3, SHORT_LIVED, mode)
    envs.reset(seed=0)
    untouched.reset(seed=0)
    one_env = np.array([True, False, False])
    for actions in fixed_actions(STEPS, 3, SHORT_LIVED):
        step = envs.step(actions)
        expected_step = untouched.step(actions)
        assert_same_answers(step, expected_step)
        ended = expected_step[2] | expected_step[3]
        for values in step[:4]:
            values[...] = 1
        infos = step[4]
        for key in infos:
            if key.startswith("_"):
                infos[key][...] = False
                # No two masks are one.
                assert infos["_wear" if key != "_wear" else "_path"].all()
                infos[key][...] = True
        for _, values in infos.items():
            if not isinstance(values, dict):
                values[...] = 1
        options = {"reset_mask": one_env | ended}
        assert_same_answers(envs.reset(options=options), untouched.reset(options=options))


def test_unknown_options_are_refused():
    options = {"reset_masks": np.ones(2, bool)}
    with pytest.raises(ValueError, match=r"no option 'reset_masks'; did you mean reset_mask\?"):
        RoughTurningVectorEnv(2).reset(options=options)


def test_batches_step_side_by_side_in_threads():
    whole = RoughTurningVectorEnv(64, SHORT_LIVED)
    halves = [RoughTurningVectorEnv(32, SHORT_LIVED), RoughTurningVectorEnv(32, SHORT_LIVED)]
    whole.reset(seed=3)
    halves[0].reset(seed=3)
    halves[1].reset(seed=3 + 32)
    with ThreadPoolExecutor(2) as pool:
        for actions in fixed_actions(35, 64):
            observations = pool.map(
                lambda env, half: env.step(half)[0], halves, np.split(actions, 2)
            )
            expected = whole.step(actions)[0]
            np.testing.assert_array_equal(np.concatenate(list(observations)), expected)
