"""The nominal models of many environments side by side, which follow the jobs of a family."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from baselines.rule import Mask
from turning_env import FamilyEnv, FamilyVectorEnv, Scenario
from turning_env.physics.quantities import layout
from turning_env.scenario.scenario import flat
from turning_env.scenario.scenario_batch import ScenarioBatch

_CHOICE = "spindle.short_time_load"
"""This value decides which entries an observation has, so it is the same in all environments."""

Values = dict[str, Any]
"""Values of a nominal model by dotted names."""


def values_of(nominal: Scenario) -> Values:
    """Return the values of a nominal model by dotted names."""
    return flat(nominal.model_dump(exclude={"name", "nominal_model"}))


class NominalModels:
    """Nominal models of many environments, one each.

    Args:
        scenarios: nominal model of each environment. All share their choices, such as action and
            sensors.

    Attributes:
        scenario: the nominal models side by side.
        entries: number of entries of an observation without a context.
    """

    def __init__(self, scenarios: Sequence[Scenario]) -> None:
        self.entries = len(layout(scenarios[0]))

        # ``set`` writes to the arrays of this batch.
        rows = [values_of(scenario) for scenario in scenarios]
        self._numbers: dict[str, Any] = {}
        for name, value in rows[0].items():
            if isinstance(value, float) and name != _CHOICE:
                self._numbers[name] = np.array([row[name] for row in rows])
        self.scenario = ScenarioBatch(rows[0] | self._numbers, len(scenarios))

    def set(self, env_index: int, values: Values) -> None:
        """Give an environment a nominal model with these values; it keeps the others."""
        for name, value in values.items():
            if name in self._numbers:
                self._numbers[name][env_index] = value


def scenario_of(env: Any, needed_by: str) -> Scenario:
    """Return the scenario of the environment below some wrappers.

    ``needed_by``: what needs the environment, for the error. Raise ValueError if it is another's.
    """
    scenario = getattr(env.unwrapped, "scenario", None)
    if not isinstance(scenario, Scenario):
        raise ValueError(
            f"{needed_by} needs a RoughTurning environment, but this is {env.unwrapped}"
        )
    return scenario


def new_jobs(env: Any, infos: dict[str, Any], present: Any) -> list[int]:
    """Return the environments that play another job of a family than before.

    Args:
        env: environment, or vector environment, without wrappers.
        infos: those of its last reset or step.
        present: number of each environment's job before, shape (num_envs,); it is brought up to
            date.
    """
    if not isinstance(env, FamilyEnv | FamilyVectorEnv):
        return []
    jobs = np.atleast_1d(infos["job"])
    # A reset of some environments says nothing of the others.
    is_known: Mask = np.broadcast_to(infos.get("_job", True), jobs.shape)
    changed = is_known & (jobs != present)
    present[changed] = jobs[changed]
    return np.flatnonzero(changed).tolist()
