"""The seeds for training, tuning and scoring, which have no bars in common.

Seed and episode number determine an episode's bars and edge. Agents train on seeds below
``TUNING_START``, with any number of episodes per seed. Rules are tuned on ``tuning_seeds``. All
policies are scored on ``held_out_seeds``, one episode per seed.
"""

TUNING_START = 1_000_000_000
HELD_OUT_START = 2_000_000_000
MAX_SEEDS = 1_000_000


def tuning_seeds(count: int) -> list[int]:
    """Return the first ``count`` seeds, 1 to 1,000,000, on which controllers are tuned."""
    return _seeds(TUNING_START, count)


def held_out_seeds(count: int) -> list[int]:
    """Return the first ``count`` seeds, 1 to 1,000,000, on which policies are scored."""
    return _seeds(HELD_OUT_START, count)


def _seeds(start: int, count: int) -> list[int]:
    if not 1 <= count <= MAX_SEEDS:
        raise ValueError(f"{count} seeds asked for, but there must be 1 to {MAX_SEEDS}")
    return list(range(start, start + count))
