"""Frames and the window: Gymnasium's conventions, and pictures of the true state."""

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, Error, ResetNeeded

from tests.turning_env.playing import SHORT_LIVED, assert_same_bytes, fixed_actions, play
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.rendering.fields import Fields
from turning_env.rendering.theme import HEIGHT, WIDTH

SHAPE = (HEIGHT, WIDTH, 3)
MAX_DIFFERENCE = 2.0  # of a colour's 256 steps, as other versions of Pillow round otherwise


def assert_same_picture(frame, expected):
    """Assert that two frames have the same colours but for rounding."""
    assert frame.shape == expected.shape == SHAPE
    assert frame.dtype == expected.dtype == np.uint8
    difference = np.abs(frame.astype(np.float64) - expected)
    assert difference.max() <= MAX_DIFFERENCE


class Rendered(gymnasium.Wrapper):
    """Renders after every reset and, if asked, after every step."""

    def __init__(self, env, steps):
        super().__init__(env)
        self._steps = steps

    def reset(self, **options):
        result = self.env.reset(**options)
        self.env.render()
        return result

    def step(self, action):
        result = self.env.step(action)
        if self._steps:
            self.env.render()
        return result


@pytest.mark.slow
@pytest.mark.parametrize(
    "scenario", [SHORT_LIVED, "override", "batch_casting"], ids=["short", "override", "batch"]
)
def test_rendering_changes_neither_the_episode_nor_later_frames(scenario):
    actions = fixed_actions(40, 1, scenario)[:, 0]
    expected = play(RoughTurningEnv(scenario), 5, actions)
    env = RoughTurningEnv(scenario, render_mode="rgb_array")
    assert_same_bytes(play(Rendered(env, steps=True), 5, actions), expected)
    other_env = RoughTurningEnv(scenario, render_mode="rgb_array")
    assert_same_bytes(play(Rendered(other_env, steps=False), 5, actions), expected)
    assert_same_picture(env.render(), other_env.render())


def test_a_frame_is_the_caller_s_own():
    env = RoughTurningEnv(render_mode="rgb_array")
    env.reset(seed=5)
    frame = env.render()
    copy = frame.copy()
    env.step((1.0, 1.0))
    assert (env.render() != copy).any()
    np.testing.assert_array_equal(frame, copy)


def test_an_unknown_render_mode_is_refused():
    allowed = "render_mode is 'ansi', but must be None or one of 'human', 'rgb_array'"
    assert RoughTurningEnv.metadata["render_modes"] == ["human", "rgb_array"]
    with pytest.raises(ValueError, match=allowed):
        RoughTurningEnv(render_mode="ansi")


def test_there_is_no_frame_before_reset():
    with pytest.raises(ResetNeeded, match="reset"):
        RoughTurningEnv(render_mode="rgb_array").render()


def test_a_list_of_frames_has_one_for_each_step():
    env = gymnasium.make("RoughTurning-v0", render_mode="rgb_array_list")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    assert [frame.shape for frame in env.render()] == [SHAPE, SHAPE]


@pytest.mark.parametrize("make", [RoughTurningEnv, lambda: RoughTurningVectorEnv(2)])
def test_without_a_render_mode_there_is_a_warning_and_no_frame(make):
    env = make()
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="render mode"):
        assert env.render() is None


def test_whole_parts_are_shown_more_slowly_than_steps():
    parts = gymnasium.make("RoughTurning-Batch-v0", render_mode="rgb_array")
    steps = gymnasium.make("RoughTurning-v0", render_mode="rgb_array")
    assert parts.metadata["render_fps"] < steps.metadata["render_fps"]


def test_frames_of_a_batch_are_those_of_single_environments():
    num_envs = 3
    actions = fixed_actions(20, num_envs, SHORT_LIVED)
    envs = RoughTurningVectorEnv(
        num_envs,
        SHORT_LIVED,
        render_mode="rgb_array",
        rendered_envs=2,
    )
    envs.reset(seed=6)
    for action in actions:
        envs.step(action)
    frames = envs.render()
    assert len(frames) == 2
    for index, frame in enumerate(frames):
        env = RoughTurningEnv(SHORT_LIVED, render_mode="rgb_array")
        play(env, 6 + index, actions[:, index])
        assert_same_picture(frame, env.render())


def test_the_window_shows_every_step_and_says_when_it_was_closed(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    import pygame

    env = gymnasium.make("RoughTurning-v0", render_mode="human")
    env.reset(seed=0)
    screen = pygame.display.get_surface()
    assert screen.get_size() == (WIDTH, HEIGHT)
    before = pygame.surfarray.array3d(screen)
    env.step((1.0, 1.0))
    assert (pygame.surfarray.array3d(screen) != before).any()
    assert env.render() is None
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    with pytest.raises(ClosedEnvironmentError, match=r"window of RoughTurning-v0.* was closed"):
        env.step((1.0, 1.0))
    env.close()
    env.close()
    assert not pygame.display.get_init()


def test_without_a_display_the_error_says_what_to_do(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "nonsense")
    with pytest.raises(Error, match=r"no window can be opened .*rgb_array"):
        RoughTurningEnv(render_mode="human").reset(seed=0)


@pytest.mark.parametrize("preset", ["forging_skin", "small_diameter"])
def test_the_bar_that_is_drawn_is_the_one_that_is_cut(preset):
    scenario = Scenario.load(preset)
    workpiece = scenario.workpiece
    pitch = workpiece.bar_length + workpiece.approach
    fields = Fields(scenario)
    env = RoughTurningEnv(scenario)
    env.reset(seed=2**64 - 1)
    env.reset()
    checked = 0
    for action in fixed_actions(300, 1)[:, 0]:
        *_, terminated, truncated, info = env.step(action)
        place = info["path"] - info["bar"] * pitch - workpiece.approach
        if info["cutting"] and place > 1.0:
            metal = fields.along((2**64 - 1, 1), int(info["bar"]), np.array([place]))
            # The report is of the middle of the last sub-step's cut.
            assert metal.depth[0] == pytest.approx(info["depth_of_cut"], abs=0.03)
            assert metal.hardness[0] == pytest.approx(info["hardness"], abs=0.01)
            checked += 1
        if terminated or truncated:
            break
    assert checked > 20
