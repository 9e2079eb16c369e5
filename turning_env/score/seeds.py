"""Which seeds are for what, so that nothing is scored on the bars it was tuned or trained on.

An episode's bars and edge follow from (seed, episode). Agents train on seeds below ``TUNING_START``, through as many episodes
as they like; rules are tuned on ``tuning_seeds``; everything is scored on ``held_out_seeds``, one episode per seed.
"""

TUNING_START = 1_000_000_000
HELD_OUT_START = 2_000_000_000
_MAX = 1_000_000


def tuning_seeds(count: int) -> list[int]:
    """The first ``count`` seeds on which controllers are tuned.

    Raises:
        ValueError: ``count`` is not 1 to 1,000,000.
    """
    return _draws(TUNING_START, count)


def held_out_seeds(count: int) -> list[int]:
    """The first ``count`` seeds on which policies are scored.

    Raises:
        ValueError: ``count`` is not 1 to 1,000,000.
    """
    return _draws(HELD_OUT_START, count)


def _draws(start: int, count: int) -> list[int]:
    if not 1 <= count <= _MAX:
        raise ValueError(f"{count} draws asked for, but there must be 1 to {_MAX}")
    return list(range(start, start + count))
