"""The game by hand, in a window without a display and with scripted keys."""

import sys
from collections.abc import Iterator

import numpy as np
import pytest

from leaderboard.__main__ import main
from leaderboard.game import Game, best_opponent, match_on_family, match_on_task

pygame = pytest.importorskip("pygame")


@pytest.fixture(autouse=True)
def without_display(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    yield
    pygame.display.quit()


def press(key: int) -> None:
    pygame.event.post(pygame.event.Event(pygame.KEYDOWN, key=key))


def release(key: int) -> None:
    pygame.event.post(pygame.event.Event(pygame.KEYUP, key=key))


def commands(game: Game) -> tuple[float, float]:
    """Return the commanded cutting speed and feed, as places in their ranges."""
    return float(game.player.observation[4]), float(game.player.observation[5])


def test_keys_change_speed_and_feed_while_they_are_held() -> None:
    game = Game(match_on_task("RoughTurning-v0", seed=3), frames_per_second=1000)
    assert game.advance()
    speed, feed = commands(game)
    press(pygame.K_RIGHT)
    press(pygame.K_DOWN)
    for _ in range(2):
        assert game.advance()
    release(pygame.K_RIGHT)
    release(pygame.K_DOWN)
    faster, less_feed = commands(game)
    assert faster > speed
    assert less_feed < feed
    assert game.advance()
    assert commands(game) == pytest.approx((faster, less_feed))
    press(pygame.K_SPACE)
    before = game.player.total
    assert game.advance()
    assert game.player.total == before
    press(pygame.K_ESCAPE)
    assert not game.advance()
    assert f"{game.opponent.name} {game.rule.total:.1f} s when you stopped" in game.finish()


def test_a_feed_override_is_set_and_stays() -> None:
    game = Game(match_on_task("RoughTurning-Override-v1", seed=3), frames_per_second=1000)
    press(pygame.K_UP)
    assert game.advance()
    release(pygame.K_UP)
    assert game.advance()
    assert np.isfinite(game.rule.total)
    assert game.finish().startswith("RoughTurning-Override-v1, seed 3: you ")


def test_a_training_job_of_a_family_is_played_beside_the_rule_that_learns() -> None:
    game = Game(match_on_family("unmodelled", seed=3), frames_per_second=1000)
    assert game.opponent.name == "self_tuning"
    assert game.advance()
    assert game.player.total == pytest.approx(game.rule.total, abs=0.1)
    press(pygame.K_e)
    press(pygame.K_UP)
    assert game.advance()
    # A new edge costs its price and the time of the change; the rule keeps its edge.
    assert game.player.total < game.rule.total - 10.0
    assert "job unmodelled-train-3: you " in game.finish()


def test_the_opponent_is_a_feasible_rule_that_beats_fixed_values() -> None:
    assert best_opponent("RoughTurning-v0").name not in ("fixed_tuned", "fixed_handbook")


@pytest.mark.parametrize(
    ("env_id", "advice"),
    [("RoughTurning-Family-v1", "--family shop"), ("RoughTurning-Batch-v0", "whole part")],
)
def test_an_id_that_no_hand_plays_is_refused_with_the_reason(
    env_id: str, advice: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(["play", "--env", env_id])
    assert advice in capsys.readouterr().err


def test_a_missing_package_is_named_before_anything_compiles(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def starts(env_id: str, seed: int) -> None:
        raise AssertionError("the match starts")

    monkeypatch.setattr("leaderboard.game.match_on_task", starts)
    monkeypatch.setitem(sys.modules, "pygame", None)
    assert main(["play"]) == 2
    assert "pygame is not installed: pip install" in capsys.readouterr().err
