"""The leaderboard: plays policies on held-out seeds, verifies and ranks their results.

``score`` scores one policy. Policies as code belong in ``baselines``, training in ``train``.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from turning_env.extras import tell_plainly

if TYPE_CHECKING:
    from leaderboard.scoring import Score, score

__all__ = ["Score", "score"]

tell_plainly()


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: Numba and Pydantic take half a second."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.scoring"), name)
    globals()[name] = value
    return value
