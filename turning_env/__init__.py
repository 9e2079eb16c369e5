"""RoughTurning: a Gymnasium environment for feed and speed control in CNC rough turning.

Importing this package registers the ids in ``IDS``; ``env.py`` and ``tasks.py`` specify them.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import gymnasium

if TYPE_CHECKING:
    from turning_env.env import RoughTurningEnv
    from turning_env.family_env import FamilyEnv, FamilyVectorEnv
    from turning_env.observation import Reading, read
    from turning_env.physics import MODEL_VERSION
    from turning_env.physics.quantities import OBS
    from turning_env.scenario import SPLITS, Scenario, ScenarioError, presets
    from turning_env.scenario.family import Family
    from turning_env.scenario.power_law import PowerLaw
    from turning_env.scoring.score import Score, score
    from turning_env.vector_env import RoughTurningVectorEnv

_MODULES = {
    "env": ("RoughTurningEnv",),
    "family_env": ("FamilyEnv", "FamilyVectorEnv"),
    "observation": ("Reading", "read"),
    "physics": ("MODEL_VERSION",),
    "physics.quantities": ("OBS",),
    "scenario": ("SPLITS", "Scenario", "ScenarioError", "presets"),
    "scenario.family": ("Family",),
    "scenario.power_law": ("PowerLaw",),
    "scoring.score": ("Score", "score"),
    "vector_env": ("RoughTurningVectorEnv",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: Numba and Pydantic take half a second."""
    if name == "__version__":
        from importlib.metadata import version

        return version("rough-turning")
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(import_module(f"{__name__}.{_MODULE_OF[name]}"), name)
    return value


__all__ = [
    "FAMILY_ID",
    "IDS",
    "MODEL_VERSION",
    "OBS",
    "SPLITS",
    "Family",
    "FamilyEnv",
    "FamilyVectorEnv",
    "PowerLaw",
    "Reading",
    "RoughTurningEnv",
    "RoughTurningVectorEnv",
    "Scenario",
    "ScenarioError",
    "Score",
    "__version__",
    "presets",
    "read",
    "score",
]

_ENTRY_POINTS = {
    "RoughTurning-v0": ("env:RoughTurningEnv", "rough_turning"),
    "RoughTurning-Paper-v0": ("tasks:PaperEnv", "paper"),
    "RoughTurning-Override-v1": ("tasks:OverrideEnv", "override"),
    "RoughTurning-Surface-v1": ("tasks:SurfaceEnv", "surface"),
    "RoughTurning-Shift-v0": ("tasks:ShiftEnv", "shift"),
    "RoughTurning-Batch-v0": ("tasks:BatchEnv", "batch_casting"),
}

IDS = {env_id: preset for env_id, (_, preset) in _ENTRY_POINTS.items()}
"""Registered ids and the preset that each takes when no scenario is given."""
FAMILY_ID = "RoughTurning-Family-v0"
"""The registered id of families."""

_BATCH = "turning_env.vector_env:RoughTurningVectorEnv"
_FAMILY = "turning_env.family_env:Family"

for _id, (_single, _preset) in _ENTRY_POINTS.items():
    gymnasium.register(
        _id, f"turning_env.{_single}", vector_entry_point=_BATCH, kwargs={"scenario": _preset}
    )
gymnasium.register(
    FAMILY_ID, f"{_FAMILY}Env", vector_entry_point=f"{_FAMILY}VectorEnv", kwargs={"family": "shop"}
)
