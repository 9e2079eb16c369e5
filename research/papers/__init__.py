"""The five papers: their claims checked (``research.papers.reproduce``) and their figures drawn anew (``research.papers.figures``).

The papers' controllers belong in ``baselines``; their equations belong in ``turning_env/physics``.
"""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from turning_env import RoughTurningVectorEnv, Scenario
from turning_env.extras import tell_plainly
from turning_env.physics.quantities import INFO
from turning_env.scenario import Source
from turning_env.scoring.policy import Policy

tell_plainly()

DATA = Path(__file__).parent / "data"  # folder of the papers' printed values and items


def rows(name: str) -> list[dict[str, str]]:
    """Return the rows of a file in ``DATA`` as printed."""
    with (DATA / name).open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def changed(preset: Source, **sections: dict[str, Any]) -> Scenario:
    """Return a preset with some values of its sections replaced, validated anew."""
    values = Scenario.load(preset).model_dump()
    for section, replaced in sections.items():
        values[section] |= replaced
    return Scenario.model_validate(values)


def record(
    policy: Policy, scenario: Scenario, seeds: Sequence[int], seconds: float | None = None
) -> dict[str, NDArray[Any]]:
    """Play an episode of each seed, for some seconds or until all have ended.

    Returns:
        ``info`` and ``observation`` after each step, arrays of shape (steps, seeds) and (steps, seeds, entries).
    """
    env = RoughTurningVectorEnv(len(seeds), scenario)
    observations, _ = env.reset(seed=list(seeds))
    policy.reset(np.ones(len(seeds), np.bool_))
    steps = None if seconds is None else round(seconds / scenario.control.interval)
    kept: list[dict[str, Any]] = []
    ended = False
    while not ended if steps is None else len(kept) < steps:
        observations, _, terminated, truncated, infos = env.step(policy.act(observations))
        kept.append(infos | {"observation": observations.copy()})
        ended = bool((terminated | truncated).all())
    return {
        name: np.array([each[name] for each in kept])
        for name in (*(quantity.name for quantity in INFO), "observation")
    }
