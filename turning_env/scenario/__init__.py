"""The configuration: the scenario, its sections, the power law, validation and the presets.

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

__all__ = ["SPLITS", "PortableScenario", "Scenario", "ScenarioError", "Source", "presets"]
