"""Many environments: each is the single environment, and the whole behaves as Gymnasium's own vector environments do."""

from concurrent.futures import ThreadPoolExecutor

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from tests.turning_env.playing import FAILING, HOT_SPINDLE, SHORT_LIVED, changed, fixed_actions
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario, presets

STEPS = 80


def assert_same_infos(ours, theirs):
    """Same keys, masks and types, and the same bits in the environments that the masks name."""
    assert ours.keys() == theirs.keys()
    for key, expected in theirs.items():
        if isinstance(expected, dict):
            assert_same_infos(ours[key], expected)
            continue
        assert ours[key].dtype == expected.dtype, key
        mask = slice(None) if key.startswith("_") else theirs["_" + key]
        ours_chosen, expected_chosen = ours[key][mask], expected[mask]
        if expected.dtype == object:
            ours_chosen, expected_chosen = (
                np.stack(list(ours_chosen)),
                np.stack(list(expected_chosen)),
            )
        assert ours_chosen.tobytes() == expected_chosen.tobytes(), key


def assert_same_answers(ours, theirs):
    for our, their in zip(ours[:-1], theirs[:-1], strict=True):
        assert (our.dtype, our.shape, our.tobytes()) == (their.dtype, their.shape, their.tobytes())
    assert_same_infos(ours[-1], theirs[-1])


MORTAL = [pytest.param(SHORT_LIVED, mode, 3, marks=pytest.mark.slow) for mode in AutoresetMode]
MORTAL.append(pytest.param(HOT_SPINDLE, AutoresetMode.NEXT_STEP, 64, marks=pytest.mark.slow))
MORTAL.append(pytest.param(SHORT_LIVED, AutoresetMode.SAME_STEP, 64, marks=pytest.mark.slow))
MORTAL.append(pytest.param(changed(Scenario(), **FAILING), AutoresetMode.SAME_STEP, 3))


@pytest.mark.parametrize(
    ("scenario", "mode", "num_envs"),
    [*MORTAL, *((preset, AutoresetMode.NEXT_STEP, 3) for preset in presets())],
)
def test_it_is_single_environments_side_by_side(scenario, mode, num_envs):
    """Bit for bit what Gymnasium makes of single environments, through several episodes per environment."""
    ours = RoughTurningVectorEnv(num_envs, scenario, mode)
    theirs = SyncVectorEnv([lambda: RoughTurningEnv(scenario)] * num_envs, autoreset_mode=mode)
    assert_same_answers(ours.reset(seed=2**63), theirs.reset(seed=2**63))
    ended_count = np.zeros(num_envs, int)
    for actions in fixed_actions(STEPS, num_envs, scenario):
        answers = ours.step(actions)
        assert_same_answers(answers, theirs.step(actions))
        ended = answers[2] | answers[3]
        ended_count += ended
        if mode is AutoresetMode.DISABLED and ended.any():
            masks = [{"reset_mask": ended.copy()} for _ in range(2)]
            assert_same_answers(ours.reset(options=masks[0]), theirs.reset(options=masks[1]))
    assert ended_count.min() >= 2 or scenario is not SHORT_LIVED
    assert_same_answers(ours.reset(), theirs.reset())


def test_seeds_may_be_given_one_by_one():
    env, singles = RoughTurningVectorEnv(3), RoughTurningEnv()
    _, infos = env.reset(seed=[7, 7, 9])
    assert infos["wear_factor"].tolist() == [
        singles.reset(seed=seed)[1]["wear_factor"] for seed in (7, 7, 9)
    ]
    _, infos = env.reset(seed=[None, 1, None])
    expected = []
    for seed, again in ((7, None), (1, 1), (9, None)):
        singles.reset(seed=seed)
        expected.append(singles.reset(seed=again)[1]["wear_factor"])
    assert infos["wear_factor"].tolist() == expected


@pytest.mark.parametrize(
    ("mask", "error"),
    [
        ([1, 0, 1], ValueError),
        ([True, False], ValueError),
        ("all", ValueError),
        ([True, False, True], ResetNeeded),
    ],
)
def test_bad_reset_masks_are_refused(mask, error):
    env = RoughTurningVectorEnv(3)
    if error is ValueError:
        env.reset(seed=0)
    with pytest.raises(error, match=r"reset_mask must be bool of shape \(3,\)|first reset"):
        env.reset(options={"reset_mask": mask})


@pytest.mark.parametrize(
    ("seed", "said"),
    [
        (-1, "seed -1 of environment 0"),
        (2**64 - 2, f"seed {2**64} of environment 2"),
        ("abc", "seed 'a' of environment 0"),
        ([1, 2], "2 seeds given, but there must be one for each of 3 environments"),
        ([1, 2.5, 3], "seed 2.5 of environment 1"),
    ],
)
def test_bad_seeds_are_refused_and_nothing_moves(seed, said):
    env, untouched = RoughTurningVectorEnv(3), RoughTurningVectorEnv(3)
    env.reset(seed=0)
    untouched.reset(seed=0)
    with pytest.raises(ValueError, match=said):
        env.reset(seed=seed)
    for _ in range(5):
        assert_same_answers(env.step(np.ones((3, 2))), untouched.step(np.ones((3, 2))))


def test_bad_arguments_are_refused():
    with pytest.raises(
        ValueError,
        match=r"max_episode_steps is 9, but must be 3600: set control.time_limit instead",
    ):
        gymnasium.make_vec("RoughTurning-v0", max_episode_steps=9)
    with pytest.raises(ValueError, match=r"no option 'reset_masks'; did you mean reset_mask\?"):
        RoughTurningVectorEnv(2).reset(options={"reset_masks": np.ones(2, bool)})
    with pytest.raises(ValueError, match="num_envs is 0, but must be at least 1"):
        RoughTurningVectorEnv(0)
    with pytest.raises(
        ValueError, match="rendered_envs is 3, but must be None or 1 to num_envs, which is 2"
    ):
        RoughTurningVectorEnv(2, render_mode="rgb_array", rendered_envs=3)
    with pytest.raises(
        ValueError, match="render_mode is 'human', but must be None or one of 'rgb_array'"
    ):
        RoughTurningVectorEnv(1, render_mode="human")
    with pytest.raises(ValueError, match="Sometimes"):
        RoughTurningVectorEnv(1, autoreset_mode="Sometimes")


def test_batches_step_side_by_side_in_threads_of_ones_own():
    alone, halves = (
        RoughTurningVectorEnv(64, SHORT_LIVED),
        [RoughTurningVectorEnv(32, SHORT_LIVED) for _ in range(2)],
    )
    alone.reset(seed=3)
    for k, half in enumerate(halves):
        half.reset(seed=3 + 32 * k)
    with ThreadPoolExecutor(2) as pool:
        for actions in fixed_actions(35, 64):
            stepped = pool.map(lambda env, given: env.step(given)[0], halves, np.split(actions, 2))
            np.testing.assert_array_equal(np.concatenate(list(stepped)), alone.step(actions)[0])
