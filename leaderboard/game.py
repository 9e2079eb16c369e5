"""The game: one episode by hand in a window, beside the best rule on the same bars."""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium.error import ClosedEnvironmentError, DependencyNotInstalled, Error
from numpy.typing import NDArray

from baselines import catalogue
from leaderboard.scoring import shipped
from leaderboard.standings import best_rule, rank_together
from turning_env import FAMILY_ID, IDS, Family, Scenario
from turning_env.console import UserError, described, exits
from turning_env.extras import needed
from turning_env.policy import Policy
from turning_env.rendering.viewer import Window
from turning_env.scenario.arguments import environment_id
from turning_env.scenario.family import families

PLAYABLE = [env_id for env_id in IDS if env_id != "RoughTurning-Batch-v0"]
"""Ids that are played by hand.

A step of RoughTurning-Batch-v0 is a plan of ten numbers for a whole part, which no keys steer.
"""
FAMILY_RULE = "self_tuning"  # opponent on families: it learns the lathe while it cuts
FIRST_SEED = 1_000_000  # of games without --seed; no leaderboard plays it
_CHANGE = 0.3  # share of the largest change of speed or feed in a step with a key held
_LEVEL_STEP = 0.05  # by which a step changes an action that sets a value, within -1..1
_STRIP_HEIGHT = 34  # [pixels]


class Opponent(NamedTuple):
    """A rule and its name."""

    name: str
    policy: Policy


@dataclass
class Lathe:
    """An environment and what its episode has returned so far."""

    env: gymnasium.Env[Any, Any]
    observation: NDArray[np.float32]
    total: float = 0.0  # [s of machine time]
    ended: bool = False

    def step(self, action: NDArray[np.float64]) -> None:
        """Run one step, unless the episode has ended."""
        if self.ended:
            return
        self.observation, reward, terminated, truncated, _ = self.env.step(action)
        self.total += float(reward)
        self.ended = terminated or truncated


@dataclass(frozen=True)
class Match:
    """One episode, and the rule that plays it, too.

    ``arguments`` are those of ``gymnasium.make`` beside the id and the mode of rendering.
    """

    env_id: str
    seed: int
    scenario: Scenario
    opponent: Opponent
    title: str
    arguments: Mapping[str, Any] = field(default_factory=dict)

    def start(self, render_mode: str | None = None) -> Lathe:
        """Return an environment at the start of the episode."""
        env = gymnasium.make(self.env_id, render_mode=render_mode, **self.arguments)
        observation, _ = env.reset(seed=self.seed)
        return Lathe(env, observation)


def match_on_task(env_id: str, seed: int) -> Match:
    """Return the match on an id, one of ``PLAYABLE``, against its best rule."""
    return Match(
        env_id=env_id,
        seed=seed,
        scenario=Scenario.load(IDS[env_id]),
        opponent=best_opponent(env_id),
        title=f"{env_id}, seed {seed}",
    )


def match_on_family(name: str, seed: int) -> Match:
    """Return the match on the training job of a seed, against ``FAMILY_RULE``.

    The rule is built from the job's nominal model, so the observation need not show its numbers.
    """
    family = Family.load(name)
    job = family.job(seed)
    rule = catalogue.spec(FAMILY_RULE, job.scenario, tuned_on=Scenario.load(family.base))
    return Match(
        env_id=FAMILY_ID,
        seed=seed,
        scenario=job.scenario,
        opponent=Opponent(FAMILY_RULE, rule.make(1)),
        title=f"{FAMILY_ID}, job {job.scenario.name}",
        arguments={"family": family, "split": "train", "context": "hidden"},
    )


def best_opponent(env_id: str) -> Opponent:
    """Return the rule of the highest mean return among the feasible ones of an id's leaderboard.

    Raise UserError if no feasible rule plays the id.
    """
    scenario = Scenario.load(IDS[env_id])
    rules = catalogue.names(scenario)
    policies = [played for played in shipped(env_id) if played.name in rules]
    best = best_rule(rank_together(policies, scenario, on_family=False)) if policies else None
    if best is None or not best.feasible:
        raise UserError(f"no feasible rule plays {env_id}")
    rule = catalogue.spec(best.name, scenario)
    return Opponent(best.name, rule.make(1))


