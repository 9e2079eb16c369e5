"""RoughTurning: a Gymnasium environment for feed and speed control in CNC rough turning.

Importing this package registers ``RoughTurning-v0`` and ``RoughTurning-Paper-v0``.
"""

import gymnasium

from turning_env.env import RoughTurningEnv
from turning_env.observation import Reading, read
from turning_env.power_law import PowerLaw
from turning_env.scenario import Scenario, ScenarioError, presets
from turning_env.vector_env import RoughTurningVectorEnv

__all__ = [
    "IDS",
    "PowerLaw",
    "Reading",
    "RoughTurningEnv",
    "RoughTurningVectorEnv",
    "Scenario",
    "ScenarioError",
    "presets",
    "read",
]

IDS = {"RoughTurning-v0": "rough_turning", "RoughTurning-Paper-v0": "paper"}
"""Registered ids and the preset that each takes when no scenario is given."""

for _id, _preset in IDS.items():
    gymnasium.register(
        _id,
        entry_point="turning_env.env:RoughTurningEnv",
        vector_entry_point="turning_env.vector_env:RoughTurningVectorEnv",
        kwargs={"scenario": _preset},
    )
