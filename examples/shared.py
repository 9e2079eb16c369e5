"""What the examples share: how an agent is scored, and how a command line ends."""

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import torch

from turning_env import Scenario
from turning_env.score.play import play
from turning_env.score.policy import PolicyFactory
from turning_env.score.seeds import tuning_seeds

ENV_ID = "RoughTurning-v0"
NUM_SEEDS = 32
"""Tuning seeds that are played for a score: what is tried out is never scored on the held-out ones."""


def score(make: PolicyFactory, num_seeds: int = NUM_SEEDS) -> str:
    """Mean return per edge [s of machine time] on the first tuning seeds, with its standard error, for people."""
    returns = play(make, Scenario.load("rough_turning"), tuning_seeds(num_seeds))["return"]
    error = returns.std(ddof=1) / math.sqrt(num_seeds) if num_seeds > 1 else math.nan
    return f"{returns.mean():.0f} s per edge (standard error {error:.0f}, {num_seeds} tuning seeds)"


def at_least(least: int) -> Callable[[str], int]:
    """A type of command line argument: a whole number, not below ``least``."""

    def number(text: str) -> int:
        if not text.removeprefix("-").isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"is {text}, but must be a whole number of at least {least}")
        return int(text)

    return number


def run(main: Callable[[Sequence[str] | None], int]) -> int:
    """The exit status of a script's ``main``, on one thread: 130 where it is interrupted."""
    torch.set_num_threads(1)
    try:
        return main(None)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Around imports that an optional extra brings: says which, and exits with 2, where it is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        print(f"error: {error.name} is not installed: pip install -e '.[{name}]' in a clone", file=sys.stderr)
        raise SystemExit(2) from error
