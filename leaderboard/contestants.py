"""What can be ranked: policies that act on observations, and references that are computed otherwise."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from leaderboard.result import PolicyRecord, ResultError
from turning_env import Scenario
from turning_env.score.play import Episodes, play
from turning_env.score.policy import PolicyFactory


@dataclass(frozen=True)
class Contestant:
    """A policy that can play."""

    policy: PolicyRecord
    make: PolicyFactory

    def episodes(self, scenario: Scenario, draws: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
        """Play one episode per draw: see ``turning_env.score.play.play``.

        Raises:
            ResultError: its actions have the wrong shape or are not finite.
        """
        try:
            return play(self.make, scenario, draws, on_step)
        except ValueError as error:
            raise ResultError(f"{self.policy.label} cannot play: {error}") from error


@dataclass(frozen=True)
class Reference:
    """What no policy plays, as it knows more than observations tell: a bound. Its record is of the kind "reference"."""

    policy: PolicyRecord
    compute: Callable[[Scenario, Sequence[int], Callable[[int], None]], Episodes]
    """The episodes of a scenario and draws; calls the third after each piece of work with the number of episodes done."""

    def episodes(self, scenario: Scenario, draws: Sequence[int], on_step: Callable[[int], None]) -> Episodes:
        """What it comes to on each draw."""
        return self.compute(scenario, draws, on_step)


Player = Contestant | Reference


@dataclass(frozen=True)
class Turn:
    """A player's episodes on some draws of a scenario: what is played at a time, by this process or by a worker."""

    player: Player
    scenario: Scenario
    draws: Sequence[int]

    def play(self, on_step: Callable[[int], None] = lambda ended: None) -> Episodes:
        """Play them; see ``Contestant.episodes``."""
        return self.player.episodes(self.scenario, self.draws, on_step)

    def attempt(self, on_step: Callable[[int], None] = lambda ended: None) -> Episodes | ResultError:
        """Play them, or say why the player cannot, so that others go on."""
        try:
            return self.play(on_step)
        except ResultError as error:
            return error
