"""The seeds for training, tuning and scoring: no policy is scored on bars on which it was tuned or trained.

Seed and episode number determine an episode's bars and edge. Agents train on seeds below ``TUNING_START``, with any number of
episodes per seed. Rules are tuned on ``tuning_seeds``. All policies are scored on ``held_out_seeds``, one episode per seed. An
organiser can score them on ``private_seeds`` instead.
"""

from hashlib import sha256

TUNING_START = 1_000_000_000
HELD_OUT_START = 2_000_000_000
_MAX = 1_000_000
MIN_KEY = 16
"""Least number of characters of a private key: who sees results must not find it by trying."""


def tuning_seeds(count: int) -> list[int]:
    """Return the first ``count`` seeds, 1 to 1,000,000, on which controllers are tuned."""
    return _seeds(TUNING_START, count)


def held_out_seeds(count: int) -> list[int]:
    """Return the first ``count`` seeds, 1 to 1,000,000, on which policies are scored."""
    return _seeds(HELD_OUT_START, count)


def private_seeds(key: str, count: int) -> list[int]:
    """Return the first ``count`` seeds, 1 to 1,000,000, that a key of at least 16 characters determines; its owner knows them."""
    if len(key) < MIN_KEY:
        raise ValueError(f"the private key has {len(key)} characters, but must have at least {MIN_KEY}")
    start = int.from_bytes(sha256(f"seeds {key}".encode()).digest()[:8]) >> 1
    return _seeds(HELD_OUT_START + _MAX + start, count)


def _seeds(start: int, count: int) -> list[int]:
    if not 1 <= count <= _MAX:
        raise ValueError(f"{count} seeds asked for, but there must be 1 to {_MAX}")
    return list(range(start, start + count))
