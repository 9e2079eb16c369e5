"""The five papers: ``reproduce`` checks their claims, ``figures`` draws their figures anew.

Their controllers belong in ``baselines``, and their equations in ``turning_env/physics``.
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
    """Return a preset with some values of its sections replaced, and validate it.

    Raises:
        ValueError: A value is not valid.
    """
    values = Scenario.load(preset).model_dump()
    for section, new_values in sections.items():
        values[section].update(new_values)
    return Scenario.model_validate(values)


def record(
    policy: Policy, scenario: Scenario, seeds: Sequence[int], seconds: float | None = None
) -> dict[str, NDArray[Any]]:
    """Play an episode of each seed, for some seconds or until all end in the same step.

    Returns:
        ``info`` and ``observation`` after each step, arrays of shape (steps, seeds) and
        (steps, seeds, entries).
    """
    env = RoughTurningVectorEnv(len(seeds), scenario)
    observations, _ = env.reset(seed=list(seeds))
    policy.reset(np.ones(len(seeds), np.bool_))

    num_steps = None
    if seconds is not None:
        num_steps = round(seconds / scenario.control.interval)
    steps: list[dict[str, Any]] = []
    finished = False
    while not finished:
        observations, _, terminated, truncated, infos = env.step(policy.act(observations))
        # The environment overwrites its observations in the next step.
        steps.append(infos | {"observation": observations.copy()})
        if num_steps is None:
            finished = bool((terminated | truncated).all())
        else:
            finished = len(steps) >= num_steps

    names = [quantity.name for quantity in INFO]
    names.append("observation")
    return {name: np.array([step[name] for step in steps]) for name in names}
