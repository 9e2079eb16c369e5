"""The five papers: their claims checked (``papers.reproduce``) and their figures drawn anew (``papers.figures``).

The papers' controllers belong in ``baselines``; their equations belong in ``turning_env/physics``.
"""

from typing import Any

from turning_env import Scenario
from turning_env.extras import tell_plainly

tell_plainly()


def changed(preset: str, **sections: dict[str, Any]) -> Scenario:
    """Return a preset with some values of its sections replaced, validated anew."""
    values = Scenario.load(preset).model_dump()
    for section, replaced in sections.items():
        values[section] |= replaced
    return Scenario.model_validate(values)
