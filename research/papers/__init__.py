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
from turning_env.policy import Policy
from turning_env.scenario import Source

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


RECORDED = (*(quantity.name for quantity in INFO), "observation")
"""Names of the quantities that ``record`` can return."""


def record(
    policy: Policy,
    scenario: Scenario,
    seeds: Sequence[int],
    seconds: float | None = None,
    names: Sequence[str] = RECORDED,
) -> dict[str, NDArray[Any]]:
    """Play an episode of each seed, for some seconds or until all end in the same step.

    Args:
        policy: plays.
        scenario: task.
        seeds: of the episodes.
        seconds: duration [s]; None: whole episodes.
        names: quantities to return, some of ``RECORDED``. Fewer take less time.

    Returns:
        Quantities of ``info`` after each step, arrays of shape (steps, seeds), and
        ``observation``, of shape (steps, seeds, entries).
    """
    env = RoughTurningVectorEnv(len(seeds), scenario)
    observations, _ = env.reset(seed=list(seeds))
    policy.reset(np.ones(len(seeds), np.bool_))

    num_steps = None
    if seconds is not None:
        num_steps = round(seconds / scenario.control.interval)
    columns: dict[str, list[NDArray[Any]]] = {name: [] for name in names}
    played_steps = 0
    finished = False
    while not finished:
        observations, _, terminated, truncated, infos = env.step(policy.act(observations))
        # The environment overwrites its observations in the next step.
        values = infos | {"observation": observations.copy()}
        for name, column in columns.items():
            column.append(values[name])
        played_steps += 1
        if num_steps is None:
            finished = bool((terminated | truncated).all())
        else:
            finished = played_steps >= num_steps

    return {name: np.array(column) for name, column in columns.items()}