class Keyboard:
    """The keys that are held down, and those pressed since the last look."""

    def __init__(self) -> None:
        import pygame

        self._pygame: Any = pygame
        self._held: set[int] = set()
        self._pressed: set[int] = set()

    def look(self) -> None:
        """Take in what has happened since the last look."""
        pygame = self._pygame
        self._pressed = set()
        for event in pygame.event.get((pygame.KEYDOWN, pygame.KEYUP)):
            if event.type == pygame.KEYDOWN:
                self._held.add(event.key)
                self._pressed.add(event.key)
            else:
                self._held.discard(event.key)

    def direction(self, up: str, down: str) -> float:
        """Return 1 if one key is active, -1 if the other is, otherwise 0."""
        return float(self._is_active(up)) - float(self._is_active(down))

    def pressed(self, name: str) -> bool:
        """Return whether a key was pressed between the last two looks."""
        return self._pygame.key.key_code(name) in self._pressed

    def _is_active(self, name: str) -> bool:
        # A short tap may begin and end between two looks.
        code = self._pygame.key.key_code(name)
        return code in self._held or code in self._pressed


class Game:
    """One episode by hand, in a window, beside a rule in the same episode.

    Args:
        match: the episode and the rule.
        frames_per_second: highest number of steps shown in a second.

    Raises:
        gymnasium.error.Error: no window can be opened, or rendering lacks a package.
    """

    def __init__(self, match: Match, frames_per_second: int = 30) -> None:
        self.opponent = match.opponent
        self.player = match.start(render_mode="rgb_array")
        self.rule = match.start()
        self.opponent.policy.reset(np.ones(1, np.bool_))
        self.paused = False
        control = match.scenario.control
        self._sets_changes = control.action == "incremental"
        self._has_speed = control.action != "override"
        self._changes_edges = control.edge_changes == "commanded"
        self._end = control.time_limit  # [min]
        self._levels = np.zeros(2 if self._has_speed else 1)
        self._title = match.title
        with needed(DependencyNotInstalled):
            self._window = Window(frames_per_second)
            self._keyboard = Keyboard()
        self.show()

    def show(self) -> None:
        """Show the present state, and wait until the next frame is due."""
        frame: Any = self.player.env.render()
        self._window.show(np.vstack([frame, self._strip(frame.shape[1])]), self._title)

    def advance(self) -> bool:
        """Take in the keys and run one step of both lathes; return whether the game goes on."""
        keyboard = self._keyboard
        keyboard.look()
        if keyboard.pressed("escape"):
            return False
        if keyboard.pressed("space"):
            self.paused = not self.paused
        if not self.paused:
            self.player.step(self._action())
            self._step_rule()
        self.show()
        return not self.player.ended

    def finish(self) -> str:
        """Let the rule end its episode, close the window and return the result in words."""
        while self.player.ended and not self.rule.ended:
            self._step_rule()
        self._window.close()
        lead = self.player.total - self.rule.total
        place = "ahead" if lead > 0.0 else "behind"
        end = "" if self.player.ended else " when you stopped"
        return (
            f"{self._title}: you {self.player.total:.1f} s, "
            f"{self.opponent.name} {self.rule.total:.1f} s{end}: "
            f"you are {abs(lead):.1f} s {place}"
        )

    def _step_rule(self) -> None:
        actions = self.opponent.policy.act(self.rule.observation[np.newaxis])
        self.rule.step(actions[0])

    def _action(self) -> NDArray[np.float64]:
        """Return the action of the keys that are held.

        Actions that change speed and feed last while a key is held; others are levels, which keys
        move and which stay.
        """
        keyboard = self._keyboard
        feed = keyboard.direction("up", "down")
        directions = np.array([feed])
        if self._has_speed:
            directions = np.array([keyboard.direction("right", "left"), feed])
        if self._sets_changes:
            action = _CHANGE * directions
        else:
            self._levels = np.clip(self._levels + _LEVEL_STEP * directions, -1.0, 1.0)
            action = self._levels
        if self._changes_edges:
            action = np.append(action, 1.0 if keyboard.pressed("e") else -1.0)
        return action

    def _strip(self, width: int) -> NDArray[np.uint8]:
        """Return the line below the frame: both returns, and the keys."""
        from PIL import Image

        from turning_env.rendering.theme import PAPER, QUIET, length, write

        image = Image.new("RGB", (width, _STRIP_HEIGHT), PAPER)
        player = f"you {self.player.total:.1f} s"
        rule = f"{self.opponent.name} {self.rule.total:.1f} s"
        score = f"{player}     {rule}"
        write(image, (16, 5), score, size=17)
        if self._changes_edges:  # the time ends these episodes, not the edge
            place = (36 + length(score, 17), 8)
            write(image, place, f"until {self._end:.0f} min", size=13, colour=QUIET)
        keys = ["up/down: feed", "space: pause", "Esc: end"]
        if self._has_speed:
            keys.insert(0, "left/right: speed")
        if self._changes_edges:
            keys.insert(-2, "E: new edge")
        write(
            image,
            (width - 16, 8),
            "   ".join(keys),
            size=13,
            colour=QUIET,
            anchor="right",
        )
        return np.asarray(image)


