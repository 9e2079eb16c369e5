"""RoughTurning: a Gymnasium environment for feed and speed control in CNC rough turning.

Importing this package registers the ids in ``IDS``; ``env.py`` and ``tasks.py`` specify them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

import gymnasium

if TYPE_CHECKING:
    from turning_env.env import RoughTurningEnv
    from turning_env.family_env import FamilyEnv, FamilyVectorEnv
    from turning_env.named_observation import NamedObservation, NamedVectorObservation
    from turning_env.observation import Reading, read
    from turning_env.physics import MODEL_VERSION
    from turning_env.physics.quantities import OBS
    from turning_env.scenario import SPLITS, Scenario, ScenarioError, presets
    from turning_env.scenario.family import Family
    from turning_env.scenario.power_law import PowerLaw
    from turning_env.vector_env import RoughTurningVectorEnv

_MODULES = {
    "env": ("RoughTurningEnv",),
    "family_env": ("FamilyEnv", "FamilyVectorEnv"),
    "named_observation": ("NamedObservation", "NamedVectorObservation"),
    "observation": ("Reading", "read"),
    "physics": ("MODEL_VERSION",),
    "physics.quantities": ("OBS",),
    "scenario": ("SPLITS", "Scenario", "ScenarioError", "presets"),
    "scenario.family": ("Family",),
    "scenario.power_law": ("PowerLaw",),
    "vector_env": ("RoughTurningVectorEnv",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: Numba and Pydantic take half a second."""
    if name == "__version__":
        from importlib.metadata import version

        return version("rough-turning")
    if name == "tasks":
        return import_module(f"{__name__}.tasks")
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    module = import_module(f"{__name__}.{_MODULE_OF[name]}")
    value = getattr(module, name)
    # Python looks here first, and does not call this function again.
    globals()[name] = value
    return value


__all__ = [
    "ALL_IDS",
    "FAMILY_ID",
    "IDS",
    "MODEL_VERSION",
    "OBS",
    "SPLITS",
    "Family",
    "FamilyEnv",
    "FamilyVectorEnv",
    "NamedObservation",
    "NamedVectorObservation",
    "PowerLaw",
    "Reading",
    "RoughTurningEnv",
    "RoughTurningVectorEnv",
    "Scenario",
    "ScenarioError",
    "__version__",
    "presets",
    "read",
]


class _Task(NamedTuple):
    """An id's class of the single environment, and the preset that it takes by default."""

    entry_point: str
    preset: str


_TASKS = {
    "RoughTurning-v0": _Task("turning_env.env:RoughTurningEnv", "rough_turning"),
    "RoughTurning-Paper-v0": _Task("turning_env.tasks:PaperEnv", "paper"),
    "RoughTurning-Override-v1": _Task("turning_env.tasks:OverrideEnv", "override"),
    "RoughTurning-Surface-v1": _Task("turning_env.tasks:SurfaceEnv", "surface"),
    "RoughTurning-Shift-v0": _Task("turning_env.tasks:ShiftEnv", "shift"),
    "RoughTurning-Batch-v0": _Task("turning_env.tasks:BatchEnv", "batch_casting"),
}

IDS = {env_id: task.preset for env_id, task in _TASKS.items()}
"""Registered ids and the preset that each takes when no scenario is given."""
FAMILY_ID = "RoughTurning-Family-v1"
"""The registered id of families."""
ALL_IDS = (*IDS, FAMILY_ID)
"""All registered ids: those of single scenarios, and that of families."""

# Entry points are texts, so that Gymnasium imports a module only when an environment is made.
for _env_id, _task in _TASKS.items():
    gymnasium.register(
        _env_id,
        entry_point=_task.entry_point,
        vector_entry_point="turning_env.vector_env:RoughTurningVectorEnv",
        kwargs={"scenario": _task.preset},
    )
gymnasium.register(
    FAMILY_ID,
    entry_point="turning_env.family_env:FamilyEnv",
    vector_entry_point="turning_env.family_env:FamilyVectorEnv",
    kwargs={"family": "shop"},
)
