"""Pieces of work of a run: one policy plays some seeds of a scenario, or is recorded on one.

``leaderboard.run`` hands pieces to ``leaderboard.workers``; a policy that fails stops no other.
"""

import traceback
from collections.abc import Callable, Sequence
from typing import NamedTuple

from baselines.policy_spec import PolicySpec
from leaderboard.adapt import place_in_module
from leaderboard.play import Episodes, play
from leaderboard.policies import reason_of
from leaderboard.result import ResultError
from leaderboard.trajectories import Trajectory, record
from turning_env import Scenario
from turning_env.console import printable


class Piece(NamedTuple):
    """A piece of work: a policy that plays some seeds of a scenario."""

    policy: PolicySpec
    scenario: Scenario
    seeds: Sequence[int]


Attempt = Episodes | ResultError
"""The episodes of a piece, or why its policy cannot play."""


def attempt(piece: Piece, on_step: Callable[[int], None] = lambda ended: None) -> Attempt:
    """Play a piece, or return why its policy cannot play, so that others go on."""
    policy, scenario, seeds = piece
    try:
        if policy.compute is not None:
            return dict(policy.compute(scenario, seeds, on_step))
        return play(policy.make, scenario, seeds, on_step, tell=policy.kind == "oracle")
    except Exception as error:
        return failure(policy, "cannot play", error)


def failure(policy: PolicySpec, what_failed: str, error: Exception) -> ResultError:
    """Return why a policy has failed.

    Raise the error if it is a fault of the project: that of a rule, unless it is a ValueError.
    """
    if isinstance(error, ValueError):
        place = place_in_module(error, policy.command)
        return ResultError(f"{policy.label} {what_failed}: {printable(str(error))}{place}")
    if policy.kind != "agent":
        raise error
    # An agent, or a policy of one's own code, may raise anything, and must not stop the others.
    frame = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{frame.filename}, line {frame.lineno}"
    return ResultError(f"{policy.label} {what_failed}: {reason_of(error)} ({place})")


def record_piece(piece: Piece) -> Trajectory | ResultError:
    """Record the episode of a piece's only seed, or return why the policy cannot play it."""
    (seed,) = piece.seeds
    try:
        return record(piece.policy, piece.scenario, seed)
    except Exception as error:
        return failure(piece.policy, f"cannot play seed {seed}", error)
