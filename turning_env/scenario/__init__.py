"""The configuration: scenarios with their sections, checks and presets, and families of scenarios.

A scenario holds values and no state; equations of the process belong in ``physics``.
"""

from turning_env.scenario.scenario import (
    SPLITS,
    PortableScenario,
    Scenario,
    ScenarioError,
    Source,
    presets,
)
from turning_env.scenario.scenario_batch import ScenarioBatch

__all__ = [
    "SPLITS",
    "PortableScenario",
    "Scenario",
    "ScenarioBatch",
    "ScenarioError",
    "Source",
    "presets",
]
