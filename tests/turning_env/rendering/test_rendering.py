"""Frames and the window: Gymnasium's conventions, rendering changes nothing, and what is drawn is true."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ClosedEnvironmentError, Error, ResetNeeded

from tests.turning_env.playing import SHORT_LIVED, assert_same_bytes, fixed_actions, play
from turning_env import RoughTurningEnv, RoughTurningVectorEnv, Scenario
from turning_env.rendering.fields import Fields
from turning_env.rendering.theme import HEIGHT, WIDTH

SHAPE = (HEIGHT, WIDTH, 3)
ROOT = Path(__file__).parents[3]


def rendered(scenario, seed, actions):
    """Return the environment after these actions."""
    env = RoughTurningEnv(scenario, render_mode="rgb_array")
    play(env, seed, actions)
    return env


@pytest.mark.parametrize("scenario", [SHORT_LIVED, "override", "batch_casting"])
def test_rendering_every_step_changes_neither_the_episode_nor_later_frames(scenario):
    actions = fixed_actions(40, 1, scenario)[:, 0]
    always, at_first = (RoughTurningEnv(scenario, render_mode="rgb_array") for _ in range(2))
    for env, methods in ((always, ("step", "reset")), (at_first, ("reset",))):
        for name in methods:
            method = getattr(env, name)
            setattr(
                env,
                name,
                lambda *given, m=method, e=env, **named: (m(*given, **named), e.render())[0],
            )
    told = play(RoughTurningEnv(scenario), 5, actions)
    assert_same_bytes(play(always, 5, actions), told)
    assert_same_bytes(play(at_first, 5, actions), told)
    frame = always.render()
    assert np.array_equal(frame, at_first.render())
    kept = frame.copy()
    always.reset(seed=6)
    assert np.array_equal(frame, kept)


def test_render_modes_are_gymnasium_s():
    assert RoughTurningEnv.metadata["render_modes"] == ["human", "rgb_array"]
    with pytest.raises(
        ValueError, match="render_mode is 'ansi', but must be None or one of 'human', 'rgb_array'"
    ):
        RoughTurningEnv(render_mode="ansi")
    with pytest.raises(ResetNeeded, match="reset"):
        RoughTurningEnv(render_mode="rgb_array").render()
    env = gymnasium.make("RoughTurning-v0", render_mode="rgb_array_list")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    assert [frame.shape for frame in env.render()] == [SHAPE, SHAPE]
    for without in (RoughTurningEnv(), RoughTurningVectorEnv(2)):
        without.reset(seed=0)
        with pytest.warns(UserWarning, match="render mode"):
            assert without.render() is None
    slow = gymnasium.make("RoughTurning-Batch-v0", render_mode="rgb_array")
    assert slow.metadata["render_fps"] < RoughTurningEnv.metadata["render_fps"]


def test_as_many_environments_as_asked_are_drawn_as_single_ones():
    actions = fixed_actions(20, 3, SHORT_LIVED)
    envs = RoughTurningVectorEnv(3, SHORT_LIVED, render_mode="rgb_array", rendered_envs=2)
    envs.reset(seed=6)
    for each in actions:
        envs.step(each)
    frames = envs.render()
    assert len(frames) == 2
    for index, frame in enumerate(frames):
        assert np.array_equal(frame, rendered(SHORT_LIVED, 6 + index, actions[:, index]).render())


def test_the_window_shows_by_itself_and_says_when_it_was_closed(monkeypatch):
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
    fields, env = Fields(scenario), RoughTurningEnv(scenario)
    env.reset(seed=2**64 - 1)
    env.reset()
    checked = 0
    for action in fixed_actions(300, 1)[:, 0]:
        *_, terminated, truncated, info = env.step(action)
        pitch = scenario.workpiece.bar_length + scenario.workpiece.approach
        place = info["path"] - info["bar"] * pitch - scenario.workpiece.approach
        if info["cutting"] and place > 1.0:
            hardness, depth = fields.along((2**64 - 1, 1), int(info["bar"]), np.array([place]))
            # What is reported is the middle of the last sub-step's cut.
            assert depth[0] == pytest.approx(info["depth_of_cut"], abs=0.03)
            assert hardness[0] == pytest.approx(info["hardness"], abs=0.01)
            checked += 1
        if terminated or truncated:
            break
    assert checked > 20
