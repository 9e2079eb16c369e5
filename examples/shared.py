"""What the examples share: how an agent is scored, and how a command line ends."""

import argparse
import math
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
import torch
from numpy.typing import NDArray

from turning_env import Scenario
from turning_env.scoring.play import play
from turning_env.scoring.policy import Actions, Observations, PolicyFactory
from turning_env.scoring.seeds import tuning_seeds

ENV_ID = "RoughTurning-v0"
NUM_SEEDS = 32
"""Tuning seeds that are played for a score: what is tried out is never scored on the held-out ones."""


class NetworkPolicy:
    """A network from observations to actions as a policy; it has no memory."""

    def __init__(self, network: Callable[[torch.Tensor], torch.Tensor]) -> None:
        self._network = network

    def reset(self, mask: NDArray[np.bool_]) -> None:
        """Do nothing: nothing is remembered."""

    @torch.no_grad()
    def act(self, observations: Observations) -> Actions:
        """Return actions in -1..1, shape (num_envs, actions), for observations, shape (num_envs, entries)."""
        actions: Actions = self._network(torch.from_numpy(observations)).clamp(-1.0, 1.0).numpy()
        return actions


def score(make: PolicyFactory, num_seeds: int = NUM_SEEDS) -> str:
    """Return the mean return per edge [s of machine time] on the first tuning seeds, with its standard error, for people."""
    returns = play(make, Scenario.load("rough_turning"), tuning_seeds(num_seeds))["return"]
    error = returns.std(ddof=1) / math.sqrt(num_seeds) if num_seeds > 1 else math.nan
    return f"{returns.mean():.0f} s per edge (standard error {error:.0f}, {num_seeds} tuning seeds)"


def at_least(least: int) -> Callable[[str], int]:
    """Return a type of command line argument: a whole number, not below ``least``."""

    def number(text: str) -> int:
        if not text.removeprefix("-").isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"is {text}, but must be a whole number of at least {least}")
        return int(text)

    return number


def run(main: Callable[[Sequence[str] | None], int]) -> int:
    """Run a script's ``main`` on one thread; return its exit status, 130 if it is interrupted."""
    torch.set_num_threads(1)
    try:
        return main(None)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Wrap imports of an optional extra: exit with 2, naming the extra, if it is not installed."""
    try:
        yield
    except ModuleNotFoundError as error:
        print(f"error: {error.name} is not installed: pip install -e '.[{name}]' in a clone", file=sys.stderr)
        raise SystemExit(2) from error
