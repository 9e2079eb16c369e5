"""The batch behind other libraries' interfaces gives what single environments give."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import (
    DummyVecEnv,
    VecCheckNan,
    VecFrameStack,
    VecMonitor,
    VecNormalize,
    VecVideoRecorder,
)

from tests.turning_env.playing import changed
from tests.turning_env.test_family_env import BRIEF_FAMILY
from turning_env import (
    IDS,
    Family,
    FamilyEnv,
    RoughTurningEnv,
    RoughTurningVectorEnv,
    Scenario,
)
from turning_env.adapters.stable_baselines3 import RoughTurningVecEnv
from turning_env.vector_env import info_at_end_of_step

# Episodes of at most 12 steps, ending in breakage as well as out of time.
SHORT = Scenario.model_validate({"tool": {"edge_strength": 900.0}, "control": {"time_limit": 0.2}})


NUM_ENVS = 5
SCALE = 0.5  # of rewards
STEPS = 60


def single_environment(scenario: Scenario | Family) -> Monitor:
    """Return an environment with the wrapper of Stable-Baselines3 that sums up episodes."""
    if isinstance(scenario, Family):
        return Monitor(FamilyEnv(scenario))
    return Monitor(RoughTurningEnv(scenario))


def assert_same_info(info: dict[str, Any], expected: dict[str, Any]) -> None:
    """Assert that the infos of an environment whose episode has ended agree."""
    assert info.keys() == expected.keys()
    for name in expected.keys() - {"terminal_observation", "episode"}:
        assert info[name] == expected[name], name
        assert type(info[name]) is type(expected[name]), name
    np.testing.assert_array_equal(info["terminal_observation"], expected["terminal_observation"])
    assert info["TimeLimit.truncated"] == expected["TimeLimit.truncated"]
    # Returns are not scaled.
    returned = expected["episode"]["r"]
    assert info["episode"]["r"] == pytest.approx(returned, rel=1e-5, abs=1e-5)
    assert info["episode"]["l"] == expected["episode"]["l"]


@pytest.mark.parametrize(
    ("scenario", "kinds_of_end"),
    [
        pytest.param(SHORT, {True, False}, id="rough_turning"),
        pytest.param(
            changed("override", workpiece={"bar_length": 1.0, "approach": 0.1}),
            {False},
            id="override",
        ),
        pytest.param(changed("surface", control={"time_limit": 0.003}), {True}, id="surface"),
        pytest.param(
            changed("shift", control={"time_limit": 5.0}, tool={"edge_strength": 900.0}),
            {True},
            id="shift",
        ),
        pytest.param(changed("batch_casting", workpiece={"bars": 3}), {False}, id="batch"),
        pytest.param(BRIEF_FAMILY, {True}, id="family"),
    ],
)
def test_it_agrees_with_the_vector_environment_of_stable_baselines3(
    scenario: Scenario | Family, kinds_of_end: set[bool]
) -> None:
    env = RoughTurningVecEnv(scenario, NUM_ENVS, SCALE)
    expected_env = DummyVecEnv([lambda: single_environment(scenario)] * NUM_ENVS)
    env.seed(40)
    expected_env.seed(40)
    np.testing.assert_array_equal(env.reset(), expected_env.reset())
    (size,) = env.action_space.shape or ()
    phase = np.arange(NUM_ENVS * size).reshape(NUM_ENVS, size)
    truncated = set()
    for step in range(STEPS):
        actions = np.sin(phase + 0.2 * step).astype(np.float32)
        observations, rewards, dones, infos = env.step(actions)
        expected_observations, expected_rewards, expected_dones, expected_infos = expected_env.step(
            actions
        )
        np.testing.assert_array_equal(observations, expected_observations)
        np.testing.assert_array_equal(dones, expected_dones)
        np.testing.assert_allclose(rewards, SCALE * expected_rewards, rtol=1e-6)
        assert rewards.dtype == np.float32
        for done, info, expected_info in zip(
            dones,
            infos,
            expected_infos,
            strict=True,
        ):
            if done:
                assert_same_info(info, expected_info)
                truncated.add(info["TimeLimit.truncated"])
            else:
                assert info == {}
    assert truncated == kinds_of_end


@pytest.mark.slow
def test_evaluate_policy_reports_returns_whatever_the_scale_of_rewards() -> None:
    """Warnings, such as that there is no Monitor, count as errors."""

    def evaluated(reward_scale: float) -> Any:
        env = RoughTurningVecEnv(SHORT, NUM_ENVS, reward_scale)
        env.seed(40)
        model = PPO("MlpPolicy", env, seed=1, device="cpu")
        return evaluate_policy(
            model,
            env,
            2 * NUM_ENVS,
            return_episode_rewards=True,
        )

    assert evaluated(SCALE) == evaluated(1.0)


def test_an_episode_has_a_sum_of_costs() -> None:
    env = RoughTurningVecEnv(SHORT, NUM_ENVS)
    plain = RoughTurningVectorEnv(NUM_ENVS, SHORT, AutoresetMode.SAME_STEP)
    env.seed(40)
    env.reset()
    plain.reset(seed=40)
    actions = np.ones((NUM_ENVS, 2), np.float32)
    expected = np.zeros(NUM_ENVS)
    num_ended = 0
    for _ in range(STEPS):
        _, _, dones, infos = env.step(actions)
        *_, plain_infos = plain.step(actions)
        expected += info_at_end_of_step(plain_infos, "cost")
        for index in np.flatnonzero(dones):
            assert infos[index]["episode"]["cost"] == pytest.approx(expected[index], abs=1e-12)
        expected[dones] = 0.0
        num_ended += dones.sum()
    assert num_ended > NUM_ENVS


@pytest.mark.parametrize(
    "wrap",
    [
        pytest.param(lambda env: env, id="none"),
        pytest.param(VecMonitor, id="VecMonitor"),
        pytest.param(
            lambda env: VecMonitor(env, info_keywords=("finished", "cost")),
            id="VecMonitor of infos",
        ),
        pytest.param(lambda env: VecNormalize(env, gamma=0.9), id="VecNormalize"),
        pytest.param(lambda env: VecFrameStack(env, 3), id="VecFrameStack"),
        pytest.param(lambda env: VecCheckNan(env, raise_exception=True), id="VecCheckNan"),
    ],
)
@pytest.mark.parametrize("preset", [*IDS.values(), "shop"])
@pytest.mark.filterwarnings("ignore:The environment is already wrapped with a `Monitor`")
def test_wrappers_take_it_as_they_take_single_environments(preset: str, wrap: Any) -> None:
    env = wrap(RoughTurningVecEnv(preset, 2))
    source = Family.load("shop") if preset == "shop" else Scenario.load(preset)
    expected_env = wrap(DummyVecEnv([lambda: single_environment(source)] * 2))
    env.seed(40)
    expected_env.seed(40)
    np.testing.assert_allclose(env.reset(), expected_env.reset(), rtol=1e-6, atol=1e-6)
    actions = np.zeros((2, *env.action_space.shape), np.float32)
    for _ in range(25):
        step = env.step(actions)
        expected_step = expected_env.step(actions)
        for values, expected_values in zip(step[:3], expected_step[:3], strict=True):
            np.testing.assert_allclose(values, expected_values, rtol=1e-5, atol=1e-5)
        for done, info, expected_info in zip(step[2], step[3], expected_step[3], strict=True):
            if done:
                assert info.keys() == expected_info.keys()
                assert info["episode"]["r"] == pytest.approx(expected_info["episode"]["r"])


def test_attributes_are_those_of_single_environments() -> None:
    env = RoughTurningVecEnv(BRIEF_FAMILY, 3)
    single = single_environment(BRIEF_FAMILY)
    for name in ("observation_space", "action_space", "render_mode", "scenario", "split"):
        expected = [single.get_wrapper_attr(name)] * 3
        assert env.get_attr(name) == expected
        assert env.env_method("get_wrapper_attr", name) == expected
    assert env.has_attr("family")
    assert not env.has_attr("no_such_attribute")
    assert env.env_method("has_wrapper_attr", "no_such_attribute", indices=1) == [False]


def test_methods_of_single_environments_can_be_called() -> None:
    env = RoughTurningVecEnv(BRIEF_FAMILY, 3)
    env.seed(4)
    env.reset()
    single = FamilyEnv(BRIEF_FAMILY)
    scenarios = []
    for seed in (4, 6):
        single.reset(seed=seed)
        scenarios.append(single.job().scenario)
    jobs = env.env_method("job", indices=[0, 2])
    assert [job.scenario for job in jobs] == scenarios
    with pytest.raises(NotImplementedError, match="cannot call 'step' of one environment"):
        env.env_method("step", np.zeros(3))


def test_unknown_options_are_refused() -> None:
    env = RoughTurningVecEnv(SHORT, 2)
    env.set_options({"difficulty": 1})
    with pytest.raises(ValueError, match="reset has no option 'difficulty'"):
        env.reset()


@pytest.mark.slow
def test_frames_are_those_of_the_environments() -> None:
    env = RoughTurningVecEnv(SHORT, 3, render_mode="rgb_array", rendered_envs=2)
    env.seed(40)
    env.reset()
    env.step(np.zeros((3, 2), np.float32))
    assert env.render_mode == "rgb_array"
    frames = env.get_images()
    assert [frame.shape for frame in frames] == [(640, 960, 3)] * 2
    single = RoughTurningEnv(SHORT, render_mode="rgb_array")
    single.reset(seed=41)
    single.step(np.zeros(2, np.float32))
    np.testing.assert_array_equal(frames[1], single.render())
    np.testing.assert_array_equal(env.env_method("render", indices=1)[0], frames[1])
    assert env.render().shape == (2 * 640, 960, 3)


@pytest.mark.slow
def test_videos_are_recorded(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = VecVideoRecorder(
        RoughTurningVecEnv(SHORT, 1, render_mode="rgb_array"),
        str(tmp_path),
        record_video_trigger=lambda step: step == 0,
        video_length=4,
    )
    env.reset()
    for _ in range(5):
        env.step(np.zeros((1, 2), np.float32))
    env.close()
    assert env.frames_per_sec == 30
    assert [path.suffix for path in tmp_path.iterdir()] == [".mp4"]