def add_to(commands: Any) -> None:
    """Add the command ``play`` to the subparsers of a command line."""
    parser = commands.add_parser(
        "play",
        help="play a lathe by hand, beside the best rule",
        **described(play_by_hand.__doc__),
    )
    parser.set_defaults(command=play_by_hand)
    _add_options(parser)


def _playable(word: str) -> str:
    """Return an argument that names an id that is played by hand, as it is.

    Raises:
        argparse.ArgumentTypeError: it is no such id; the message says what to give instead.
    """
    env_id = environment_id(word)
    if env_id == FAMILY_ID:
        raise argparse.ArgumentTypeError(f"{env_id} has families: give --family {families()[0]}")
    if env_id not in PLAYABLE:
        raise argparse.ArgumentTypeError(f"{env_id} cannot be played: its step plans a whole part")
    return env_id


def _add_options(parser: argparse.ArgumentParser) -> None:
    task = parser.add_mutually_exclusive_group()
    task.add_argument(
        "--env",
        type=_playable,
        choices=PLAYABLE,
        default="RoughTurning-v0",
        metavar="ID",
        help=f"environment, one of {', '.join(PLAYABLE)} (default: %(default)s)",
    )
    task.add_argument(
        "--family",
        choices=families(),
        help=f"play a training job of this family instead, against the rule {FAMILY_RULE}",
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=FIRST_SEED,
        help="seed of the bars, which also determines a family's job (default: %(default)s)",
    )


@exits(Error)
def play_by_hand(options: argparse.Namespace) -> int:
    """Play a lathe by hand in a window, beside the best rule on the same bars.

    Left and right change the cutting speed, up and down the feed, E changes the edge if the task
    lets you, and the space bar pauses. Escape ends the game. Hold a key to go on.

    python -m leaderboard play
    python -m leaderboard play --env RoughTurning-Override-v1 --seed 7
    python -m leaderboard play --family shop --seed 7
    """
    if options.seed < 0:
        raise UserError(f"--seed {options.seed} must be 0 or more")
    # Say that a package is missing before the rule and the lathe compile.
    with needed(DependencyNotInstalled):
        import PIL.Image  # noqa: F401
        import pygame  # noqa: F401
    if options.family is None:
        match = match_on_task(options.env, options.seed)
    else:
        match = match_on_family(options.family, options.seed)
    game = Game(match)
    try:
        while game.advance():
            pass
    except ClosedEnvironmentError:
        pass  # the window was closed by hand, which ends the game as Escape does
    print(game.finish())
    return 0
