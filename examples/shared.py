"""Shared parts of the examples: score an agent, and parse the command line."""

import argparse
import math
from collections.abc import Callable, Sequence
from typing import Any

import torch

from leaderboard.adapt import as_factory
from leaderboard.play import play, play_family
from leaderboard.seeds import tuning_seeds
from leaderboard.statistics import Estimate
from turning_env import ALL_IDS, FAMILY_ID, IDS, Family, Scenario
from turning_env.console import described, exits, whole_number
from turning_env.policy import Observations
from turning_env.scenario.arguments import environment_id

ENV_ID = "RoughTurning-v0"
NUM_SEEDS = 32
"""Number of tuning seeds for a score; experiments are never scored on held-out seeds."""


def of_tensors(function: Callable[[torch.Tensor], torch.Tensor]) -> Callable[[Observations], Any]:
    """Return a function of PyTorch's tensors as one of arrays, without gradients."""

    def of_arrays(observations: Observations) -> Any:
        with torch.no_grad():
            return function(torch.from_numpy(observations)).numpy()

    return of_arrays


def score(policy: Any, num_seeds: int = NUM_SEEDS, env_id: str = ENV_ID) -> str:
    """Return a line with the mean return per episode [s of machine time] and its standard error.

    The policy, any that ``leaderboard.score`` accepts, plays the first tuning seeds, or the first
    validation jobs of the family.
    """
    if env_id == FAMILY_ID:
        family = Family.load("shop")
        episodes = play_family(family, "validation", range(num_seeds), as_factory(policy))
    else:
        scenario = Scenario.load(IDS[env_id])
        episodes = play(as_factory(policy), scenario, tuning_seeds(num_seeds))
    mean = float(episodes["return"].mean())
    if num_seeds == 1:
        decimals = Estimate(mean, low=mean, high=mean).decimals()
        return f"{mean:.{decimals}f} s per episode (1 tuning seed)"
    error = float(episodes["return"].std(ddof=1)) / math.sqrt(num_seeds)
    decimals = Estimate(mean, low=mean - error, high=mean + error).decimals()
    spread = f"standard error {error:.{decimals}f}, {num_seeds} tuning seeds"
    return f"{mean:.{decimals}f} s per episode ({spread})"


def at_least(minimum: int) -> Callable[[str], int]:
    """Return an argparse type for a whole number of at least ``minimum``."""

    def number(text: str) -> int:
        value = whole_number(text)
        if value < minimum:
            raise argparse.ArgumentTypeError(f"is {text}, but must be at least {minimum}")
        return value

    return number


def parser(
    name: str,
    description: str | None,
    total_timesteps: int,
    num_envs: int | None = None,
    ids: bool = False,
) -> argparse.ArgumentParser:
    """Return a parser with the options that the examples share.

    Args:
        name: name of the example.
        description: docstring of the example, which its help shows.
        total_timesteps: default of ``--total-timesteps``.
        num_envs: default of ``--num-envs``; None: there is no such option.
        ids: whether there are options of a task, for any id.
    """
    parser = argparse.ArgumentParser(prog=f"python -m examples.{name}", **described(description))
    parser.add_argument(
        "--total-timesteps",
        "--steps",
        type=at_least(1),
        metavar="N",
        default=total_timesteps,
        help="total steps of all environments (default: %(default)s)",
    )
    if num_envs is not None:
        parser.add_argument(
            "--num-envs",
            type=at_least(1),
            default=num_envs,
            help="environments (default: %(default)s)",
        )
    if ids:
        parser.add_argument(
            "--env",
            type=environment_id,
            choices=ALL_IDS,
            default=ENV_ID,
            help="environment id (default: %(default)s)",
        )
        parser.add_argument(
            "--gamma",
            type=float,
            metavar="GAMMA",
            default=0.8,
            help="discount per step (default: %(default)s)",
        )
        parser.add_argument(
            "--reward-scale", type=float, default=1 / 3, help="factor on rewards [s] (default: 1/3)"
        )
    parser.add_argument("--seed", type=at_least(0), default=0, help="default: %(default)s")
    parser.add_argument(
        "--tuning-seeds",
        type=at_least(1),
        default=NUM_SEEDS,
        help="seeds of the score (default: %(default)s)",
    )
    return parser


def run(main: Callable[[Sequence[str] | None], int]) -> int:
    """Run a script's ``main`` on one thread; return its exit status, 130 if it is interrupted."""
    # Networks are small: more threads would wait for one another.
    torch.set_num_threads(1)
    return exits()(main)(None)
